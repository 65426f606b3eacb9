"""A planar disk: the scan plane meets it in a chord."""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.fitting import fit_sphere, principal_axes
from profilecal.geometry.poses import circle_around, cross, dot, frame_around, root
from profilecal.profiles.edges import find_chords
from profilecal.targets.plane import BELOW_MM, Plane
from profilecal.targets.target import Target, in_sensor


@dataclass(frozen=True)
class Disk(Target):
    """The disk around `centre` (3,) with unit `normal` (3,) and `radius`, base frame,
    mm.
    """

    centre: np.ndarray
    normal: np.ndarray
    radius: float

    kind, shape, lengths, tables = "disk", "circle", ("radius",), ("profiles", "chords")
    shifts, turns, points, rows, fit_is_best = "xyz", "xy", 2, 2, False
    groups, positions, sizes, with_tool = 4, 40, (50.0,), True
    find = staticmethod(find_chords)

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """x and z of each sensed tip minus those of the chord's end.

        Across the chord runs N = (nx, nz)/g, along it A = (nz, -nx)/g, g² = nx² + nz².
        The chord's middle is the disk's centre projected onto the plane along the disk,
        (cx, cz) + cy t N with t = ny/g; it is q = cy/g off the centre.
        """
        (cx, cy, cz), (nx, ny, nz), (radius,) = origin, axes[2], sizes
        g = np.hypot(nx, nz)
        N, A, t, q = (nx / g, nz / g), (nz / g, -nx / g), ny / g, cy / g
        half, slope = root(radius**2 - q**2, 0.1 * radius)
        # of the tips, smaller x first
        side = np.array([[-1.0], [1.0]]) * np.where(nz < 0, -1, 1)
        end, by_q = side * half, -2 * q * slope * side
        r, force, torque = [], [], []
        for k, (observed, centre) in enumerate(zip(seen, (cx, cz), strict=True)):
            r.append(observed - (centre + cy * t * N[k]) - end * A[k])
            force.append([0.0, -t * N[k] - by_q * (A[k] / g), 0.0])
            force[k][2 * k] = -1.0
            # by the angle of N and A in the scan plane, by t, by g; and what a turn of
            # the disk makes of these
            by_angle, by_t, by_g = (
                end * N[k] - cy * t * A[k],
                -cy * N[k],
                by_q * (cy * A[k] / g**2),
            )
            x, z = (
                by_g * (ny * A[i]) - by_angle * (t * N[i]) - by_t * A[i] / g**2
                for i in (0, 1)
            )
            torque.append([x, by_angle, z])
        return r, force, torque

    @staticmethod
    def residual_in_space(origin, axes, seen, sizes):
        """Each tip's height above the disk, and its distance from the centre less the
        radius.
        """
        (x, z), (cx, cy, cz), normal = seen, origin, axes[2]
        v = (x - cx, -cy, z - cz)
        length = np.sqrt(dot(v, v))
        force = [[-n for n in normal], [-c / length for c in v]]
        return (
            [dot(normal, v), length - sizes[0]],
            force,
            [cross(normal, v), [0.0, 0.0, 0.0]],
        )

    @staticmethod
    def fit(points):
        axes = frame_around(principal_axes(points)[..., 2, :])
        middle = points.mean(axis=-2, keepdims=True)
        centre, radius = fit_sphere((points - middle) @ axes[..., :2])
        return (
            middle[..., 0, :] + (axes[..., :2] @ centre[..., None])[..., 0],
            axes,
            (radius,),
        )

    def distance(self, points):
        """From the rim."""
        offset = points - self.centre
        height = offset @ self.normal
        across = np.linalg.norm(offset - height[..., None] * self.normal, axis=-1)
        return np.hypot(height, across - self.radius)

    def meet(self, rotation, origin) -> np.ndarray:
        """The chords that scan planes cut from the disk, (..., 2, 2): two tips, the one
        of smaller x first, each as x and z in the sensor frame; NaN where the disk is
        missed.
        """
        c, n = in_sensor(rotation, self.centre - origin), self.normal @ rotation
        cy, ny, c, n = c[..., 1:2], n[..., 1:2], c[..., [0, 2]], n[..., [0, 2]]
        with np.errstate(divide="ignore", invalid="ignore"):
            squared = np.sum(n**2, axis=-1, keepdims=True)
            middle = c + cy * ny / squared * n
            # as long as n
            along = n[..., ::-1] * np.where(n[..., 1:] < 0, [-1, 1], [1, -1])
            half = np.sqrt((self.radius**2 - cy**2 / squared) / squared) * along
            return np.stack([middle - half, middle + half], axis=-2)

    def outline(self, specimen, rotation, origin, away):
        """On top of a cylinder, above a table."""
        table = Plane(self.centre + BELOW_MM * away, away)
        return table.behind(self.meet(rotation, origin), rotation, origin)

    @staticmethod
    def offsets(shape, motion, normals, sizes, steering_mm, rng):
        """Half-way between the scan plane's normal and the disk's, to either side: what
        suits the disk paper's method best; with the motion "equal", one way for all. No
        chord is farther than 0.9 radii from the centre.
        """
        groups, positions = shape
        way = normals + np.where(np.arange(groups) % 2, -1, 1)[:, None] * np.array(
            [0.0, 1.0, 0.0]
        )
        way = way / way[:, 1:2]
        if motion == "equal":
            way[:] = way[0]
        reach = (
            sizes[0]
            * np.minimum(0.64, 0.9 * np.hypot(normals[:, 0], normals[:, 2]))[
                :, None, None
            ]
        )
        return np.linspace(-1, 1, positions)[:, None] * reach * way[:, None]

    def lines(self, points):
        return [circle_around(self.centre, self.normal, self.radius)]
