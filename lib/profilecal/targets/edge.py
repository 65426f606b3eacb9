"""A straight edge: the scan plane meets it in a point; specimens that have one."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.fitting import principal_axes
from profilecal.geometry.poses import cross, dot, frame_around, unit
from profilecal.profiles.edges import find_edges
from profilecal.targets.target import (
    ALONG_Y,
    Fitted,
    Linearised,
    Sight,
    Target,
    distances_in_space,
)

# 20 mm along a face that is inclined by 35°
ASIDE = 20 * np.cos(np.radians(35))
DOWN = 20 * np.sin(np.radians(35))
# Cross-sections as chains of corners, aside of the edge and up from it, mm; the paper's
# Fig. 4 gives no sizes
SPECIMENS: dict[str, list[tuple[float, float]]] = {
    # seen corner on: its top and, square to that, a side wall
    "parallel bar": [(-ASIDE, -DOWN), (0, 0), (DOWN, -ASIDE)],
    # 1 mm thick, above a table
    "straight scale": [
        (-40, 0),
        (0, 0),
        (0, -1),
        (-39, -1),
        (-39, -20),
        (200, -20),
    ],
}


@dataclass(frozen=True)
class Edge(Target):
    """A straight edge, endless in both directions.

    It passes through `point` (3,), mm, along the unit vector `direction` (3,), both in
    the base frame; a batch of edges has (..., 3) each.

    A scanner in the base frame, whose scan plane is y = 0, sees a point, x and z:

    >>> import numpy as np
    >>> import profilecal as pc
    >>> edge = pc.Edge(np.array([5.0, 40.0, 100.0]), np.array([0.6, 0.8, 0.0]))
    >>> edge.meet(rotation=np.eye(3), origin=np.zeros(3)).tolist()
    [-25.0, 100.0]
    """

    point: ndarray
    direction: ndarray

    kind = "edge"
    shape = "straight line"
    shifts = "xy"
    turns = "xy"
    points = 1
    rows = 2
    tables = ("profiles", "points")
    finder = staticmethod(find_edges)
    beside_mm = 6.0
    groups = 25
    positions = 10
    stance = ALONG_Y
    across = (1.0, 0.3, 0.5)
    specimens = tuple(SPECIMENS)

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """x and z of the sensed point minus those of the place where the plane meets
        the edge.

        The edge p + a d, with p = (px, py, pz) and d = (dx, dy, dz), meets the plane
        y = 0 where a = -s, s = py / dy. A turn ω of the edge moves that place as does a
        shift by ω × a d.
        """
        dx, dy, dz = sight.axes[2]
        x, y, z = sight.offset  # y is -py
        a, by_x, by_z = y / dy, dx / dy, dz / dy
        way = a * dx, y, a * dz
        forces = [(-1.0, by_x, 0.0), (0.0, by_z, -1.0)]
        return [x - way[0], z - way[2]], forces, [cross(way, force) for force in forces]

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """How far the sensed point is off along the two axes across the edge."""
        offset = sight.offset
        across = [(dot(axis, offset), axis) for axis in sight.axes[:2]]
        return distances_in_space(offset, *across)

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        return points.mean(axis=-2), frame_around(principal_axes(points)[..., 0, :]), ()

    def lines(self, points: ndarray) -> list[ndarray]:
        """The edge as long as it was seen."""
        seen = np.nanpercentile((points - self.point) @ self.direction, [1, 99])
        ends = seen + 0.1 * np.diff(seen) * [-1, 1]
        return [self.point + np.outer(ends, self.direction)]

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> ndarray:
        """The chains (..., V, 2) that scan planes cut from a specimen with this edge, x
        and z in the sensor frame, mm. All its faces run along the edge; its top faces
        the scanner, on the side of smaller x, as most planes have it: it is one body.
        """
        corners = np.array(SPECIMENS[specimen])
        x = rotation[..., 0].reshape(-1, 3).mean(axis=0)
        return self.cut(corners, rotation, origin, away, x)

    def cut(
        self,
        corners: ndarray,
        rotation: ndarray,
        origin: ndarray,
        away: ndarray,
        x: ndarray,
    ) -> ndarray:
        """The chains (..., V, 2) that scan planes cut from a body along this edge whose
        cross-section has `corners` (V, 2): to the side of `x` (..., 3), or to either
        where that says none, and against `away` (..., 3), which points away from the
        scanner, not along the edge.
        """
        aside = unit(np.cross(self.direction, away))
        up = np.cross(self.direction, aside)
        aside = aside * np.copysign(1, np.vecdot(aside, x))[..., None]
        across = np.stack([aside, up], axis=-2)
        parallel = Edge(self.point + corners @ across, self.direction)
        return parallel.meet(rotation[..., None, :, :], origin[..., None, :])
