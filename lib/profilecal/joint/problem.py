"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise, variances
from profilecal.joint.observability import POSE_UNITS
from profilecal.joint.observations import Observations
from profilecal.joint.state import State
from profilecal.joint.terms import Term
from profilecal.joint.whitening import Whitening, _remove

CAUCHY = 2.385  # noise levels at which a residual's weight is a half: 95 % efficient on clean data (Rey 1983)


class Problem:
    """All terms with their noise. `noise.profile_mm` must be known here; it may be an array (B,)."""

    def __init__(self, observations: Sequence[Observations], noise: Noise):
        self.terms = [Term(entry, noise) for entry in observations]
        self.sigma = np.asarray(noise.profile_mm, dtype=float).reshape(-1, 1, 1)
        self.of_pose = variances(noise.position_mm, noise.orientation_deg)
        self.of_group = variances(noise.group_position_mm, noise.group_orientation_deg)
        self.has_group = bool(self.of_group.any())
        self.has_robot = bool(self.of_pose.any()) or self.has_group
        self.n = 6 + sum(term.n for term in self.terms)

    def count(self) -> np.ndarray:
        """How many residuals, (1,) or (B,)."""
        total = 0
        for term in self.terms:
            rows = {"edge": 2, "disk": 4, "point": 3}.get(term.module.__name__.rsplit(".", 1)[1])
            if term.present is None:
                total = total + np.array([(rows or len(term.seen)) * term.P])
            else:
                total = total + term.present.sum(axis=(0, 2)) * ((rows or len(term.seen)) // len(term.seen))
        return total

    def whitening(self, state: State) -> list:
        """What robot errors do to each term's residuals at this state; None where there are none."""
        if not self.has_robot:
            return [None] * len(self.terms)
        pairs = zip(self.terms, state.placements, strict=True)
        errors = [
            term.in_units_of_noise(term.linearise(state, p, True, with_robot=True)[0][:, -6:], self.sigma)
            for term, p in pairs
        ]
        return [
            Whitening(np.nan_to_num(E, posinf=0, neginf=0), self.of_pose, self.of_group, term.group)
            for E, term in zip(errors, self.terms, strict=True)
        ]

    def moments(self, state: State, scale=None, in_plane: bool = True, weights=None, whitening=None):
        """(M, loss, own): normal equations [J r]ᵀ C⁻¹ [J r], (B, n + 1, n + 1), the loss (B,), and each pose's own
        χ² per residual, one (B, P) for each target.

        `scale` (B,): Cauchy's loss with that many noise levels as its unit; None: least squares. `weights`: one
        (B, P) or (P,) for each target. `whitening`: from the state itself if None.
        """
        B = len(state.rotation)
        total, loss, per_pose = np.zeros((B, self.n + 1, self.n + 1)), np.zeros(B), []
        whitening = whitening or self.whitening(state)
        start = 6
        for index, (term, placement) in enumerate(zip(self.terms, state.placements, strict=True)):
            z, present = term.linearise(state, placement, in_plane)
            count = z.shape[2] if present is None else np.maximum(present.sum(axis=1), 1)
            weight = None if weights is None else np.asarray(weights[index], dtype=float)
            z = term.in_units_of_noise(z, self.sigma, in_plane)
            white = whitening[index]
            r = z[:, -1:] if white is None else _remove(z[:, -1:], *white.marginal)
            own = np.einsum("bnkp,bnkp->bp", r, r) / count
            if scale is not None:
                unit = (CAUCHY * scale[:, None]) ** 2
                loss += (count * (1 if weight is None else weight) * unit * np.log1p(own / unit)).sum(axis=1)
                weight = (1 if weight is None else weight) / (1 + own / unit)
            if white is not None and white.pose:
                z = _remove(z, *white.pose)
            root_weight = 1.0
            if weight is not None:
                root_weight = np.sqrt(np.broadcast_to(weight, own.shape))[:, None, None]
                z *= root_weight
            if white is not None and white.shared is not None:
                z = white.groups(z, root_weight)
            flat = z.reshape(B, z.shape[1], -1)
            M = flat @ np.swapaxes(flat, 1, 2)
            if scale is None:
                loss += M[:, -1, -1]
            per_pose.append(own)
            columns = np.r_[0:6, start : start + term.n, self.n]
            total[:, columns[:, None], columns] += M
            start += term.n
        return total, loss, per_pose

    def move(self, state: State, step) -> State:
        """The state after a step (B, n)."""
        turned = Rotation.from_rotvec(step[:, 3:6]).as_matrix()
        placements, start = [], 6
        for term, (place, direction) in zip(self.terms, state.placements, strict=True):
            points, turning = term.moving((place, direction))
            q = points.shape[1]
            place = place + np.einsum("bj,bja->ba", step[:, start : start + q], points)
            if term.turns:
                direction = direction + np.einsum("bj,bja->ba", step[:, start + q : start + term.n], turning)
                direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
            placements.append((place, direction))
            start += term.n
        shift = np.einsum("bij,bj->bi", state.rotation, step[:, :3])
        return State(state.rotation @ turned, state.translation + shift, tuple(placements))

    def place(self, rotation, translation) -> State:
        """Sensor poses (B, 3, 3), (B, 3) with each target placed where they see it."""
        placements = []
        for term in self.terms:
            B, m, P = len(rotation), len(term.seen), term.P
            x, z = (np.swapaxes(term.seen[:, i], 0, 1).reshape(-1, 1, m * P) for i in (0, 1))  # (B|1, 1, mP)
            seen = rotation[:, :, :1] * x + rotation[:, :, 2:] * z + translation[:, :, None]
            seen = seen.reshape(B, 3, m, P) + term.shift[:, :, None]
            base = np.einsum("nabp,nbmp->npma", term.turn.reshape(-1, 3, 3, P), seen)
            if term.present is not None:
                base = _fill(base, np.moveaxis(term.present, 0, 2))
            placements.append(term.module.place(base.reshape(B, -1, 3), term.size))
        return State(rotation, translation, tuple(placements))


def _fill(points, present):
    """Points (B, P, m, 3) with the missing ones put into the middle of the others."""
    present = present[..., None]
    middle = (points * present).sum(axis=(1, 2), keepdims=True) / present.sum(axis=(1, 2), keepdims=True)
    return np.where(present, points, middle)


def units_by_hand(problem: Problem) -> np.ndarray:
    """What one would know of each parameter (n,) by hand: `observability.POSE_UNITS`, and the same for placements."""
    mm, rad = POSE_UNITS[0], POSE_UNITS[3]
    return np.concatenate([POSE_UNITS, *([mm] * (t.n - 2 * t.turns) + [rad] * (2 * t.turns) for t in problem.terms)])
