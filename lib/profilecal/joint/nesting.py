"""Which profiles share errors of the flange: visits within commanded poses, poses
within orientations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class Level:
    """The errors that profiles share in groups of one kind: visits, poses or
    orientations. A group of one profile is none: its error is that profile's own.

    Groups of all kinds are counted through, from coarse to fine; group 0 holds all and
    shares nothing.
    """

    errors: ndarray  # (e,) numbers of the errors, from 1: 0 is the scanner's noise
    groups: slice  # which groups these are
    parents: ndarray  # the coarser group that holds each, in rising order

    def add_to_parents(self, sums: ndarray, parts: ndarray) -> None:
        """Add parts (S, G, ...) of these groups to the sums of those that hold them."""
        firsts = np.flatnonzero(np.diff(self.parents, prepend=-1))
        total = np.add.reduceat(parts, firsts, axis=1)
        sums[:, self.parents[firsts]] += total


@dataclass(frozen=True, eq=False)
class Nesting:
    """Who shares what."""

    # errors that are some profiles' own: the number, and whose (profiles,) it is
    own: list[tuple[int, ndarray]]
    levels: list[Level]  # from coarse to fine
    holder: ndarray  # (profiles,) the finest group that holds each
    count: int  # of groups

    def bundles(self, kept: ndarray, most: int) -> list[tuple[ndarray, ndarray]]:
        """The profiles kept (profiles,) in bundles of at most about `most`: the groups
        (b,) that hold them, each once, and (b, Q) profiles of each; -1 where there are
        fewer. A larger group is in several bundles.
        """
        profiles = np.flatnonzero(kept)
        profiles = profiles[np.argsort(self.holder[profiles], kind="stable")]
        holder = self.holder[profiles]
        place = np.arange(len(holder)) - np.searchsorted(holder, holder)
        starts = np.flatnonzero(place % most == 0)  # of groups, or parts of large ones
        sizes = np.diff(np.append(starts, len(holder)))
        # those of nearly one size together
        kinds = np.stack([place[starts], 2 * np.log2(sizes) // 1], axis=1)
        found = []
        for kind in np.unique(kinds, axis=0):
            alike = np.flatnonzero((kinds == kind).all(axis=1))
            of_group = np.arange(sizes[alike].max())
            at_once = max(1, most // len(of_group))
            for first in range(0, len(alike), at_once):
                some = alike[first : first + at_once]
                places = starts[some, None] + of_group
                members = profiles.take(places, mode="clip")
                members[of_group >= sizes[some, None]] = -1
                found.append((holder[starts[some]], members))
        return found


def nesting(profiles: int, numbers: Sequence[ndarray]) -> Nesting:
    """How groups nest. `numbers`: of each error, the number (profiles,) of the group
    that has it in common.
    """
    counts = np.array([number.max() + 1 for number in numbers], dtype=int)
    own, levels = [], []
    holder = np.zeros(profiles, dtype=int)
    total = 1
    for count in np.unique(counts):
        kind = np.flatnonzero(counts == count)
        number = numbers[kind[0]]
        shared = np.bincount(number)[number] > 1
        if not shared.all():
            own += [(1 + error, ~shared) for error in kind.tolist()]
        if not shared.any():
            continue
        # in the order of those that hold them
        key = holder[shared] * count + number[shared]
        groups, of_profiles = np.unique(key, return_inverse=True)
        holder[shared] = total + of_profiles
        part = slice(total, total + len(groups))
        levels.append(Level(1 + kind, part, groups // count))
        total = part.stop
    return Nesting(own, levels, holder, total)
