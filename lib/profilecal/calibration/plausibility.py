"""Is a solution to be believed? What its residuals say that its covariance does not.

A covariance speaks of noise. What is wrong in every pose alike (a scale, a drift, a
radius) leaves a pattern in the residuals and moves the answer by more: each is one more
unknown, tested by Rao's score. Contradictions, many rejected poses and a misfit larger
than noise speak against a solution too.
"""

import re
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from profilecal.geometry.noise import FALSE_ALARM, normalised_square
from profilecal.geometry.observability import WEAK, of_covariance
from profilecal.joint.linear_model import score
from profilecal.joint.prior import Perturbation, of_scanner, of_target
from profilecal.joint.solution import Solution
from profilecal.joint.solve import LARGEST_ERROR_MM, LARGEST_REJECTED


@dataclass(frozen=True)
class Finding:
    """Something that may be wrong in the same way in every pose."""

    words: str  # as `Perturbation` has them
    size: float
    clear: float  # the size over its standard deviation
    moves: np.ndarray  # (6,) the sensor pose, mm and rad
    among: int  # so many tests

    @property
    def sentence(self) -> str:
        """The error in words, with its size."""
        words = re.sub(
            r"\[(.*?)\|(.*?)\]", r"\1" if self.size > 0 else r"\2", self.words
        )
        return words.format(self.size if words == self.words else abs(self.size))


def systematic_tests(solution: Solution) -> list[Finding]:
    """What might be wrong everywhere, each by itself, with the size that fits the
    residuals best.
    """
    # of an error's own pattern: less is left of it beside the unknowns than rounding
    absorbed = 1e-9
    targets = [entry.target for entry in solution.problem.observations]
    tried = [*of_scanner(), *of_target(targets), *of_robot()]
    model, found = solution.model(tried)
    n, (normal,) = model.n - len(tried), found.normal
    with np.errstate(invalid="ignore", divide="ignore"):
        sizes, sds, moves = score(normal, n, model.precision[:n, :n])
        seen = sds**-2 > absorbed * np.diag(normal)[n:-1]
    # the size is what the data would have to change by, the error is the opposite
    return [
        Finding(error.words, -size * error.unit, size / sd, move * size, len(tried))
        for error, size, sd, move, good in zip(
            tried, sizes, sds, moves.T[:, :6], seen, strict=True
        )
        if good
    ]


def of_robot() -> list[Perturbation]:
    """Scales of the positions, drifts."""

    def off_middle(T):
        return T - T.mean(axis=0)

    positions, far = (
        "the robot's positions",
        "too [far apart|close together] by {:.2g} %",
    )
    found = [Perturbation(f"{positions} were {far}", 100, positions=off_middle)]
    for axis, a in zip("xyz", np.eye(3), strict=True):
        along = f"along the base's {axis}"
        drift = f"the robot or the target drifted {along} by {{:.2g}} mm"
        found += [
            Perturbation(
                f"{positions} {along} were {far}",
                100,
                positions=lambda T, a=a: a * off_middle(T),
            ),
            Perturbation(
                drift,
                1,
                positions=lambda T, a=a: np.outer(np.linspace(0, 1, len(T)), a),
            ),
        ]
    return found


# standard deviations that an error moves a pose by, or times what the stated noise
# explains: no more "ok"
MUCH = 3.0
ADVICE = (
    "check the mount, units and convention of the poses, which pose each profile belongs to, x and z of the profiles, "
    "the radius"
)


def check(solution: Solution) -> tuple[Solution, bool]:
    """The solution with the status, covariance and messages that its residuals leave,
    and whether they speak against it: more poses would not mend that.
    """
    objections = contradictions(solution)
    if solution.status == "unobservable":
        return replace(solution, messages=(*solution.messages, *objections)), bool(
            objections
        )
    C, weak = solution.covariance, bool(objections)
    guilty = clear_findings(systematic_tests(solution))
    if guilty:
        weak |= max(normalised_square(C, s.moves) for s in guilty) > MUCH**2
        C = C + sum(np.outer(s.moves, s.moves) for s in guilty)
        objections.append(accusation(guilty))
    found = of_covariance(
        C, solution.observability.rank, solution.observability.parameters
    )
    status = "weak" if weak or found.sd[0] > WEAK else solution.status
    messages = tuple(objections or solution.messages)
    return replace(
        solution, covariance=C, observability=found, messages=messages, status=status
    ), bool(objections)


def contradictions(solution: Solution) -> list[str]:
    """What in the residuals no noise explains, in words."""
    noise, misfit, messages = solution.noise, np.sqrt(solution.chi2_per_dof), []
    if solution.noise_source == "given" and misfit > MUCH:
        messages.append(
            f"the residuals are {misfit:.2g} times what the stated noise explains; {ADVICE}"
        )
    scales = solution.prior.scales
    stated = 3 * max(noise.steering_mm, scales.position_mm, scales.group_position_mm)
    error = max(solution.rms_mm, noise.position_mm)
    if error > max(LARGEST_ERROR_MM, stated):
        messages.append(
            f"the data contradict each other by {error:.2g} mm, more than a robot errs; {ADVICE}"
        )
    rejected = np.concatenate(solution.rejected)
    if rejected.mean() > LARGEST_REJECTED:
        messages.append(
            f"{rejected.sum()} of {len(rejected)} poses contradict the others; {ADVICE}"
        )
    return messages


def clear_findings(found: list[Finding]) -> list[Finding]:
    """Those that chance does not explain, clearest first."""
    shadow = 0.8  # of the clearest error's clarity: less is taken for its shadow
    clear = [s for s in found if abs(s.clear) > -ndtri(FALSE_ALARM / 2 / s.among)]
    clear.sort(key=lambda s: -abs(s.clear))
    return [s for s in clear if abs(s.clear) > shadow * abs(clear[0].clear)]


def accusation(guilty: list[Finding]) -> str:
    """What the residuals look like, and what it would do."""
    most = max(guilty, key=lambda s: np.linalg.norm(s.moves[:3]))
    return (
        f"the residuals look as if {', or as if '.join(s.sentence for s in guilty[:4])} "
        f"({abs(guilty[0].clear):.0f} standard deviations), "
        f"which would move the sensor by up to {np.linalg.norm(most.moves[:3]):.2g} mm and "
        f"{np.degrees(np.linalg.norm(most.moves[3:])):.2g}°; the covariance is enlarged to match"
    )
