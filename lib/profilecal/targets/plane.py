"""A flat face: the scan plane meets it in a line (Carlson et al. 2015, Sharifzadeh et
al. 2020). What balls and rods, which lie on one in simulated profiles, have in common.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.fitting import principal_axes
from profilecal.geometry.poses import circle_around, dot, frame_around
from profilecal.profiles.faces import find_lines
from profilecal.targets.target import (
    Fitted,
    Linearised,
    Sight,
    Target,
    distances_in_space,
    in_scan_plane,
)

BELOW_MM = 20.0  # other targets, in simulated profiles: a table
FAR = np.array([-500.0, 500.0])  # mm along the line, beyond any field of view


@dataclass(frozen=True)
class Plane(Target):
    """A flat face, endless in all directions.

    It passes through `point` (3,), mm, square to the unit vector `normal` (3,), both in
    the base frame.

    A scanner in the base frame, whose scan plane is y = 0, sees a line; its points at x
    = 0 and 10 mm are, as x and z:

    >>> import numpy as np
    >>> import profilecal as pc
    >>> plane = pc.Plane(np.array([0.0, 0.0, 100.0]), np.array([0.6, 0.0, -0.8]))
    >>> rotation, origin = np.eye(3)[None], np.zeros((1, 3))
    >>> plane.line_at(rotation, origin, x=np.array([0.0, 10.0])).tolist()
    [[[0.0, 100.0], [10.0, 107.5]]]
    """

    point: ndarray
    normal: ndarray

    kind = "plane"
    shape = "plane"
    shifts = "z"
    turns = "xy"
    finder = staticmethod(find_lines)
    groups = 12
    positions = 3
    across = (0.3, 0.3, 1.0)

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """Distance from the line in which the planes meet."""
        return in_scan_plane(Plane.residual_in_space(sight), sight.offset)

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """Distance from the face."""
        offset, normal = sight.offset, sight.axes[2]
        return distances_in_space(offset, (dot(normal, offset), normal))

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        return points.mean(axis=-2), frame_around(principal_axes(points)[..., 2, :]), ()

    def lines(self, points: ndarray) -> list[ndarray]:
        """A square."""
        return [circle_around(self.point, self.normal, 60.0, 5)]

    def line_at(self, rotation: ndarray, origin: ndarray, x: ndarray) -> ndarray:
        """Points (P, k, 2) at x (P, k) or (k,) of the lines in which scan planes
        (P, 3, 3), (P, 3) meet the face; not finite where these are parallel to the
        depth.
        """
        sight = self.sight_from(rotation, origin)
        normal, place = sight.axes[2][..., 0], sight.origin[..., 0]
        nx, _, nz = normal
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (dot(normal, place) - nx * x) / nz
        return np.stack(np.broadcast_arrays(x, z), axis=-1)

    def points_seen(self, rotation: ndarray, origin: ndarray, count: int) -> ndarray:
        return self.line_at(rotation, origin, np.linspace(-20, 20, count))

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> ndarray:
        """A face that fills the field of view."""
        return self.line_at(rotation, origin, FAR)


def above_table(
    arcs: ndarray, top: ndarray, rotation: ndarray, origin: ndarray, away: ndarray
) -> list[ndarray]:
    """Outlines of bodies above a table: their arcs (P, k, 2) between parts of it, or
    the table alone where an arc is NaN. The table is BELOW_MM below `top` (3,), square
    to `away` (3,).
    """
    table = Plane(top + BELOW_MM * away, away)
    x = np.insert(arcs[:, [0, -1], 0], [0, 2], FAR, axis=1)
    line = table.line_at(rotation, origin, x)
    chains = np.concatenate([line[:, :2], arcs, line[:, 2:]], axis=1)
    return [chain[np.isfinite(chain).all(axis=1)] for chain in chains]


class Round(Target):
    """What has a radius and shows an arc in profiles: a ball or a rod."""

    radius: float
    # how far to either side of its top the scanner sees it
    half_arc_deg: float

    size_names = ("radius",)
    fit_is_best = False

    # arc(rotation, origin, reach_deg, count): points (P, count, 2) that scan planes
    # (P, 3, 3), (P, 3) show of it, by angles to either side of its top
    arc: Callable[..., ndarray]

    def points_seen(self, rotation: ndarray, origin: ndarray, count: int) -> ndarray:
        return self.arc(rotation, origin, self.half_arc_deg, count)

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> list[ndarray]:
        """Above a table."""
        top = self.frame[0] + self.radius * away
        arcs = self.arc(rotation, origin, 90.0, 721)
        return above_table(arcs, top, rotation, origin, away)


def fan(reach_deg: float, count: int) -> ndarray:
    """Unit vectors (count, 2) by angles to either side of the second axis."""
    angle = np.radians(reach_deg) * np.linspace(-1, 1, count)
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1)
