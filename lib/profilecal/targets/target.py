"""What a target is to the rest of the library: the contract, from top to bottom.

A target stands somewhere as a rigid frame: an origin and three axes in the base frame,
mm. Some shifts and turns of that frame change it and are unknown; the others do not (an
edge slides along itself). The scanner sees it from a sensor frame whose scan plane is
y = 0; x runs along the laser line, z is the depth.

To add one:

1. Write `targets/NAME.py` with a frozen dataclass that derives from `Target`. Its
   fields are the origin, the z axis if turns change the target, and its sizes. With
   other fields it has its own `at` and `frame`. It may derive from another target, as a
   ball from what is round.
2. Set the attributes that have no default here, and those of which the default does not
   fit. Each is a line of the class.
3. Write the methods that every target has: `residual`, `residual_in_space`, `fit` and
   `lines`; its own `distance` where `residual_in_space` has another.
4. If it shows in raw profiles, write its `outline`, and its `finder`, which may be a
   function of `profiles` or stand in the same file. If it shows any number of points,
   write `points_seen`, and `meet` if a folder may hold what was measured of it instead.
5. Name it in `TARGETS` of `targets/__init__.py`, and where kinds are listed for people:
   `simulate`, `Scan.of`, `--target`, README, data/README.md, data/examples/edge.toml,
   the changelog; its class in `PUBLIC` of `profilecal/__init__.py` and in its `.pyi`.
6. Test it: `tests/library/targets/test_contract.py` runs every registered target
   through what the library asks of it, its finder's covariance too. Name it in the
   tables of `tests/library/profiles/test_finders.py`, and in `KINDS` of
   `tests/planned.py`.

`tests/library/targets/test_new_target.py` adds one, a V-groove, and goes with it from
raw profiles to a report. Nothing else decides on a target's kind, but for the papers'
closed forms.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy import ndarray

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import Frames, cross, directions, dot, frame_around
from profilecal.profiles.features import Feature
from profilecal.profiles.points import Profiles, in_order

# of vectors in the sensor frame x, y and z, each an array (batch, 1 or points, poses)
Components = Sequence[ndarray] | ndarray
# what `residual` returns: residuals, forces and, if there are any, torques
Linearised = tuple[list, list, Any]
# what `fit` returns: origins (..., 3), axes (..., 3, 3), and sizes, each (...)
Fitted = tuple[ndarray, ndarray, tuple]
# mm, in the order of a target's `size_names`
Sizes = Sequence[float]
# a stance: z along the sensor's y, y towards the scanner
ALONG_Y = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


class Sight(NamedTuple):
    """A target and what was seen of it, in the sensor frame and by components."""

    origin: ndarray  # of its frame, (3, batch, 1, poses)
    axes: Sequence[ndarray] | ndarray  # x, y and z of its frame, likewise
    points: ndarray  # x and z in the scan plane, (2, batch, points, poses)
    sizes: Sizes

    @property
    def offset(self) -> Components:
        """The points from the origin; y is the same for all points."""
        (x, z), (px, py, pz) = self.points, self.origin
        return x - px, -py, z - pz


class Views(NamedTuple):
    """What a plan of simulated scans is for."""

    shape: tuple[int, int]  # groups, and positions in each
    sizes: Sizes
    normals: ndarray  # (groups, 3) in the sensor frames, what faces the scanner
    one_way: bool  # disks: all motions go one way, which leaves the pose open
    steering_mm: float  # how well the operator steers through a marked point


class Target:
    """A target in its place. Class attributes and static methods speak of all targets
    of the kind.
    """

    def __post_init__(self) -> None:
        length = np.linalg.norm(self.frame[1][..., 2], axis=-1)
        if not np.abs(length - 1).max(initial=0) <= 1e-6:
            raise ValueError(
                f"the axis of this {self.kind} has length {length.max():g}; expected 1"
            )
        for name in self.size_names:
            size = getattr(self, name)
            if not 0 < size < np.inf:
                raise ValueError(
                    f"the {name} of this {self.kind} is {size:g}; expected mm above 0"
                )

    # Its name and its sizes

    # in scan.toml, on the command line and in JSON
    kind: str
    # what all its points make up, in words for a message; targets may share it
    shape: str
    # its known sizes: entries of [target] in scan.toml, fields of the class
    size_names: tuple[str, ...] = ()

    # How it stands

    # axes of its frame along which a shift changes it
    shifts: str
    # axes of its frame about which a turn changes it
    turns: str

    @classmethod
    def at(cls, origin: ndarray, axes: ndarray, sizes: Sizes) -> Self:
        """The target whose frame has an origin (3,) and axes (3, 3), in columns, and
        which has these sizes.
        """
        create: Callable[..., Self] = cls
        z = [axes[..., 2]] if cls.turns else []
        return create(origin, *z, *sizes)

    @property
    def frame(self) -> Frames:
        """Its origin (3,), mm, and axes (3, 3), in columns."""
        origin, *others = vars(self).values()
        return origin, frame_around(others[0]) if self.turns else np.eye(3)

    @property
    def sizes(self) -> tuple[float, ...]:
        """Its own sizes, mm."""
        return tuple(getattr(self, name) for name in self.size_names)

    # What the joint solution asks

    # points that a pose gives; None: any number, each anywhere on a curve
    points: int | None = None
    # residuals of each point
    rows: int = 1
    # the operator steers the scan plane through it, and records the pose that this
    # takes
    steered = False
    # of all placements `fit` leaves the least squares of distances; False: it is a
    # start
    fit_is_best = True

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """Observed points minus where the scan plane meets the target, in the scan
        plane, where the noise arises.

        Returns three lists with an entry for each of a point's residuals: the
        residuals, mm; forces, their derivatives by a shift of the target, by
        components; and torques, by a turn about its origin, rad, or None where no turn
        changes the target.
        """
        raise NotImplementedError

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """As `residual`, by distances in space: they exist for any pose, which serves a
        search.
        """
        raise NotImplementedError

    @classmethod
    def residual_sd(cls, noise: Noise) -> tuple[float, ...]:
        """Standard deviations of a point's residuals, as multiples of the scanner's."""
        return (1.0,) * cls.rows

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        """The target through points (..., n, 3) anywhere on it: its origin, axes and
        sizes. A start for the joint solution, and what a scan is verified with.
        """
        raise NotImplementedError

    def distance(self, points: ndarray) -> ndarray:
        """How far points (n, 3) are from it, (n,) mm; of a disk, from its rim, to first
        order where that is near.

        A sensor frame in each point, along the base's axes, has the point in its
        origin, and the distance is `residual_in_space`.
        """
        sight = self.sight_from(np.eye(3), np.atleast_2d(points))
        return np.linalg.norm(self.residual_in_space(sight)[0], axis=0)[:, 0, 0]

    def sight_from(self, rotation: ndarray, origin: ndarray) -> Sight:
        """What sensor frames (..., 3, 3), (..., 3) see of it, as if points were seen in
        their origins; its arrays are (3, ..., 1, 1), of points (2, ..., 1, 1).
        """
        place, axes = self.frame
        vectors = place - origin, *np.moveaxis(axes, -1, 0)
        in_sensor = [np.vecmat(vector, rotation) for vector in vectors]
        seen, *along = (np.moveaxis(v, -1, 0)[..., None, None] for v in in_sensor)
        return Sight(seen, along, 0 * seen[:2], self.sizes)

    def lines(self, points: ndarray) -> list[ndarray]:
        """Polylines (n, 3) that draw it, as far as it was seen at points (k, 3)."""
        raise NotImplementedError

    # What a scan holds of it

    # what a folder may hold (`scan.folder.MEASURED`); the last is what is simulated
    tables: tuple[str, ...] = ("profiles",)
    # its finder: from the points (n, 2) that a scan's profiles show, mm, in order, and
    # its sizes; what most of them show clearly settles which of several candidates
    # the others show. A target that leaves no trace has none
    finder: Callable[..., list[Feature]]
    # mm of a profile to either side of a point of it by which its finder knows it:
    # planned poses keep them in view
    beside_mm = 0.0

    @classmethod
    def find(cls, profiles: Profiles, *sizes: float) -> list[Feature]:
        """What each raw profile (n, 2) shows of a target with these sizes, mm.

        The finder gets the points that the scanner saw, in order, alone: whether a
        scanner's software keeps the rows of missing points, and how it sorts, makes no
        difference. Raises ValueError for a target that leaves no trace in them.
        """
        if "profiles" not in cls.tables:
            raise ValueError(f"a {cls.kind} leaves no trace in profiles")
        rows = [*map(in_order, profiles)]
        seen = [profile[own] for profile, own in zip(profiles, rows, strict=True)]
        return [
            replace(feature, used=np.sort(own[feature.used]))
            for feature, own in zip(cls.finder(seen, *sizes), rows, strict=True)
        ]

    def meet(self, rotation: ndarray, origin: ndarray) -> ndarray:
        """Where scan planes, sensor frames (..., 3, 3), (..., 3), meet it: (..., 2) or,
        where its `points` are several, (..., points, 2), x and z in the sensor frame.

        That is minus the `residual` of points in the sensor's origin: of a marked point
        that is beside the scan plane, where it is seen from there. A target with any
        number of points has none, or what its table of a folder holds. Raises
        ValueError.
        """
        if self.points is None:
            raise ValueError(f"a {self.kind} is met in a curve: see `points_seen`")
        x, z, *_ = self.residual(self.sight_from(rotation, origin))[0]
        places = -np.concatenate([x, z], axis=-1)
        return places if self.points != 1 else places[..., 0, :]

    def points_seen(self, rotation: ndarray, origin: ndarray, count: int) -> ndarray:
        """What a perfect scanner at sensor frames (P, 3, 3), (P, 3) sees, (P, m, 2):
        `count` points of a curve. Usually the points in which the scan planes `meet`
        it.
        """
        met = self.meet(rotation, origin)
        return met if met.ndim > 2 else met[:, None]

    def sides(self, rotation: ndarray, origin: ndarray) -> ndarray:
        """The `side` (P,) that a scan folder states for scan planes (P, 3, 3), (P, 3);
        0 where it says nothing.
        """
        return np.zeros(len(origin))

    # What simulated scans ask

    # flange orientations
    groups: int
    # in each
    positions: int
    # its sizes, mm
    usual_sizes: tuple[float, ...] = ()
    # its axes, in columns, in a sensor frame that looks at it squarely
    stance = np.eye(3)
    # inside a group the scanner moves with the flange's axes, not the base's
    with_tool = False
    # the direction in which sweeps cross it, in the sensor's frame; empty: none do
    across: tuple[float, ...] = ()
    # bodies that have it, the usual one first
    specimens: tuple[str, ...] = ("",)

    @property
    def across_mm(self) -> float:
        """How far to either side sweeps go: half of its first size, if it has one."""
        return self.sizes[0] / 2 if self.sizes else 20.0

    def outline(
        self, specimen: str, rotation: ndarray, origin: ndarray, away: ndarray
    ) -> Sequence[ndarray] | ndarray:
        """Chains (V, 2) that scan planes (P, 3, 3), (P, 3) cut from it, and from what
        is behind it; `away` (3,) points away from the scanner. A target that leaves no
        trace in profiles leaves this out.
        """
        raise NotImplementedError

    @staticmethod
    def offsets(views: Views, rng: np.random.Generator) -> ndarray:
        """A plan: by how much the target is off the middle of the scans, (groups,
        positions, 3) mm, in the first sensor frame or, `with_tool`, in each. The usual
        one: anywhere in a ball of 25 mm.
        """
        radius = 25 * np.cbrt(rng.uniform(size=(*views.shape, 1)))
        return radius * directions(rng, views.shape)


def distances_in_space(
    offset: Components, *distances: tuple[ndarray, Components]
) -> Linearised:
    """What `Target.residual_in_space` returns of distances, each with the unit vector
    along which it grows when the point, at an `offset` from the target's origin, moves.

    A shift of the target moves the point the other way, as the target sees it. So does
    a turn ω, by -ω × v where the offset is v, which changes a distance that grows along
    e by -e · (ω × v) = ω · (v × -e).
    """
    forces = [[-part for part in along] for _, along in distances]
    torques = [cross(offset, force) for force in forces]
    return [distance for distance, _ in distances], forces, torques


def in_scan_plane(
    in_space: Linearised, offset: Components, bend: Sequence = (0.0, 0.0, 0.0)
) -> Linearised:
    """What `Target.residual` returns of a distance in space, mm, taken within the scan
    plane, to first order.

    The distance f grows by one along the unit vector e = -F, F the force, and by h
    within the scan plane, where h² = ex² + ez² = 1 - Fy². The residual is f / h, and
    its derivative df / h - k dey with k = f Fy / h³.

    A point at an `offset` v from the target's origin that moves by m changes f by e · m
    and ey by j · m, j the `bend` of the target: zero where e is the same everywhere. A
    shift of the target moves the point the other way, as the target sees it, which has
    the force G = F / h + k j. A turn ω moves it by -ω × v, and it turns e, by which ey
    grows by Y · (ω × e) = -ω · (F × Y). The torque is

        v × G + k (F × Y),    F × Y = (-Fz, 0, Fx).
    """
    (distance,), (force,), _ = in_space
    Fx, Fy, Fz = force
    h = np.sqrt(1 - Fy * Fy)
    k = distance * Fy / h**3
    force = [part / h + k * by_bend for part, by_bend in zip(force, bend, strict=True)]
    x, y, z = cross(offset, force)
    return [distance / h], [force], [[x - k * Fz, y, z + k * Fx]]


def length_of(vector: Components) -> ndarray:
    """The length of vectors by their components."""
    return np.sqrt(dot(vector, vector))
