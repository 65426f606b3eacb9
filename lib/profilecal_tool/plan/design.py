"""Which of many candidates to take: those that make the sensor pose's covariance small.

What is made small is the larger of two: the largest standard deviation of the
translation in any direction, and that of the rotation about any axis, each over the one
that is wanted. A plan `lacks` that many times; the choice looks at `smooth_worst`,
which is nearly the same and sees the directions behind the worst one too.

A greedy start adds the candidate that helps most; then each pose in turn is exchanged
for whatever serves best in its place (Fedorov 1972), a few rounds among neighbours. A
plan is a list of candidates of one pool, by number.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.spatial.distance import cdist

from profilecal.geometry.observability import LEAST_TURN_DEG
from profilecal.geometry.poses import Frames, angle_between, chord
from profilecal.geometry.progress import watched
from profilecal.scan.scan import ScanError
from profilecal_tool.plan.candidates import BEYOND, draw, joined, neighbours
from profilecal_tool.plan.scan_model import (
    Prediction,
    ScanModel,
    information,
    largest_sd,
    predict,
)

USUAL_SD = 0.1, 0.05  # mm and degrees that are good enough
EXCHANGES = 6  # rounds; without neighbours, standard deviations are 10 % larger
FEW = 15  # poses: fewer do not tell the size of the errors to 15 %
NOWHERE = np.empty((0, 3, 3)), np.empty((0, 3))  # no poses


@dataclass(frozen=True)
class Plan:
    """Poses in the order to go through them, and what they are predicted to give."""

    model: ScanModel
    # flange poses (P, 3, 3), (P, 3), mm, as the joint solution has them
    R: ndarray
    T: ndarray
    # with the poses that were there before
    predicted: Prediction
    # mm and degrees that were asked for
    wanted_sd: Sequence[float] = USUAL_SD
    # so many poses as these would be enough for that; 0: no number of them
    enough_poses: int = 0
    # whether only a second step, from the answer of these poses, can reach it
    is_first_step: bool = False
    # mm/s, where two poses at a time are the ends of a sweep
    speed: float = 0.0
    # why there are not as many sweeps as were to be
    left_out: Sequence[str] = ()
    # so many other poses do not have the target in view
    unseen: int = 0

    @property
    def falls_short(self) -> bool:
        """Whether the poses are not enough."""
        return self.predicted.lacks(self.wanted_sd) > 1


class Pool:
    """Candidates, and their blocks of information on the unknowns.

    `R` (N, 3, 3) and `T` (N, 3) are their flange poses; `roots` (N, q, r) has V of each
    block V Vᵀ, `prior` (q, q) what is there without them. The unknowns are in units:
    the sensor pose in those of what is asked for, all others in those of what is known
    of them beforehand.
    """

    def __init__(
        self,
        model: ScanModel,
        R: ndarray,
        T: ndarray,
        wanted_sd: Sequence[float],
        before: Frames = NOWHERE,
    ) -> None:
        """Of flange poses (N, 3, 3), (N, 3).

        `wanted_sd`: mm and degrees; `before`: poses that are there already.
        """
        # An empty plan has a thousandth of the information that is known by hand. With
        # far less, rounding would choose.
        ridge = 1e-3
        # of the largest eigenvalue of a block
        negligible = 1e-7
        problem, linear, variances = model.linear(R, T)
        precision, n = linear.precision.copy(), problem.n
        precision[:n, :n] = np.diag(ridge / problem.units**2)
        unit = np.diag(precision) ** -0.5
        if len(before[0]):
            precision += information(model, *before)
        unit[:n] = problem.units
        unit[:6] = np.repeat([wanted_sd[0], np.radians(wanted_sd[1])], 3)
        scale = np.outer(unit, unit)
        blocks = linear.alone(variances)[:, :-1, :-1] * scale
        values, vectors = np.linalg.eigh(blocks)
        large = (values > negligible * values.max()).any(axis=0)
        lengths = np.sqrt(np.maximum(values[:, None, large], 0))
        self.R, self.T = R, T
        self.roots = vectors[..., large] * lengths
        self.prior = precision * scale

    def covariance(self, chosen: list[int], times: float = 1.0) -> ndarray:
        """Of all unknowns (q, q) after `times` as many poses as the candidates
        `chosen`.
        """
        V = self.roots[chosen].transpose(1, 0, 2).reshape(len(self.prior), -1)
        return np.linalg.inv(self.prior + times * V @ V.T)

    def lacks(self, chosen: list[int], times: float = 1.0) -> float:
        """How many times as large as asked for a plan's standard deviations are."""
        return max(largest_sd(self.covariance(chosen, times)[:6, :6]))

    def enough_poses(self, chosen: list[int], lacks: float) -> int:
        """How many poses as the candidates `chosen` would be enough; 0: no number.
        `lacks`: what they are predicted to, which the pool only nearly knows.
        """
        enough = self.lacks(chosen) / lacks
        for times in np.geomspace(1, 10, 50):
            if self.lacks(chosen, times) <= enough:
                return int(np.ceil(times * len(chosen)))
        return 0

    def with_each(self, chosen: list[int]) -> ndarray:
        """How good a plan is with one of the candidates (N,) more; less is better.

        It is `smooth_worst`. While poses leave a direction open, that would see no
        other: it is the share of the covariance's volume that is left, less than 1. inf
        for candidates whose orientation the plan has.

        With W = C V of a candidate, the covariance becomes C - W (1 + Vᵀ W)⁻¹ Wᵀ, and
        its determinant is divided by |1 + Vᵀ W|.
        """
        # so many times what is asked for, a standard deviation is no better than one by
        # hand
        left_open = 100.0
        C = self.covariance(chosen)
        W = C @ self.roots
        inner = np.eye(W.shape[-1]) + self.roots.mT @ W
        pose = C[:6, :6]
        if smooth_worst(pose) > left_open:
            values = 1 / np.linalg.det(inner)
        else:
            W = W[:, :6]
            values = smooth_worst(pose - W @ np.linalg.solve(inner, W.mT))
        R = self.R.reshape(-1, 9)
        alike = cdist(R, R[chosen]) < chord(LEAST_TURN_DEG)
        values[alike.any(axis=1)] = np.inf
        return values


