"""A planar disk: the scan plane meets it in a chord."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.fitting import fit_sphere, middle_of, principal_axes
from profilecal.geometry.poses import circle_around, cross, dot, frame_around, root
from profilecal.profiles.chords import find_chords
from profilecal.targets.plane import BELOW_MM, Plane
from profilecal.targets.target import (
    Fitted,
    Linearised,
    Sight,
    Target,
    Views,
    Y,
)


@dataclass(frozen=True)
class Disk(Target):
    """A flat round disk.

    `centre` (3,), mm, and the unit vector `normal` (3,) are those of its face in the
    base frame; `radius` is in mm.

    A scanner in the base frame, whose scan plane passes the centre at 6 mm, sees a
    chord 16 mm long; each tip is x and z:

    >>> import numpy as np
    >>> import profilecal as pc
    >>> centre, normal = np.array([5.0, 6.0, 100.0]), np.array([0.0, 0.0, -1.0])
    >>> disk = pc.Disk(centre, normal, radius=10.0)
    >>> disk.meet(rotation=np.eye(3), origin=np.zeros(3)).tolist()
    [[-3.0, 100.0], [13.0, 100.0]]
    """

    centre: ndarray
    normal: ndarray
    radius: float

    kind = "disk"
    shape = "circle"
    lengths = ("radius",)
    shifts = "xyz"
    turns = "xy"
    points = 2
    rows = 2
    fit_is_best = False
    tables = ("profiles", "chords")
    finder = staticmethod(find_chords)
    beside_mm = 6.0
    groups = 4
    positions = 40
    sizes = (50.0,)
    with_tool = True
    across = (0.3, 1.0, 0.2)

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """x and z of each sensed tip minus those of the chord's end.

        The disk has its centre at (cx, cy, cz), the unit normal (nx, ny, nz) and the
        radius R. In the scan plane, where vectors are (x, z), the centre is c =
        (cx, cz), at the distance cy. With g² = nx² + nz², the unit vector
        N = (nx, nz) / g is across the chord and A = (nz, -nx) / g along it.

        A point p of the scan plane is on the disk's face where N · (p - c) = cy t, with
        t = ny / g. The point of that line nearest to the centre is the chord's middle:

            M = c + cy t N.

        It is q = cy √(1 + t²) = cy / g from the centre, so that half the chord is
        h = √(R² - q²), which `root` continues where the disk is missed. The tips are

            E = M + e A,    e = s h,    de/dq = -s q / h,

        s = -1 for the first tip, which has the smaller x, and 1 for the second; the
        other way round where nz < 0, since A then points towards smaller x.

        A shift of the disk moves c, with which E moves, and changes cy:

            dE/dcy = t N + de/dq A / g.

        A turn ω of the disk about its centre adds ω × n to its normal n. With
        ω' = (ωx, ωz) this turns N and A by an angle φ and changes t and g:

            dφ = ωy - t N · ω',    dN = A dφ,    dA = -N dφ,
            dg = ny A · ω',    dt = -A · ω' / g²,    dq = -cy / g² dg,

            -dE = (e N - cy t A) dφ - cy N dt + de/dq cy / g² A dg.
        """
        (nx, ny, nz), cy = sight.axes[2], sight.origin[1]
        (radius,) = sight.sizes
        g = np.hypot(nx, nz)
        N = np.array([nx, nz]) / g
        A = np.array([nz, -nx]) / g
        t = ny / g
        q = cy / g
        h, h_by_square = root(radius**2 - q**2, 0.1 * radius)
        s = np.array([[-1.0], [1.0]]) * np.where(nz < 0, -1, 1)
        e = s * h
        e_by_q = -2 * q * h_by_square * s

        r = sight.points - (sight.origin[::2] + cy * t * N) - e * A
        by_cy = -t * N - e_by_q * (A / g)
        force = [[-1.0, by_cy[0], 0.0], [0.0, by_cy[1], -1.0]]
        by_phi = e * N - cy * t * A
        by_t = -cy * N
        by_g = e_by_q * (cy * A / g**2)
        by_x, by_z = (
            by_g * (ny * A[i]) - by_phi * (t * N[i]) - by_t * (A[i] / g**2)
            for i in (0, 1)
        )
        return [*r], force, [*zip(by_x, by_phi, by_z, strict=True)]

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """Each tip's height above the disk, and its distance from the centre less the
        radius.
        """
        v, normal = sight.offset, sight.axes[2]
        length = np.sqrt(dot(v, v))
        r = [dot(normal, v), length - sight.sizes[0]]
        force = [-normal, [-c / length for c in v]]
        return r, force, [cross(normal, v), [0.0, 0.0, 0.0]]

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        return fit_around(principal_axes(points)[..., 2, :], points)

    def lines(self, points: ndarray) -> list[ndarray]:
        """The rim."""
        return [circle_around(self.centre, self.normal, self.radius)]

    def meet(self, rotation: ndarray, origin: ndarray) -> ndarray:
        """The chords that scan planes cut from the disk, (..., 2, 2): two tips, the one
        of smaller x first, each as x and z in the sensor frame; NaN where the disk is
        missed.
        """
        cy = np.vecmat(self.centre - origin, rotation)[..., 1]
        n = self.normal @ rotation
        g = np.hypot(n[..., 0], n[..., 2])
        missed = np.abs(cy) > self.radius * g
        tips = super().meet(rotation, origin)
        return np.where(missed[..., None, None], np.nan, tips)

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> list[ndarray]:
        """On top of a cylinder, above a table."""
        table = Plane(self.centre + BELOW_MM * away, away)
        return table.behind(self.meet(rotation, origin), rotation, origin)

    @staticmethod
    def offsets(views: Views, rng: np.random.Generator) -> ndarray:
        """Half-way between the scan plane's normal and the disk's, to either side: what
        suits the disk paper's method best. No chord is farther than 0.9 radii from the
        centre.
        """
        groups, positions = views.shape
        normals = views.normals
        sides = np.where(np.arange(groups) % 2, -1, 1)
        way = normals + np.outer(sides, Y)
        way = way / way[:, 1:2]
        if views.one_way:
            way[:] = way[0]
        farthest = np.minimum(0.64, 0.9 * np.hypot(normals[:, 0], normals[:, 2]))
        reach = views.sizes[0] * farthest[:, None, None]
        return np.linspace(-1, 1, positions)[:, None] * reach * way[:, None]


def fit_around(axis: ndarray, points: ndarray) -> Fitted:
    """What is round about unit vectors (..., 3) and nearest to points (..., n, 3): its
    frame's origin and axes, z the unit vector, and its radius.
    """
    axes = frame_around(axis)
    across = axes[..., :2]
    middle = middle_of(points)
    centre, radius = fit_sphere((points - middle) @ across)
    return middle[..., 0, :] + np.matvec(across, centre), axes, (radius,)
