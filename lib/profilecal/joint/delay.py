"""The delay between the clocks of the robot and the scanner, where profiles were taken
in motion: the robot's clock less the scanner's.

A profile of time t is seen from the pose that the log has at t + τ. The linear model
has τ among its unknowns (`prior.DELAY`), but a search and a rejection of bad profiles
do not know it: at 150 mm/s, 150 ms are 22 mm. So it is first looked for by itself.

τ stays open where the flange's twist is, in all profiles, that of one screw in the base
or one in the flange: ξ_base + Ad(T) ξ_flange. The first shifts the target, which does
no harm; the second shifts the sensor. Whether the sensor is known tells which.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from profilecal.geometry.log import DELAY_S
from profilecal.geometry.noise import normalised_square
from profilecal.geometry.observability import (
    HAND_PRECISION,
    WEAK,
    Spectrum,
    name_direction,
    of_covariance,
    size_direction,
)
from profilecal.joint.descent import ROUGHLY, refine, search, thin
from profilecal.joint.problem import Problem
from profilecal.joint.solution import Solution
from profilecal.targets.observations import State

TRIED = np.linspace(-DELAY_S, DELAY_S, 9)  # s
FEW = 100  # profiles of each target that are looked at


def roughly(problem: Problem, starts: Sequence = ()) -> float:
    """By how much later (s) in the robot's log the poses of what was seen in motion
    fit best: at the best of several delays, and from there downhill. `starts`: as
    `solve` takes them.

    What counts is Cauchy's loss over the residuals that most profiles have there, and
    the square of the delay over what it may be.
    """
    few = problem.of(thin(seen, FEW) for seen in problem.observations)
    fits, units = [], []
    for delay in TRIED:
        later = few.later(delay)
        state = search(later, starts)
        fit = refine(later, state, iterations=20, tolerance=ROUGHLY).best_first
        fits.append(fit.state[[0]])
        units.append(later.typical(fit)[0])
    scale = min(units)

    def loss(delay: float, state: State) -> float:
        later = few.later(delay)
        unit = np.full(1, scale)
        fit = refine(later, state, scale=unit, iterations=20, tolerance=ROUGHLY)
        return fit.loss[0] / scale**2 + (delay / DELAY_S) ** 2

    best = int(np.argmin(list(map(loss, TRIED, fits))))
    step = TRIED[1] - TRIED[0]
    around = TRIED[best] - step, TRIED[best] + step
    found = minimize_scalar(
        loss, args=(fits[best],), bounds=around, options={"xatol": 1e-4}
    )
    return found.x


def verdict(solution: Solution) -> tuple[str, Spectrum, list[str]]:
    """What becomes of a sensor pose by a delay that is known no better, if anything was
    seen in motion: its status; how well it would be known if the delay were; and what a
    person should know, and do.

    With the covariance c of pose and delay, which has the variance s², a known delay
    leaves the pose's covariance C - c cᵀ / s². By c / s a standard deviation of the
    delay moves the pose; it does harm where that is more than is known of the pose
    otherwise. An open delay then makes "ok" "weak", and "weak" "unobservable", however
    slow the motion.
    """
    status, known = solution.status, solution.observability
    clock = solution.problem.clock
    if clock is None:
        return status, known, []
    sd_s = solution.delay_sd_s
    moves = solution.error_sizes.covariance[:6, clock] / sd_s
    C = known.covariance - np.outer(moves, moves)
    others = of_covariance(C, known.rank, known.parameters)
    is_open = sd_s > DELAY_S / 2
    harms = normalised_square(others.covariance, moves) > 1
    to_blame = others.sd[0] < WEAK <= known.sd[0] or others.sd[0] < 1 <= known.sd[0]
    most_ms = 1e3 * min(sd_s, DELAY_S)
    delay = f"the delay between the clocks of robot and scanner (± {most_ms:.3g} ms)"
    if is_open and harms:
        status = "weak" if status == "ok" else "unobservable"
    elif is_open:
        harmless = f"these motions leave {delay} open, which does not move the sensor"
        return status, others, [harmless]
    elif not to_blame:
        return status, known, []
    in_units = moves / HAND_PRECISION
    length = float(np.linalg.norm(in_units))
    direction = in_units / length
    what = name_direction(direction, solution.rotation, solution.problem.frame)
    size = size_direction(length, direction)
    sentence = (
        f"{what} is known only to {size}, because the motions leave {delay} open: "
        "drive the same sweeps backwards, or stop at eight places"
    )
    return status, others, [sentence]