def smooth_worst(C: ndarray) -> ndarray:
    """Nearly `Pool.lacks`, but smooth, of covariances (..., 6, 6) of the sensor pose.

    It is the root of the p-norm, p = 16, of the variances along the main axes of both
    blocks, translation and rotation: hardly larger than the largest of them. The sum of
    their 16th powers is the squared norm of a block's 8th power.
    """
    power = np.stack([C[..., :3, :3], C[..., 3:, 3:]], axis=-3)
    for _ in range(3):
        power = power @ power
    return np.sum(power**2, axis=(-3, -2, -1)) ** (1 / 32)


def design(
    model: ScanModel,
    rng: np.random.Generator,
    *,
    before: Frames = NOWHERE,
    **asked: Any,
) -> Plan:
    """The poses that serve a calibration best.

    They are so many `poses`, or as many as it takes until the standard deviations of
    translation and rotation are below `until`, mm and degrees, in every direction,
    `most` of them at most, chosen among so many `candidates`: `asked` for so, or as the
    model's `Limits` have it.
    `before`: poses R (P, 3, 3), T (P, 3) that are there.

    Raises ScanError where the limits leave too few poses.
    """
    limits = replace(model.limits, **asked)
    wanted_sd = limits.until or USUAL_SD
    drawn = draw(model, limits.candidates, rng, BEYOND)
    # what smooth errors do must not depend on the poses, for information to add up
    smooth = model.linear(*drawn)[0].smooth(model.state).known
    fixed = replace(model, smooth=smooth)
    pool = Pool(fixed, *drawn, wanted_sd, before)

    def by_pool(chosen: list[int]) -> bool:
        return not limits.poses and pool.lacks(chosen) <= 1

    def by_prediction(chosen: list[int]) -> bool:
        poses = joined(before, (pool.R[chosen], pool.T[chosen]))
        return not limits.poses and predict(model, *poses).lacks(wanted_sd) <= 1

    most = limits.poses or limits.most
    chosen = grown(pool, [], most, by_pool)
    for _ in watched(range(EXCHANGES), "exchanging poses"):
        plan = pool.R[chosen], pool.T[chosen]
        several = joined(plan, neighbours(model, *plan, 40, rng))
        pool = Pool(fixed, *several, wanted_sd, before)
        chosen = exchanged(pool, list(range(len(chosen))))
        # better poses make up for others: the next round goes on from fewer
        chosen = trimmed(chosen, by_pool)
    # smooth errors as these poses have them are not quite those of the pool
    chosen = trimmed(grown(pool, chosen, most, by_prediction), by_prediction)
    R, T = pool.R[chosen], pool.T[chosen]
    predicted = predict(model, *joined(before, (R, T)), rng)
    way = there_and_back(short_way(R, T))
    enough = pool.enough_poses(chosen, predicted.lacks(wanted_sd))
    return Plan(model, R[way], T[way], predicted, wanted_sd, enough)


