"""What a calibration target is to the rest of the library. One class, one file, one
line in the registry.

A target stands somewhere as a rigid frame: an origin and three axes in the base frame,
mm. Some shifts and turns of that frame change it and are unknown; the others do not (an
edge slides along itself). The scanner sees it from a sensor frame whose scan plane is y
= 0; x runs along the laser line, z is the depth.

To add one:

1. Write `targets/NAME.py` with a class that derives from `Target` and offers all that
has no default below. Its finder
   is a function there, or in `profiles` if other targets may use it.
2. Name it in `TARGETS` of `targets/__init__.py`. 3. Test it:
`tests/targets/test_contract.py` runs every registered target through what the library
asks of it.

Nothing else decides on a target's kind, but for the papers' closed forms.
"""

from collections.abc import Callable, Sequence

import numpy as np

from profilecal.geometry.checks import check_array
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import directions, frame_around
from profilecal.profiles.points import Feature

Y = (0.0, 1.0, 0.0)  # across the scan plane, in the sensor frame
# a stance: z along the sensor's y, y towards the scanner
ALONG_Y = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


class Target:
    """A target in its place. Class attributes and static methods speak of all targets
    of the kind.
    """

    kind: str  # its name in scan.toml, on the command line and in JSON
    shape: str  # what all its points make up, in words
    # its known measures, mm: entries of [target] in scan.toml, fields of the class
    lengths: tuple[str, ...] = ()
    tables: tuple[str, ...] = (
        "profiles",
    )  # what a scan folder may hold of it (`scan.folder.MEASURED`)
    # its finder: from profiles and its lengths; none if it leaves no trace
    find: Callable[..., list[Feature]]
    # The joint solution
    beside_mm = 0.0  # around a point of it, that a raw profile must show
    shifts: str  # axes of its frame along which a shift changes it
    turns: str  # axes of its frame about which a turn changes it
    # that a pose gives; None: any number, each anywhere on a curve
    points: int | None = None
    rows: int  # residuals of each point
    # of all placements `fit` leaves the least squares of distances; False: it is a
    # start
    fit_is_best = True
    # the operator steers the scan plane through it, and records the pose that this
    # takes
    steered = False
    # inside a group of one orientation its points are affine in the flange's position
    affine = False
    # Simulated scans
    groups: int  # flange orientations
    positions: int  # in each
    sizes: tuple[float, ...] = ()  # the `lengths`, mm
    # its axes, in columns, in a sensor frame that looks at it squarely
    stance = np.eye(3)
    # inside a group the scanner moves with the flange's axes, not the base's
    with_tool = False
    specimens: tuple[str, ...] = ("",)  # bodies that have it, the usual one first

    @classmethod
    def at(cls, origin, axes, sizes) -> "Target":
        """The target whose frame has an origin (3,) and axes (3, 3), in columns, and
        whose lengths are `sizes`. Usually its fields are the origin, the z axis where
        turns change it, and the lengths.
        """
        z = [axes[..., 2]] if cls.turns else []
        # type: ignore[call-arg]  # of the kinds of targets
        return cls(origin, *z, *sizes)

    @property
    def frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Its origin (3,), mm, and axes (3, 3), in columns."""
        origin, *others = vars(self).values()
        return origin, frame_around(others[0]) if self.turns else np.eye(3)

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """Observed points minus where the scan plane meets the target, in the scan
        plane, where the noise arises.

        All in the sensor frame and by components: `seen` x and z of the points, arrays
        (batch, points, poses); `origin` x, y, z and `axes` three times x, y, z, arrays
        (batch, 1, poses). Returns three lists with an entry for each of a point's
        residuals: the residuals, mm; forces, their derivatives by a shift of the
        target, by components; and torques, by a turn about its origin, rad, or None
        where no turn changes the target.
        """
        raise NotImplementedError

    @staticmethod
    def residual_in_space(origin, axes, seen, sizes):
        """As `residual`, by distances in space: they exist for any pose, which serves a
        search.
        """
        raise NotImplementedError

    @classmethod
    def residual_sd(cls, noise: Noise) -> tuple[float, ...]:
        """Standard deviations of a point's residuals, as multiples of the scanner's."""
        return (1.0,) * cls.rows

    @staticmethod
    def fit(points):
        """The target through points (..., n, 3) anywhere on it: origin (..., 3), axes
        (..., 3, 3), and its lengths, a tuple of (...). A start for the joint solution,
        and what a scan is verified with.
        """
        raise NotImplementedError

    def distance(self, points) -> np.ndarray:
        """How far points (n, 3) are from it, (n,) mm; of a disk, from its rim."""
        raise NotImplementedError

    def meet(self, rotation, origin) -> np.ndarray:
        """Where scan planes, sensor frames (..., 3, 3), (..., 3), meet it: (..., k), as
        in its table of a folder. A target of which a folder holds profiles alone leaves
        this out.
        """
        raise NotImplementedError

    def points_seen(self, rotation, origin, count: int) -> np.ndarray:
        """What a perfect scanner at sensor frames (P, 3, 3), (P, 3) sees, (P, m, 2):
        `count` points of a curve. Usually the points in which the scan planes `meet`
        it.
        """
        found = self.meet(rotation, origin)
        return found.reshape(len(origin), int(np.prod(found.shape[1:])) // 2, 2)

    def sides(self, rotation, origin) -> np.ndarray:
        """The `side` (P,) that a scan folder states for scan planes (P, 3, 3), (P, 3);
        0 where it says nothing.
        """
        return np.zeros(len(origin))

    @classmethod
    def check_sizes(cls, sizes) -> None:
        """Raise ValueError unless each of its lengths is there, in mm."""
        given = [*sizes, *[None] * (len(cls.lengths) - len(sizes))]
        for name, value in zip(cls.lengths, given, strict=True):
            if not (value and value > 0):
                raise ValueError(
                    f"the {cls.kind}'s {name} is {value}; expected a length in mm"
                )

    def outline(
        self, specimen: str, rotation, origin, away
    ) -> Sequence[np.ndarray] | np.ndarray:
        """Chains (V, 2) that scan planes (P, 3, 3), (P, 3) cut from it, and from what
        is behind it; `away` (3,) points away from the scanner. A target that leaves no
        trace in profiles leaves this out.
        """
        raise NotImplementedError

    @staticmethod
    def offsets(
        shape, motion: str, normals, sizes, steering_mm: float, rng: np.random.Generator
    ) -> np.ndarray:
        """A plan: by how much the target is off the middle of the scans, (*shape, 3)
        mm, shape (groups, positions), in the first sensor frame or, `with_tool`, in
        each. The usual one: along an "arc", or anywhere in a ball of 25 mm. `normals`
        (groups, 3): in the sensor frames, what faces the scanner.
        """
        if (
            motion == "arc"
        ):  # of 25 mm radius and 90°, in a plane at 45° to the sensor's y and x axes
            angle = np.linspace(-np.pi / 4, np.pi / 4, shape[1]) + rng.uniform(
                0, 2 * np.pi
            )
            arc = 25 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            plane = np.array([[np.sqrt(0.5), np.sqrt(0.5), 0.0], [0.0, 0.0, 1.0]])
            return np.broadcast_to((arc - arc.mean(axis=0)) @ plane, (*shape, 3))
        return 25 * np.cbrt(rng.uniform(size=(*shape, 1))) * directions(rng, shape)

    def lines(self, points) -> list[np.ndarray]:
        """Polylines (n, 3) that draw it, as far as it was seen at points (k, 3)."""
        raise NotImplementedError


def in_sensor(rotation, vectors) -> np.ndarray:
    """Components of vectors (..., 3) along the axes of sensor frames (..., 3, 3)."""
    return (vectors[..., None, :] @ rotation)[..., 0, :]


def in_scan_plane(distance, force, torque, ey_by_turn, ey_by_shift=None):
    """What `Target.residual` returns of a distance in space, mm, taken within the scan
    plane, to first order.

    The distance f grows by one along the unit vector e, and by h within the scan plane,
    where h² = ex² + ez² = 1 - ey². The residual is f / h, its derivative df / h + (f ey
    / h³) dey. `force`, which is -e, and `torque` are what a shift and a turn of the
    target change in f; beside them is what they change in ey, all by components.
    """
    h = np.sqrt(np.maximum(force[0] ** 2 + force[2] ** 2, 1e-12))
    by_ey = -distance * force[1] / h**3
    force = [part / h for part in force]
    if ey_by_shift is not None:
        force = [
            part + by_ey * of_ey for part, of_ey in zip(force, ey_by_shift, strict=True)
        ]
    torque = [
        part / h + by_ey * of_ey for part, of_ey in zip(torque, ey_by_turn, strict=True)
    ]
    return [distance / h], [force], [torque]


def find_features(target: type[Target], profiles, sizes=()) -> list[Feature]:
    """What each of a scan's raw profiles, (n, 2) mm, shows of a target of some `sizes`,
    mm. They are read together: what most of them show clearly settles which of several
    candidates the others show. Raises ValueError for a missing size, or a profile of
    another shape.
    """
    target.check_sizes(sizes)
    profiles = [
        check_array(f"profile {k}", values, (None, 2), finite=False)
        for k, values in enumerate(profiles)
    ]
    return target.find(profiles, *sizes)
