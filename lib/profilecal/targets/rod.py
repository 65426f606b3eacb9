"""A straight round bar of known radius: the scan plane meets it in an ellipse, of which
the scanner sees an arc.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.fitting import with_sign
from profilecal.geometry.poses import circle_around, dot
from profilecal.profiles.arcs import find_rods
from profilecal.targets.disk import round_about
from profilecal.targets.edge import Edge
from profilecal.targets.plane import Round, fan
from profilecal.targets.target import (
    ALONG_Y,
    Fitted,
    Linearised,
    Sight,
    distances_in_space,
    in_scan_plane,
    length_of,
)


@dataclass(frozen=True)
class Rod(Round):
    """A straight round bar, endless in both directions.

    Its axis passes through `point` (3,), mm, along the unit vector `direction` (3,),
    both in the base frame; `radius` is in mm.

    A scanner in the base frame, whose scan plane is y = 0, sees an arc on the side that
    faces it; its point nearest to the scanner is, as x and z:

    >>> import numpy as np
    >>> import profilecal as pc
    >>> rod = pc.Rod(np.array([5.0, 0, 100]), np.array([0.0, 1, 0]), radius=10.0)
    >>> rod.points_seen(np.eye(3)[None], np.zeros((1, 3)), count=3)[0, 1].tolist()
    [5.0, 90.0]
    """

    point: ndarray
    direction: ndarray
    radius: float

    kind = "rod"
    shape = "cylinder"
    shifts = "xy"
    turns = "xy"
    half_arc_deg = 60.0
    finder = staticmethod(find_rods)
    groups = 15
    positions = 4
    usual_sizes = (15.0,)
    stance = ALONG_Y
    across = (1.0, 0.3, 0.5)
    across_mm = 10.0

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """Distance from the ellipse, to first order, as `in_scan_plane` has it.

        v runs from the bar's origin to the point, the unit vector e from the bar's axis
        to it, and d along the axis. The point is f + R from the axis. A move m of the
        point changes e by the part of m square to d and e, over that distance, so that

            dey = j · m,    j = (Y - dy d - ey e) / (f + R).
        """
        in_space = Rod.residual_in_space(sight)
        (distance,), (force,), _ = in_space
        axis = sight.axes[2]
        parts = zip((0, 1, 0), axis, force, strict=True)
        bend = [
            (y - axis[1] * d - force[1] * F) / (distance + sight.sizes[0])
            for y, d, F in parts
        ]
        return in_scan_plane(in_space, sight.offset, bend)

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """Distance from the bar."""
        offset, axis = sight.offset, sight.axes[2]
        along = dot(offset, axis)
        across = [v - along * d for v, d in zip(offset, axis, strict=True)]
        distance = length_of(across)
        outward = [part / distance for part in across]
        return distances_in_space(offset, (distance - sight.sizes[0], outward))

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        """The axis algebraically, and the nearest circle around it.

        With points p from their middle, in units of their spread, and h = (p, 1), those
        of a rod have hᵀ Q h = 0. The block of Q that is square in p is 1 - d dᵀ but for
        a factor, d the unit vector along the axis, which is its eigenvector to the
        smallest eigenvalue. Q = Σ c_k h_i h_j, k the pair i, j, has the least Σ (hᵀ Q
        h)² = cᵀ S c of all whose block has the same trace t · c where S c is a multiple
        of t.
        """
        p = points - points.mean(axis=-2, keepdims=True)
        p = p / p.std(axis=(-2, -1), keepdims=True)
        h = np.insert(p, 3, 1.0, axis=-1)
        i, j = np.triu_indices(4)
        products = h[..., i] * h[..., j]
        # of exact points S has no inverse
        S = products.mT @ products + 1e-10 * np.eye(10)
        Q = np.zeros((*S.shape[:-2], 4, 4))
        Q[..., i, j] = np.linalg.solve(S, (i == j) & (i < 3))
        direction = np.linalg.eigh((Q + Q.mT)[..., :3, :3])[1][..., 0]
        return round_about(with_sign(direction), points)

    def lines(self, points: ndarray) -> list[ndarray]:
        """Four generators, as long as the bar was seen."""
        around = circle_around(self.point, self.direction, self.radius, 5)[:4]
        return [Edge(place, self.direction).lines(points)[0] for place in around]

    def arc(
        self, rotation: ndarray, origin: ndarray, reach_deg: float, count: int
    ) -> ndarray:
        """Points (P, count, 2) where scan planes (P, 3, 3), (P, 3) meet the bar's
        generators, by angles about its axis to either side of the one that faces the
        scanner.
        """
        corners = self.radius * fan(reach_deg, count)
        axis = Edge(self.point, self.direction)
        return axis.cut(corners, rotation, origin, rotation[..., 2], rotation[..., 0])
