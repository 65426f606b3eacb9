"""A straight round bar of known radius: the scan plane meets it in an ellipse, of which
the scanner sees an arc.
"""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.fitting import fit_sphere
from profilecal.geometry.poses import cross, dot, frame_around
from profilecal.profiles.arcs import find_rods
from profilecal.targets.edge import Edge
from profilecal.targets.plane import BELOW_MM, Plane
from profilecal.targets.target import ALONG_Y, Target, Y, in_scan_plane


@dataclass(frozen=True)
class Rod(Target):
    """The cylinder of `radius` around the line through `point` (3,) along the unit
    vector `direction` (3,), mm.
    """

    point: np.ndarray
    direction: np.ndarray
    radius: float

    kind, shape, lengths = "rod", "cylinder", ("radius",)
    shifts, turns, rows, fit_is_best = "xy", "xy", 1, False
    groups, positions, sizes, stance = 15, 4, (15.0,), ALONG_Y
    find = staticmethod(find_rods)

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """Distance from the ellipse, to first order.

        v runs from the bar's origin to the point, the unit vector e from its axis. A
        move of the point changes ey by j: the part of the y axis square to bar and e,
        over the distance from the axis. Shifts of the bar move the point the other way;
        so do turns, which turn e too.
        """
        (f,), (force,), (torque,) = Rod.residual_in_space(origin, axes, seen, sizes)
        e, d, v = [-c for c in force], axes[2], Rod.offset(origin, seen)
        j = [(Y[k] - d[1] * d[k] - e[1] * e[k]) / (f + sizes[0]) for k in range(3)]
        ey_by_turn = [
            own - moved for own, moved in zip(cross(e, Y), cross(v, j), strict=True)
        ]
        return in_scan_plane(
            f, force, torque, ey_by_turn, ey_by_shift=[-part for part in j]
        )

    @staticmethod
    def residual_in_space(origin, axes, seen, sizes):
        """Distance from the bar."""
        v, d = Rod.offset(origin, seen), axes[2]
        along = dot(v, d)
        off = [a - along * b for a, b in zip(v, d, strict=True)]
        distance = np.sqrt(dot(off, off))
        e = [c / distance for c in off]
        return [distance - sizes[0]], [[-c for c in e]], [cross(e, v)]

    @staticmethod
    def offset(origin, seen):
        """Points of the scan plane from the origin, by components."""
        (x, z), (px, py, pz) = seen, origin
        return x - px, -py + np.zeros_like(x), z - pz

    @staticmethod
    def fit(points):
        """The axis algebraically, from |p|² = pᵀ D p + b·p + k with D = d dᵀ; around it
        the nearest circle.
        """
        middle = points.mean(axis=-2, keepdims=True)
        scale = np.sqrt(np.mean(np.sum((points - middle) ** 2, axis=-1), axis=-1))[
            ..., None, None
        ]
        p = (points - middle) / scale
        i, j = np.triu_indices(3)
        A = np.concatenate(
            [
                p[..., i] * p[..., j] * np.where(i == j, 1, 2),
                p,
                np.ones_like(p[..., :1]),
            ],
            axis=-1,
        )
        At = A.mT
        ridge = 1e-9 * np.eye(10) * p.shape[-2]
        x = np.linalg.solve(At @ A + ridge, At @ np.sum(p**2, axis=-1)[..., None])[
            ..., 0
        ]
        D = np.empty((*x.shape[:-1], 3, 3))
        D[..., i, j] = D[..., j, i] = x[..., :6]
        axes = frame_around(np.linalg.eigh(D)[1][..., 2])
        centre, radius = fit_sphere((points - middle) @ axes[..., :2])
        return (
            middle[..., 0, :] + (axes[..., :2] @ centre[..., None])[..., 0],
            axes,
            (radius,),
        )

    def distance(self, points):
        return Edge(self.point, self.direction).distance(points) - self.radius

    def arc(self, rotation, origin, reach_deg: float, count: int) -> np.ndarray:
        """Points (P, count, 2) where scan planes (P, 3, 3), (P, 3) meet the bar's
        generators, by angles about its axis to either side of the one that faces the
        scanner.
        """
        angle = np.radians(np.linspace(-reach_deg, reach_deg, count))
        d, z = self.direction, rotation[..., 2]
        up = (z @ d)[:, None] * d - z
        up /= np.linalg.norm(up, axis=-1, keepdims=True)
        aside = np.cross(up, d)
        aside *= np.sign(np.einsum("pa,pa->p", aside, rotation[..., 0]))[:, None]
        around = (
            np.cos(angle)[:, None] * up[:, None]
            + np.sin(angle)[:, None] * aside[:, None]
        )
        return Edge(self.point + self.radius * around, self.direction).meet(
            rotation[:, None], origin[:, None]
        )

    def points_seen(self, rotation, origin, count):
        return self.arc(rotation, origin, 60, count)

    def outline(self, specimen, rotation, origin, away):
        """Above a table."""
        table = Plane(self.point + (self.radius + BELOW_MM) * away, away)
        return table.behind(self.arc(rotation, origin, 90, 721), rotation, origin)

    def lines(self, points):
        """Four generators, as long as the bar was seen."""
        (axis,) = Edge(self.point, self.direction).lines(points)
        x, y, _ = self.frame[1].T
        return [axis + self.radius * around for around in (x, y, -x, -y)]
