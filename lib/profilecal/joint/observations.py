"""What the scanner saw of a target; the unknowns: sensor poses and the frames of the targets; which profiles share an
error of the flange; and what may be wrong at every pose alike.

Nobody knows the scanner's and the target's systematic errors, but everybody knows about how large they can be. They are
considered: the answer gives way to them as far as they are likely (Schmidt 1966). Those of the robot are only tested
(`calibrate.plausibility`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from profilecal.geometry.checks import check_array
from profilecal.geometry.noise import ROBOT, Systematic
from profilecal.geometry.poses import SAME_ORIENTATION_DEG, angle_between, inverse, parallel
from profilecal.targets import TARGETS
from profilecal.targets.target import Target


@dataclass(frozen=True)
class Observations:
    """What the scanner saw of one target from P flange poses; leading axes are a batch of problems."""

    kind: str  # of the target, one of TARGETS
    R_flange: np.ndarray  # (..., P, 3, 3) flange in the base frame; eye-to-hand: base in the flange frame
    T_flange: np.ndarray  # (..., P, 3) mm
    points: np.ndarray  # (..., P, m, 2) x and z, m as the target's `points`; NaN: none
    sizes: tuple[float, ...] = ()  # the target's `lengths`, mm
    group: np.ndarray | None = None  # (P,) poses of one flange orientation share a number
    eye_to_hand: bool = False
    # of what was seen from each pose, as a multiple of `Noise.profile_mm`²; None: 1 for each coordinate, independent.
    # (..., P, m) of points' distances from a curve; else (..., P, 2m, 2m) of x and z of all points
    covariance: np.ndarray | None = None

    def __post_init__(self):
        if self.kind not in TARGETS:
            raise ValueError(f"kind is {self.kind!r}; expected one of {', '.join(TARGETS)}")
        self.target.check_sizes(self.sizes)
        shape = (..., None, self.target.points, 2)
        P, m, _ = check_array(f"points ({self.kind})", self.points, shape, finite=False).shape[-3:]
        check_array("R_flange", self.R_flange, (..., P, 3, 3))
        check_array("T_flange", self.T_flange, (..., P, 3))
        if self.group is not None:
            check_array("group", self.group, (P,), finite=False)
        if self.covariance is not None:
            if "profiles" not in self.target.tables:
                raise ValueError(f"a {self.kind} has no covariance of its own; state profile_mm and steering_mm")
            tail = (P, m) if self.on_curve else (P, 2 * m, 2 * m)
            check_array("covariance", self.covariance, (..., *tail), finite=False)

    @property
    def target(self) -> type[Target]:
        """The class of the target."""
        return TARGETS[self.kind]

    @property
    def on_curve(self) -> bool:
        """Whether points lie anywhere on a curve, so that only their distance from it says something."""
        return self.target.points is None

    @property
    def arrays(self) -> dict[str, Any]:
        """What leading axes are a batch of."""
        names = ("R_flange", "T_flange", "points", "covariance")
        return {name: np.asarray(getattr(self, name)) for name in names if getattr(self, name) is not None}

    @property
    def labels(self) -> np.ndarray:
        """Numbers from 0 (P,) that the poses of one rotation group share; without groups, each its own."""
        poses = np.arange(np.shape(self.points)[-3])
        return poses if self.group is None else np.unique(self.group, return_inverse=True)[1]

    def keep(self, poses) -> "Observations":
        """Only some poses, by mask or index."""
        one_axis = ("T_flange", "covariance") if self.on_curve else ("T_flange",)  # after that of the poses
        kept = {
            name: array[..., poses, :] if name in one_axis else array[..., poses, :, :]
            for name, array in self.arrays.items()
        }
        return replace(self, **kept, group=None if self.group is None else np.asarray(self.group)[poses])

    def take(self, chosen) -> "Observations":
        """Some problems of a batch, by mask, index or slice."""
        arrays = self.arrays
        length = max(map(len, arrays.values()))
        return replace(self, **{k: v[chosen] if len(v) == length else v for k, v in arrays.items()})


def each(function, first, *others):
    """`function` of the arrays in the same place of batches, or of tuples, that are built alike."""
    if isinstance(first, np.ndarray):
        return function(first, *others)
    if isinstance(first, tuple):
        return tuple(each(function, *parts) for parts in zip(first, *others, strict=True))
    return type(first)(*(each(function, *(getattr(one, f.name) for one in (first, *others))) for f in fields(first)))


class Batch:
    """A dataclass of arrays, tuples of them and further batches, all with one leading axis."""

    def __getitem__(self, chosen):
        return each(lambda array: array[chosen], self)

    def repeat(self, count: int):
        """The first one, `count` times."""
        return self[np.zeros(count, dtype=int)]

    def join(self, *others):
        """Batches as one."""
        return each(lambda *arrays: np.concatenate(arrays), self, *others)

    def where(self, mask, other):
        """This one where the mask (B,) holds, the other elsewhere."""
        return each(lambda a, b: np.where(mask.reshape(-1, *[1] * (a.ndim - 1)), a, b), self, other)


@dataclass(frozen=True)
class State(Batch):
    """Sensor poses and, for each target, the frame that it stands in."""

    rotation: np.ndarray  # (B, 3, 3)
    translation: np.ndarray  # (B, 3) mm
    placements: tuple  # for each target its origin (B, 3), mm, and axes (B, 3, 3), in columns


def pose_error(rotation, translation, true_rotation, true_translation) -> np.ndarray:
    """δ (..., 6), mm and rad, sensor frame, with T_true = T · exp(δ) to first order: what the covariance is of."""
    turn = rotation.mT @ true_rotation
    shift = rotation.mT @ (true_translation - translation)[..., None]
    angles = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
    return np.concatenate([shift[..., 0], angles], axis=-1)


def normalised_square(covariance, error) -> np.ndarray:
    """Errors (..., 6) squared over their covariances (..., 6, 6): follows χ² with 6 degrees of freedom if honest."""
    return np.einsum("...i,...i", error, np.linalg.solve(covariance, error[..., None])[..., 0])


@dataclass(frozen=True)
class Perturbation:
    """One error, which moves points, positions of the robot, or a length by so much for one unit of its size."""

    words: str  # with a place for the size, and [one word|another] for its sign
    unit: float  # what the size is to be multiplied by, for the words
    prior: str = ""  # the entry of `Systematic` that says how large it can be
    points: Callable | None = None  # of points x and z (...): by how much both are wrong, mm
    positions: Callable = np.zeros_like  # of flange positions (P, 3) in the base: by how much they are wrong, mm
    length: str = ""  # of the target


def of_scanner() -> list[Perturbation]:
    """Scales of the profiles, x that grows with z, and a bend."""
    words, scale = "the profiles' {} were too [large|small] by {{:.2g}} %", "scale_percent"
    return [
        Perturbation(words.format("x"), 100, scale, points=lambda x, z: (x, 0 * z)),
        Perturbation(words.format("z"), 100, scale, points=lambda x, z: (0 * x, z)),
        Perturbation("the profiles' x grew with z by {:+.2g} %", 100, "shear_percent", points=lambda x, z: (z, 0 * z)),
        Perturbation(
            "the profiles were bent by {:+.2g} mm, 50 mm from the middle",
            1,
            "bend_mm",
            points=lambda x, z: (0 * x, (x / 50) ** 2),
        ),
    ]


def of_target(targets: Sequence) -> list[Perturbation]:
    """Wrong lengths."""
    names = dict.fromkeys(name for target in targets for name in target.lengths)
    words = "the {} was too [large|small] by {{:.2g}} mm"
    return [Perturbation(words.format(name), 1, "tolerance_mm", length=name) for name in names]


def considered(targets: Sequence, prior: Systematic) -> list[tuple[Perturbation, float]]:
    """What may be wrong, with its standard deviation in its own unit, of which there is none where that is 0."""
    errors = [*of_scanner(), *of_target(targets)]
    sizes = [getattr(prior, error.prior) / error.unit for error in errors]
    return [(error, size) for error, size in zip(errors, sizes, strict=True) if size]


def derivative(error: Perturbation, state, placement, observed: Observations, residuals, columns) -> np.ndarray:
    """By the size of an error at a state, of a batch of one: (1, K, P). `columns`: of these `residuals`, there, with
    those by the flange pose."""
    if error.length:
        h = 1e-4  # mm
        step = h * (np.array(residuals.target.lengths) == error.length)
        plus, minus = (
            residuals.with_sizes(residuals.sizes + s).linearise(state, placement)[:, -1] for s in (step, -step)
        )
        return (plus - minus) / (2 * h)
    if error.points:
        dx, dz = error.points(*residuals.seen)  # (1, m, P) each
        by_x, by_z = residuals.by_point(columns)
        return (by_x * dx[:, :, None] + by_z * dz[:, :, None]).reshape(1, *columns.shape[2:])
    moved = error.positions(positions_in_base(observed))
    if observed.eye_to_hand:
        in_sensor = -moved @ state.rotation[0]
    else:
        in_sensor = (moved[:, None] @ observed.R_flange[0])[:, 0] @ state.rotation[0]
    return np.sum(columns[:, -6:-3] * in_sensor.T[:, None], axis=1)


def positions_in_base(observed: Observations) -> np.ndarray:
    """Of the flange, (P, 3), in the first problem."""
    R, T = observed.R_flange.reshape(-1, *observed.R_flange.shape[-3:])[0], observed.T_flange
    T = T.reshape(-1, *T.shape[-2:])[0]
    return inverse(R, T)[1] if observed.eye_to_hand else T


@dataclass(frozen=True)
class PoseGroups:
    """Profiles are counted through, target by target; a repeated pose, or one seen of two targets, has several."""

    pose: np.ndarray  # (profiles,) number of the commanded pose
    orientation: np.ndarray  # (poses,) number of its orientation

    def sharing(self, name: str) -> np.ndarray:
        """Numbers (profiles,) that profiles with the same error of the robot have in common; an entry of `Noise`."""
        other = {"repeatability": np.arange(len(self.pose)), "group": self.orientation[self.pose]}
        return other.get(name.split("_")[0], self.pose)

    @property
    def distinguishable(self) -> list[str]:
        """The errors of the robot, entries of `Noise`, that are not the same as finer ones at these poses."""
        repeated = len(self.orientation) < len(self.pose)
        grouped = int(self.orientation.max()) + 1 < len(self.orientation)
        missing = ["repeatability_"] * (not repeated) + ["group_"] * (not grouped)
        return [name for name in ROBOT if not name.startswith(tuple(missing))]


def pose_groups(observations: Sequence[Observations]) -> PoseGroups:
    """Of the targets' poses; those of a batch are alike, and the first problem's are looked at."""
    same_mm, same_deg = 0.05, 0.01  # commanded poses that differ by less are one: no controller comes back any closer
    R, T = (
        np.concatenate([np.reshape(getattr(o, name), (-1, *np.shape(getattr(o, name))[-k:]))[0] for o in observations])
        for name, k in (("R_flange", 3), ("T_flange", 2))
    )
    orientation = same_orientations(R, [o.labels for o in observations])
    pairs = cKDTree(T).query_pairs(same_mm, p=np.inf, output_type="ndarray")
    i, j = pairs[np.lexsort(pairs.T[::-1])].T
    alike = (orientation[i] == orientation[j]) & (np.degrees(angle_between(R[i], R[j])) < same_deg)
    first = np.arange(len(R))
    for one, other in zip(i[alike], j[alike], strict=True):
        if first[one] == one and first[other] == other:
            first[other] = one
    firsts, pose = np.unique(first, return_inverse=True)
    return PoseGroups(pose, orientation[firsts])


def same_orientations(R, labels) -> np.ndarray:
    """Numbers (profiles,) of the orientations R (profiles, 3, 3): one for each of a target's groups, `labels` (P,), and
    the same for that of another target that points the same way."""
    numbers, firsts, begin = [], np.empty((0, 3, 3)), 0
    for own in labels:
        rows = R[begin : begin + len(own)][np.unique(own, return_index=True)[1]]
        there = np.pad(parallel(rows, firsts, SAME_ORIENTATION_DEG), [(0, 0), (0, 1)], constant_values=True)
        number = there.argmax(axis=1)  # the first that it is parallel to, if any
        new = number == len(firsts)
        number[new] += np.arange(new.sum())
        numbers.append(number[own])
        firsts, begin = np.concatenate([firsts, rows[new]]), begin + len(own)
    return np.concatenate(numbers)
