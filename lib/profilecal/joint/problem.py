"""All that was seen, with the scanner's noise, as one least-squares problem."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from profilecal.geometry.noise import Noise, Systematic, chi2_limit
from profilecal.geometry.observability import units_by_hand
from profilecal.geometry.poses import carry, rotations
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.prior import Perturbation, considered
from profilecal.joint.residuals import Residuals
from profilecal.targets.observations import Batch, PoseGroups, State, pose_groups

# precision, over that of a measurement by hand: it keeps matrices without rank
# invertible
NOTHING_KNOWN = 1e-8


@dataclass(frozen=True)
class Fit(Batch):
    """What the data say at B states, and how well these fit."""

    state: State
    normal: np.ndarray  # (B, n + 1, n + 1) normal equations [J r]ᵀ [J r]
    loss: np.ndarray  # (B,)
    per_pose: np.ndarray  # (B, profiles) each pose's χ² per residual

    @property
    def best_first(self) -> "Fit":
        """In the order of their losses, NaN last."""
        return self[np.argsort(self.loss)]


class Problem:
    """Residuals of each of the `Observations` over the scanner's noise, which is known:
    in the scan plane, where the noise arises; or, `in_space`, distances in space, which
    exist for any pose and serve a search. Errors of the robot are part of the `model`
    alone.
    """

    def __init__(
        self,
        observations,
        noise: Noise,
        systematic: Systematic | None = None,
        in_space: bool = False,
    ):
        self.observations, self.noise = list(observations), noise
        self.terms = [Residuals(entry, in_space) for entry in self.observations]
        self.considered = considered(
            [entry.target for entry in self.observations], systematic or Systematic()
        )
        # of residuals, in the first problem
        self.counts = np.concatenate([term.counts()[0] for term in self.terms])
        self.freedoms = np.maximum(self.counts, 1)
        ends = np.cumsum([6, *(term.n for term in self.terms)])
        self.n = int(ends[-1])
        self.parts = [np.arange(*ends) for ends in pairwise(ends)]  # of the unknowns

    @property
    def units(self) -> np.ndarray:
        """What one would know of each parameter (n,) by hand, mm and rad
        (`geometry.observability`).
        """
        return units_by_hand([term.target for term in self.terms])

    @cached_property
    def groups(self) -> PoseGroups:
        """Which profiles share errors of the flange."""
        return pose_groups(self.observations)

    def typical(self, fit: Fit) -> np.ndarray:
        """How many noise levels large the residuals of most poses are, (B,), from
        medians: bad poses do not count.
        """
        ratio = fit.per_pose * (self.freedoms / chi2_limit(0.5, self.freedoms))
        return np.sqrt(
            np.mean([np.median(own, axis=0) for own in self.split(ratio.T)], axis=0)
        )

    def split(self, profiles) -> list[np.ndarray]:
        """What is of all profiles (profiles, ...), for each target (P, ...)."""
        return np.split(profiles, np.cumsum([term.P for term in self.terms])[:-1])

    def linear(self, state: State) -> list[np.ndarray]:
        """Each target's residuals and derivatives (`Residuals.linearise`) over the
        noise.
        """
        pairs = zip(self.terms, state.placements, strict=True)
        return [
            term.over_noise(term.linearise(state, placement), self.noise)
            for term, placement in pairs
        ]

    def moments(self, state: State, scale=None, weights=None) -> Fit:
        """`scale` (B,): Cauchy's loss with that many noise levels as its unit; None:
        least squares. `weights`: one (B, P) or (P,) for each target.
        """
        # noise levels at which a pose's weight is a half: little is lost on clean data
        # (notebook 42)
        cauchy = 2.385
        B = len(state.rotation)
        normal, loss, per_pose = np.zeros((B, self.n + 1, self.n + 1)), np.zeros(B), []
        for index, z in enumerate(self.linear(state)):
            count = np.maximum(self.terms[index].counts(), 1)
            own = np.einsum("bkp,bkp->bp", z[:, -1], z[:, -1]) / count
            weight = np.broadcast_to(
                1.0 if weights is None else weights[index], own.shape
            )
            if scale is not None:
                unit = (cauchy * scale[:, None]) ** 2
                loss += (count * weight * unit * np.log1p(own / unit)).sum(axis=1)
                weight = weight / (1 + own / unit)
            per_pose.append(own)
            if weights is not None or scale is not None:
                z *= np.sqrt(weight)[:, None, None]
            flat = z.reshape(B, z.shape[1], -1)
            to = np.r_[:6, self.parts[index], self.n]
            normal[:, to[:, None], to] += flat @ flat.mT
        if scale is None:
            loss = normal[:, -1, -1]
        return Fit(state, normal, loss, np.concatenate(per_pose, axis=1))

    def columns_in_mm(
        self, state: State, tried: Sequence[Perturbation] = ()
    ) -> list[np.ndarray]:
        """Each target's residuals (first problem's) at a state, a batch of one, and
        their derivatives by all unknowns, by the errors considered and those `tried`,
        and by the flange pose: (1, n + c + d + 7, K, P). These are taken where the
        state has the points: at the noisy ones they follow the noise, and all lengths
        look too small.
        """
        found, errors = [], [*(error for error, _ in self.considered), *tried]
        total = self.n + len(errors)
        for part, term, placement in zip(
            self.parts, self.terms, state.placements, strict=True
        ):
            measured = term.linearise(state, placement)
            there = term.on_target(measured)
            at = there.linearise(state, placement, with_flange=True)
            z = np.zeros((1, total + 7, *at.shape[2:]))
            z[:, :6], z[:, part] = at[:, :6], at[:, 6 : 6 + term.n]
            for k, error in enumerate(errors, self.n):
                z[:, k] = there.by_error(error, state, placement, at)
            z[:, total], z[:, total + 1 :] = measured[:, -1], at[:, -6:]
            found.append(np.nan_to_num(z, copy=False, posinf=0, neginf=0))
        return found

    def model(
        self, state: State, names=(), tried: Sequence[Perturbation] = (), columns=None
    ) -> LinearModel:
        """The linear model at a state, a batch of one, with errors of the robot of
        these `names`, entries of `Noise`. Of the errors `tried` nothing is known
        beforehand. `columns`: as `columns_in_mm` has them, if known.
        """
        columns = columns or self.columns_in_mm(state, tried)
        parts = [
            term.over_noise(z.copy(), self.noise)[0]
            for term, z in zip(self.terms, columns, strict=True)
        ]
        K = max(part.shape[1] for part in parts)
        parts = [
            np.pad(part, [(0, 0), (0, K - part.shape[1]), (0, 0)]) for part in parts
        ]
        whole = np.concatenate(parts, axis=2).T.copy()  # (profiles, K, n + 7)
        sizes = [size for _, size in self.considered]
        unknown = np.r_[
            NOTHING_KNOWN / self.units**2,
            np.power(sizes, -2.0),
            np.full(len(tried), NOTHING_KNOWN),
        ]
        return LinearModel(
            whole[..., -6:],
            whole[..., :-6],
            self.counts,
            self.groups,
            names,
            np.diag(unknown),
        )

    def rms_mm(self, columns, x, profiles) -> float:
        """Root mean square of the residuals of some profiles (profiles,) after a step x
        (n + c,) from the state that `columns_in_mm` are of, less the errors considered.
        """
        x, square = np.append(x, 1.0), 0.0
        for z, chosen in zip(columns, self.split(profiles), strict=True):
            left = np.tensordot(x, z[0, : len(x), :, chosen], (0, 1))
            square += np.sum(left**2)
        return float(np.sqrt(square / self.counts[profiles].sum()))

    def move(self, state: State, step) -> State:
        """The state after a step (B, n)."""
        parts = zip(self.terms, state.placements, self.parts, strict=True)
        placements = tuple(
            term.move(placement, step[:, part]) for term, placement, part in parts
        )
        shifted = carry(state.rotation, state.translation, step[:, :3])
        return State(state.rotation @ rotations(step[:, 3:6]), shifted, placements)

    def place(self, rotation, translation) -> State:
        """Sensor poses (B, 3, 3), (B, 3) with each target placed where they see them."""
        return State(
            rotation,
            translation,
            tuple(term.place(rotation, translation) for term in self.terms),
        )
