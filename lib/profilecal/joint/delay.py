"""The delay between the clocks of the robot and the scanner, where profiles were taken
in motion: the robot's clock less the scanner's.

A profile of time t is seen from the pose that the log has at t + τ. The linear model
has τ among the errors considered (`prior.DELAY`), but a search and a rejection of bad
profiles do not know τ: at 150 mm/s, 150 ms are 22 mm. So `roughly` first looks for τ by
itself.

τ stays open where the flange's twist is, in all profiles, that of one screw in the base
or one in the flange: ξ_base + Ad(T) ξ_flange. A screw in the base shifts the target,
which does no harm; one in the flange shifts the sensor. Whether the sensor is known
tells which of the two it is.
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
from profilecal.joint.descent import refine, search, thin
from profilecal.joint.problem import Problem
from profilecal.joint.solution import Solution
from profilecal.targets.state import State

TRIED = np.linspace(-DELAY_S, DELAY_S, 9)  # s
FEW = 100  # profiles of each target that are looked at


def roughly(problem: Problem, starts: Sequence = ()) -> float:
    """By how much later (s) in the robot's log the poses of what was seen in motion
    fit best: at the best of several delays, and from there downhill. `starts`: as
    `solve` takes them.

    The loss of a delay is Cauchy's loss of the residuals, over the square of those that
    most profiles have at the best delay, plus the square of the delay over DELAY_S.
    """
    few = problem.of(thin(seen, FEW) for seen in problem.observations)
    fits, units = [], []
    for delay in TRIED:
        later = few.later(delay)
        state = search(later, starts)
        fit = refine(later, state, iterations=20).best_first
        fits.append(fit.state[[0]])
        units.append(later.typical(fit.per_pose)[0])
    scale = min(units)

    def loss(delay: float, state: State) -> float:
        later = few.later(delay)
        unit = np.full(1, scale)
        fit = refine(later, state, scale=unit, iterations=20)
        return fit.loss[0] / scale**2 + (delay / DELAY_S) ** 2

    best = np.argmin(list(map(loss, TRIED, fits)))
    step = TRIED[1] - TRIED[0]
    around = TRIED[best] + [-step, step]
    found = minimize_scalar(
        loss, args=(fits[best],), bounds=around, options={"xatol": 1e-4}
    )
    return found.x


def verdict(solution: Solution) -> tuple[str, Spectrum, list[str]]:
    """The status of a sensor pose, the spectrum to explain it by, and sentences for a
    person, where the delay of what was seen in motion may be known too roughly.

    With the covariance c of pose and delay, and the variance s² of the delay, a known
    delay would leave the pose's covariance C - c cᵀ / s². A standard deviation of the
    delay `moves` the pose by c / s. The delay `harms` where that is more than would be
    known of the pose otherwise. It is `to_blame` where it alone takes the worst
    direction of the pose over a limit of the status.

        delay                     status              spectrum           sentence
        open, harms               one step worse      with known delay   what to drive
        open, harmless            as it was           with known delay   it is harmless
        not open, but to blame    as it was           with known delay   what to drive
        not open, not to blame    as it was           as it was          none

    One step worse is "weak" for "ok", and "unobservable" for "weak", however slow the
    motion. Where the delay is not open, the status says already what it leaves unknown.
    Where nothing moved, all is as it was.
    """
    status, as_it_was = solution.status, solution.observability
    clock = solution.problem.clock
    if clock is None:
        return status, as_it_was, []
    sd_s = solution.delay_sd_s
    moves = solution.error_sizes.covariance[:6, clock] / sd_s
    C = as_it_was.covariance - np.outer(moves, moves)
    with_known = of_covariance(C, as_it_was.is_open)
    is_open = sd_s > DELAY_S / 2
    harms = normalised_square(with_known.covariance, moves) > 1
    # standard deviations along the worst direction, over those by hand
    worst, worst_if_known = as_it_was.sd[0], with_known.sd[0]
    to_blame = worst_if_known < WEAK <= worst or worst_if_known < 1 <= worst
    most_ms = 1e3 * min(sd_s, DELAY_S)
    delay = f"the delay between the clocks of robot and scanner (± {most_ms:.3g} ms)"
    if is_open and harms:
        status = "weak" if status == "ok" else "unobservable"
    elif is_open:
        harmless = f"these motions leave {delay} open, which does not move the sensor"
        return status, with_known, [harmless]
    elif not to_blame:
        return status, as_it_was, []
    in_units = moves / HAND_PRECISION
    length = float(np.linalg.norm(in_units))
    direction = in_units / length
    what = name_direction(direction, solution.rotation, solution.problem.frame)
    size = size_direction(length, direction)
    sentence = (
        f"{what} is known only to {size}, because the motions leave {delay} open: "
        "drive the same sweeps backwards, or stop at eight places"
    )
    return status, with_known, [sentence]
