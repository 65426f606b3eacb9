"""A planar disk: the scan plane meets it in a chord."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.fitting import fit_sphere, principal_axes
from profilecal.geometry.poses import circle_around, dot, frame_around, root
from profilecal.profiles.chords import find_chords
from profilecal.targets.plane import above_table
from profilecal.targets.target import (
    Fitted,
    Linearised,
    Sight,
    Target,
    Views,
    distances_in_space,
    length_of,
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
    size_names = ("radius",)
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
    usual_sizes = (50.0,)
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

            -dE = P dφ - cy N dt + de/dq cy / g² A dg,    P = e N - cy t A.

        By ωy that is P, and by each of ω' = (ωx, ωz), with the same of N and A,

            Ak Q - t Nk P,    Q = q / g (N + de/dq ny A).
        """
        nx, ny, nz = sight.axes[2]
        cy = sight.origin[1]
        (radius,) = sight.sizes
        g = np.hypot(nx, nz)
        t, q = ny / g, cy / g
        N = np.array([nx, nz]) / g
        A = np.array([nz, -nx]) / g
        half, slope = root(radius**2 - q * q, 0.1 * radius)
        s = np.where(nz < 0, -1, 1) * [[-1], [1]]
        e, de_dq = s * half, -2 * s * slope * q
        r = sight.points - sight.origin[::2] - cy * t * N - e * A
        by_cy = -t * N - de_dq / g * A
        force = [(-1.0, by_cy[0], 0.0), (0.0, by_cy[1], -1.0)]
        P, Q = e * N - cy * t * A, q / g * (N + de_dq * ny * A)
        by_x, by_z = (A[k] * Q - t * N[k] * P for k in (0, 1))
        return [*r], force, [*zip(by_x, P, by_z, strict=True)]

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """Each tip's height above the disk, and its distance from the centre less the
        radius.
        """
        offset, normal = sight.offset, sight.axes[2]
        distance = length_of(offset)
        outward = [part / distance for part in offset]
        height = dot(normal, offset), normal
        return distances_in_space(offset, height, (distance - sight.sizes[0], outward))

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        return round_about(principal_axes(points)[..., 2, :], points)

    def lines(self, points: ndarray) -> list[ndarray]:
        """The rim."""
        return [circle_around(self.centre, self.normal, self.radius)]

    def meet(self, rotation: ndarray, origin: ndarray) -> ndarray:
        """The chords that scan planes cut from the disk, (..., 2, 2): two tips, the one
        of smaller x first, each as x and z in the sensor frame; NaN where the disk is
        missed.
        """
        sight = self.sight_from(rotation, origin)
        nx, _, nz = sight.axes[2]
        is_met = np.abs(sight.origin[1]) < self.radius * np.hypot(nx, nz)
        return np.where(is_met, super().meet(rotation, origin), np.nan)

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> list[ndarray]:
        """On top of a cylinder, above a table."""
        chords = self.meet(rotation, origin)
        return above_table(chords, self.centre, rotation, origin, away)

    @staticmethod
    def offsets(views: Views, rng: np.random.Generator) -> ndarray:
        """Half-way between the scan plane's normal and the disk's, to either side: what
        suits the disk paper's method best. No chord is farther than 0.9 radii from the
        centre.
        """
        groups, positions = views.shape
        side = np.where(np.arange(groups) % 2, -1, 1)[:, None]
        way = side * views.normals + [0, 1, 0]
        if views.one_way:
            way = way[:1]
        # a chord is 1 / g times as far from the centre as the scan plane, g as in
        # `residual`
        g = np.linalg.norm(views.normals[:, ::2], axis=1, keepdims=True)
        ends = views.sizes[0] * np.minimum(0.64, 0.9 * g) * way / way[:, [1]]
        return np.linspace(-1, 1, positions)[:, None] * ends[:, None]


def round_about(axis: ndarray, points: ndarray) -> Fitted:
    """What is round about unit vectors (..., 3) and nearest to points (..., n, 3): its
    frame's origin and axes, z the unit vector, and its radius.
    """
    axes = frame_around(axis)
    in_axes = points @ axes
    place = in_axes.mean(axis=-2)
    place[..., :2], radius = fit_sphere(in_axes[..., :2])
    return np.matvec(axes, place), axes, (radius,)
