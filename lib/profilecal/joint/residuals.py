"""One target's residuals and their derivatives, arranged for speed."""

from copy import copy

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import carry, cross, dot, inverse, rotations
from profilecal.joint.prior import Perturbation
from profilecal.targets.observations import Observations, State


class Residuals:
    """Poses are the last axis, a batch (B, or 1 for all) is the first."""

    def __init__(self, observations: Observations, in_space: bool = False):
        self.observed, self.in_space = observations, in_space
        self.target, self.sizes = observations.target, observations.sizes
        # of three shifts and three turns
        self.free = ["xyz".index(axis) for axis in self.target.shifts]
        self.free += [3 + "xyz".index(axis) for axis in self.target.turns]
        self.n = len(self.free)
        _, self.P, self.m, _ = observations.points.shape
        R, T, covariance = (
            observations.R_flange,
            observations.T_flange,
            observations.covariance,
        )
        # (B|1, 3, 3P)
        self.R_flange = R.transpose(0, 2, 3, 1).reshape(-1, 3, 3 * self.P)
        self.T_in_flange = -inverse(R, T)[1].mT  # Rᵀ T, (B|1, 3, P)
        # x and z, (2, B|1, m, P)
        seen = observations.points.transpose(3, 0, 2, 1).copy()
        self.present = np.isfinite(seen).all(axis=0)  # (B|1, m, P)
        self.seen = np.where(self.present, seen, 0.0)
        # of points, over the noise (B|1, m, P); of a pose's residuals (B|1, K, K, P)
        self.sd, self.whiten = np.ones((1, self.m, self.P)), None
        if covariance is None:
            return
        if observations.on_curve:
            self.sd = np.sqrt(covariance.mT)
        elif in_space:
            of_x_and_z = np.diagonal(covariance, axis1=2, axis2=3).reshape(
                -1, self.P, self.m, 2
            )
            self.sd = np.sqrt(of_x_and_z.mean(axis=3)).mT
        else:
            self.whiten = np.moveaxis(
                np.linalg.inv(np.linalg.cholesky(covariance)), 1, -1
            )

    def counts(self) -> np.ndarray:
        """How many residuals each pose has, (B|1, P)."""
        return self.present.sum(axis=1) * self.target.rows

    def linearise(
        self, state: State, placement, with_flange: bool = False
    ) -> np.ndarray:
        """K residuals of each of P poses and their derivatives, mm and rad, zero where
        no point is: (B, columns, K, P) by the sensor pose (6) and the target's frame
        (n), then the residual; and, if asked for, by position and orientation of the
        flange (6), about the sensor's axes.
        """
        B = len(state.rotation)
        # the target's origin and axes
        vectors = np.concatenate([placement[0][:, None], placement[1].mT], axis=1)
        # in the flange frames
        local = (vectors @ self.R_flange).reshape(B, 4, 3, self.P)
        local[:, 0] -= self.T_in_flange + state.translation[:, :, None]
        local = state.rotation.mT[:, None] @ local  # in the sensor frames
        origin, *axes = ([local[:, j, None, i] for i in range(3)] for j in range(4))
        residual = (
            self.target.residual_in_space if self.in_space else self.target.residual
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            r, force, torque = residual(origin, axes, self.seen, self.sizes)
        rows = len(r)
        by_point = np.empty((B, 7 + self.n + 6 * with_flange, self.m, rows, self.P))
        for k in range(rows):
            column = by_point[:, :, :, k]
            lever = cross(origin, force[k])
            for j in range(3):
                column[:, j] = -force[k][j]
                column[:, 3 + j] = (
                    -lever[j] if torque is None else -(lever[j] + torque[k][j])
                )
            for j, axis in enumerate(self.free, 6):
                column[:, j] = dot((force if axis < 3 else torque)[k], axes[axis % 3])
            column[:, 6 + self.n] = r[k]
        z = by_point.reshape(B, -1, self.m * rows, self.P)
        if with_flange:
            arm = (
                state.translation[:, :, None]
                + self.observed.eye_to_hand * self.T_in_flange
            )  # from flange to sensor
            arm = np.moveaxis(state.rotation.mT @ arm, 1, 0)[:, :, None]  # (3, B, 1, P)
            z[:, -6:-3] = z[:, :3]
            z[:, -3:] = z[:, 3:6] + np.stack(
                cross(arm, np.moveaxis(z[:, :3], 1, 0)), axis=1
            )
        if not self.present.all():
            z *= np.repeat(self.present, rows, axis=1)[:, None]
        return z

    def with_sizes(self, sizes) -> "Residuals":
        """Those of a target with other lengths, mm."""
        other = copy(self)
        other.sizes = tuple(sizes)
        return other

    def by_point(self, columns) -> np.ndarray:
        """The derivatives (2, B, m, rows, P) of each point's residuals by its own x and
        z: what moves the point alone moves its residuals as what moves the whole
        scanner.
        """
        return (
            columns[:, [0, 2]]
            .swapaxes(0, 1)
            .reshape(2, len(columns), self.m, -1, self.P)
        )

    def by_error(
        self, error: Perturbation, state: State, placement, columns
    ) -> np.ndarray:
        """By the size of an error at a state, of a batch of one: (1, K, P). `columns`:
        of these residuals, there, with those by the flange pose.
        """
        if error.length:
            h = 1e-4  # mm
            step = h * (np.array(self.target.lengths) == error.length)
            plus, minus = (
                self.with_sizes(self.sizes + s).linearise(state, placement)[:, -1]
                for s in (step, -step)
            )
            return (plus - minus) / (2 * h)
        if error.points:
            dx, dz = error.points(*self.seen)  # (1, m, P) each
            by_x, by_z = self.by_point(columns)
            return (by_x * dx[:, :, None] + by_z * dz[:, :, None]).reshape(
                1, *columns.shape[2:]
            )
        R, T = self.observed.R_flange[0], self.observed.T_flange[0]
        if self.observed.eye_to_hand:
            in_sensor = -error.positions(inverse(R, T)[1]) @ state.rotation[0]
        else:
            in_sensor = (error.positions(T)[:, None] @ R)[:, 0] @ state.rotation[0]
        return np.sum(columns[:, -6:-3] * in_sensor.T[:, None], axis=1)

    def on_target(self, columns) -> "Residuals":
        """Those of points where the state of `columns` has them on the target. Slopes
        of residuals have length one.
        """
        r = columns[:, 6 + self.n].reshape(len(columns), self.m, -1, self.P)
        other = copy(self)
        other.seen = self.seen - np.sum(self.by_point(columns) * r, axis=3)
        return other

    def over_noise(self, z, noise: Noise) -> np.ndarray:
        """Columns (B, columns, K, P), changed in place, over the scanner's noise, and
        as precise as each point is.
        """
        sd = noise.profile_mm * self.sd.repeat(z.shape[2] // self.m, axis=1)
        if not self.in_space:
            sd = sd * np.tile(self.target.residual_sd(noise), self.m)[:, None]
        if self.whiten is not None:
            z[:] = np.einsum("bijp,bcjp->bcip", self.whiten, z)
        z /= sd[:, None]
        return z

    def move(self, placement, step):
        """A placement after a step (B, n) of its free shifts and turns."""
        origin, axes = placement
        moved = np.zeros((len(step), 6))
        moved[:, self.free] = step
        return carry(axes, origin, moved[:, :3]), axes @ rotations(moved[:, 3:])

    def place(self, rotation, translation):
        """The target's frame where sensor poses (B, 3, 3), (B, 3) see it: origin (B, 3)
        and axes (B, 3, 3).
        """
        B, (x, z) = len(rotation), self.seen.reshape(2, -1, 1, self.m * self.P)
        seen = rotation[:, :, :1] * x + rotation[:, :, 2:] * z + translation[:, :, None]
        seen = seen.reshape(B, 3, self.m, self.P) + self.T_in_flange[:, :, None]
        # R_flange has base (a) and flange (b) components, then poses
        points = np.einsum(
            "nabp,nbmp->npma", self.R_flange.reshape(-1, 3, 3, self.P), seen
        )
        there = self.present.mT[..., None]
        middle = (points * there).sum(axis=(1, 2), keepdims=True) / there.sum(
            axis=(1, 2), keepdims=True
        )
        # the missing ones go into the middle of the others
        points = np.where(there, points, middle)
        origin, axes, _ = self.target.fit(points.reshape(B, -1, 3))
        return origin, axes
