"""One target's residuals and their derivatives, arranged for speed."""

from copy import copy

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import cross, dot, rotations
from profilecal.joint.observations import Observations, State


class Residuals:
    """Poses are the last axis, a batch (B, or 1 for all) is the first."""

    def __init__(self, observations: Observations, in_space: bool = False):
        self.target, self.sizes = observations.target, observations.sizes
        self.in_space, self.eye_to_hand = in_space, observations.eye_to_hand
        free = self.target.shifts, self.target.turns
        self.free_shifts, self.free_turns = (["xyz".index(axis) for axis in axes] for axes in free)
        self.n = len(self.free_shifts) + len(self.free_turns)
        self.P, self.m = np.shape(observations.points)[-3:-1]
        R = np.asarray(observations.R_flange, float).reshape(-1, self.P, 3, 3)
        T = np.asarray(observations.T_flange, float).reshape(-1, self.P, 3)
        points = np.asarray(observations.points, float).reshape(-1, self.P, self.m, 2)
        self.R_flange = np.ascontiguousarray(R.transpose(0, 2, 3, 1)).reshape(-1, 3, 3 * self.P)  # (B|1, 3, 3P)
        self.T_in_flange = (R.mT @ T[..., None])[..., 0].mT  # Rᵀ T, (B|1, 3, P)
        seen = np.ascontiguousarray(points.transpose(3, 0, 2, 1))  # x and z, (2, B|1, m, P)
        there = np.isfinite(seen).all(axis=0)
        self.present = None if there.all() else there  # (B|1, m, P)
        self.seen = np.where(there, seen, 0.0)
        self.group = observations.labels
        self.sd = self.whiten = None  # of points, over the noise (B|1, m, P); of a pose's residuals (B|1, K, K, P)
        if observations.covariance is None:
            return
        covariance = np.asarray(observations.covariance, float)
        if observations.on_curve:
            self.sd = np.sqrt(covariance.reshape(-1, self.P, self.m).mT)
            return
        covariance = covariance.reshape(-1, self.P, 2 * self.m, 2 * self.m)
        of_x_and_z = np.diagonal(covariance, axis1=2, axis2=3).reshape(-1, self.P, self.m, 2)
        self.sd = np.sqrt(of_x_and_z.mean(axis=3)).mT
        self.whiten = np.moveaxis(np.linalg.inv(np.linalg.cholesky(covariance)), 1, -1)

    def counts(self) -> np.ndarray:
        """How many residuals each pose has, (B|1, P)."""
        points = np.full((1, self.P), self.m) if self.present is None else self.present.sum(axis=1)
        return points * self.target.rows

    def _look(self, state: State, placement) -> tuple:
        """Where the sensor sees the target's origin and axes, by components, and what `Target.residual` says there."""
        vectors = np.concatenate([placement[0][:, None], placement[1].mT], axis=1)  # origin and axes
        local = (vectors @ self.R_flange).reshape(len(vectors), 4, 3, self.P)  # in the flange frames
        local[:, 0] -= self.T_in_flange + state.translation[:, :, None]
        local = state.rotation.mT[:, None] @ local  # in the sensor frames
        origin, *axes = ([local[:, j, None, i] for i in range(3)] for j in range(4))
        residual = self.target.residual_in_space if self.in_space else self.target.residual
        with np.errstate(divide="ignore", invalid="ignore"):
            return origin, axes, *residual(origin, axes, self.seen, self.sizes)

    def linearise(self, state: State, placement, with_flange: bool = False) -> np.ndarray:
        """K residuals of each of P poses and their derivatives, mm and rad, zero where no point is: (B, columns, K, P)
        by the sensor pose (6) and the target's frame (n), then the residual; and, if asked for, by position and
        orientation of the flange (6), about the sensor's axes."""
        origin, axes, r, force, torque = self._look(state, placement)
        B = len(state.rotation)
        rows = len(r)
        by_point = np.empty((B, 7 + self.n + 6 * with_flange, self.m, rows, self.P))
        for k in range(rows):
            column = by_point[:, :, :, k]
            lever = cross(origin, force[k])
            for j in range(3):
                column[:, j] = -force[k][j]
                column[:, 3 + j] = -lever[j] if torque is None else -(lever[j] + torque[k][j])
            for j, axis in enumerate(self.free_shifts, 6):
                column[:, j] = dot(force[k], axes[axis])
            for j, axis in enumerate(self.free_turns, 6 + len(self.free_shifts)):
                column[:, j] = dot(torque[k], axes[axis])
            column[:, 6 + self.n] = r[k]
        z = by_point.reshape(B, -1, self.m * rows, self.P)
        if with_flange:
            arm = state.translation[:, :, None] + (self.T_in_flange if self.eye_to_hand else 0)  # from flange to sensor
            arm = np.moveaxis(state.rotation.mT @ arm, 1, 0)[:, :, None]  # (3, B, 1, P)
            z[:, -6:-3] = z[:, :3]
            z[:, -3:] = z[:, 3:6] + np.stack(cross(arm, np.moveaxis(z[:, :3], 1, 0)), axis=1)
        if self.present is not None:
            z *= np.repeat(self.present, rows, axis=1)[:, None]
        return z

    def with_sizes(self, sizes) -> "Residuals":
        """Those of a target with other lengths, mm."""
        other = copy(self)
        other.sizes = tuple(sizes)
        return other

    def by_point(self, columns) -> np.ndarray:
        """The derivatives (2, 1, m, rows, P) of each point's residuals, of a batch of one, by its own x and z: what
        moves the point alone moves its residuals as what moves the whole scanner."""
        return columns[0, [0, 2]].reshape(2, 1, self.m, -1, self.P)

    def on_target(self, columns) -> "Residuals":
        """Those of points where the state of `columns` has them on the target. Slopes of residuals have length one."""
        r = columns[:, 6 + self.n].reshape(len(columns), self.m, -1, self.P)
        other = copy(self)
        other.seen = self.seen - np.sum(self.by_point(columns) * r, axis=3)
        return other

    def over_noise(self, z, noise: Noise) -> np.ndarray:
        """Columns (B, columns, K, P), changed in place, over the scanner's noise, and as precise as each point is."""
        z /= np.reshape(noise.profile_mm, (-1, 1, 1, 1))
        row_sd = np.array(self.target.residual_sd(noise))
        if not self.in_space and (row_sd != 1).any():
            z /= np.tile(row_sd, self.m)[:, None]
        if self.whiten is not None and not self.in_space:
            z[:] = np.einsum("bijp,bcjp->bcip", self.whiten, z)
        elif self.sd is not None:
            z /= np.repeat(self.sd, z.shape[2] // self.m, axis=1)[:, None]
        return z

    def move(self, placement, step):
        """A placement after a step (B, n) of its free shifts and turns."""
        origin, axes = placement
        shifted = np.zeros((len(step), 3))
        shifted[:, self.free_shifts] = step[:, : len(self.free_shifts)]
        origin = origin + (axes @ shifted[..., None])[..., 0]
        if not self.free_turns:
            return origin, axes
        turned = np.zeros((len(step), 3))
        turned[:, self.free_turns] = step[:, len(self.free_shifts) :]
        return origin, axes @ rotations(turned)

    def place(self, rotation, translation):
        """The target's frame where sensor poses (B, 3, 3), (B, 3) see it: origin (B, 3) and axes (B, 3, 3)."""
        B, (x, z) = len(rotation), self.seen.reshape(2, -1, 1, self.m * self.P)
        seen = rotation[:, :, :1] * x + rotation[:, :, 2:] * z + translation[:, :, None]
        seen = seen.reshape(B, 3, self.m, self.P) + self.T_in_flange[:, :, None]
        # R_flange has base (a) and flange (b) components, then poses
        points = np.einsum("nabp,nbmp->npma", self.R_flange.reshape(-1, 3, 3, self.P), seen)
        if self.present is not None:  # the missing ones go into the middle of the others
            there = np.moveaxis(self.present, 2, 1)[..., None]
            middle = (points * there).sum(axis=(1, 2), keepdims=True) / there.sum(axis=(1, 2), keepdims=True)
            points = np.where(there, points, middle)
        origin, axes, _ = self.target.fit(points.reshape(B, -1, 3))
        return origin, axes
