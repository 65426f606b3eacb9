"""A straight edge: the scan plane meets it in a point. Three specimens that have one, and how profiles show it."""

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

    def outline(self, specimen: str, up, rotation, origin) -> np.ndarray:
        """The chains (..., V, 2) that scan planes cut from a specimen with this edge, x and z in the sensor frame, mm.

        All its faces run along the edge; `up` (..., 3), perpendicular to the edge, is where the specimen's top points.
        """
        aside = np.cross(self.direction, up)
        lines = [Edge(self.point + a * aside + h * up, self.direction) for a, h in SPECIMENS[specimen]]
        return np.stack([line.meet(rotation, origin) for line in lines], axis=-2)


def turned(corners, angle_deg: float) -> list[tuple[float, float]]:
    """Corners of a cross-section turned about the edge."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return [(c * a - s * h, s * a + c * h) for a, h in corners]


# Cross-sections as chains of corners (aside, up) from the edge, mm; the paper's Fig. 4 gives no measures
SPECIMENS = {
    "parallel bar": turned([(-20, 0), (0, 0), (0, -20)], 35),  # seen corner on: its top and a side wall
    "straight scale": [(-40, 0), (0, 0), (0, -1), (-39, -1), (-39, -20), (200, -20)],  # 1 mm thick, above a table
    "knife blade": [(-200, -20), (-0.3, -20), (-0.3, -1.2), (0, 0), (0.3, -1.2), (0.3, -20), (200, -20)],  # edge up
}


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
