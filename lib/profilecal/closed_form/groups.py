"""Poses in groups of one flange orientation, found or stated, laid out as arrays."""

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.checks import check_count
from profilecal.geometry.poses import check_alike, rotation_groups


def find_groups(name: str, R: ndarray, group: ArrayLike | None) -> ndarray:
    """The number (n,), from 0, of the group that each orientation R (n, 3, 3) is in.

    Without `group`, orientations that agree within 0.05° form one; else it has the
    user's labels (n,). Raises ValueError for another shape, or where orientations of
    one label differ by more than 1°. `name` is the argument that holds R.
    """
    check_count("poses", len(R), 3, "three orientations fix the translation")
    if group is None:
        return rotation_groups(R)
    labels = np.asarray(group)
    if labels.shape != (len(R),):
        raise ValueError(f"group has shape {labels.shape}; expected ({len(R)},)")
    return check_alike(name, R, labels)


def group_members(number: ndarray) -> tuple[ndarray, ndarray]:
    """The poses of each group, from numbers (n,) as `find_groups` gives them.

    Returns the poses' indices (G, N), in which a group of less than N repeats its first
    pose, and the mask (G, N), which is False for these repetitions.
    """
    counts = np.bincount(number)
    starts = np.cumsum(counts) - counts
    place = np.arange(counts.max())
    present = place < counts[:, None]
    in_order = np.argsort(number, kind="stable")
    return in_order[starts[:, None] + present * place], present