def grown(
    pool: Pool, chosen: list[int], most: int, suffice: Callable[[list[int]], bool]
) -> list[int]:
    """A plan with whatever helps most, until its poses suffice or are so many."""
    for _ in watched(range(len(chosen), most), "choosing poses"):
        if chosen and suffice(chosen):
            break
        chosen = added(pool, chosen)
    return chosen


def trimmed(chosen: list[int], suffice: Callable[[list[int]], bool]) -> list[int]:
    """A plan without the poses that it does not take to suffice."""
    for pose in list(chosen):
        fewer = [other for other in chosen if other != pose]
        if fewer and suffice(fewer):
            chosen = fewer
    return chosen


def added(pool: Pool, chosen: list[int]) -> list[int]:
    """A plan with the one candidate more that helps most.

    Raises ScanError where none is left.
    """
    values = pool.with_each(chosen)
    best = int(np.argmin(values))
    if values[best] == np.inf:
        raise ScanError(
            f"no pose is left whose orientation differs by {LEAST_TURN_DEG:g}° or more "
            f"from those of the {len(chosen)} chosen; widen tilt_deg or spin_deg, or "
            "ask for fewer poses"
        )
    return [*chosen, best]


def exchanged(pool: Pool, chosen: list[int]) -> list[int]:
    """A plan in which each pose in turn gives way to what serves best in its place."""
    plan = list(chosen)
    least = smooth_worst(pool.covariance(plan)[:6, :6])
    for place in range(len(plan)):
        # where the others leave a direction open, all values are less than `least`
        values = pool.with_each(plan[:place] + plan[place + 1 :])
        best = int(np.argmin(values))
        if values[best] < least:
            plan[place] = best
            least = values[best]
    return min(chosen, plan, key=pool.lacks)


def there_and_back(way: list[int]) -> list[int]:
    """Every other place of a way, and on the way back the others.

    Errors that depend on the place, as an arm's do, then look like no drift: at each
    place the mean time is the same.
    """
    return way[::2] + way[1::2][::-1]


def short_way(R: ndarray, T: ndarray) -> list[int]:
    """An order of poses (P, 3, 3), (P, 3) with a short way: to the nearest each time.

    A degree counts as 3 mm.
    """
    turn_deg = np.degrees(angle_between(R[:, None], R))
    far = np.linalg.norm(T[:, None] - T, axis=-1) + 3 * turn_deg
    order = [0]
    while len(order) < len(T):
        far[:, order[-1]] = np.inf
        order.append(int(np.argmin(far[order[-1]])))
    return order
