"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.joint.observations import TARGETS, Observations
from profilecal.joint.state import State
from profilecal.targets import ball, disk, edge, plane, point


def across(direction):
    """Two unit vectors (B, 2, 3) perpendicular to unit vectors (B, 3) and to each other."""
    aside = np.eye(3)[np.argmin(np.abs(direction), axis=-1)]
    first = np.stack(_cross(direction.T, aside.T), axis=-1)
    first /= np.sqrt(np.einsum("...i,...i", first, first))[..., None]
    return np.stack([first, np.stack(_cross(direction.T, first.T), axis=-1)], axis=-2)


def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _pairs(covariance, m):
    """Covariances (B, P, 2m, 2m) as (B, P, m, 2, m, 2)."""
    return covariance.reshape(*covariance.shape[:2], m, 2, m, 2)


class Term:
    """One target's observations, arranged for speed: poses along the last axis, a batch axis B (or 1) first."""

    def __init__(self, observations: Observations, noise: Noise):
        self.module = TARGETS[observations.kind]
        self.size = observations.size
        if observations.kind == "point":
            self.size = noise.profile_mm / noise.steering_mm if noise.steering_mm and noise.profile_mm else 1.0
        R, T, points = (
            np.asarray(a, float) for a in (observations.R_flange, observations.T_flange, observations.points)
        )
        self.P = points.shape[-3]
        R, T = R.reshape(-1, self.P, 3, 3), T.reshape(-1, self.P, 3)
        points = points.reshape(-1, *points.shape[-3:])
        self.turn = np.ascontiguousarray(R.transpose(0, 2, 3, 1)).reshape(-1, 3, 3 * self.P)  # (B|1, 3, 3P)
        self.shift = np.einsum("npab,npa->nbp", R, T)  # Rᵀ T, (B|1, 3, P)
        seen = np.ascontiguousarray(points.transpose(2, 3, 0, 1))  # (m, 2, B|1, P)
        missing = ~np.isfinite(seen).all(axis=1)  # (m, B|1, P)
        self.present = None
        if missing.any():
            seen = np.where(missing[:, None], 0.0, seen)
            self.present = ~missing
        self.seen, self.eye_to_hand = seen, observations.eye_to_hand
        self.moves, self.turns = self.module.MOVES, self.module.TURNS
        self.n = {"across": 2, "along": 1, "anywhere": 3}[self.moves] + 2 * self.turns
        group = np.arange(self.P) if observations.group is None else observations.group
        self.group = np.unique(group, return_inverse=True)[1]
        self.sd = self.whiten = None
        if observations.covariance is not None:
            self.sd, self.whiten = self.precision(np.asarray(observations.covariance, float), observations.on_curve)

    def precision(self, covariance, on_curve: bool):
        """Standard deviations (B|1, m, P) of the points, as multiples of the noise; and for edge and disk the
        triangular matrices (B|1, 2m, 2m, P) that turn their residuals into independent ones of unit variance."""
        m = len(self.seen)
        if on_curve:
            return np.sqrt(np.moveaxis(covariance.reshape(-1, self.P, m), 1, 2)), None
        covariance = covariance.reshape(-1, self.P, 2 * m, 2 * m)
        sd = np.sqrt(np.einsum("bpmimi->bmp", _pairs(covariance, m)) / 2)
        if m == 2:  # the disk's residuals are across and along the chord
            chord = self.seen[1] - self.seen[0]
            x, z = chord / np.maximum(np.hypot(*chord), 1e-300)  # (B, P)
            x = np.where(np.hypot(x, z) > 0, x, 1.0)  # where nothing was seen
            turn = np.moveaxis(np.array([[-z, x], [x, z]]), (0, 1), (2, 3))
            turned = np.einsum("bpij,bpmjnk,bplk->bpminl", turn, _pairs(covariance, m), turn)
            covariance = turned.reshape(covariance.shape)
        return sd, np.moveaxis(np.linalg.inv(np.linalg.cholesky(covariance)), 1, -1)

    def in_units_of_noise(self, z, sigma, in_plane: bool = True):
        """Derivatives and residuals z (B, columns, K, P), changed in place: over the noise sigma (B|1, 1, 1), mm, and
        as precise as each point is."""
        z /= sigma[..., None]
        if self.whiten is not None and in_plane:
            for k in reversed(range(z.shape[2])):
                z[:, :, k] *= self.whiten[:, None, k, k]
                for j in range(k):
                    z[:, :, k] += self.whiten[:, None, k, j] * z[:, :, j]
        elif self.sd is not None:
            z /= np.repeat(self.sd, z.shape[2] // len(self.seen), axis=1)[:, None]
        return z

    def moving(self, placement):
        """The directions in which the placement's point moves and in which its direction turns, (B, ·, 3) each."""
        place, direction = placement
        turning = across(direction) if self.turns else np.zeros((len(place), 0, 3))
        if self.moves == "across":
            return turning, turning
        if self.moves == "along":
            return direction[:, None], turning
        return np.broadcast_to(np.eye(3), (len(place), 3, 3)), turning

    def linearise(self, state: State, placement, in_plane: bool, with_robot: bool = False):
        """Derivatives by the sensor pose (6) and the placement (n), the residual, and if asked for the derivatives by
        the flange pose (6): (B, columns, K, P). And which residuals there are: None (all), or 0 and 1, (B, K, P)."""
        points, turning = self.moving(placement)
        vectors = np.concatenate([placement[0][:, None], placement[1][:, None], points, turning], axis=1)
        B = len(vectors)
        local = (vectors @ self.turn).reshape(B, -1, 3, self.P)  # in the flange frames
        local[:, 0] -= self.shift + state.translation[:, :, None]
        local = np.swapaxes(state.rotation, 1, 2)[:, None] @ local  # in the sensor frames
        p, d, *moving = ([local[:, j, i] for i in range(3)] for j in range(local.shape[1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            r, by_point, by_direction = self.module.residual(p, d, self.seen, self.size, in_plane)

        K, q = len(r), points.shape[1]
        z = np.empty((B, 7 + self.n + 6 * with_robot, K, self.P))
        for k in range(K):
            P = by_point[k]
            for j in range(3):
                np.negative(P[j], out=z[:, j, k])
            turn = _cross(P, p)
            if self.turns:
                D = by_direction[k]
                turn = [a + b for a, b in zip(turn, _cross(D, d), strict=True)]
            for j in range(3):
                z[:, 3 + j, k] = turn[j]
            for j in range(q):
                z[:, 6 + j, k] = _dot(P, moving[j])
            for j in range(turning.shape[1]):
                z[:, 6 + q + j, k] = _dot(D, moving[q + j])
            z[:, 6 + self.n, k] = r[k]
        if with_robot:
            arm = state.translation[:, :, None] + (self.shift if self.eye_to_hand else 0)
            arm = np.moveaxis(np.swapaxes(state.rotation, 1, 2) @ arm, 1, 0)[
                :, :, None
            ]  # flange to sensor, (3, B, 1, P)
            z[:, -6:-3] = z[:, :3]
            lever = _cross(arm, np.moveaxis(z[:, :3], 1, 0))
            for j in range(3):
                z[:, -3 + j] = z[:, 3 + j] + lever[j]
        present = None
        if self.present is not None:
            present = np.moveaxis(np.repeat(self.present, K // len(self.present), axis=0), 0, 1)
            z *= present[:, None]
        return z, present


def _per_pose(term: Term) -> np.ndarray:
    """How many residuals each pose has, (P,)."""
    rows = {"edge": 2, "disk": 4, "point": 3}.get(term.module.__name__.rsplit(".", 1)[1], len(term.seen))
    if term.present is None:
        return np.full(term.P, rows)
    return np.maximum(term.present[:, 0].sum(axis=0) * (rows // len(term.seen)), 1)


def target_at(observations: Observations, place, direction):
    """The target object of a placement."""
    if observations.kind == "disk":
        return disk.Disk(place, direction, observations.size)
    if observations.kind == "ball":
        return ball.Ball(place, observations.size)
    if observations.kind == "point":
        return point.Point(place)
    return {"edge": edge.Edge, "plane": plane.Plane}[observations.kind](place, direction)
