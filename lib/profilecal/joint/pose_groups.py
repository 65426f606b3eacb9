"""Which profiles share an error of the flange: those of one visit, of one commanded pose, of one orientation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import SAME_ORIENTATION_DEG, angle_between, parallel
from profilecal.joint.observations import Observations


@dataclass(frozen=True)
class PoseGroups:
    """Profiles are counted through, target by target; a repeated pose, or one seen of two targets, has several."""

    pose: np.ndarray  # (profiles,) number of the commanded pose
    orientation: np.ndarray  # (poses,) number of its orientation

    @property
    def orientation_of_profile(self) -> np.ndarray:
        """(profiles,)."""
        return self.orientation[self.pose]

    def sharing(self, name: str) -> np.ndarray:
        """Numbers (profiles,) that profiles with the same error of the robot have in common; an entry of `Noise`."""
        match name.split("_")[0]:
            case "repeatability":
                return np.arange(len(self.pose))
            case "group":
                return self.orientation_of_profile
        return self.pose

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
