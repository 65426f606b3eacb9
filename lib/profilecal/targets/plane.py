"""A flat face: the scan plane meets it in a line (Carlson et al. 2015, Sharifzadeh et
al. 2020).
"""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.fitting import principal_axes
from profilecal.geometry.poses import circle_around, cross, dot, frame_around
from profilecal.profiles.edges import find_lines
from profilecal.targets.target import Target, Y, in_scan_plane

BELOW_MM = 20.0  # other targets, in simulated profiles: a table
FAR = np.array([-500.0, 500.0])  # mm along the line, beyond any field of view


@dataclass(frozen=True)
class Plane(Target):
    """The plane through `point` (3,) with unit `normal` (3,), base frame, mm."""

    point: np.ndarray
    normal: np.ndarray

    kind, shape = "plane", "plane"
    shifts, turns, rows = "z", "xy", 1
    groups, positions = 12, 3
    find = staticmethod(find_lines)

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """Distance from the line in which the planes meet."""
        (height,), (force,), (torque,) = Plane.residual_in_space(
            origin, axes, seen, sizes
        )
        return in_scan_plane(height, force, torque, ey_by_turn=cross(axes[2], Y))

    @staticmethod
    def residual_in_space(origin, axes, seen, sizes):
        """Distance from the face."""
        (x, z), (cx, cy, cz), normal = seen, origin, axes[2]
        v = (x - cx, -cy, z - cz)
        return [dot(normal, v)], [[-n for n in normal]], [cross(normal, v)]

    @staticmethod
    def fit(points):
        return points.mean(axis=-2), frame_around(principal_axes(points)[..., 2, :]), ()

    def distance(self, points):
        return (points - self.point) @ self.normal

    def line_at(self, rotation, origin, x) -> np.ndarray:
        """Points (P, k, 2) at x (P, k) or (k,) of the lines in which scan planes (P, 3,
        3), (P, 3) meet the face; not finite where these are parallel to the depth.
        """
        height, n = (self.point - origin) @ self.normal, self.normal @ rotation
        x = np.broadcast_to(x, (len(n), np.shape(x)[-1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.stack([x, (height[:, None] - n[:, :1] * x) / n[:, 2:]], axis=-1)

    def points_seen(self, rotation, origin, count):
        return self.line_at(rotation, origin, np.linspace(-20, 20, count))

    def outline(self, specimen, rotation, origin, away):
        """A face that fills the field of view."""
        return self.line_at(rotation, origin, FAR)

    def behind(self, arcs, rotation, origin) -> list[np.ndarray]:
        """Outlines of bodies above this face: their arcs (P, k, 2), NaN where there is
        none, between parts of it.
        """
        far = np.broadcast_to(FAR, (len(arcs), 2))
        ends = np.concatenate([far[:, :1], arcs[:, [0, -1], 0], far[:, 1:]], axis=1)
        around, alone = (
            self.line_at(rotation, origin, ends),
            self.line_at(rotation, origin, FAR),
        )
        return [
            np.concatenate([face[:2], arc, face[2:]])
            if np.isfinite(arc).all()
            else line
            for face, arc, line in zip(around, arcs, alone, strict=True)
        ]

    def lines(self, points):
        """A square."""
        return [circle_around(self.point, self.normal, 60.0, count=5)]
