"""Has the sensor moved? Two scans of a target that stayed where it was, from the same commanded poses.

What is the same in both cancels: where the target is, how well the sensor pose is known, and where the robot errs at a
commanded pose. What is left is the scanner's noise and how well the robot comes back. Five poses do.
"""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.calibrate.observe import observe_all, stated_noise
from profilecal.calibrate.verify import Difference
from profilecal.geometry.noise import FALSE_ALARM, ROBOT
from profilecal.joint.descent import settle_targets
from profilecal.joint.noise import prior_from
from profilecal.joint.observability import HAND_PRECISION, of_covariance, units_by_hand
from profilecal.joint.problem import Problem
from profilecal.joint.solve import LARGEST_ERROR_MM
from profilecal.joint.state import State
from profilecal.scan.scan import Scan, ScanError


@dataclass(frozen=True)
class Drift(Difference):
    """By how much the sensor has moved on the flange between two scans, and what is to be expected if it has not."""

    shared: int  # so many commanded poses are in both scans


def drift(before: Scan, after: Scan, T, covariance, noise_mm: float) -> Drift:
    """By how much a sensor whose pose was T (4, 4), mm, has moved between two scans of one target in one place.

    `covariance` (6, 6): of the sensor pose, mm and rad. `noise_mm`: the scanner's, where the scans do not tell it.

    Raises ScanError for scans of different targets or from different poses, and for poses that determine nothing.
    """
    if (before.kind, before.sizes, before.mount) != (after.kind, after.sizes, after.mount):
        raise ScanError(f"the scans show {before.description} and {after.description}; expected one target and mount")
    seen, observed, features_mm = observe_all((before, after), 1)
    level = prior_from(stated_noise((before, after)), features_mm)
    noise = replace(level.prior.scales, profile_mm=noise_mm if level.source == "residuals" else level.noise.profile_mm)
    problem = Problem(observed, noise)
    state = state_by(problem, T)
    off = float(np.sqrt(np.nanmean(problem.residuals(state)[0] ** 2)))
    if off > LARGEST_ERROR_MM:
        raise ScanError(
            f"{before.title or 'the first scan'}: with the sensor pose given, what it saw is {off:.2g} mm from any "
            f"{before.kind}; expected at most {LARGEST_ERROR_MM:g}: is it of another sensor?"
        )
    first, second = (np.unique(part) for part in np.split(problem.groups.pose, [len(seen[0].poses)]))
    shared = len(np.intersect1d(first, second))
    if not shared:
        raise ScanError(
            f"{after.title or 'the scan'}: no pose is one of the other scan's; expected the same poses again"
        )

    units = np.r_[HAND_PRECISION, units_by_hand([problem.terms[0].target])]
    precision = np.diag(units**-2.0)  # what nothing determines is known as by hand
    precision[6:12, 6:12] += np.linalg.pinv(covariance, hermitian=True)
    names = [name for name in ROBOT if getattr(noise, name)]
    model = problem.model(state, names, columns=columns_of_movement(problem, state), precision=precision)
    found = model.posterior(np.array([[1.0, *(getattr(noise, name) ** 2 for name in names)]]))
    result = Drift(found.mean[0, :6], of_covariance(found.covariance[0, :6, :6], model.n, model.n), shared)
    if not len(result.apart):
        raise ScanError(
            f"{after.title or 'the scan'}: determines no movement of the sensor; expected poses that differ"
        )
    return result


def columns_of_movement(problem: Problem, state: State) -> list[np.ndarray]:
    """The residuals' derivatives, as `Problem.columns_in_mm` has them, by the movement (6), the sensor pose before it
    (6), and the target, which is the same in both scans; then the residual, and the derivatives by the flange pose."""
    found = []
    for z, part, is_after in zip(problem.columns_in_mm(state), problem.parts, (False, True), strict=True):
        sensor, target, rest = z[:, :6], z[:, part], z[:, problem.n :]
        found.append(np.concatenate([is_after * sensor, sensor, target, rest], axis=1))
    return found


def state_by(problem: Problem, T) -> State:
    """The sensor pose T (4, 4) with the target, once for both scans, where the first shows it."""
    alone = Problem(problem.observations[:1], problem.noise)
    state = settle_targets(alone, T[None, :3, :3], T[None, :3, 3])
    return replace(state, placements=state.placements * 2)


def to_text(found: Drift) -> str:
    """What `profilecal verify --before` prints."""
    verdict = "not moved" if found.as_expected else "moved: the sensor on the flange, or the target"
    lines = found.lines("moved by", "if nothing moved")
    lines.append(f"poses          {found.shared} of the first scan again")
    lines.append(f"verdict        {verdict}; a false alarm in {100 * FALSE_ALARM:.0f} % of all checks")
    return "\n".join(lines)
