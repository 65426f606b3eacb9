"""A flat face: the scan plane meets it in a line (Carlson et al. 2015, Sharifzadeh et al. 2020)."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Plane:
    """The plane through `point` (3,) with unit `normal` (3,), base frame, mm."""

    point: np.ndarray
    normal: np.ndarray

    def meet(self, rotation, origin) -> np.ndarray:
        """The lines in which scan planes meet the face, (..., 2, 2): the point nearest to the sensor's origin and the
        direction, x ≥ 0, each as x and z in the sensor frame; not finite where they are parallel."""
        height = (self.point - origin) @ self.normal
        n = self.normal @ rotation
        across = n[..., [0, 2]]
        squared = np.sum(across**2, axis=-1, keepdims=True)
        along = np.stack([across[..., 1], -across[..., 0]], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            nearest = height[..., None] * across / squared
            along = along * np.where(along[..., :1] < 0, -1, 1) / np.sqrt(squared)
        return np.stack([nearest, along], axis=-2)


MOVES = "along"  # how the point of its placement moves: along the normal
TURNS = True  # whether it has a direction


def residual(point, direction, seen, size=None, in_plane=True):
    """How far points of profiles are from a plane with normal `direction`; see `profilecal.targets`.

    In the scan plane: distance from the line in which the planes meet. In space: distance from the face.
    """
    cx, cy, cz = point
    nx, ny, nz = direction
    vx, vz = seen[:, 0] - cx, seen[:, 1] - cz
    vy = -cy + np.zeros_like(vx)
    scale = 1 / np.hypot(nx, nz) if in_plane else np.ones_like(nx)
    r = scale * (nx * vx + ny * vy + nz * vz)
    by_point = np.stack(np.broadcast_arrays(-scale * nx + 0 * vx, -scale * ny, -scale * nz), axis=1)
    correction = r * scale**2 if in_plane else 0
    by_direction = np.stack([scale * vx - correction * nx, scale * vy, scale * vz - correction * nz], axis=1)
    return r, by_point, by_direction


def place(points, size=None):
    """The plane nearest to points (..., n, 3): a point on it and its normal, both (..., 3)."""
    middle = points.mean(axis=-2)
    return middle, np.linalg.svd(points - middle[..., None, :], full_matrices=False)[2][..., 2, :]
