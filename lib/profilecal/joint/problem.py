"""All that was seen, with its noise, as one least-squares problem."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise, Systematic
from profilecal.joint.effects import Information, inflation, remove_common, remove_each
from profilecal.joint.observability import units_by_hand
from profilecal.joint.observations import Observations
from profilecal.joint.sharing import Sharing, level_variances, sharing
from profilecal.joint.state import State
from profilecal.joint.systematic import STEP, Change, considered
from profilecal.joint.terms import Term

CAUCHY = 2.385  # noise levels at which a residual's weight is a half: 95 % efficient on clean data (Rey 1983)


@dataclass(frozen=True)
class Moments:
    """What the data say at a state, and how well it fits."""

    normal: np.ndarray  # (B, n + 1, n + 1) normal equations [J r]ᵀ C⁻¹ [J r]
    loss: np.ndarray  # (B,)
    per_pose: list  # (B, P) each pose's χ² per residual, for each target


@dataclass(frozen=True)
class Effects:
    """How shared errors move the residuals over the noise, at one state."""

    rows: list  # for each target, (B, P, K, 6 + c) by the flange pose and by c systematic errors
    sharing: Sharing
    precision: np.ndarray  # (c,) of the systematic errors


class Problem:
    """Terms, one for each target, and their noise. `noise.profile_mm` must be known; it may be an array (B,).

    Residuals are distances in the scan plane, where the noise arises; or, `in_space`, distances in space, which exist
    for any pose and serve a search.
    """

    def __init__(
        self,
        observations: Sequence[Observations],
        noise: Noise,
        systematic: Systematic = Systematic(),  # noqa: B008
        in_space: bool = False,
    ):
        self.observations, self.noise, self.systematic = list(observations), noise, systematic
        self.terms = [Term(entry, in_space) for entry in self.observations]
        self.considered = considered([entry.target for entry in self.observations], systematic)
        self.changed = [self.changed_by(change) for change, _ in self.considered]  # the terms with each of these
        ends = np.cumsum([6, *(term.n for term in self.terms)])
        self.n = int(ends[-1])
        self.parts = [np.arange(*ends) for ends in pairwise(ends)]  # of the unknowns

    def with_noise(self, noise: Noise) -> "Problem":
        """The same measurements with other noise."""
        other = copy(self)
        other.noise = noise
        return other

    @property
    def has_effects(self) -> bool:
        """Whether residuals share any errors."""
        return self.noise.of_robot or bool(self.considered)

    @property
    def units(self) -> np.ndarray:
        """What one would know of each parameter (n,) by hand, mm and rad (`observability`)."""
        return units_by_hand([term.target for term in self.terms])

    def columns(self, index: int) -> np.ndarray:
        """Which of the n unknowns, and the residual as the last, a term's columns are."""
        return np.concatenate([np.arange(6), self.parts[index], [self.n]])

    def count(self) -> np.ndarray:
        """How many residuals, (1,) or (B,)."""
        return sum(term.counts().sum(axis=1) for term in self.terms)

    def freedoms(self) -> list[np.ndarray]:
        """How many residuals each pose (P,) of the first problem has, for each target, one at least."""
        return [np.maximum(term.counts()[0], 1) for term in self.terms]

    def counted(self, kept) -> int:
        """How many residuals the poses kept (P,) of each target have."""
        return sum(int((good * count).sum()) for good, count in zip(kept, self.freedoms(), strict=True))

    def linear(self, state: State, with_flange: bool = False) -> list:
        """Each term's residuals and derivatives (`terms.Linear`) over the noise."""
        pairs = zip(self.terms, state.placements, strict=True)
        linears = [term.linearise(state, p, with_flange) for term, p in pairs]
        for term, linear in zip(self.terms, linears, strict=True):
            term.over_noise(linear.columns, self.noise)
        return linears

    def residuals(self, state: State) -> list[np.ndarray]:
        """Each term's residuals (B, K, P), mm."""
        return [term.residuals(state, p)[:, 0] for term, p in zip(self.terms, state.placements, strict=True)]

    def effects(self, state: State) -> Effects | None:
        """What the shared errors do to the residuals at this state; None where there are none."""
        return self.effects_at(state) if self.has_effects else None

    def effects_at(self, state: State, tried: Sequence[Change] = ()) -> Effects:
        """What errors of the flange, and those considered, would do to the residuals at this state; and then those
        `tried`, of which nothing is known beforehand."""
        columns = [[linear.by_flange] for linear in self.linear(state, with_flange=True)]
        for changed in [*self.changed, *map(self.changed_by, tried)]:
            for rows, terms, placement in zip(columns, changed, state.placements, strict=True):
                plus, minus = (term.over_noise(term.residuals(state, placement), self.noise) for term in terms)
                rows.append((plus - minus) / (2 * STEP))
        rows = [np.nan_to_num(by_pose(np.concatenate(c, axis=1)), posinf=0, neginf=0) for c in columns]
        precision = np.array([size**-2.0 for _, size in self.considered] + [0.0] * len(tried))
        return Effects(rows, self.shared, precision)

    @cached_property
    def shared(self) -> Sharing:
        """Which profiles share errors of the flange."""
        return sharing(self.observations)

    def changed_by(self, change: Change) -> list[tuple[Term, Term]]:
        """The terms with a systematic error of plus and of minus `STEP`."""
        return [(Term(change.apply(o, STEP)), Term(change.apply(o, -STEP))) for o in self.observations]

    def moments(self, state: State, scale=None, weights=None, effects: Effects | None = None) -> Moments:
        """`scale` (B,): Cauchy's loss with that many noise levels as its unit; None: least squares. `weights`: one
        (B, P) or (P,) for each target. `effects`: from the state itself if None."""
        B = len(state.rotation)
        normal, loss, per_pose = np.zeros((B, self.n + 1, self.n + 1)), np.zeros(B), []
        grams, used, counts = [], [], []
        effects = effects or self.effects(state)
        for index, linear in enumerate(self.linear(state)):
            z = linear.columns
            count = z.shape[2] if linear.present is None else np.maximum(linear.present.sum(axis=1), 1)
            if effects:
                gram = gram_by_pose(effects.rows[index], z)
                own = self.square_of_each_pose(gram) / count
            else:
                own = np.einsum("bkp,bkp->bp", linear.residual, linear.residual) / count
            weight = None if weights is None else np.asarray(weights[index], dtype=float)
            if scale is not None:
                unit = (CAUCHY * scale[:, None]) ** 2
                loss += (count * (1 if weight is None else weight) * unit * np.log1p(own / unit)).sum(axis=1)
                weight = (1 if weight is None else weight) / (1 + own / unit)
            per_pose.append(own)
            if effects:
                grams.append(gram)
                counts.append(count)
                used.append(gram if weight is None else gram * np.broadcast_to(weight, own.shape)[..., None, None])
                continue
            if weight is not None:
                z *= np.sqrt(np.broadcast_to(weight, own.shape))[:, None, None]
            flat = z.reshape(B, z.shape[1], -1)
            columns = self.columns(index)
            normal[:, columns[:, None], columns] += flat @ np.swapaxes(flat, 1, 2)
        if effects:
            normal, common = self.without_effects(self.information(used, len(effects.precision)), effects)
            if common.shape[1]:
                pairs = zip(grams, counts, strict=True)
                per_pose = [self.square_of_each_pose(gram, common) / count for gram, count in pairs]
        if scale is None:
            loss = normal[:, -1, -1]
        return Moments(normal, loss, per_pose)

    def square_of_each_pose(self, gram, common=None) -> np.ndarray:
        """χ² (B, P) of each pose by itself, with all errors of the flange, from `gram_by_pose` (B, P, ., .), where the
        systematic errors are `common` (B, c), or none."""
        S = sum(level_variances(self.noise))
        residual = gram[..., -1:]
        if common is not None:
            residual = residual + gram[..., 6 : 6 + common.shape[1]] @ common[:, None, :, None]
        square = residual[..., -1, 0]
        if common is not None:
            square = square + (common[:, None] * residual[..., 6 : 6 + common.shape[1], 0]).sum(axis=-1)
        b = residual[..., :6, :]
        taken = np.swapaxes(b, -1, -2) @ (S[:, None] * np.linalg.solve(inflation(gram[..., :6, :6], S), b))
        return np.maximum(square - taken[..., 0, 0], 0)

    def information(self, grams, common: int) -> Information:
        """Of all profiles, from `gram_by_pose` of each target: n unknowns, `common` systematic errors, the residual."""
        size, B = self.n + common + 1, len(grams[0])
        normal, crossed = np.zeros((B, size, size)), []
        for index, gram in enumerate(grams):
            columns = np.r_[self.n + np.arange(common), self.columns(index)[:-1], size - 1]
            normal[:, columns[:, None], columns] += gram[..., 6:, 6:].sum(axis=1)
            B_own = np.zeros((*gram.shape[:2], 6, size))
            B_own[..., columns] = gram[..., :6, 6:]
            crossed.append(B_own)
        A = np.concatenate([gram[..., :6, :6] for gram in grams], axis=1)
        return Information(A, np.concatenate(crossed, axis=1), normal)

    def without_effects(self, information: Information, effects: Effects) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations (B, n + 1, n + 1) with all shared errors integrated out, and the systematic ones (B, c) that
        the residuals suggest."""
        normal = remove_each(information, effects.sharing.levels(self.noise))
        return remove_common(normal, self.n, effects.precision)

    def with_systematic(self, effects: Effects, linears, kept) -> np.ndarray:
        """Normal equations (n + c + 1, n + c + 1) of the unknowns, the systematic errors and the residual, from the
        poses kept (P,) of each target, with effects and `linear` at a state; errors of the flange are integrated out,
        and what one knows of the systematic ones is added."""
        triples = zip(effects.rows, linears, kept, strict=True)
        grams = [gram_by_pose(rows, linear.columns) * good[:, None, None] for rows, linear, good in triples]
        information = self.information(grams, len(effects.precision))
        normal = remove_each(information, effects.sharing.levels(self.noise))
        return normal[0] + np.diag(np.r_[np.zeros(self.n), effects.precision, 0.0])

    def without_systematic(self, state: State, kept) -> "Problem":
        """The problem of the data less the systematic errors that the poses kept (P,) of each target suggest at a state
        (a batch of one)."""
        if not self.considered:
            return self
        normal, observations = self.with_systematic(self.effects_at(state), self.linear(state), kept), self.observations
        _, common = remove_common(normal, self.n, np.zeros(len(self.considered)))
        for (change, _), size in zip(self.considered, common, strict=True):
            observations = [change.apply(o, size) for o in observations]
        return Problem(observations, self.noise, self.systematic)

    def move(self, state: State, step) -> State:
        """The state after a step (B, n)."""
        turned = Rotation.from_rotvec(step[:, 3:6]).as_matrix()
        shift = (state.rotation @ step[:, :3, None])[..., 0]
        parts = zip(self.terms, state.placements, self.parts, strict=True)
        placements = tuple(term.move(placement, step[:, part]) for term, placement, part in parts)
        return State(state.rotation @ turned, state.translation + shift, placements)

    def place(self, rotation, translation) -> State:
        """Sensor poses (B, 3, 3), (B, 3) with each target placed where they see it."""
        return State(rotation, translation, tuple(term.place(rotation, translation) for term in self.terms))


def by_pose(columns) -> np.ndarray:
    """(B, columns, K, P) as (B, P, K, columns)."""
    return np.ascontiguousarray(columns.transpose(0, 3, 2, 1))


def gram_by_pose(rows, columns) -> np.ndarray:
    """Inner products (B, P, ., .), pose by pose, of the columns of `Effects.rows`, then of a term's columns."""
    columns = by_pose(columns)
    both = np.concatenate([np.broadcast_to(rows, (len(columns), *rows.shape[1:])), columns], axis=-1)
    return np.swapaxes(both, -1, -2) @ both
