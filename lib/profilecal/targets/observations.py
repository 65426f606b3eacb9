"""What the scanner saw of a target; what is unknown: sensor poses and the frames of the
targets; and which profiles share an error of the flange.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy import ndarray
from scipy.spatial import KDTree

from profilecal.geometry.log import Log
from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import (
    SAME_ORIENTATION_DEG,
    angle_between,
    chord,
    inverse,
)
from profilecal.targets import TARGETS
from profilecal.targets.target import Target

# commanded poses that differ by less are one: no controller comes back any closer
SAME_MM = 0.05
SAME_DEG = 0.01


@dataclass(frozen=True)
class Observations:
    """What the scanner saw of one target from P flange poses, in each of B problems.

    An array of what is the same in all problems may have the length 1 in place of B.
    """

    # of the target, one of TARGETS
    kind: str
    # (B|1, P, 3, 3) flange in the base frame; eye-to-hand: base in the flange frame
    R_flange: ndarray
    # (B|1, P, 3) mm
    T_flange: ndarray
    # (B|1, P, m, 2) x and z, m as the target's `points`; NaN where there is none
    points: ndarray
    # the target's `lengths`, mm
    sizes: tuple[float, ...] = ()
    # (P,) poses of one flange orientation share a number
    group: ndarray | None = None
    eye_to_hand: bool = False
    # of what was seen from each pose, as a multiple of `Noise.profile_mm`²: (B|1, P, m)
    # of points' distances from a curve, else (B|1, P, 2m, 2m) of x and z of all points;
    # None: 1 for each coordinate, independent
    covariance: ndarray | None = None
    # of a ball: whether the three points of a pose stand for a fitted circle
    are_circles: bool = False
    # what was seen in motion: the robot's log, and when it was by the scanner's clock,
    # (B|1, P) s, NaN at rest
    log: Log | None = None
    times: ndarray | None = None
    # the robot's clock less the scanner's, at which the poses are, and whether it is so
    delay_s: float = 0.0
    delay_known: bool = False

    @property
    def target(self) -> type[Target]:
        """The class of the target."""
        return TARGETS[self.kind]

    @property
    def on_curve(self) -> bool:
        """Whether points lie anywhere on a curve, so that only their distance from it
        says something.
        """
        return self.target.points is None

    @property
    def arrays(self) -> dict[str, Any]:
        """What the first axis is a batch of."""
        names = ("R_flange", "T_flange", "points", "covariance", "times")
        own = vars(self)
        return {name: own[name] for name in names if own[name] is not None}

    @property
    def labels(self) -> ndarray:
        """Numbers from 0 (P,) that the poses of one rotation group share; without
        groups, each has its own.
        """
        if self.group is None:
            return np.arange(self.points.shape[1])
        return np.unique(self.group, return_inverse=True)[1]

    @property
    def moving(self) -> ndarray:
        """Which poses the flange went through without a stop, (B|1, P)."""
        if self.times is None:
            return np.zeros(self.points.shape[:2], bool)
        return np.isfinite(self.times)

    @property
    def twist(self) -> ndarray:
        """How the flange moves by itself, as seen from the target: its velocity, mm/s,
        and angular velocity, rad/s, along its own axes, (P, 6), of the first problem.

        Eye-to-hand, the "flange" is the base, and the target moves: it is the twist of
        the base as seen from the flange, at the flange's origin.
        """
        moving = self.moving[0]
        twist = np.zeros((len(moving), 2, 3))
        if self.log and self.times is not None:
            R, _, in_base = self.log.at(self.times[0, moving] + self.delay_s)
            parts = in_base.reshape(-1, 2, 3)
            twist[moving] = -parts if self.eye_to_hand else parts @ R
        return twist.reshape(-1, 6)

    def later(self, seconds: float) -> "Observations":
        """With the poses of what was seen in motion so much later in the log."""
        if self.log is None or self.times is None:
            return self
        delay_s, moving = self.delay_s + seconds, self.moving
        R, T = self.R_flange.copy(), self.T_flange.copy()
        there = self.log.at(self.times[moving] + delay_s)[:2]
        R[moving], T[moving] = inverse(*there) if self.eye_to_hand else there
        return replace(self, R_flange=R, T_flange=T, delay_s=delay_s)

    def keep(self, poses: Any) -> "Observations":
        """Only some poses, by mask or index."""
        kept = {name: array[:, poses] for name, array in self.arrays.items()}
        if self.group is not None:
            kept["group"] = self.group[poses]
        return replace(self, **kept)

    def take(self, chosen: Any) -> "Observations":
        """Some problems of a batch, by mask, index or slice."""
        taken = {
            name: array if len(array) == 1 else array[chosen]
            for name, array in self.arrays.items()
        }
        return replace(self, **taken)


def each(function: Callable[..., ndarray], *batches: Any) -> Any:
    """`function` of the arrays in the same place of batches, or of tuples, that are
    built alike.
    """
    kind = type(batches[0])
    if kind is ndarray:
        return function(*batches)
    if kind is tuple:
        return tuple(each(function, *parts) for parts in zip(*batches, strict=True))
    return kind(*each(function, *(tuple(vars(batch).values()) for batch in batches)))


class Batch:
    """A dataclass of arrays, tuples of them and further batches, all with one leading
    axis.
    """

    def __getitem__(self, chosen: Any) -> Self:
        return each(lambda array: array[chosen], self)

    def join(self, *others: Self) -> Self:
        """Batches as one."""
        return each(lambda *arrays: np.concatenate(arrays), self, *others)

    def where(self, mask: ndarray, other: Self) -> Self:
        """This one where the mask (B,) holds, the other elsewhere."""
        if mask.all():
            return self
        if not mask.any():
            return other
        return each(lambda own, others: np.where(mask, own.T, others.T).T, self, other)


@dataclass(frozen=True)
class State(Batch):
    """Sensor poses and, for each target, the frame that it stands in."""

    rotation: ndarray  # (B, 3, 3)
    translation: ndarray  # (B, 3) mm
    # for each target its origin (B, 3), mm, and axes (B, 3, 3), in columns
    placements: tuple


@dataclass(frozen=True)
class PoseGroups:
    """Which profiles share a pose of the flange, an orientation, or a group.

    Profiles are counted through, target by target; a repeated pose, or one from which
    two targets were seen, has several.
    """

    pose: ndarray  # (profiles,) number of the commanded pose
    orientation: ndarray  # (poses,) number of its orientation
    group: ndarray  # (profiles,) number of the rotation group of one target
    moving: bool = False  # whether some were seen in motion

    def sharing(self, name: str) -> ndarray:
        """Numbers (profiles,) that profiles have in common if they share the error of
        the robot with this name, an entry of `Noise`.
        """
        if name.startswith(("repeatability_", "jitter_")):
            return np.arange(len(self.pose))
        if name.startswith("group_"):
            return self.orientation[self.pose]
        return self.pose

    @property
    def distinguishable(self) -> list[str]:
        """The errors of the robot, entries of `Noise`, that can be told apart at these
        poses.
        """
        repeated = len(self.orientation) < len(self.pose)
        grouped = self.orientation.max() + 1 < len(self.orientation)
        there = {"repeatability": repeated, "group": grouped, "jitter": self.moving}
        names = (*ROBOT, "jitter_ms")
        return [name for name in names if there.get(name.split("_")[0], True)]


def pose_groups(observations: Sequence[Observations]) -> PoseGroups:
    """Which profiles of several targets share a pose, an orientation, or a group.

    The poses of a batch are alike, and the first problem's are looked at. Poses are
    shared within an orientation: without groups, by other targets' profiles alone. What
    was seen in motion has a pose of its own, and its sweep is the group.
    """
    own = [(one.R_flange[0], one.T_flange[0], one.moving[0]) for one in observations]
    R, T, moving = map(np.concatenate, zip(*own, strict=True))

    labels = [seen.labels for seen in observations]
    target = np.repeat(np.arange(len(labels)), [*map(len, labels)])
    # no two targets have a number in common
    numbers = len(target) * target + np.concatenate(labels)
    _, first, group = np.unique(numbers, return_index=True, return_inverse=True)

    # each of a target's groups is one, and one with another target's that points the
    # same way
    def of_other_targets(i: ndarray, j: ndarray) -> ndarray:
        return target[first][i] != target[first][j]

    ways, same = R[first].reshape(-1, 9), chord(SAME_ORIENTATION_DEG)
    orientation = first_alike(ways, same, of_other_targets)[group]

    def are_one(i: ndarray, j: ndarray) -> ndarray:
        near = np.abs(T[i] - T[j]).max(axis=1) < SAME_MM
        turned = np.degrees(angle_between(R[i], R[j])) < SAME_DEG
        at_rest = ~(moving[i] | moving[j])
        return near & turned & at_rest & (orientation[i] == orientation[j])

    pose = first_alike(T, np.sqrt(3) * SAME_MM, are_one)
    _, firsts = np.unique(pose, return_index=True)
    return PoseGroups(pose, orientation[firsts], group, bool(moving.any()))


def first_alike(
    places: ndarray, within: float, alike: Callable[[ndarray, ndarray], ndarray]
) -> ndarray:
    """Classes (n,) by number: places are in one class if the first that each is like,
    or itself where none is before it, is the same. That is the order's choice where
    being alike does not carry over: of three in a row, each like the next alone, the
    third has a class of its own.

    Looked at are pairs of `places` (n, k) that are at most `within` apart; `alike(i,
    j)` says which of them are.
    """
    pairs = KDTree(places).query_pairs(within, output_type="ndarray")
    firsts = np.arange(len(places))
    # profiles of one pose are as many pairs as their square: some at a time
    for some in np.array_split(pairs, 1 + len(pairs) // 100_000):
        i, j = some.T  # i < j
        chosen = alike(i, j)
        np.minimum.at(firsts, j[chosen], i[chosen])
    return np.unique(firsts, return_inverse=True)[1]
