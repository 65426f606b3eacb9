"""One target's residuals and their derivatives, arranged for speed."""

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from numpy.typing import ArrayLike

from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import Frames, carry, cross, dot, inverse, rotations
from profilecal.joint.prior import Perturbation
from profilecal.targets.ball import Ball
from profilecal.targets.observations import Observations
from profilecal.targets.state import State
from profilecal.targets.target import Sight

# Where derivatives stand among the columns of linearised residuals: those by the sensor
# pose, which shifts and turns, come first, and the residual last.
SENSOR = slice(6)
SHIFT = slice(3)
TURN = slice(3, 6)
TARGET = slice(6, -1)
# directions (2, 21) from a ball's centre to points of the arc that a scanner sees, and
# what takes errors along them to those of centre and radius (3, 21)
ANGLE = np.radians(Ball.half_arc_deg) * np.linspace(-1, 1, 21)
ARC = np.stack([np.sin(ANGLE), -np.cos(ANGLE)])
FITTED = np.linalg.pinv(np.stack([*ARC, np.ones(21)], axis=1))


class Residuals:
    """The residuals of one target at P poses, m points each.

    Poses are the last axis of all arrays and a batch (B, or 1 for all) is the first, so
    that NumPy's inner loops run over poses.
    """

    def __init__(
        self, observations: Observations, noise: Noise, in_space: bool = False
    ) -> None:
        self.observed = observations
        self.in_space = in_space
        self.target = observations.target
        self.sizes = observations.sizes
        # along and about which axes of the target's frame shifts and turns are unknown
        self.shifts = ["xyz".index(axis) for axis in self.target.shifts]
        self.turns = ["xyz".index(axis) for axis in self.target.turns]
        self.n = len(self.shifts + self.turns)
        _, self.P, self.m, _ = observations.points.shape

        R, T = observations.R_flange, observations.T_flange
        # base components, then flange components and poses together, (B|1, 3, 3P)
        self.R_flange = R.transpose(0, 2, 3, 1).reshape(-1, 3, 3 * self.P)
        # Rᵀ T (B|1, 3, P): where the flange is in the base, along the flange's axes;
        # eye-to-hand, minus that, along the base's axes
        self.T_in_flange = -inverse(R, T)[1].mT
        # x and z, (2, B|1, m, P), with poses next to each other in memory
        points = observations.points.transpose(3, 0, 2, 1).copy()
        self.present = np.isfinite(points).all(axis=0)  # (B|1, m, P)
        self.seen = np.where(self.present, points, 0.0)
        # how many residuals each pose has, (B|1, P)
        self.counts = self.present.sum(axis=1) * self.target.rows
        self.set_precision(noise)

    def set_precision(self, noise: Noise) -> None:
        """How precise residuals are: the standard deviation `sd` (B|1, m, rows, P) of
        each point's residuals, and `whiten` (B|1, K, K, P), which makes the residuals
        of a pose independent, where they are not.

        The covariance of the observations has variances (B|1, P, m) of points on a
        curve; of other points it is whole, (B|1, P, K, K), and distances in space,
        which only a search uses, go without it.
        """
        rows = [1.0] if self.in_space else self.target.residual_sd(noise)
        of_points = np.ones((1, self.m, self.P))
        self.whiten = None
        covariance = self.observed.covariance
        if covariance is not None and self.observed.on_curve:
            of_points = np.sqrt(covariance.mT)
        elif covariance is not None and not self.in_space:
            whiten = np.linalg.inv(np.linalg.cholesky(covariance))
            self.whiten = np.moveaxis(whiten, 1, -1)
        self.sd = of_points[:, :, None] * noise.profile_mm * np.array(rows)[:, None]

    def linearise(
        self, state: State, placement: tuple, longer: ArrayLike = 0.0
    ) -> ndarray:
        """The K residuals of each of P poses and their derivatives, mm and rad, if the
        target's sizes are so much `longer`.

        Returns (B, columns, K, P), zero where no point is. The columns are derivatives
        by the sensor pose (6) and by the target's frame (n), then the residual.

        The target says how a residual r changes when its frame, of origin o and axes a,
        is shifted by s and turned about o by w, in the sensor's frame: by a force f and
        a torque t,

            dr = f · s + t · w

        A sensor that moves by (ρ, φ) sees the target shifted by s = -ρ - φ × o and
        turned by w = -φ:

            dr = -f · ρ - (o × f + t) · φ

        The unknowns of the target's frame are shifts along its axes, of derivative
        f · a, and turns about them, of derivative t · a.
        """
        origin, axes = self.target_in_sensor(state, placement)
        target = self.target
        residual = target.residual_in_space if self.in_space else target.residual
        with np.errstate(divide="ignore", invalid="ignore"):
            sizes = tuple(np.add(self.sizes, longer).tolist())
            sight = Sight(origin, axes, self.seen, sizes)
            r, force, torque = residual(sight)

        B, rows = len(state.rotation), len(r)
        count = self.n + 7
        by_row = np.empty((B, count, self.m, rows, self.P))
        for k in range(rows):
            column = by_row[:, :, :, k]
            moment = cross(origin, force[k])  # o × f; t is added below
            for j, axis in enumerate(self.shifts, 6):
                column[:, j] = dot(force[k], axes[axis])
            if torque is not None:
                moment = [moment[j] + torque[k][j] for j in range(3)]
                for j, axis in enumerate(self.turns, 6 + len(self.shifts)):
                    column[:, j] = dot(torque[k], axes[axis])
            for j in range(3):
                column[:, j] = -force[k][j]
                column[:, 3 + j] = -moment[j]
            column[:, -1] = r[k]

        z = by_row.reshape(B, count, self.m * rows, self.P)
        if not self.present.all():
            z *= np.repeat(self.present, rows, axis=1)[:, None]
        return z

    def target_in_sensor(self, state: State, placement: tuple) -> tuple[ndarray, list]:
        """The target's origin and its three axes, as every pose has them in the
        sensor's frame: arrays (3, B, 1, P).
        """
        origin, axes = placement
        in_base = np.concatenate([origin[:, None], axes.mT], axis=1)
        # origin or axis (4), component (3): (B, 4, 3, P)
        in_flange = (in_base @ self.R_flange).reshape(-1, 4, 3, self.P)
        in_flange[:, 0] -= self.T_in_flange + state.translation[:, :, None]
        in_sensor = state.rotation.mT[:, None] @ in_flange
        # (4, 3, B, 1, P)
        origin, *axes = in_sensor.transpose(1, 2, 0, 3)[:, :, :, None]
        return origin, axes

    def middle(self, state: State, placement: tuple) -> ndarray:
        """The middle (3,) of what all poses see, in the sensor's frame: the mean over
        the poses of the middle of each one's points, moved to where the target is: to a
        ball's centre, to a rod's axis.
        """
        in_sensor = self.target_in_sensor(state, placement)
        # at the first state, (3, P) and (3, 3, P)
        origin, axes = (np.array(part)[..., 0, 0, :] for part in in_sensor)
        number = self.present[0].sum(axis=0)
        x, z = self.seen[:, 0].sum(axis=1) / np.maximum(number, 1)
        middle = np.array([x, 0 * x, z])  # (3, P)
        for axis in axes[self.shifts]:
            middle -= axis * np.sum(axis * (middle - origin), axis=0)
        return middle[:, number > 0].mean(axis=1)

    def by_flange(self, columns: ndarray, state: State) -> ndarray:
        """The derivatives (B, 6, K, P) by the flange pose, about the sensor's axes,
        from those by the sensor pose among the columns.

        A flange that is shifted takes the sensor along. A turn ψ about its origin turns
        the sensor by φ = ψ and shifts it by ρ = ψ × a, a the arm from flange to sensor.
        With the derivatives g by ρ and h by φ, that is

            dr = g · (ψ × a) + h · ψ = (h + a × g) · ψ
        """
        arm = state.translation[:, :, None]
        arm = arm + self.observed.eye_to_hand * self.T_in_flange
        arm = np.moveaxis(state.rotation.mT @ arm, 1, 0)[:, :, None]  # (3, B, 1, P)
        by_shift = columns[:, SHIFT]
        lever = np.stack(cross(arm, np.moveaxis(by_shift, 1, 0)), axis=1)
        return np.concatenate([by_shift, columns[:, TURN] + lever], axis=1)

    def by_point(self, columns: ndarray) -> ndarray:
        """The derivatives (2, B, m, rows, P) of each point's residuals by its own x and
        z: what moves the point alone moves its residuals as what moves the whole
        scanner.
        """
        by_x_and_z = columns[:, [0, 2]].swapaxes(0, 1)
        return by_x_and_z.reshape(2, len(columns), self.m, -1, self.P)

    def by_error(
        self,
        error: Perturbation,
        state: State,
        placement: tuple,
        columns: ndarray,
        by_flange: ndarray,
    ) -> ndarray:
        """The derivative (1, K, P) by the size of an error, at a state of a batch of
        one. `columns` and `by_flange` are what `linearise` and `by_flange` return at
        that state.
        """
        if error.length:
            return self.by_length(error.length, state, placement)
        if error.points:
            moves = self.by_point(columns) * self.moved_by(error.points)[:, :, :, None]
            return moves.sum(axis=0).reshape(1, *columns.shape[2:])
        shift_and_turn = self.motion_by(error).reshape(-1, 2, 3)
        in_sensor = (shift_and_turn @ state.rotation[0]).reshape(-1, 6)
        return np.einsum("bjkp,pj->bkp", by_flange, in_sensor)

    def motion_by(self, error: Perturbation) -> ndarray:
        """How an error of times or positions moves the flange, along its own axes;
        eye-to-hand, how it moves the sensor, along the base's axes: (P, 6), of the
        first problem.
        """
        seen = self.observed
        motion = np.zeros((self.P, 6))
        if error.clock:
            if seen.times is not None:
                late = error.clock(np.nan_to_num(seen.times[0]))
                motion = seen.twist * late[:, None]
        elif seen.eye_to_hand:
            motion[:, :3] = -error.positions(-self.T_in_flange[0].T)
        else:
            shift = error.positions(seen.T_flange[0])
            motion[:, :3] = np.vecmat(shift, seen.R_flange[0])
        return motion

    def moved_by(self, error: Callable) -> ndarray:
        """By how much an error of points moves x and z of the points seen, (2, 1, m, P)
        mm.

        Three points that stand for a circle move as the circle does that fits the arc
        that was seen. If points in the directions n from the centre move by e, the
        centre moves by c and the radius by d so that about

            n · c + d = n · e
        """
        if not self.observed.are_circles:
            return np.array(error(*self.seen))
        *centre, radius = self.circles
        outward = (self.seen - centre) / radius
        arc = centre + radius * ARC[:, None, :, None]
        at_arc = np.einsum("xa,xbap->ap", ARC, error(*arc))
        x, z, d = FITTED @ at_arc
        return outward * (outward[0] * x + outward[1] * z + d)

    @cached_property
    def circles(self) -> ndarray:
        """x, z and radius (3, 1, 1, P) of the circles through three points each."""
        with np.errstate(divide="ignore", invalid="ignore"):  # where no points are
            circles = fit_circle(self.seen.transpose(1, 3, 2, 0))
        return np.moveaxis(circles, -1, 0)[:, :, None]

    def by_length(self, length: tuple, state: State, placement: tuple) -> ndarray:
        """The derivative (1, K, P) by a length of a target, by differences; zero if
        that is another target.
        """
        h = 1e-4  # mm
        step = np.zeros(len(self.sizes))
        if length[:2] == (self.observed.kind, self.sizes):
            step[length[2]] = h
        longer, shorter = (
            self.linearise(state, placement, by)[:, -1] for by in (step, -step)
        )
        return (longer - shorter) / (2 * h)

    def on_target(self, columns: ndarray) -> "Residuals":
        """The residuals of points that lie on the target, where the state of `columns`
        has it.

        The slope of a residual by the point, x and z, has length one, as the residual
        is a distance, or zero, of a distance from the scan plane; the slopes of a
        point's residuals are orthogonal. So the point is moved against each slope by as
        much as the residual.
        """
        r = columns[:, -1].reshape(len(columns), self.m, -1, self.P)
        other = copy(self)
        vars(other).pop("circles", None)  # of the points before
        other.seen = self.seen - np.sum(self.by_point(columns) * r, axis=3)
        return other

    def over_noise(self, z: ndarray) -> ndarray:
        """Columns (B, columns, K, P), divided in place by the standard deviation of
        each residual; the residuals of a pose are made independent first.
        """
        if self.whiten is not None:
            z[:] = np.einsum("bijp,bcjp->bcip", self.whiten, z)
        by_row = z.reshape(*z.shape[:2], self.m, -1, self.P)
        by_row *= 1 / self.sd[:, None]
        return z

    def seen_anew(self, r: ndarray, columns: ndarray, rng: Generator) -> Observations:
        """Simulated observations of the first problem. The points are those observed,
        moved along the slopes of their residuals, so that the residuals at the state of
        `columns` are r (K, P), mm, plus fresh noise of the scanner.
        """
        drawn = self.sd[0] * rng.normal(size=self.sd[0].shape)
        drawn = drawn.reshape(r.shape)
        if self.whiten is not None:
            whiten = np.moveaxis(self.whiten[0], -1, 0)
            drawn = np.linalg.solve(whiten, drawn.T[..., None])[..., 0].T
        # `on_target` takes off the residual; here it is to leave r + drawn
        columns = columns.copy()
        columns[:, -1] -= r + drawn
        points = np.where(self.present, self.on_target(columns).seen, np.nan)
        return replace(self.observed, points=points.transpose(1, 3, 2, 0))

    def move(self, placement: tuple, step: ndarray) -> Frames:
        """A placement after a step (B, n) of its free shifts and turns."""
        origin, axes = placement
        shift, turn = np.zeros((2, len(step), 3))
        parts = np.split(step, [len(self.shifts)], axis=1)
        shift[:, self.shifts], turn[:, self.turns] = parts
        turned = axes @ rotations(turn) if self.turns else axes
        return carry(axes, origin, shift), turned

    def place(self, rotation: ndarray, translation: ndarray) -> Frames:
        """The target's frame where sensor poses (B, 3, 3), (B, 3) see it: origin (B, 3)
        and axes (B, 3, 3).
        """
        B = len(rotation)
        x, z = self.seen.reshape(2, -1, 1, self.m * self.P)
        seen = rotation[:, :, :1] * x + rotation[:, :, 2:] * z + translation[:, :, None]
        in_flange = seen.reshape(B, 3, self.m, self.P) + self.T_in_flange[:, :, None]
        # R_flange has base (a) and flange (b) components, then poses
        R_flange = self.R_flange.reshape(-1, 3, 3, self.P)
        points = np.einsum("nabp,nbmp->npma", R_flange, in_flange)
        if not self.present.all():
            # the missing points go into the middle of the others
            present = self.present.mT[..., None]
            total = (points * present).sum(axis=(1, 2), keepdims=True)
            middle = total / present.sum(axis=(1, 2), keepdims=True)
            points = np.where(present, points, middle)
        origin, axes, _ = self.target.fit(points.reshape(B, -1, 3))
        return origin, axes
