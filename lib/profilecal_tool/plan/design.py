"""Which of the possible poses together tell the most.

What poses say of the unknowns adds up: each is a block of information, so that a plan
is chosen from a pool of them by small matrices alone. It grows by the best pose at a
time, then poses are exchanged for better ones nearby.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy.spatial.distance import cdist

from profilecal.calibration.observe import LEAST_POSES
from profilecal.geometry.noise import Noise
from profilecal.geometry.observability import LEAST_TURN_DEG
from profilecal.geometry.poses import angle_between, chord
from profilecal.geometry.progress import watched
from profilecal.scan.tables import ScanError
from profilecal.simulation.sweeps import Motion, drive, half_way, straight
from profilecal_tool.plan.candidates import BEYOND, draw, neighbours, refused
from profilecal_tool.plan.scan_model import (
    NOWHERE,
    Limits,
    Prediction,
    ScanModel,
    each_alone,
    joined,
    largest_sd,
    predict,
)

# An empty plan has a thousandth of the information that is known by hand. With far
# less, rounding would choose.
RIDGE = 1e-3
NEGLIGIBLE = 1e-7  # of the largest entry of all blocks
# so many times what is asked for, a standard deviation is no better than one by hand
LEFT_OPEN = 100.0
USUAL_SD = 0.1, 0.05  # mm and degrees that are good enough
EXCHANGES = 6  # rounds; without neighbours, standard deviations are 10 % larger
FEW = 15  # poses: fewer do not tell the size of the errors to 15 %
Chosen = list[int]  # poses of a pool, by number


@dataclass(frozen=True)
class Plan:
    """Poses, or ends of sweeps at a speed, in their order, and what they are worth."""

    model: ScanModel
    R: ndarray  # (P, 3, 3)
    T: ndarray  # (P, 3) mm
    predicted: Prediction
    # mm and degrees; of given poses nothing is wanted
    wanted_sd: Sequence[float] = (np.inf, np.inf)
    enough_poses: int = 0  # like these, 0: not even ten times as many
    is_first_step: bool = False
    speed: float = 0.0  # mm/s
    left_out: Sequence[str] = ()  # why sweeps are
    unseen: int = 0  # poses that do not have the target in view

    @property
    def falls_short(self) -> bool:
        """Whether they give less than was wanted."""
        return self.predicted.lacks(self.wanted_sd) > 1


class Pool:
    """Possible poses, and what each by itself says of the unknowns x, beside a prior.

    All in units of the standard deviations wanted of the sensor pose, and of what is
    known beforehand of the others. Pose i says V_i V_iᵀ, and poses together

        C = (Π + Σ_i V_i V_iᵀ)⁻¹
    """

    def __init__(
        self,
        model: ScanModel,
        R: ndarray,
        T: ndarray,
        wanted_sd: Sequence[float],
    ) -> None:
        """`wanted_sd`: mm and degrees."""
        problem, linear, variances = model.linear(R, T)
        precision, n = linear.precision.copy(), problem.n
        unit = np.diag(precision) ** -0.5
        unit[:n] = problem.units
        unit[:6] = np.repeat([wanted_sd[0], np.radians(wanted_sd[1])], 3)
        scale = np.outer(unit, unit)
        precision[:n, :n] = np.diag(RIDGE / problem.units**2)
        if len(model.before[1]):
            _, done, _ = model.linear(*model.before)
            known = done.posterior(variances[None]).normal[0, :-1, :-1]
            # what it says but for the target, which then was somewhere else
            others = np.r_[:6, n : len(known)]
            target = np.linalg.solve(known[6:n, 6:n], known[6:n, others])
            known = known[np.ix_(others, others)] - known[others, 6:n] @ target
            precision[np.ix_(others, others)] += known
        self.R, self.T = R, T
        self.prior = precision * scale
        self.V = factors(each_alone(linear, variances) * scale)

    def covariance(self, chosen: Chosen, times: float = 1.0) -> ndarray:
        """C of the poses chosen, each so many times."""
        V = self.V[chosen]
        return np.linalg.inv(self.prior + times * np.tensordot(V, V, ((0, 2), (0, 2))))

    def lacks(self, chosen: Chosen, times: float = 1.0) -> float:
        """How many times the largest standard deviation is what is wanted."""
        return largest_sd(self.covariance(chosen, times)).max()

    def with_each(self, chosen: Chosen) -> ndarray:
        """The `smooth_worst` of the poses chosen and of one more, for each (N,). With S
        = 1 + Vᵀ C V of that,

            C' = C - C V S⁻¹ (C V)ᵀ        |C'| = |C| / |S|

        While a direction is open, 1 / |S| in its place; inf for orientations that are
        there.
        """
        C = self.covariance(chosen)
        CV = C @ self.V
        S = np.eye(CV.shape[2]) + self.V.mT @ CV
        if smooth_worst(C) > LEFT_OPEN:
            values = 1 / np.linalg.det(S)
        else:
            CV = CV[:, :6]
            values = smooth_worst(C[:6, :6] - CV @ np.linalg.inv(S) @ CV.mT)
        way = self.R.reshape(-1, 9)
        # ‖A - B‖² = 6 - 2 A · B
        near = way @ way[chosen].T > 3 - chord(LEAST_TURN_DEG) ** 2 / 2
        values[near.any(axis=1)] = np.inf
        return values

    def enough_poses(self, chosen: Chosen, lacks: float) -> int:
        """How many poses like those chosen are enough where these give so many times
        what is wanted; 0: not even ten times as many.
        """
        aim = self.lacks(chosen) / lacks
        for times in np.geomspace(1, 10, 50):
            if self.lacks(chosen, times) <= aim:
                return int(np.ceil(times * len(chosen)))
        return 0


def factors(blocks: ndarray) -> ndarray:
    """V (N, q, r) with V Vᵀ = blocks (N, q, q), but for what is negligible.

    By Cholesky, with the largest pivot of each block first: r steps, of which a pose
    takes two to five, where all eigenvectors of its block would take ten times as long.
    """
    each, columns = np.arange(len(blocks)), []
    least = NEGLIGIBLE * blocks.max()
    while (diagonal := blocks.diagonal(0, 1, 2)).max() > least:
        size = np.maximum(diagonal.max(axis=1), least)
        v = blocks[each, diagonal.argmax(axis=1)] / np.sqrt(size)[:, None]
        blocks = blocks - v[..., None] * v[:, None]
        columns.append(v)
    return np.stack(columns, axis=-1)


def smooth_worst(C: ndarray) -> ndarray:
    """Nearly the largest standard deviation of a shift or a turn, of covariances
    (..., 6, 6), but smooth: (Σ λ¹⁶)^(1/32) over the variances λ along the axes of both
    blocks A, Σ λ¹⁶ = ‖A⁸‖².
    """
    blocks = np.stack([C[..., :3, :3], C[..., 3:6, 3:6]])
    powers = np.linalg.matrix_power(blocks, 8)
    return np.sum(powers**2, axis=(0, -2, -1)) ** (1 / 32)


def added(pool: Pool, chosen: Chosen) -> Chosen:
    """One pose more, the best. Raises ScanError where none is left."""
    values = pool.with_each(chosen)
    best = int(values.argmin())
    if np.isinf(values[best]):
        raise ScanError(
            f"no pose is left whose orientation differs by {LEAST_TURN_DEG:g}° or more "
            f"from those of the {len(chosen)} chosen; widen tilt_deg or spin_deg, or "
            "ask for fewer poses"
        )
    return [*chosen, best]


def exchanged(pool: Pool, chosen: Chosen) -> Chosen:
    """A plan in which each pose in turn gives way to what serves best in its place."""
    plan = chosen
    for _ in chosen:
        plan = added(pool, plan[1:])
    return min(chosen, plan, key=pool.lacks)


def fitted(
    pool: Pool, chosen: Chosen, limits: Limits, lacks: Callable[[Chosen], float]
) -> Chosen:
    """A plan with whatever helps most, until its poses are as many as asked for or lack
    nothing; then without those that it does not take.
    """

    def suffice(some: Chosen) -> bool:
        is_enough = len(some) >= LEAST_POSES and not limits.poses
        return is_enough and lacks(some) <= 1

    most = limits.poses or limits.most
    for _ in watched(range(len(chosen), most), "choosing poses"):
        if suffice(chosen):
            break
        chosen = added(pool, chosen)
    for pose in chosen:
        fewer = [other for other in chosen if other != pose]
        if suffice(fewer):
            chosen = fewer
    return chosen


def design(model: ScanModel, rng: Generator, **asked: Any) -> Plan:
    """The poses that serve a calibration best.

    They are so many `poses`, or as many as it takes until the standard deviations of
    translation and rotation are below `until`, mm and degrees, in every direction,
    `most` of them at most, chosen among so many `candidates`: `asked` for so, or as the
    model's `Limits` have it.

    Raises ScanError where the limits leave too few poses.
    """
    limits = replace(model.limits, **asked)
    wanted_sd = limits.until or USUAL_SD
    drawn = draw(model, limits.candidates, rng, BEYOND)
    # what smooth errors do must not depend on the poses, for information to add up
    smooth = model.linear(*drawn)[0].smooth(model.state).known
    fixed = replace(model, smooth=smooth)
    # first as if nothing were there: one by one, poses do not place a further target
    pool = Pool(replace(fixed, before=NOWHERE), *drawn, wanted_sd)
    chosen = fitted(pool, [], limits, pool.lacks)
    for _ in watched(range(EXCHANGES), "exchanging poses"):
        plan = pool.R[chosen], pool.T[chosen]
        poses = joined(plan, neighbours(model, *plan, 40, rng))
        pool = Pool(fixed, *poses, wanted_sd)
        # better poses make up for others: the next round goes on from fewer
        chosen = exchanged(pool, [*range(len(chosen))])
        chosen = fitted(pool, chosen, limits, pool.lacks)

    def predicted_lack(chosen: Chosen) -> float:
        return predict(model, pool.R[chosen], pool.T[chosen]).lacks(wanted_sd)

    # smooth errors as these poses have them are not quite those of the pool
    chosen = fitted(pool, chosen, limits, predicted_lack)
    R, T = pool.R[chosen], pool.T[chosen]
    predicted = predict(model, R, T, rng)
    way = driving_order(R, T)
    enough = pool.enough_poses(chosen, predicted.lacks(wanted_sd))
    return Plan(model, R[way], T[way], predicted, wanted_sd, enough)


def driving_order(R: ndarray, T: ndarray) -> Chosen:
    """Poses in an order: of a way from the first one each time to the nearest, every
    other place, and on the way back the others.

    Errors that depend on the place, as an arm's do, then look like no drift: at each
    place the mean time is the same.
    """
    apart = cdist(T, T) + 3 * np.degrees(angle_between(R[:, None], R))
    way = [0]
    while len(way) < len(T):
        apart[:, way[-1]] = np.inf
        way.append(int(apart[way[-1]].argmin()))
    return way[::2] + way[1::2][::-1]


def line_through(model: ScanModel, R: ndarray, T: ndarray) -> tuple[ndarray, str]:
    """Both ends (2, 3) of the longest possible line across the target through a flange
    pose (3, 3), (3,), and why there is none, "" where there is.
    """
    half = R @ model.R_sensor @ half_way(model)
    for share, middle in product((1, 1 / 2, 1 / 4), (0, 1, -1)):
        ends = T + share * np.outer([middle - 1, middle + 1], half)
        begin, end = refused(model, np.array([R, R]), ends)
        if not (begin or end):
            break
    return ends, begin or end


def along_lines(plan: Plan, motion: Motion, rng: Generator) -> Plan:
    """A plan of lines through the poses of a plan, each driven there and back at the
    speed of a motion; its poses are where the sweeps begin and end.

    A delay between the clocks of robot and scanner shifts what is seen along the
    motion: on the way back the other way. A wrong mount shifts both alike.

    Raises ScanError where no line is possible.
    """
    model = plan.model
    lines = [line_through(model, *pose) for pose in zip(plan.R, plan.T, strict=True)]
    ends, why = map(np.array, zip(*lines, strict=True))
    possible = why == ""
    left_out = [
        f"{count} line{'s' * (count > 1)} whose ends {reason}"
        for reason, count in Counter(why[~possible].tolist()).most_common()
    ]
    if not possible.any():
        raise ScanError(
            f"no straight sweep fits within the limits: {', '.join(left_out)}"
        )
    R = plan.R[possible].repeat(4, axis=0)
    T = ends[possible][:, [0, 1, 1, 0]].reshape(-1, 3)
    record, flange = drive(
        model,
        # few rows of a log tell straight lines
        Motion(profiles=motion.profiles, delay_ms=0.0, log_hz=2.0),
        Noise(),
        rng,
        sweeps=straight(model, R, T, motion.speed),
        to_hand=model.to_hand,
    )
    predicted = predict(
        model,
        *model.in_base(*flange),
        rng,
        log=record["log"],
        times=record["times"][None],
        group=np.array(record["sweeps"]),
    )
    return replace(
        plan, R=R, T=T, predicted=predicted, speed=motion.speed, left_out=left_out
    )
