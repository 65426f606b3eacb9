"""A straight round bar of known radius: the scan plane meets it in an ellipse, of which
the scanner sees an arc.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.fitting import middle_of, with_sign
from profilecal.geometry.poses import cross, dot
from profilecal.profiles.arcs import find_rods
from profilecal.targets.disk import fit_around
from profilecal.targets.edge import Edge
from profilecal.targets.plane import Round
from profilecal.targets.target import (
    ALONG_Y,
    Fitted,
    Linearised,
    Sight,
    Y,
    in_scan_plane,
    up_and_aside,
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
    sizes = (15.0,)
    stance = ALONG_Y
    across = (1.0, 0.3, 0.5)

    @property
    def across_mm(self) -> float:
        return 10.0

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """Distance from the ellipse, to first order, as `in_scan_plane` has it.

        v runs from the bar's origin to the point, the unit vector e from the bar's axis
        to it, and d along the axis. The point is f + R from the axis. A move m of the
        point changes e by the part of m square to d and e, over that distance, so that

            dey = j · m,    j = (Y - dy d - ey e) / (f + R).

        A shift of the bar moves the point the other way, as the bar sees it: m is minus
        the shift. So does a turn ω, m = -ω × v, which turns e too:

            dey = Y · (ω × e) - j · (ω × v) = ω · (e × Y - v × j).
        """
        (f,), (force,), _ = in_space = Rod.residual_in_space(sight)
        d, e = sight.axes[2], -force
        j = -d[1] * d - e[1] * e
        j[1] += 1
        j /= f + sight.sizes[0]
        turned, moved = cross(e, Y), cross(sight.offset, j)
        by_turn = [turned[k] - moved[k] for k in range(3)]
        return in_scan_plane(in_space, -j, by_turn)

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """Distance from the bar."""
        v, d = sight.offset, sight.axes[2]
        along = dot(v, d)
        off = np.array([v[k] - along * d[k] for k in range(3)])
        distance = np.sqrt(dot(off, off))
        e = off / distance
        return [distance - sight.sizes[0]], [-e], [cross(e, v)]

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        """The axis algebraically, and the nearest circle around it.

        With points p from their middle, in units of their spread, and the unit vector d
        along the axis, those of a rod have |p|² = pᵀ D p + b·p + k with D = d dᵀ. Least
        squares give D, of which d is the eigenvector to the largest eigenvalue.
        """
        p = points - middle_of(points)
        spread = np.sqrt(np.vecdot(p, p).mean(axis=-1))
        p = p / spread[..., None, None]
        i, j = np.triu_indices(3)
        # by the ten unknowns: D's six entries, those off its diagonal twice; b; and k
        of_D = p[..., i] * p[..., j] * np.where(i == j, 1, 2)
        A = np.concatenate([of_D, p, np.ones_like(p[..., :1])], axis=-1)
        square = np.vecdot(p, p)
        # points of one profile, or fewer than ten, leave some of them open
        ridge = 1e-9 * np.eye(10) * p.shape[-2]
        x = np.linalg.solve(A.mT @ A + ridge, A.mT @ square[..., None])[..., 0]
        D = x[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        return fit_around(with_sign(np.linalg.eigh(D)[1][..., 2]), points)

    def lines(self, points: ndarray) -> list[ndarray]:
        """Four generators, as long as the bar was seen."""
        (axis,) = Edge(self.point, self.direction).lines(points)
        x, y, _ = self.frame[1].T
        return [axis + self.radius * out for out in (x, y, -x, -y)]

    def arc(
        self, rotation: ndarray, origin: ndarray, reach_deg: float, count: int
    ) -> ndarray:
        """Points (P, count, 2) where scan planes (P, 3, 3), (P, 3) meet the bar's
        generators, by angles about its axis to either side of the one that faces the
        scanner.
        """
        z, x = rotation[..., 2], rotation[..., 0]
        up, aside = up_and_aside(self.direction, z, x)
        angle = np.radians(np.linspace(-reach_deg, reach_deg, count))[:, None]
        out = np.cos(angle) * up[:, None] + np.sin(angle) * aside[:, None]
        generators = Edge(self.point + self.radius * out, self.direction)
        return generators.meet(rotation[:, None], origin[:, None])
