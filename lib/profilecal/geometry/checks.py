"""Guards of the public entries: each says in one sentence what is wrong, where, and what was expected."""

import numpy as np

ORTHONORMAL_TOLERANCE = 1e-3  # matrices printed to four decimals pass, a scaled or sheared one does not


class UnobservableError(ValueError):
    """The data are well formed but cannot determine the answer, whatever the noise."""


def check_vectors(name: str, values, count: int | None = None) -> np.ndarray:
    """Return `values` as a float array (n, 3).

    Raises ValueError naming the first offending row as Python does, from 0, the value and what was expected.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} has shape {array.shape}; expected (n, 3), one row per pose")
    if count is not None and len(array) != count:
        raise ValueError(f"{name} has {len(array)} rows; expected {count}, one per pose")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}] is {array[bad[0]]}; expected finite numbers")
    return array


def check_rotations(name: str, values, count: int | None = None) -> np.ndarray:
    """Return `values` as a float array (n, 3, 3) of rotation matrices.

    Raises ValueError for anything else: not finite, not orthonormal within 1e-3, or a reflection.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != 3 or array.shape[1:] != (3, 3):
        raise ValueError(f"{name} has shape {array.shape}; expected (n, 3, 3), one matrix per pose")
    if count is not None and len(array) != count:
        raise ValueError(f"{name} has {len(array)} matrices; expected {count}, one per pose")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=(1, 2)))
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}] holds a value that is not finite; expected a rotation matrix")
    excess = np.abs(array @ array.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    bad = np.flatnonzero(excess > ORTHONORMAL_TOLERANCE)
    if bad.size:
        raise ValueError(
            f"{name}[{bad[0]}] is not orthonormal: R Rᵀ differs from the identity by {excess[bad[0]]:.2g}; "
            f"expected at most {ORTHONORMAL_TOLERANCE:g}"
        )
    bad = np.flatnonzero(np.linalg.det(array) < 0)
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}] is a reflection (determinant -1); expected a rotation (+1)")
    return array


def check_count(name: str, count: int, least: int, why: str) -> None:
    """Raise UnobservableError unless there are at least `least`."""
    if count < least:
        raise UnobservableError(f"{name}: {count} given, at least {least} needed ({why})")
