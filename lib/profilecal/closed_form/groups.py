"""Poses in groups of one flange orientation, laid out as arrays."""

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import check_count
from profilecal.geometry.poses import rotation_groups


def find_groups(R: ndarray) -> ndarray:
    """The number (n,), from 0, of the group that each orientation R (n, 3, 3) is in:
    those that agree within 0.05° form one.
    """
    check_count("poses", len(R), 3, "three orientations fix the translation")
    return rotation_groups(R)


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
