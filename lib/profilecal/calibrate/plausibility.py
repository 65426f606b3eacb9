"""Is a solution to be believed? What its residuals say that its covariance does not.

A covariance speaks of noise, which differs from pose to pose. What is wrong in the same way everywhere
(`systematic_tests`) moves the answer by more. Contradictions, many rejected poses and a misfit larger than noise speak
against it too.
"""

from dataclasses import replace

import numpy as np

from profilecal.calibrate.systematic_tests import Finding, systematic_tests
from profilecal.joint.observability import WEAK, of_covariance
from profilecal.joint.solution import Solution
from profilecal.joint.solve import LARGEST_ERROR_MM, LARGEST_REJECTED

LARGEST_MISFIT = 3.0  # residuals over what the stated noise explains
MOVES_MUCH = 3.0  # standard deviations of the pose that an error must move it by to make it weak
SHADOW = 0.8  # of the clearest error's clarity: less is taken for its shadow
ADVICE = (
    "check the mount, units and convention of the poses, which pose each profile belongs to, x and z of the profiles, "
    "the radius"
)


def check(solution: Solution) -> tuple[Solution, bool]:
    """The solution with the status, covariance and messages that its residuals leave, and whether they speak against
    it: more poses would not mend that."""
    objections = contradictions(solution)
    if solution.status == "unobservable":
        return replace(solution, messages=(*solution.messages, *objections)), bool(objections)
    C, weak = solution.covariance, bool(objections)
    guilty = clear_findings(systematic_tests(solution))
    if guilty:
        weak |= max(distance(s.moves, C) for s in guilty) > MOVES_MUCH
        C = C + sum(np.outer(s.moves, s.moves) for s in guilty)
        objections.append(accusation(guilty))
    found = of_covariance(C, solution.observability.rank, solution.observability.parameters)
    status = "weak" if weak or found.sd[0] > WEAK else solution.status
    messages = tuple(objections or solution.messages)
    return replace(solution, covariance=C, observability=found, messages=messages, status=status), bool(objections)


def contradictions(solution: Solution) -> list[str]:
    """What in the residuals no noise explains, in words."""
    noise, messages = solution.noise, []
    misfit = np.sqrt(solution.chi2_per_dof)
    if solution.noise_source == "given" and misfit > LARGEST_MISFIT:
        messages.append(f"the residuals are {misfit:.2g} times what the stated noise explains; {ADVICE}")

    scales = solution.level.prior.scales
    stated = 3 * max(noise.steering_mm, scales.position_mm, scales.group_position_mm)
    error = max(solution.rms_mm, noise.position_mm)
    if error > max(LARGEST_ERROR_MM, stated):
        messages.append(f"the data contradict each other by {error:.2g} mm, more than a robot errs; {ADVICE}")

    rejected = np.concatenate(solution.rejected)
    if rejected.mean() > LARGEST_REJECTED:
        messages.append(f"{rejected.sum()} of {len(rejected)} poses contradict the others; {ADVICE}")
    return messages


def clear_findings(found: list[Finding]) -> list[Finding]:
    """Those that chance does not explain, clearest first."""
    clear = sorted((s for s in found if s.is_clear), key=lambda s: -abs(s.clear))
    return [s for s in clear if abs(s.clear) > SHADOW * abs(clear[0].clear)]


def distance(delta, covariance) -> float:
    """How many standard deviations a change (6,) of the sensor pose is."""
    return float(np.sqrt(delta @ np.linalg.solve(covariance, delta)))


def accusation(guilty: list[Finding]) -> str:
    """What the residuals look like, and what it would do."""
    most = max(guilty, key=lambda s: np.linalg.norm(s.moves[:3]))
    return (
        f"the residuals look as if {', or as if '.join(s.sentence for s in guilty[:4])} "
        f"({abs(guilty[0].clear):.0f} standard deviations), "
        f"which would move the sensor by up to {np.linalg.norm(most.moves[:3]):.2g} mm and "
        f"{np.degrees(np.linalg.norm(most.moves[3:])):.2g}°; the covariance is enlarged to match"
    )
