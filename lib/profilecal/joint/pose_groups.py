"""Which profiles share an error of the flange."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.spatial import KDTree

from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import SAME_ORIENTATION_DEG, angle_between, chord
from profilecal.targets.observations import Observations

# commanded poses that differ by less are one: no controller comes back any closer
SAME_MM = 0.05
SAME_DEG = 0.01


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
    own = [
        (one.R_flange[0], one.T_flange[0], one.moving[0], one.labels)
        for one in observations
    ]
    R, T, moving, labels = map(np.concatenate, zip(*own, strict=True))

    target = np.arange(len(own)).repeat([len(labels) for *_, labels in own])
    # no two targets have a number in common
    numbers = len(target) * target + labels
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
