"""All that was seen, with the scanner's noise, as one least-squares problem."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise, Systematic, chi2_limit
from profilecal.joint.linear_model import Linearised, LinearModel
from profilecal.joint.observability import units_by_hand
from profilecal.joint.observations import Batch, Perturbation, PoseGroups, State, considered, derivative, pose_groups
from profilecal.joint.residuals import Residuals

NOTHING_KNOWN = 1e-8  # precision, over that of a measurement by hand: it keeps matrices without rank invertible


@dataclass(frozen=True)
class Fit(Batch):
    """What the data say at B states, and how well these fit."""

    state: State
    normal: np.ndarray  # (B, n + 1, n + 1) normal equations [J r]ᵀ [J r]
    loss: np.ndarray  # (B,)
    per_pose: tuple  # (B, P) each pose's χ² per residual, for each target


class Problem:
    """Residuals of each of the `Observations` over the scanner's noise, which is known and may be an array (B,): in the
    scan plane, where the noise arises; or, `in_space`, distances in space, which exist for any pose and serve a search.
    Errors of the robot are part of the `model` alone."""

    def __init__(self, observations, noise: Noise, systematic: Systematic | None = None, in_space: bool = False):
        self.observations, self.noise = list(observations), noise
        self.terms = [Residuals(entry, in_space) for entry in self.observations]
        self.considered = considered([entry.target for entry in self.observations], systematic or Systematic())
        ends = np.cumsum([6, *(term.n for term in self.terms)])
        self.n = int(ends[-1])
        self.parts = [np.arange(*ends) for ends in pairwise(ends)]  # of the unknowns

    @property
    def units(self) -> np.ndarray:
        """What one would know of each parameter (n,) by hand, mm and rad (`observability`)."""
        return units_by_hand([term.target for term in self.terms])

    @cached_property
    def groups(self) -> PoseGroups:
        """Which profiles share errors of the flange."""
        return pose_groups(self.observations)

    @property
    def precision(self) -> np.ndarray:
        """What is known beforehand: nothing of the n unknowns, and about how large the errors considered are."""
        return np.diag(np.concatenate([NOTHING_KNOWN / self.units**2, [size**-2.0 for _, size in self.considered]]))

    def count(self) -> np.ndarray:
        """How many residuals, (1,) or (B,)."""
        return sum(term.counts().sum(axis=1) for term in self.terms)

    def freedoms(self) -> list[np.ndarray]:
        """How many residuals each pose (P,) of the first problem has, for each target, one at least."""
        return [np.maximum(term.counts()[0], 1) for term in self.terms]

    def typical(self, fit: Fit) -> np.ndarray:
        """How many noise levels large the residuals of most poses are, (B,), from medians: bad poses do not count."""
        pairs = zip(fit.per_pose, self.freedoms(), strict=True)
        return np.sqrt(np.mean([np.median(own * (k / chi2_limit(0.5, k)), axis=1) for own, k in pairs], axis=0))

    def split(self, profiles) -> list[np.ndarray]:
        """What is of all profiles (profiles, ...), for each target (P, ...)."""
        return np.split(profiles, np.cumsum([term.P for term in self.terms])[:-1])

    def linear(self, state: State) -> list[np.ndarray]:
        """Each target's residuals and derivatives (`Residuals.linearise`) over the noise."""
        pairs = zip(self.terms, state.placements, strict=True)
        return [term.over_noise(term.linearise(state, placement), self.noise) for term, placement in pairs]

    def residuals(self, state: State) -> list[np.ndarray]:
        """Each target's residuals (B, K, P), mm."""
        return [term.linearise(state, p)[:, -1] for term, p in zip(self.terms, state.placements, strict=True)]

    def moments(self, state: State, scale=None, weights=None) -> Fit:
        """`scale` (B,): Cauchy's loss with that many noise levels as its unit; None: least squares. `weights`: one
        (B, P) or (P,) for each target."""
        cauchy = 2.385  # noise levels at which a pose's weight is a half: little is lost on clean data (notebook 42)
        B = len(state.rotation)
        normal, loss, per_pose = np.zeros((B, self.n + 1, self.n + 1)), np.zeros(B), []
        for index, z in enumerate(self.linear(state)):
            count = np.maximum(self.terms[index].counts(), 1)
            own = np.einsum("bkp,bkp->bp", z[:, -1], z[:, -1]) / count
            weight = None if weights is None else np.asarray(weights[index], dtype=float)
            if scale is not None:
                unit = (cauchy * scale[:, None]) ** 2
                loss += (count * (1 if weight is None else weight) * unit * np.log1p(own / unit)).sum(axis=1)
                weight = (1 if weight is None else weight) / (1 + own / unit)
            per_pose.append(own)
            if weight is not None:
                z *= np.sqrt(np.broadcast_to(weight, own.shape))[:, None, None]
            flat = z.reshape(B, z.shape[1], -1)
            to = np.concatenate([np.arange(6), self.parts[index], [self.n]])
            normal[:, to[:, None], to] += flat @ np.swapaxes(flat, 1, 2)
        if scale is None:
            loss = normal[:, -1, -1]
        return Fit(state, normal, loss, tuple(per_pose))

    def columns_in_mm(self, state: State, tried: Sequence[Perturbation] = ()) -> list[np.ndarray]:
        """Each target's residuals (first problem's) at a state, a batch of one, and their derivatives by all unknowns,
        by the errors considered and those `tried`, and by the flange pose: (1, n + c + d + 7, K, P). These are taken
        where the state has the points: at the noisy ones they follow the noise, and all lengths look too small."""
        found, errors = [], [*(error for error, _ in self.considered), *tried]
        total = self.n + len(errors)
        targets = zip(self.parts, self.terms, self.observations, state.placements, strict=True)
        for part, term, observed, placement in targets:
            measured = term.linearise(state, placement)
            there = term.on_target(measured)
            at = there.linearise(state, placement, with_flange=True)
            z = np.zeros((1, total + 7, *at.shape[2:]))
            z[:, :6], z[:, part] = at[:, :6], at[:, 6 : 6 + term.n]
            for k, error in enumerate(errors, self.n):
                z[:, k] = derivative(error, state, placement, observed, there, at)
            z[:, total], z[:, total + 1 :] = measured[:, -1], at[:, -6:]
            found.append(np.nan_to_num(z, copy=False, posinf=0, neginf=0))
        return found

    def model(self, state: State, names=(), tried: Sequence[Perturbation] = (), columns=None) -> LinearModel:
        """The linear model at a state, a batch of one, with errors of the robot of these `names`, entries of `Noise`.
        Of the errors `tried` nothing is known beforehand. `columns`: as `columns_in_mm` has them, if known."""
        targets = []
        for term, z in zip(self.terms, columns or self.columns_in_mm(state, tried), strict=True):
            by_profile = np.ascontiguousarray(term.over_noise(z.copy(), self.noise)[0].transpose(2, 1, 0))
            targets.append(Linearised(by_profile[..., -6:], by_profile[..., :-6], term.counts()[0]))
        precision = block_diag(self.precision, NOTHING_KNOWN * np.eye(len(tried)))
        return LinearModel(targets, self.groups, names, precision)

    def rms_mm(self, state: State, x, profiles, columns=None) -> float:
        """Root mean square of the residuals of some profiles (profiles,) after a step x (n + c,) from a state, less the
        errors considered. `columns`: as `columns_in_mm` has them, if known."""
        x, square, count = np.append(x, 1.0), 0.0, 0
        for term, z, chosen in zip(self.terms, columns or self.columns_in_mm(state), self.split(profiles), strict=True):
            left = np.tensordot(x, z[0, : len(x), :, chosen], (0, 1))
            square, count = square + np.sum(left**2), count + term.counts()[0][chosen].sum()
        return float(np.sqrt(square / count))

    def move(self, state: State, step) -> State:
        """The state after a step (B, n)."""
        turned = Rotation.from_rotvec(step[:, 3:6]).as_matrix()
        shift = (state.rotation @ step[:, :3, None])[..., 0]
        parts = zip(self.terms, state.placements, self.parts, strict=True)
        placements = tuple(term.move(placement, step[:, part]) for term, placement, part in parts)
        return State(state.rotation @ turned, state.translation + shift, placements)

    def place(self, rotation, translation) -> State:
        """Sensor poses (B, 3, 3), (B, 3) with each target placed where they see them."""
        return State(rotation, translation, tuple(term.place(rotation, translation) for term in self.terms))
