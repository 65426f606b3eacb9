"""Which of many candidates to take: those whose blocks of information make the sensor
pose's covariance small.

What is made small is the larger of two: the largest standard deviation of the
translation in any direction, and that of the rotation about any axis, each over the
limit that is asked for. In place of a largest variance, the choice looks at (tr
Cᵖ)^(1/p), p = 16: hardly larger, and it sees the directions behind the worst one too.

A greedy start adds the candidate that helps most; then each pose in turn is exchanged
for whatever serves best in its place, until none does (Fedorov 1972). A block V Vᵀ of
low rank changes C by C V (1 + Vᵀ C V)⁻¹ Vᵀ C.
"""

from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from profilecal.geometry.observability import LEAST_TURN_DEG
from profilecal.geometry.poses import angle_between, parallel
from profilecal.scan.scan import ScanError
from profilecal_tool.plan.candidates import BEYOND, Limits, draw, neighbours
from profilecal_tool.plan.scan_model import Prediction, ScanModel, information, predict

NOWHERE = np.empty((0, 3, 3)), np.empty((0, 3))  # no poses


@dataclass(frozen=True)
class Plan:
    """Poses in the order in which to go through them, and what they are predicted to
    give.
    """

    model: ScanModel
    R: np.ndarray  # (P, 3, 3) of the flange as the joint solution has it
    T: np.ndarray  # (P, 3) mm
    predicted: Prediction  # with the poses that were there before
    until: tuple[float, float]  # mm and degrees that were asked for


@dataclass(frozen=True)
class Pool:
    """Candidates, and their blocks of information on the unknowns, the sensor pose in
    units of what is asked for.
    """

    R: np.ndarray  # (N, 3, 3) flange poses
    T: np.ndarray  # (N, 3) mm
    roots: np.ndarray  # (N, q, r) V of each block V Vᵀ
    prior: np.ndarray  # (q, q) what is there without them

    @classmethod
    def of(cls, model: ScanModel, R, T, until, before=0.0) -> "Pool":
        """`until`: standard deviations that are asked for, mm and degrees; `before` (q,
        q): `information` that is there already.
        """
        # of what is known by hand: an empty plan's information; with far less, rounding
        # would choose
        ridge = 1e-3
        negligible = 1e-7  # of the largest eigenvalue of a block
        by_hand, systematic = model.known
        unit = np.r_[
            np.repeat([until[0], np.radians(until[1])], 3), by_hand[6:], systematic
        ]
        values, vectors = np.linalg.eigh(
            information(model, R, T, each=True) * unit[:, None] * unit
        )
        rank = int((values > negligible * values.max()).sum(axis=1).max())
        roots = vectors[..., -rank:] * np.sqrt(np.maximum(values[:, None, -rank:], 0))
        precision = np.r_[ridge / by_hand**2, systematic**-2.0]
        return cls(R, T, roots, (np.diag(precision) + before) * unit[:, None] * unit)

    def covariance(self, chosen) -> np.ndarray:
        """Of all unknowns (q, q) after the candidates `chosen`."""
        V = self.roots[chosen].transpose(1, 0, 2).reshape(len(self.prior), -1)
        return np.linalg.inv(self.prior + V @ V.T)

    def lacks(self, chosen) -> float:
        """How many times as large as asked for the standard deviations of a plan are."""
        C = self.covariance(chosen)
        return float(
            np.sqrt(max(np.linalg.norm(C[:3, :3], 2), np.linalg.norm(C[3:6, 3:6], 2)))
        )

    def with_each(self, chosen) -> np.ndarray:
        """How good a plan is with one of the candidates (N,) more, less is better:
        `smooth_worst`; while there are too few for that, the volume of what is left
        open. inf for candidates whose orientation it has.
        """
        # times what is asked for, a standard deviation is no better than one by hand
        left_open = 100.0
        C = self.covariance(chosen)
        N, q, r = self.roots.shape
        W = (
            (C @ self.roots.transpose(1, 0, 2).reshape(q, -1))
            .reshape(q, N, r)
            .transpose(1, 0, 2)
        )
        inner = np.eye(r) + self.roots.mT @ W
        if smooth_worst(C[:6, :6]) > left_open:
            values = 1 / np.linalg.det(inner)
        else:
            pose = W[:, :6]
            values = smooth_worst(C[:6, :6] - pose @ np.linalg.solve(inner, pose.mT))
        if len(chosen):
            values[parallel(self.R, self.R[chosen], LEAST_TURN_DEG).any(axis=1)] = (
                np.inf
            )
        return values


