"""Guards of the public entries: each says in one sentence what is wrong, where, and
what was expected.
"""

from itertools import zip_longest

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

# matrices printed to four decimals pass, a scaled or sheared one does not
ORTHONORMAL_TOLERANCE = 1e-3
# of flange positions: a robot's size
REACH_MM = (10.0, 20_000.0)
# from the scanner; no profile scanner sees as far, and some print such numbers for no
# point
FARTHEST_MM = 10_000.0
# largest coordinate that a scanner reads: the size of its range
READINGS_MM = (1.0, FARTHEST_MM)


class UnobservableError(ValueError):
    """The data are well formed but cannot determine the answer, whatever the noise."""


def check_array(
    name: str,
    values: ArrayLike,
    shape: tuple[int | None, ...],
    finite: bool = True,
) -> ndarray:
    """Return `values` as a float array of a shape, in which None is any length; what is
    masked is NaN.

    Raises ValueError for what is no array of numbers, with the shape that it has
    instead, or with the first entry that is not finite, unless it may be.
    """
    try:
        array: ndarray = np.ma.filled(np.ma.asarray(values, dtype=float), np.nan)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is no array of numbers: {error}") from None
    # the lengths that are free, as they are
    lengths = [
        n if k is None else k for k, n in zip_longest(shape, array.shape, fillvalue=-1)
    ]
    if array.shape != (*lengths,):
        expected = str(shape).replace("None", "n")
        raise ValueError(f"{name} has shape {array.shape}; expected {expected}")
    if finite:
        for place in np.argwhere(~np.isfinite(array)):
            value = array[tuple(place)]
            raise ValueError(
                f"{name}{place.tolist()} is {value}; expected finite numbers"
            )
    return array


def check_type(name: str, value: object, *kinds: type) -> None:
    """Raise TypeError for a value that is of none of these kinds."""
    if not isinstance(value, kinds):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{name} is a {type(value).__name__}; expected a {expected}")


def check_rotations(name: str, values: ArrayLike, count: int | None) -> ndarray:
    """Return `values` as an array (count, 3, 3) of rotations.

    Raises ValueError for entries that are not finite, for columns that are not
    orthonormal within 1e-3, and for a reflection.
    """
    R = check_array(name, values, (count, 3, 3))
    excess = np.abs(R @ R.mT - np.eye(3)).max(axis=(1, 2))
    for k in np.flatnonzero(excess > ORTHONORMAL_TOLERANCE):
        raise ValueError(
            f"{name}[{k}] is not orthonormal: R Rᵀ differs from the identity by "
            f"{excess[k]:.2g}; expected at most {ORTHONORMAL_TOLERANCE:g}"
        )
    for k in np.flatnonzero(np.linalg.det(R) < 0):
        raise ValueError(
            f"{name}[{k}] is a reflection (determinant -1); expected a rotation (+1)"
        )
    return R


def check_count(name: str, count: int, least: int, why: str) -> None:
    """Raise UnobservableError unless there are at least `least`."""
    if count < least:
        raise UnobservableError(
            f"{name}: {count} given, at least {least} needed ({why})"
        )


def check_rigid(name: str, values: ArrayLike) -> ndarray:
    """Return `values` as an array (n, 4, 4) of rigid transforms. Raises ValueError for
    another shape, a last row that is not 0, 0, 0, 1, and what is no rotation.
    """
    T = check_array(name, values, (None, 4, 4))
    for k in np.flatnonzero((T[:, 3] != [0, 0, 0, 1]).any(axis=1)):
        raise ValueError(
            f"the last row of {name}[{k}] is {T[k, 3].tolist()}; expected [0, 0, 0, 1]"
        )
    check_rotations(name, T[:, :3, :3], None)
    return T


def check_positions(name: str, values: ArrayLike, count: int | None = None) -> ndarray:
    """Return flange positions as an array (count, 3), mm.

    Raises ValueError where the farthest is not at a robot's distance from the base.
    """
    p = check_array(name, values, (count, 3))
    low, high = REACH_MM
    farthest = np.linalg.norm(p, axis=1).max(initial=0.0)
    if len(p) and not low <= farthest <= high:
        raise ValueError(
            f"the largest value of {name} is {farthest:.3g} from the base; "
            f"expected {low:g} to {high:g}, in mm: are the units right?"
        )
    return p


def check_readings(
    name: str,
    values: ArrayLike,
    shape: tuple[int | None, ...],
    finite: bool = True,
) -> ndarray:
    """Return a scanner's readings as an array of a shape, mm.

    Raises ValueError where the largest is outside the limits, those of a scanner's
    range, nor zero: then they are in another unit.
    """
    array = check_array(name, values, shape, finite)
    # of those that are there
    largest = np.fmax.reduce(np.abs(array), axis=None, initial=0)
    low, high = READINGS_MM
    if largest and not low <= largest <= high:
        raise ValueError(
            f"the largest value of {name} is {largest:.3g}; "
            f"expected {low:g} to {high:g}, in mm: are the units right?"
        )
    return array
