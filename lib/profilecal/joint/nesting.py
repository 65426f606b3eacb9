"""Which profiles share errors of the flange: visits within commanded poses, poses
within orientations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

# numbers of rows, of several sets or of a part: what a cache holds, and all draws of
# a scan of sixty poses
AT_ONCE = 130_000
# Linux's malloc gives arrays above 128 kB back to the system with each of them, so that
# the next one pays for its pages again; it raises that limit to the size of an array
# that was freed, as this one is at once. Without it a calibration takes up to a tenth
# longer.
np.empty(2_000_000)


@dataclass(frozen=True, eq=False)
class Level:
    """The errors that profiles share in groups of one kind: visits, poses or
    orientations. A group of one profile is none: its error is that profile's own.

    Groups of all kinds are numbered together, from coarse to fine. Group 0 holds all
    profiles and shares nothing.
    """

    errors: ndarray  # (e,) numbers of the errors, from 1: 0 is the scanner's noise
    groups: slice  # which groups these are
    parents: ndarray  # the coarser group that holds each, in rising order


@dataclass(frozen=True, eq=False)
class Nesting:
    """Which profiles share which errors."""

    # errors that some profiles do not share: the number, and which profiles (profiles,)
    own: list[tuple[int, ndarray]]
    levels: list[Level]  # from coarse to fine
    holder: ndarray  # (profiles,) the finest group that holds each
    count: int  # of groups

    def bundles(self, kept: ndarray, most: int) -> tuple[ndarray, ndarray]:
        """The profiles kept (profiles,) in bundles, for arrays of one shape: each has
        as many places, its size, as a group holds profiles on average, but at most
        `most`; a larger group has several bundles.

        Returns the group (bundles,) of each, in rising order, and its profiles
        (bundles, size), -1 where there are fewer.
        """
        profiles = np.flatnonzero(kept)
        profiles = profiles[np.argsort(self.holder[profiles], kind="stable")]
        holder = self.holder[profiles]
        groups = np.unique(holder).size
        size = min(most, -(-len(holder) // max(1, groups)))  # the mean, rounded up
        # the place of each profile in its group: holders are in rising order
        place = np.arange(len(holder)) - np.searchsorted(holder, holder)
        firsts = np.flatnonzero(place % size == 0)
        ends = np.append(firsts, len(holder))[1:, None]
        members = firsts[:, None] + np.arange(size)
        bundled = np.where(members < ends, profiles.take(members, mode="clip"), -1)
        return holder[firsts], bundled


def add_up(sums: ndarray, holders: ndarray, parts: ndarray) -> None:
    """Add parts (S, G, ...) to the sums (S, groups, ...) of the groups (G,) that hold
    them, which are in rising order.

    Group 0 shares nothing, so its sum is not needed: where it is the only holder,
    nothing is added; where it is one of several holders, its sum stays unread.
    """
    if not holders[-1:].any():
        return
    # where each holder stands first
    places = np.arange(len(holders))
    firsts = places[places == np.searchsorted(holders, holders)]
    if len(firsts) < len(holders):
        parts = np.add.reduceat(parts, firsts, axis=1)
    sums[:, holders[firsts]] += parts


def parts_of(count: int, size: int) -> list[slice]:
    """Slices of `count` things, of `size` numbers each, in parts that a cache holds."""
    step = max(1, AT_ONCE // max(1, size))
    return [slice(k, k + step) for k in range(0, count, step)]


def in_parts(rows: ndarray) -> list[slice]:
    """Slices of rows (rows, ...), in parts that a cache holds."""
    return parts_of(len(rows), rows[:1].size)


def nesting(profiles: int, numbers: Sequence[ndarray]) -> Nesting:
    """How groups nest. `numbers`: of each error, the number (profiles,) of the group
    of profiles that share the error. Groups nest, so two errors of as many groups have
    the same groups.
    """
    counts = np.array([number.max() + 1 for number in numbers], dtype=int)
    own, levels = [], []
    holder = np.zeros(profiles, dtype=int)
    total = 1
    # the fewer groups a kind has, the coarser it is
    for count in np.unique(counts):
        kind = np.flatnonzero(counts == count)
        number = numbers[kind[0]]
        shared = np.bincount(number)[number] > 1
        if not shared.all():
            own += [(1 + error, ~shared) for error in kind.tolist()]
        if not shared.any():
            continue
        # in the order of the groups that hold them: the holder is key // count
        key = holder[shared] * count + number[shared]
        groups, of_profiles = np.unique(key, return_inverse=True)
        holder[shared] = total + of_profiles
        part = slice(total, total + len(groups))
        levels.append(Level(1 + kind, part, groups // count))
        total = part.stop
    return Nesting(own, levels, holder, total)
