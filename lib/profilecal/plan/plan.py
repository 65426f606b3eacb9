"""A plan: what is wished for, the poses that serve it best, and what they will be worth."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest

import numpy as np
from tqdm import tqdm

from profilecal.joint.observability import HAND_PRECISION
from profilecal.plan.candidates import AT_LIMIT, Limits, draw, neighbours
from profilecal.plan.design import CRITERIA, Pool, exchange, growing, leaving_out, ranked, shortest
from profilecal.plan.setup import Part, Prediction, Setup, blocks, information, predict, scales
from profilecal.scan.scan import ScanError

CANDIDATES = 2000
POLISHES, EACH = 2, 40  # rounds of looking at that many neighbours of each pose
TRIES, NEARLY = 10, 1.03  # smaller plans tried in place of one that is enough; what another round may mend
NOWHERE = np.empty((0, 3, 3)), np.empty((0, 3))
PATIENCE_S = 2.0  # without a progress bar


@dataclass(frozen=True)
class Wishes:
    """What is asked of a plan: entries of the table [plan]; those of `Limits` too."""

    poses: int = 0  # 0: as many as it takes
    most: int = 100  # of those
    until: tuple[float, ...] = (0.1, 0.05)  # mm and degrees: the largest standard deviation in any direction
    criterion: str = "worst"
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self):
        if self.criterion not in CRITERIA:
            raise ScanError(f"criterion is {self.criterion!r}; expected one of {', '.join(CRITERIA)}")
        if not (0 <= self.poses <= 1000 and 1 <= self.most <= 1000):
            raise ScanError(f"poses is {self.poses}, most is {self.most}; expected 1000 at most, and one at least")
        if len(self.until) != 2 or not min(self.until) > 0:
            raise ScanError(f"until is {list(self.until)} in [plan]; expected mm and degrees, both positive")
        low, high = np.array(self.limits.low), np.array(self.limits.high)
        if (low >= high).any():
            k = int(np.argmax(low >= high))
            raise ScanError(f"the box is empty along {'xyz'[k]}: low is {low[k]:g} and high is {high[k]:g} mm")


@dataclass(frozen=True)
class Plan:
    """Poses in the order in which to go through them, and what they are predicted to give."""

    setup: Setup
    wishes: Wishes
    R: np.ndarray  # (P, 3, 3) of the flange as the joint solution has it
    T: np.ndarray  # (P, 3) mm
    predicted: Prediction  # with what was there before, and with the poses over other targets that belong to it
    curve: list[tuple[int, float, float]]  # mm and degrees, sd in the worst direction: of the plan's best n poses
    rank: np.ndarray | None = None  # (P,) of each pose: the best n are those up to n

    @property
    def enough(self) -> int | None:
        """How many poses it takes until it is good enough; None if more than there are in the curve."""
        mm, deg = self.wishes.until
        return next((n for n, m, d in self.curve if m <= mm and d <= deg), None)


@dataclass(frozen=True)
class Choice:
    """Candidates for the poses over each target, and which of them a plan takes."""

    parts: list[Part]
    pool: Pool
    chosen: list[int]  # of all parts' poses, one after the other

    @property
    def taken(self) -> list[Part]:
        """The plan's poses over each target."""
        found, start = [], 0
        for setup, R, T in self.parts:
            own = [k - start for k in sorted(self.chosen) if start <= k < start + len(T)]
            found.append((setup, R[own], T[own]))
            start += len(T)
        return found

    @property
    def largest(self) -> tuple[float, float]:
        """The plan's largest standard deviations, mm and degrees."""
        return largest(self.pool.covariance(self.chosen)[:6, :6])


