"""Which profiles share an error of the flange: those of one commanded pose, and of one orientation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from profilecal.geometry.noise import ROBOT, Noise, variances
from profilecal.geometry.poses import SAME_ORIENTATION_DEG, angle_between, parallel
from profilecal.joint.observations import Observations

SAME_MM, SAME_DEG = 0.05, 0.01  # commanded poses that differ by less are one: no controller comes back any closer


@dataclass(frozen=True)
class Sharing:
    """Profiles are counted through, target by target; a repeated pose, or one seen of two targets, has several."""

    pose: np.ndarray  # (profiles,) number of the commanded pose
    orientation: np.ndarray  # (poses,) number of its orientation
    rotation: np.ndarray  # (poses, 3, 3) of the flange, as observed
    translation: np.ndarray  # (poses, 3) mm

    @property
    def repeated(self) -> bool:
        """Whether any pose has several profiles."""
        return len(self.orientation) < len(self.pose)

    @property
    def grouped(self) -> bool:
        """Whether any poses share an orientation."""
        return int(self.orientation.max()) + 1 < len(self.orientation)

    @property
    def told_apart(self) -> list[str]:
        """The errors of the robot, entries of `Noise`, that differ at these poses."""
        missing = ["repeatability_"] * (not self.repeated) + ["group_"] * (not self.grouped)
        return [name for name in ROBOT if not name.startswith(tuple(missing))]

    def levels(self, noise: Noise) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of the errors, finest first: their variances (6,), mm² and rad², and which error (k,) of the next level each
        of the k belongs to. A level that cannot be told from a finer one (`told_apart`), or is zero, is part of it."""
        members = self.pose, self.orientation, np.arange(self.orientation.max() + 1)
        found = list(zip(level_variances(noise), members, strict=True))
        for k, told_apart in ((1, self.grouped), (0, self.repeated)):
            (finer, own), (coarser, member) = found[k : k + 2]
            if not (told_apart and np.any(coarser)):
                found[k : k + 2] = [(finer + coarser, member[own])]
        return found


def level_variances(noise: Noise) -> list[np.ndarray]:
    """Of the flange's errors at a visit, at a commanded pose, and at an orientation, (6,) each."""
    return [
        variances(noise.repeatability_mm, noise.repeatability_deg),
        variances(noise.position_mm, noise.orientation_deg),
        variances(noise.group_position_mm, noise.group_orientation_deg),
    ]


def sharing(observations: Sequence[Observations]) -> Sharing:
    """Of the targets' poses; those of a batch are alike, and the first problem's are looked at."""
    R = np.concatenate(
        [np.asarray(o.R_flange, dtype=float).reshape(-1, *o.R_flange.shape[-3:])[0] for o in observations]
    )
    T = np.concatenate(
        [np.asarray(o.T_flange, dtype=float).reshape(-1, *o.T_flange.shape[-2:])[0] for o in observations]
    )
    orientation = same_orientations(R, [o.labels for o in observations])
    pairs = cKDTree(T).query_pairs(SAME_MM, p=np.inf, output_type="ndarray")
    i, j = pairs[np.lexsort(pairs.T[::-1])].T
    alike = (orientation[i] == orientation[j]) & (np.degrees(angle_between(R[i], R[j])) < SAME_DEG)
    first = np.arange(len(R))
    for one, other in zip(i[alike], j[alike], strict=True):
        if first[one] == one and first[other] == other:
            first[other] = one
    firsts, pose = np.unique(first, return_inverse=True)
    return Sharing(pose, orientation[firsts], R[firsts], T[firsts])


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
