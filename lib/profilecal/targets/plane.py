"""A flat face: the scan plane meets it in a line (Carlson et al. 2015, Sharifzadeh et
al. 2020). What balls and rods, which lie on one in simulated profiles, have in common.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.fitting import principal_axes
from profilecal.geometry.poses import circle_around, cross, dot, frame_around
from profilecal.profiles.faces import find_lines
from profilecal.targets.target import (
    Fitted,
    Linearised,
    Sight,
    Target,
    Y,
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
    rows = 1
    finder = staticmethod(find_lines)
    groups = 12
    positions = 3
    across = (0.3, 0.3, 1.0)

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """Distance from the line in which the planes meet."""
        ey_by_turn = cross(sight.axes[2], Y)
        return in_scan_plane(Plane.residual_in_space(sight), np.zeros(3), ey_by_turn)

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """Distance from the face."""
        v, normal = sight.offset, sight.axes[2]
        return [dot(normal, v)], [-normal], [cross(normal, v)]

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        return points.mean(axis=-2), frame_around(principal_axes(points)[..., 2, :]), ()

    def lines(self, points: ndarray) -> list[ndarray]:
        """A square."""
        return [circle_around(self.point, self.normal, 60.0, count=5)]

    def line_at(self, rotation: ndarray, origin: ndarray, x: ndarray) -> ndarray:
        """Points (P, k, 2) at x (P, k) or (k,) of the lines in which scan planes
        (P, 3, 3), (P, 3) meet the face; not finite where these are parallel to the
        depth.
        """
        height = (self.point - origin) @ self.normal
        n = self.normal @ rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (height[:, None] - n[:, :1] * x) / n[:, 2:]
        return np.stack(np.broadcast_arrays(x, z), axis=-1)

    def points_seen(self, rotation: ndarray, origin: ndarray, count: int) -> ndarray:
        return self.line_at(rotation, origin, np.linspace(-20, 20, count))

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> ndarray:
        """A face that fills the field of view."""
        return self.line_at(rotation, origin, FAR)

    def behind(
        self, arcs: ndarray, rotation: ndarray, origin: ndarray
    ) -> list[ndarray]:
        """Outlines of bodies above this face: their arcs (P, k, 2) between parts of it,
        or the face alone where an arc is NaN.
        """
        outlines = list(self.line_at(rotation, origin, FAR))
        beside = self.line_at(rotation, origin, arcs[:, [0, -1], 0])
        for k in np.flatnonzero(np.isfinite(arcs).all(axis=(1, 2))):
            (left, right), (first, last) = outlines[k], beside[k]
            outlines[k] = np.concatenate([[left, first], arcs[k], [last, right]])
        return outlines


class Round(Target):
    """What has a radius and shows an arc in profiles: a ball or a rod."""

    radius: float

    lengths = ("radius",)
    rows = 1
    fit_is_best = False
    # that a scanner sees, to either side of what is nearest to it
    half_arc_deg: float

    def arc(
        self, rotation: ndarray, origin: ndarray, reach_deg: float, count: int
    ) -> ndarray:
        """Points (P, count, 2) that scan planes (P, 3, 3), (P, 3) cut from it, by
        angles to either side of what is nearest to the scanner.
        """
        raise NotImplementedError

    def points_seen(self, rotation: ndarray, origin: ndarray, count: int) -> ndarray:
        return self.arc(rotation, origin, self.half_arc_deg, count)

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> list[ndarray]:
        """Above a table."""
        middle, _ = self.frame
        table = Plane(middle + (self.radius + BELOW_MM) * away, away)
        return table.behind(self.arc(rotation, origin, 90, 721), rotation, origin)