@dataclass(frozen=True)
class Designer:
    """What poses are chosen by."""

    wishes: Wishes
    rng: np.random.Generator
    known: tuple[np.ndarray, np.ndarray]  # the unknowns' `scales`
    before: np.ndarray | None  # information that is there already
    reference: np.ndarray | None
    polishes: int
    bar: tqdm

    def pool(self, parts: list[Part]) -> Pool:
        """Of all candidates."""
        aims = self.wishes.criterion == "worst" and not self.wishes.poses and self.reference is None
        until = self.wishes.until if aims else None
        R = np.concatenate([R for _, R, _ in parts])
        return Pool.of(R, blocks(parts), self.known, self.before, self.reference, until)

    def lacks(self, choice: Choice) -> float:
        """How many times as large as wished for the standard deviations are."""
        return float(np.max(np.divide(choice.largest, self.wishes.until)))

    def grown(self, parts: list[Part]) -> Choice:
        """A plan of as many poses as are asked for, or as it takes: over the best of the targets alone, or over all,
        from as many of the best poses over each. (Pose by pose no plan gets from one target to another, of which two or
        three poses tell nothing.)"""
        pool, criterion, start, alone = self.pool(parts), self.wishes.criterion, 0, []
        most = self.wishes.poses or self.wishes.most
        for _, R, _ in parts:
            rows = start + np.arange(len(R))
            start += len(R)
            part = replace(pool, R=pool.R[rows], roots=pool.roots[rows])
            for chosen in growing(part, criterion, most):
                choice = Choice(parts, pool, [int(rows[k]) for k in chosen])
                self.bar.update()
                if not self.wishes.poses and self.lacks(choice) <= 1:
                    most = len(chosen)
                    break
            alone += [choice] if len(R) else []

        def value(choice):
            return pool.value(choice.chosen, criterion)

        best = min((choice for choice in alone if len(choice.chosen) == most), key=value)
        if len(alone) == 1:
            return best
        order = zip_longest(*(ranked(pool, choice.chosen, criterion) for choice in alone))
        mixed = [k for several in order for k in several if k is not None][:most]
        return min(best, Choice(parts, pool, exchange(pool, mixed, criterion)), key=value)

    def polished(self, choice: Choice) -> Choice:
        """The plan with poses exchanged for others nearby; a target that it leaves out keeps some of its candidates."""
        for _ in range(self.polishes):
            parts, chosen, start = [], [], 0
            for (setup, R, T), (_, *others) in zip(choice.taken, choice.parts, strict=True):
                more = [other[:EACH] for other in others]
                if len(T):
                    more = neighbours(setup, self.wishes.limits, R, T, EACH, self.rng)
                chosen += range(start, start + len(T))
                R, T = (np.concatenate(pair) for pair in zip((R, T), more, strict=True))
                parts.append((setup, R, T))
                start += len(T)
            pool = self.pool(parts)
            choice = Choice(parts, pool, exchange(pool, chosen, self.wishes.criterion))
            self.bar.update()
        return choice

    def trimmed(self, choice: Choice) -> Choice:
        """The plan without poses that it does not take, as the errors go with the root of their number."""
        failed = 0
        for _ in range(TRIES if self.polishes else 0):
            n, lacks = len(choice.chosen), self.lacks(choice)
            if lacks > 1 or failed == n - 1:
                break
            chosen = list(choice.chosen)
            while len(chosen) > np.clip(np.ceil(n * lacks**2), failed + 1, n - 1):
                chosen.remove(leaving_out(choice.pool, chosen, self.wishes.criterion))
            tried = self.polished(replace(choice, chosen=chosen))
            if 1 < self.lacks(tried) < NEARLY:
                tried = self.polished(tried)
            if self.lacks(tried) <= 1:
                choice = tried
            else:
                failed = len(chosen)
        return choice


def design(setup: Setup, wishes: Wishes, rng: np.random.Generator, after: Sequence[Part] = (), **options) -> Plan:
    """The poses over one target that serve the wishes best: `design_together`."""
    (plan,) = design_together([setup], wishes, rng, after, **options)
    return plan


def design_together(
    setups: Sequence[Setup],
    wishes: Wishes,
    rng: np.random.Generator,
    after: Sequence[Part] = (),
    *,
    reference=None,
    candidates: int = CANDIDATES,
    polishes: int = POLISHES,
) -> list[Plan]:
    """The poses over each target that together serve the wishes best, beside those that exist already: `after`, of
    these setups or of others.

    `reference` (6, 6): instead of a mount measured by hand, the covariance, mm and rad, that sets the units of the
    criterion. `candidates`, `polishes`: how many poses to choose from, and how often to look near those chosen.
    Raises ScanError where the limits leave too few poses.
    """
    limits, each = wishes.limits, -(-candidates // len(setups))
    before = merged([*((setup, *NOWHERE) for setup in setups), *after])
    parts = [(setup, *draw(setup, limits, each, rng, AT_LIMIT)) for setup in setups]
    parts += [(setup, *NOWHERE) for setup, _, _ in before[len(setups) :]]
    given = information(before) if after else None
    with tqdm(desc="planning", unit=" steps", disable=None, leave=False, delay=PATIENCE_S) as bar:
        designer = Designer(wishes, rng, scales(parts), given, reference, polishes, bar)
        choice = designer.polished(designer.grown(parts))
        if not wishes.poses:
            choice = designer.trimmed(choice)
    predicted = predict(merged([*before, *choice.taken]), rng)
    order = ranked(choice.pool, sorted(choice.chosen), wishes.criterion)
    curve = [(n, *replace(choice, chosen=order[:n]).largest) for n in range(1, len(order))]
    curve.append((len(order), predicted.mm, predicted.deg))
    rank, plans = {k: 1 + n for n, k in enumerate(order)}, []
    ranks = iter([rank[k] for k in sorted(order)])
    for setup, R, T in choice.taken[: len(setups)]:
        way, own = shortest(R, T), np.array([next(ranks) for _ in T], dtype=int)
        plans.append(Plan(setup, wishes, R[way], T[way], predicted, curve, own[way]))
    return plans


def merged(parts: Sequence[Part]) -> list[Part]:
    """The poses of each setup in one part."""
    setups = {id(setup): setup for setup, _, _ in parts}.values()
    by_setup = [[poses for other, *poses in parts if other is setup] for setup in setups]
    return [
        (setup, *(np.concatenate(part) for part in zip(*poses, strict=True)))
        for setup, poses in zip(setups, by_setup, strict=True)
    ]


def largest(scaled) -> tuple[float, float]:
    """The largest standard deviations of a translation, mm, and of a rotation, degrees, of a covariance (6, 6) in the
    units of `observability`."""
    C = scaled * HAND_PRECISION[:, None] * HAND_PRECISION
    mm, rad = (float(np.sqrt(np.linalg.eigvalsh(part)[-1])) for part in (C[:3, :3], C[3:, 3:]))
    return mm, float(np.degrees(rad))
