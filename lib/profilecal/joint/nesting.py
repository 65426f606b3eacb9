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
    """

    errors: ndarray  # (e,) numbers of the errors, from 1: 0 is the scanner's noise
    members: ndarray  # (m,) the profiles that share one
    number: ndarray  # (m,) the group of each
    parents: ndarray  # (G,) the coarser level's group that holds each group
    # groups (b,) of equally many profiles, and these (b Q,), one group after the other
    batches: list[tuple[ndarray, ndarray | slice]]

    def sums(self, E: ndarray, rows: ndarray) -> ndarray:
        """Σ E_iᵀ rows_i (S, G, 6, columns) over each group, of S sets of all profiles'
        E (S, profiles, q, 6) and rows (S, profiles, q, columns).
        """
        shape = len(E), len(self.parents), E.shape[-1], rows.shape[-1]
        total = np.empty(shape)
        for groups, members in self.batches:
            own, other = of_groups(E, groups, members), of_groups(rows, groups, members)
            total[:, groups] = own.mT @ other
        return total

    def without(self, E: ndarray, moves: ndarray, rows: ndarray) -> ndarray:
        """Rows without E_i times what moves its group (S, G, 6, columns) in those of
        each member.
        """
        rows = rows.copy()
        for groups, members in self.batches:
            moved = of_groups(E, groups, members) @ moves[:, groups]
            rows[:, members] -= moved.reshape(len(E), -1, *rows.shape[2:])
        return rows


def of_groups(rows: ndarray, groups: ndarray, members: ndarray | slice) -> ndarray:
    """Rows (S, profiles, q, columns) of these groups' members, put together: (S, b, Q
    q, columns).
    """
    return rows[:, members].reshape(len(rows), len(groups), -1, rows.shape[-1])


def nesting(
    profiles: int, numbers: Sequence[ndarray]
) -> tuple[ndarray, list[tuple[ndarray, ndarray]], list[Level]]:
    """An order of all profiles in which those of a group stand together. In that order,
    errors that are some profiles' own: their numbers, and whose (profiles,) they are;
    and the levels of those that are shared, from coarse to fine.

    `numbers`: of each error, the number (profiles,) of the group that has it in common.
    """
    counts = np.array([number.max() + 1 for number in numbers], dtype=int)
    kinds = [np.flatnonzero(counts == count) for count in np.unique(counts)]
    coarsest_first = [numbers[kind[0]] for kind in kinds]
    holder = np.zeros(profiles, dtype=int)  # the coarser level's group
    order = np.lexsort([*coarsest_first[::-1], holder])
    own, levels = [], []
    for kind, number in zip(kinds, coarsest_first, strict=True):
        of_order = number[order]
        alone = np.bincount(of_order)[of_order] == 1
        if alone.any():
            own.append((1 + kind, alone))
        if alone.all():
            continue
        members = np.flatnonzero(~alone)
        starts = np.flatnonzero(np.diff(of_order[members], prepend=-1))
        sizes = np.diff(np.append(starts, len(members)))
        among = np.arange(len(starts)).repeat(sizes)
        batches = []
        for size in np.unique(sizes):
            of_size = members[sizes[among] == size]
            batches.append((np.flatnonzero(sizes == size), consecutive(of_size)))
        parents = holder[members[starts]]
        levels.append(Level(1 + kind, members, among, parents, batches))
        holder[members] = among
    return order, own, levels


def consecutive(numbers: ndarray) -> ndarray | slice:
    """Rising numbers, as a slice if none is left out: it takes rows without a copy."""
    first, last = numbers[[0, -1]]
    whole = last - first + 1 == len(numbers)
    return slice(first, last + 1) if whole else numbers
