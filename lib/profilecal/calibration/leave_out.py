"""How well do the others predict each flange orientation? Each is left out in turn."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.calibration.answer import DEGREES
from profilecal.calibration.calibration import Calibration
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit, normalised_square
from profilecal.geometry.observability import of_covariance
from profilecal.geometry.progress import watched
from profilecal.joint.error_sizes import Likeliest, likeliest
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.prior import Law
from profilecal.joint.solution import Solution

PARTS = 100  # calibrations: of more orientations some are left out together


@dataclass(frozen=True, eq=False, repr=False)
class LeftOut:
    """What the other orientations say of each of G, from `leave_out`.

    An orientation that the answer cannot do without has NaN.
    """

    poses: tuple[tuple[str, ...], ...]  # (G,) labels of each orientation's poses
    rms_mm: ndarray  # (G,) of its residuals from the calibration without it
    # (G,) of it, from the noise and from how well the others determine the answer
    expected_mm: ndarray
    doubted: ndarray  # (G,) farther off than expected, and beyond chance
    # (G, 6) of the sensor pose without it, a shift and a turn in the sensor's frame
    moved_mm_deg: ndarray

    def __repr__(self) -> str:
        least, most = np.nanmin(self.rms_mm), np.nanmax(self.rms_mm)
        return (
            f"LeftOut({len(self.poses)} orientations, {self.doubted.sum()} doubted, "
            f"{least:.2g} to {most:.2g} mm rms)"
        )


def leave_out(found: Calibration) -> LeftOut:
    """Cross-validation: predict each flange orientation from the others.

    These are calibrations without one orientation each, to first order at the solution,
    with errors of the sizes that the others show: none can excuse itself. Rejected
    poses stay out. Of more than a hundred orientations a hundredth is left out at a
    time.

    Parameters
    ----------
    found : Calibration
        One that has an answer.

    Returns
    -------
    LeftOut
        For each orientation how far off it is, how far is expected, and how the sensor
        pose moves without it.

    Raises
    ------
    UnobservableError
        For a calibration without an answer.

    See Also
    --------
    verify : compare with a scan that was not used.

    Examples
    --------
    >>> import profilecal as pc
    >>> scan, truth = pc.simulate("plane", seed=1, groups=8, positions=3)
    >>> left = pc.leave_out(pc.calibrate(scan))
    >>> left.rms_mm.shape, left.moved_mm_deg.shape
    ((8,), (8, 6))
    """
    check_type("found", found, Calibration)
    solution = found.known_solution
    problem, (whole, _) = solution.problem, solution.model()
    law = solution.prior.law(whole.names)
    start = likeliest(whole, law).y
    labels = [label for of_scan in found.labels_by_scan() for label in of_scan]
    group = problem.groups.group
    orientations = [
        np.flatnonzero((group == g) & whole.kept) for g in np.unique(group[whole.kept])
    ]
    count = len(orientations)
    left = LeftOut(
        poses=tuple(tuple(labels[k] for k in members) for members in orientations),
        rms_mm=np.full(count, np.nan),
        expected_mm=np.full(count, np.nan),
        doubted=np.zeros(count, dtype=bool),
        moved_mm_deg=np.full((count, 6), np.nan),
    )
    for k in watched(range(min(count, PARTS)), "leaving out each orientation"):
        some = range(k, count, PARTS)
        members = [orientations[g] for g in some]
        predictions = predict(members, solution, whole, law, start)
        for g, prediction in zip(some, predictions, strict=False):
            left.rms_mm[g], left.expected_mm[g], left.doubted[g], moved = prediction
            left.moved_mm_deg[g] = moved * DEGREES
    return left


def predict(
    orientations: Sequence[ndarray],
    solution: Solution,
    whole: LinearModel,
    law: Law,
    start: ndarray,
) -> Iterator[tuple[float, float, bool, ndarray]]:
    """What the linear model `whole` without some orientations, each the profiles (k,)
    that it has, says of them: of each the rms and the expected rms, mm, whether it is
    doubted, and how the sensor pose moves (6,), mm and rad. Nothing where the others
    leave the answer open. `start` (d,): coordinates near the likeliest sizes of errors.
    """
    problem = solution.problem
    all_out = among(np.concatenate(orientations), whole.kept)
    others = whole.keeping(whole.kept & ~all_out)
    likely = likeliest(others, law, start)
    left = others.posterior(mean_variances(law, likely)[None])
    known = of_covariance(left.covariance[0, :6, :6], problem.n, problem.n)
    if known.status == "unobservable":
        return
    error, S = others.left_out(left)
    x = np.append(left.mean[0], 1.0)
    columns = problem.columns_in_mm(solution.state)
    chance = FALSE_ALARM / whole.kept.sum()
    limit = chi2_limit(chance, np.maximum(whole.ranks, 1))
    beyond = normalised_square(S, error) > limit
    for members in orientations:
        square = np.sum(error[members] ** 2) + np.sum((whole.rest[members] @ x) ** 2)
        # residuals that no error of the flange moves
        beside = whole.counts[members].sum() - error[members].size
        variance = np.trace(S[members], axis1=1, axis2=2).sum() + beside * left.v[0, 0]
        excess = float(np.sqrt(square / variance))
        rms_mm = problem.rms_mm(columns, left.mean[0], among(members, whole.kept))
        doubted = bool(beyond[members].any() and excess > 1)
        yield rms_mm, rms_mm / excess, doubted, left.mean[0, :6]


def among(members: ndarray, profiles: ndarray) -> ndarray:
    """Which of as many profiles as an array has are `members` (k,), by mask."""
    return np.isin(np.arange(len(profiles)), members)


def mean_variances(law: Law, likely: Likeliest) -> ndarray:
    """The mean (1 + k,) of variances over coordinates about the likeliest, by points on
    the axes (cubature).
    """
    y = likely.y
    if not len(y):
        return law.scales**2
    axes = np.sqrt(len(y)) * likely.root.T
    ends = np.concatenate([y + axes, y - axes])
    return law.variances(ends)[0].mean(axis=0)
