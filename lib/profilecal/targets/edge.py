"""A straight edge: the scan plane meets it in a point. Three specimens that have one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from profilecal.geometry.fitting import principal_axes
from profilecal.geometry.poses import cross, frame_around
from profilecal.profiles.edges import find_edges
from profilecal.targets.target import ALONG_Y, Target, in_sensor


def turned(corners, angle_deg: float) -> list[tuple[float, float]]:
    """Corners of a cross-section turned about the edge."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return [(c * a - s * h, s * a + c * h) for a, h in corners]


# Cross-sections as chains of corners (aside, up) from the edge, mm; the paper's Fig. 4
# gives no measures
SPECIMENS: dict[str, Sequence[tuple[float, float]]] = {
    "parallel bar": turned(
        [(-20, 0), (0, 0), (0, -20)], 35
    ),  # seen corner on: its top and a side wall
    "straight scale": [
        (-40, 0),
        (0, 0),
        (0, -1),
        (-39, -1),
        (-39, -20),
        (200, -20),
    ],  # 1 mm thick, above a table
    "knife blade": [
        (-200, -20),
        (-0.3, -20),
        (-0.3, -1.2),
        (0, 0),
        (0.3, -1.2),
        (0.3, -20),
        (200, -20),
    ],  # edge up
}


@dataclass(frozen=True)
class Edge(Target):
    """The line through `point` (..., 3) along the unit vector `direction` (..., 3),
    base frame, mm.
    """

    point: np.ndarray
    direction: np.ndarray

    kind, shape, tables = "edge", "straight line", ("profiles", "points")
    shifts, turns, points, rows, affine, beside_mm = "xy", "xy", 1, 2, True, 6.0
    groups, positions, stance, specimens = 25, 10, ALONG_Y, tuple(SPECIMENS)
    find = staticmethod(find_edges)

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """x and z of the sensed point minus those of the place where the plane meets
        the edge.
        """
        (x, z), (px, py, pz), (dx, dy, dz) = seen, origin, axes[2]
        s = py / dy
        r = [x - px + s * dx, z - pz + s * dz]
        force = [[-1.0, dx / dy, 0.0], [0.0, dz / dy, -1.0]]
        by_direction = [[s, -s * dx / dy, 0.0], [0.0, -s * dz / dy, s]]
        return r, force, [cross(axes[2], d) for d in by_direction]

    @staticmethod
    def residual_in_space(origin, axes, seen, sizes):
        """(sensed point - origin) × direction."""
        (x, z), (px, py, pz), (dx, dy, dz) = seen, origin, axes[2]
        vx, vy, vz = x - px, -py, z - pz
        force = [[0.0, -dz, dy], [dz, 0.0, -dx], [-dy, dx, 0.0]]
        by_direction = [[0.0, -vz, vy], [vz, 0.0, -vx], [-vy, vx, 0.0]]
        return (
            cross((vx, vy, vz), axes[2]),
            force,
            [cross(axes[2], d) for d in by_direction],
        )

    @staticmethod
    def fit(points):
        return points.mean(axis=-2), frame_around(principal_axes(points)[..., 0, :]), ()

    def distance(self, points):
        offset = points - self.point
        return np.linalg.norm(
            offset - (offset @ self.direction)[..., None] * self.direction, axis=-1
        )

    def meet(self, rotation, origin) -> np.ndarray:
        """Where scan planes meet the line: x and z in the sensor frame, (..., 2);
        infinite where they are parallel.
        """
        p, d = (
            in_sensor(rotation, self.point - origin),
            in_sensor(rotation, self.direction),
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -p[..., 1] / d[..., 1]
        return (p + along[..., None] * d)[..., [0, 2]]

    def outline(self, specimen, rotation, origin, away) -> np.ndarray:
        """The chains (..., V, 2) that scan planes cut from a specimen with this edge, x
        and z in the sensor frame, mm. All its faces run along the edge; its top faces
        the scanner, on the side of smaller x.
        """
        up = (away @ self.direction) * self.direction - away
        up = up / np.linalg.norm(up)
        aside = np.cross(self.direction, up)
        aside = aside * np.sign(aside @ rotation.reshape(-1, 3, 3).mean(axis=0)[:, 0])
        lines = [
            Edge(self.point + a * aside + h * up, self.direction)
            for a, h in SPECIMENS[specimen]
        ]
        return np.stack([line.meet(rotation, origin) for line in lines], axis=-2)

    def lines(self, points):
        """The edge as long as it was seen."""
        low, high = np.nanpercentile((points - self.point) @ self.direction, [1, 99])
        ends = np.array([1.1 * low - 0.1 * high, 1.1 * high - 0.1 * low])
        return [self.point + ends[:, None] * self.direction]
