"""Which of many candidates to take: those whose blocks of information make the sensor pose's covariance small.

The criterion is a function of the covariance C (6, 6) in the units of `observability`, a mount measured by hand:

- "worst", the largest variance in any direction, E-optimal; in its place (tr Cᵖ)^(1/p), p = 16, which is at most 12 %
  larger and sees the directions behind it too; where limits are given for translation and rotation (`Pool.until`),
  the larger of the two worst directions, each over its limit, likewise;
- "A", the mean variance tr C; "D", the volume |C|.

A greedy start adds the candidate that helps most; then each pose in turn is exchanged for whatever serves best in its
place, until none does (Fedorov 1972). A block V Vᵀ of low rank changes C by C V (1 + Vᵀ C V)⁻¹ Vᵀ C.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from profilecal.geometry.poses import parallel
from profilecal.joint.observability import HAND_PRECISION
from profilecal.scan.scan import ScanError

CRITERIA = ("worst", "A", "D")
SQUARINGS = 4  # p = 2⁴
NEGLIGIBLE = 1e-2  # of a block, in units of what is known by hand, whose own information is 1
RIDGE = 1e-3  # of what is known by hand: an empty plan's information; with far less, rounding would choose
APART_DEG = 1.0  # orientations that differ by less are no new ones to the robot's errors
EACH, EVERY = 12, 6  # poses up to which a growing plan is exchanged at each step, and steps between later exchanges
SWEEPS, SETTLED = 6, 2e-3  # of exchanges at most; a gain that ends them


@dataclass(frozen=True)
class Pool:
    """Candidates, their blocks of information on unknowns in units that make all of them comparable."""

    R: np.ndarray  # (N, 3, 3) flange orientations, which a plan does not repeat
    roots: np.ndarray  # (N, q, r) V of each block V Vᵀ
    prior: np.ndarray  # (q, q) what is there without them
    root: np.ndarray  # (6, 6) W: the criterion is one of W C Wᵀ
    counted: np.ndarray | float = 1.0  # (6, 6) 1 for the entries of W C Wᵀ that count, else 0

    @classmethod
    def of(cls, R, blocks, known, before=None, reference=None, until=None) -> "Pool":
        """`blocks` (N, q, q), mm and rad; `known`: the unknowns' `setup.scales`; `before` (q, q): information that is
        there already; `reference` (6, 6): a covariance in place of the measurement by hand; `until`: limits, mm and
        degrees, of the standard deviations in any direction, each by itself, in its place."""
        unit = np.concatenate(known)
        across = unit[:, None] * unit
        values, vectors = np.linalg.eigh(blocks * across)
        rank = max(1, int((values > NEGLIGIBLE).sum(axis=1).max()))
        roots = vectors[..., -rank:] * np.sqrt(np.maximum(values[:, None, -rank:], 0))
        prior = np.diag(np.r_[np.full(len(known[0]), RIDGE), np.ones(len(known[1]))])
        if before is not None:
            prior = prior + before * across
        root, counted = np.eye(6), 1.0
        if until is not None:
            root = np.diag(HAND_PRECISION / np.repeat([until[0], np.radians(until[1])], 3))
            counted = np.kron(np.eye(2), np.ones((3, 3)))
        elif reference is not None:
            root = np.linalg.inv(np.linalg.cholesky(reference / HAND_PRECISION[:, None] / HAND_PRECISION))
        return cls(R, roots, prior, root, counted)

    def covariance(self, chosen) -> np.ndarray:
        """Of all unknowns (q, q) after the candidates `chosen`."""
        V = self.roots[chosen].transpose(1, 0, 2).reshape(len(self.prior), -1)
        return np.linalg.inv(self.prior + V @ V.T)

    def value(self, chosen, criterion: str) -> float:
        """The criterion of a plan; less is better."""
        return float(self.judged(self.covariance(chosen), criterion))

    def judged(self, C, criterion: str) -> np.ndarray:
        """The criterion of covariances (..., q, q) of all unknowns."""
        return judge(self.root @ C[..., :6, :6] @ self.root.T * self.counted, criterion)

    def values_with(self, C, criterion: str) -> np.ndarray:
        """The criterion (N,) after each candidate by itself, from the covariance (q, q) before; whole: of all unknowns
        if the criterion is "whole"."""
        N, q, r = self.roots.shape
        W = (C @ self.roots.transpose(1, 0, 2).reshape(q, -1)).reshape(q, N, r).transpose(1, 0, 2)
        inner = np.eye(r) + np.swapaxes(self.roots, 1, 2) @ W
        if criterion == "whole":
            return -np.linalg.slogdet(inner)[1]
        pose = self.root @ W[:, :6]
        change = pose @ np.linalg.solve(inner, np.swapaxes(pose, 1, 2))
        return judge((self.root @ C[:6, :6] @ self.root.T - change) * self.counted, criterion)

    def taken(self, chosen) -> np.ndarray:
        """Candidates (N,) too near to one that is chosen."""
        return parallel(self.R, self.R[chosen], APART_DEG).any(axis=1)


def judge(C, criterion: str) -> np.ndarray:
    """The criterion of covariances (..., 6, 6): in standard deviations; of A and D, of an average direction."""
    mean = np.maximum(np.trace(C, axis1=-2, axis2=-1) / 6, np.finfo(float).tiny)
    if criterion == "A":
        return np.sqrt(mean)
    if criterion == "D":
        return np.exp(np.linalg.slogdet(C)[1] / 12)
    with np.errstate(over="ignore", invalid="ignore"):  # of candidates that leave a direction open, by rounding
        power = C / mean[..., None, None]
        for _ in range(SQUARINGS):
            power = power @ power
        value = np.sqrt(mean * np.abs(np.trace(power, axis1=-2, axis2=-1)) ** (0.5**SQUARINGS))
    return np.where(np.isfinite(value), value, np.inf)


def add(pool: Pool, chosen: list[int], criterion: str) -> list[int]:
    """A plan with one pose more, the one that helps most; while some direction is open, that adds most to anything."""
    C = pool.covariance(chosen)
    few = np.trace(C[:6, :6]) > 6  # no better than by hand
    values = pool.values_with(C, "whole" if few else criterion)
    if chosen:
        values[pool.taken(chosen)] = np.inf
    best = int(np.argmin(values))
    if values[best] == np.inf:
        raise ScanError(
            f"no pose is left whose orientation differs by {APART_DEG:g}° or more from those of the {len(chosen)} "
            "chosen; widen tilt_deg or spin_deg, or ask for fewer poses"
        )
    return [*chosen, best]


def exchange(pool: Pool, chosen: list[int], criterion: str, sweeps: int = SWEEPS) -> list[int]:
    """A plan of as many poses in which no exchange of one of them helps."""
    chosen, value = list(chosen), pool.value(chosen, criterion)
    for _ in range(sweeps):
        before = value
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            values = pool.values_with(pool.covariance(others), criterion)
            if others:
                values[pool.taken(others)] = np.inf
            best = int(np.argmin(values))
            if values[best] < value * (1 - 1e-6):
                chosen[place], value = best, float(values[best])
        if value > (1 - SETTLED) * before:
            break
    return chosen


def growing(pool: Pool, criterion: str, most: int) -> Iterator[list[int]]:
    """Plans of one pose, two, and so on."""
    chosen = []
    while len(chosen) < min(most, len(pool.R)):
        chosen = add(pool, chosen, criterion)
        if len(chosen) <= EACH or len(chosen) % EVERY == 0:
            chosen = exchange(pool, chosen, criterion, sweeps=1)
        yield chosen


def leaving_out(pool: Pool, chosen: list[int], criterion: str) -> int:
    """The pose of a plan that is missed least."""
    V = pool.roots[chosen]
    own = V @ np.swapaxes(V, 1, 2)
    left = np.linalg.inv(pool.prior + own.sum(axis=0) - own)
    values = pool.judged(left, criterion)
    if np.trace(left[np.argmin(values), :6, :6]) > 6:  # too few, as in `add`
        values = np.linalg.slogdet(left)[1]
    return chosen[int(np.argmin(values))]


def ranked(pool: Pool, chosen: list[int], criterion: str) -> list[int]:
    """The poses of a plan, last the one that is missed least; before it the one that is missed least of the others; and
    so on."""
    left, order = list(chosen), []
    while left:
        order.append(leaving_out(pool, left, criterion))
        left.remove(order[-1])
    return order[::-1]


def shortest(R, T, mm_per_deg: float = 3.0) -> np.ndarray:
    """An order (P,) in which the way through poses (P, 3, 3), (P, 3) is short: to the nearest each time, then turning
    parts of the way round as long as that shortens it. A degree counts as `mm_per_deg`."""
    trace = np.einsum("iab,jab->ij", R, R)
    far = np.linalg.norm(T[:, None] - T, axis=-1) + mm_per_deg * np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
    order, left = [0][: len(T)], set(range(1, len(T)))
    while left:
        order.append(min(left, key=lambda k: far[order[-1], k]))
        left.remove(order[-1])
    order, better = np.array(order, dtype=int), True
    while better:
        better = False
        for i in range(len(order) - 2):
            a, b, ends = order[i], order[i + 1], order[i + 2 :]
            after = np.r_[order[i + 3 :], -1]
            open_end = after < 0
            saved = far[a, b] - far[a, ends] + np.where(open_end, 0, far[ends, after] - far[b, after])
            k = int(np.argmax(saved))
            if saved[k] > 1e-9:
                order[i + 1 : i + 3 + k] = order[i + 1 : i + 3 + k][::-1]
                better = True
    return order
