"""What is unknown: sensor poses and the frames of the targets, in batches."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy import ndarray


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
