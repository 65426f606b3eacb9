"""All that was seen, with its noise, as one least-squares problem."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise, variances
from profilecal.joint.observability import POSE_UNITS
from profilecal.joint.observations import Observations
from profilecal.joint.state import State
from profilecal.joint.terms import Term
from profilecal.joint.whitening import Whitening

CAUCHY = 2.385  # noise levels at which a residual's weight is a half: 95 % efficient on clean data (Rey 1983)


@dataclass(frozen=True)
class Moments:
    """What the data say at a state, and how well it fits."""

    normal: np.ndarray  # (B, n + 1, n + 1) normal equations [J r]ᵀ C⁻¹ [J r]
    loss: np.ndarray  # (B,)
    per_pose: list  # (B, P) each pose's χ² per residual, for each target


class Problem:
    """Terms, one for each target, and their noise. `noise.profile_mm` must be known; it may be an array (B,).

    Residuals are distances in the scan plane, where the noise arises; or, `in_space`, distances in space, which exist
    for any pose and serve a search.
    """

    def __init__(self, observations: Sequence[Observations], noise: Noise, in_space: bool = False):
        self.observations, self.noise = list(observations), noise
        self.terms = [Term(entry, noise, in_space) for entry in self.observations]
        self.sigma = np.asarray(noise.profile_mm, dtype=float).reshape(-1, 1, 1)
        self.of_pose = variances(noise.position_mm, noise.orientation_deg)
        self.of_group = variances(noise.group_position_mm, noise.group_orientation_deg)
        self.has_robot = bool((self.of_pose + self.of_group).any())
        ends = np.cumsum([6, *(term.n for term in self.terms)])
        self.n = int(ends[-1])
        self.parts = [np.arange(*ends) for ends in pairwise(ends)]  # of the unknowns

    @property
    def units(self) -> np.ndarray:
        """What one would know of each parameter (n,) by hand, mm and rad (`observability`)."""
        return np.concatenate([POSE_UNITS, *(term.units for term in self.terms)])

    def columns(self, index: int) -> np.ndarray:
        """Which of the n unknowns, and the residual as the last, a term's columns are."""
        return np.r_[0:6, self.parts[index], self.n]

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
        return [term.over_noise(term.linearise(state, p, with_flange), self.sigma) for term, p in pairs]

    def residuals(self, state: State) -> list[np.ndarray]:
        """Each term's residuals (B, K, P), mm."""
        pairs = zip(self.terms, state.placements, strict=True)
        return [term.linearise(state, p).residual for term, p in pairs]

    def whitening(self, state: State) -> list[Whitening] | None:
        """What robot errors do to each term's residuals at this state; None where there are none."""
        if not self.has_robot:
            return None
        return [
            Whitening(np.nan_to_num(linear.by_flange, posinf=0, neginf=0), self.of_pose, self.of_group, term.group)
            for linear, term in zip(self.linear(state, with_flange=True), self.terms, strict=True)
        ]

    def moments(self, state: State, scale=None, weights=None, whitening=None) -> Moments:
        """`scale` (B,): Cauchy's loss with that many noise levels as its unit; None: least squares. `weights`: one
        (B, P) or (P,) for each target. `whitening`: from the state itself if None."""
        B = len(state.rotation)
        normal, loss, per_pose = np.zeros((B, self.n + 1, self.n + 1)), np.zeros(B), []
        whitening = whitening or self.whitening(state)
        for index, linear in enumerate(self.linear(state)):
            z, white = linear.columns, whitening[index] if whitening else None
            count = z.shape[2] if linear.present is None else np.maximum(linear.present.sum(axis=1), 1)
            r = white.each_pose_alone(linear.residual) if white else linear.residual
            own = np.einsum("bkp,bkp->bp", r, r) / count
            weight = None if weights is None else np.asarray(weights[index], dtype=float)
            if scale is not None:
                unit = (CAUCHY * scale[:, None]) ** 2
                loss += (count * (1 if weight is None else weight) * unit * np.log1p(own / unit)).sum(axis=1)
                weight = (1 if weight is None else weight) / (1 + own / unit)
            z, root_weight = white.poses(z) if white else z, 1.0
            if weight is not None:
                root_weight = np.sqrt(np.broadcast_to(weight, own.shape))[:, None, None]
                z *= root_weight
            z = white.groups(z, root_weight) if white else z
            flat = z.reshape(B, z.shape[1], -1)
            M = flat @ np.swapaxes(flat, 1, 2)
            if scale is None:
                loss += M[:, -1, -1]
            per_pose.append(own)
            columns = self.columns(index)
            normal[:, columns[:, None], columns] += M
        return Moments(normal, loss, per_pose)

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
