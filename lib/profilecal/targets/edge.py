"""A straight edge: the scan plane meets it in a point."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Edge:
    """The line through `point` (..., 3) along the unit vector `direction` (..., 3), base frame, mm."""

    point: np.ndarray
    direction: np.ndarray

    def meet(self, rotation, origin) -> np.ndarray:
        """Where scan planes meet the line: x and z in the sensor frame, (..., 2); infinite where they are parallel."""
        p = ((self.point - origin)[..., None, :] @ rotation)[..., 0, :]
        d = (self.direction[..., None, :] @ rotation)[..., 0, :]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -p[..., 1] / d[..., 1]
        return (p + along[..., None] * d)[..., [0, 2]]


MOVES = "across"  # how the point of its placement moves: across its direction
TURNS = True  # whether it has a direction


def residual(point, direction, seen, size=None, in_plane=True):
    """How far sensed edge points are from an edge, and the derivatives; see `profilecal.targets`.

    In the scan plane: sensed point minus where the plane meets the edge, x and z.
    In space: (sensed - point) × direction.
    """
    x, z = seen[0]
    px, py, pz = point
    dx, dy, dz = direction
    zero, one = np.zeros_like(px), np.ones_like(px)
    if in_plane:
        s = py / dy
        r = [x - px + s * dx, z - pz + s * dz]
        by_point = [[-one, dx / dy, zero], [zero, dz / dy, -one]]
        by_direction = [[s, -s * dx / dy, zero], [zero, -s * dz / dy, s]]
        return r, by_point, by_direction
    vx, vy, vz = x - px, -py, z - pz
    r = [vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx]
    by_point = [[zero, -dz, dy], [dz, zero, -dx], [-dy, dx, zero]]
    by_direction = [[zero, -vz, vy], [vz, zero, -vx], [-vy, vx, zero]]
    return r, by_point, by_direction


def place(points, size=None):
    """The edge through points (..., n, 3): a point on it and its direction, both (..., 3)."""
    middle = points.mean(axis=-2)
    return middle, np.linalg.svd(points - middle[..., None, :], full_matrices=False)[2][..., 0, :]
