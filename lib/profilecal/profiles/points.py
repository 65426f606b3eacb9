"""Which of a profile's points show a surface, and how they scatter about it."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.ndimage import median_filter

from profilecal.geometry.progress import watched

# those of one scan, each (n, 2), x and z in mm
Profiles = Sequence[ndarray]

# standard deviations of the noise from an outline within which points are on it
NOISE_LIMIT = 5.0
# mm, however quiet the scanner is
LEAST_TOLERANCE = 0.1
# mm; a profile that needs as much shows no surface
LARGEST_TOLERANCE = 2.0
# mm², of errors that are rounding alone
EVEN = 1e-12


def in_each(profiles: Profiles, found_in: Callable, *given: Any) -> list:
    """What a function finds in each profile, with the same other arguments."""
    seen = watched(profiles, "looking for the target")
    return [found_in(profile, *given) for profile in seen]


def present(profile: ndarray) -> ndarray:
    """Which points (n,) of a profile (n, 2) the scanner saw.

    Their coordinates are finite. A depth of zero stands for a missing point, except
    where the depths before and after it are within a millimetre of zero too.
    """
    z = profile[:, 1]
    finite = np.isfinite(profile).all(axis=1)
    zero = z == 0
    real = np.flatnonzero(finite & ~zero)
    if real.size:
        # above zero if the point before or the point after is far from a depth of zero
        far = np.interp(np.arange(len(z)), real, np.abs(z[real]) >= 1)
        zero &= far > 0
    return finite & ~zero


def in_order(profile: ndarray) -> ndarray:
    """The rows (k,) of a profile (n, 2) that the scanner saw, x rising but for folds.

    Steep faces, and steps seen at an angle, make x fold back: it then jumps back while
    it rises nearly everywhere. There the rows stay in scan order, which sorting would
    mix up.
    """
    jump = 4.0  # times the usual step
    rows = np.flatnonzero(present(profile))
    x = profile[rows, 0]
    steps = np.diff(x)
    if np.sign(steps).sum() < 0:
        rows, x, steps = rows[::-1], x[::-1], -steps[::-1]
    is_rising = 4 * (steps < 0).sum() < len(steps)
    if is_rising and steps.min() < -jump * np.median(np.abs(steps)):
        return rows
    return rows[np.argsort(x, kind="stable")]


def tolerance(z: ndarray) -> float:
    """How far points are from a smooth outline by chance at most, mm.

    It follows from the second differences of the depths z (k,), of which independent
    noise has √6 times the standard deviation of a point. Where z comes in coarse steps
    most of them are zero; then the least of the others tells, unless it is one of a
    few: of a target's own steps, seen without noise.
    """
    if len(z) < 5:
        return LEAST_TOLERANCE
    second = np.abs(np.diff(z, 2))
    one_sigma = int(0.68 * len(second))
    sigma = np.partition(second, one_sigma)[one_sigma] / np.sqrt(6)
    bends = second[second > 1e-6]
    step = bends.min() if len(bends) > 10 else 0
    limit = max(NOISE_LIMIT * sigma, 1.5 * step)
    return float(np.clip(limit, LEAST_TOLERANCE, LARGEST_TOLERANCE))


def surface(profile: ndarray) -> tuple[ndarray, float]:
    """The rows (k,) of a profile (n, 2) that are no spikes.

    Beside them the tolerance of the surface, mm. There are no rows where neighbours
    differ too much to be of one surface.
    """
    z = profile[:, 1]
    limit = tolerance(z)
    if limit == LARGEST_TOLERANCE:
        return np.arange(0), limit
    outline = median_filter(z, 7, mode="nearest")
    return np.flatnonzero(np.abs(z - outline) <= 5 * limit), limit  # far beyond noise


def visible(mean_square: float, limit: float = LEAST_TOLERANCE) -> float:
    """The mean square of errors, mm²; that of a tolerance, mm, where points are exactly
    even, which show no noise.
    """
    return mean_square if mean_square > EVEN else (limit / NOISE_LIMIT) ** 2


def stretches(rows: ndarray, gap: int) -> list[ndarray]:
    """Rows (k,) in rising order, cut where neighbours are more than `gap` apart."""
    return np.split(rows, np.flatnonzero(np.diff(rows) > gap) + 1)


def variance_inflation(errors: ndarray) -> float:
    """How many times the variance of a mean of errors (k,) exceeds that of independent
    ones.

    It is 1 + 2 Σ ρ, up to the first autocorrelation ρ that is not twice its own
    standard error above zero. Points that are exactly even have one error.
    """
    longest = 40  # lag, in points
    k = len(errors)
    square = errors @ errors
    if square <= EVEN * k:
        return float(k)
    total = 1.0
    for lag in range(1, min(longest, k // 4)):
        rho = errors[lag:] @ errors[:-lag] / square
        if rho < 2 / np.sqrt(k):
            break
        total += 2 * rho
    return total