def smooth_worst(C) -> np.ndarray:
    """As `Pool.lacks`, but hardly larger and smooth, of covariances (..., 6, 6) of the
    sensor pose.
    """
    # of translation and of rotation
    power = np.stack([C[..., :3, :3], C[..., 3:, 3:]], axis=-3)
    scale = np.maximum(np.trace(C, axis1=-2, axis2=-1), np.finfo(float).tiny)
    power = power / scale[..., None, None, None]
    for _ in range(3):
        power = power @ power
    return np.sqrt(scale * np.sum(power**2, axis=(-3, -2, -1)) ** (1 / 16))


def design(
    model: ScanModel,
    limits: Limits,
    rng: np.random.Generator,
    *,
    poses: int = 0,
    until: tuple[float, float] = (0.1, 0.05),
    most: int = 100,
    before: tuple = NOWHERE,
    # twice as many take twice as long, and plans are 2 % better
    candidates: int = 2000,
) -> Plan:
    """The poses that serve a calibration best: so many `poses`, or as many as it takes
    `until` the standard deviations of translation and rotation are below mm and degrees
    in every direction, `most` of them at most.

    `before`: poses R (P, 3, 3), T (P, 3) that are there already. Raises ScanError where
    the limits leave too few poses.
    """
    if not all(0 < value < np.inf for value in until):
        raise ScanError(
            f"until is {list(until)}; expected mm and degrees, both positive"
        )
    given = information(model, *before) if len(before[0]) else 0.0
    pool = Pool.of(model, *draw(model, limits, candidates, rng, BEYOND), until, given)
    chosen = []
    # for neighbours in the end: without them, standard deviations are 10 % larger
    exchanges = 6
    with tqdm(
        desc="planning",
        total=(poses or most) + exchanges,
        disable=None,
        leave=False,
        delay=2.0,
    ) as bar:
        while not chosen or (
            len(chosen) < (poses or most) and (poses or pool.lacks(chosen) > 1)
        ):
            chosen = added(pool, chosen)
            bar.update()
        for _ in range(exchanges):
            R, T = pool.R[chosen], pool.T[chosen]
            near = neighbours(model, limits, R, T, 40, rng)
            pool = Pool.of(model, *joined((R, T), near), until, given)
            chosen = exchanged(pool, list(range(len(chosen))))
            chosen = chosen if poses else trimmed(pool, chosen)
            bar.update()
    R, T = pool.R[chosen], pool.T[chosen]
    way = short_way(R, T)
    return Plan(
        model, R[way], T[way], predict(model, *joined(before, (R, T)), rng), until
    )


def joined(first: tuple, second: tuple):
    """Poses R, T and further ones together."""
    return map(np.concatenate, zip(first, second, strict=True))


def added(pool: Pool, chosen: list[int]) -> list[int]:
    """A plan with the candidate more that helps most. Raises ScanError where none is
    left.
    """
    values = pool.with_each(chosen)
    best = int(np.argmin(values))
    if values[best] == np.inf:
        raise ScanError(
            f"no pose is left whose orientation differs by {LEAST_TURN_DEG:g}° or more from those of the {len(chosen)} "
            "chosen; widen tilt_deg or spin_deg, or ask for fewer poses"
        )
    return [*chosen, best]


def exchanged(pool: Pool, chosen: list[int]) -> list[int]:
    """A plan in which each pose in turn is exchanged for whatever serves best in its
    place.
    """
    found, value = list(chosen), smooth_worst(pool.covariance(chosen)[:6, :6])
    for place in range(len(found)):
        values = pool.with_each(found[:place] + found[place + 1 :])
        best = int(np.argmin(values))
        if values[best] < value:
            found[place], value = best, values[best]
    return min(chosen, found, key=pool.lacks)


def trimmed(pool: Pool, chosen: list[int]) -> list[int]:
    """A plan without the poses that it does not take to be good enough."""
    while len(chosen) > 1:
        fewer = min(
            (chosen[:k] + chosen[k + 1 :] for k in range(len(chosen))), key=pool.lacks
        )
        if pool.lacks(fewer) > 1:
            break
        chosen = fewer
    return chosen


def short_way(R, T) -> list[int]:
    """An order of poses (P, 3, 3), (P, 3) with a short way: to the nearest each time. A
    degree counts as 3 mm.
    """
    far = np.linalg.norm(T[:, None] - T, axis=-1) + 3 * np.degrees(
        angle_between(R[:, None], R)
    )
    order, left = [0], set(range(1, len(T)))
    while left:
        order.append(min(left, key=lambda pose: far[order[-1], pose]))
        left.remove(order[-1])
    return order
