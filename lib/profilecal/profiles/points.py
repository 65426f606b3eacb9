"""Which of a profile's points show a surface and how they scatter about it, and what a
profile shows of the target: a point, a chord, an arc or a line, or why there is none.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import nnls

# standard deviations of the noise from an outline within which points are on it
NOISE_LIMIT = 5.0
# mm, however quiet; a profile that needs more shows no surface
LEAST_TOLERANCE, LARGEST_TOLERANCE = 0.1, 2.0
# tolerances, rms, of points from the line or curve that they follow: twice the noise
FOLLOWS = 2 / NOISE_LIMIT


def present(profile) -> np.ndarray:
    """Which points (n,) of a profile (n, 2) the scanner saw: finite ones; a depth of
    zero stands for nothing, but for zeros between points within a millimetre.
    """
    x, z = profile.T
    finite = np.isfinite(x) & np.isfinite(z)
    zero = finite & (z == 0)
    if not zero.any():
        return finite
    real = np.flatnonzero(finite & ~zero)
    if real.size:
        # one neighbour at least is far from it
        zero &= np.interp(np.arange(len(z)), real, np.abs(z[real]) >= 1) > 0
    return finite & ~zero


def tolerance(z) -> float:
    """How far points are from a smooth outline by chance at most, mm, from the second
    differences of z (k,).
    """
    if len(z) < 5:
        return LEAST_TOLERANCE
    second = np.abs(z[2:] - 2 * z[1:-1] + z[:-2])
    one_sigma = int(0.68 * len(second))
    sigma = np.partition(second, one_sigma)[one_sigma] / np.sqrt(6)
    return float(np.clip(NOISE_LIMIT * sigma, LEAST_TOLERANCE, LARGEST_TOLERANCE))


def surface(profile, seen) -> tuple[np.ndarray, float]:
    """The rows (k,) among those `seen` (m,) in a profile (n, 2) that are no spikes, and
    the surface's tolerance, mm; no rows where neighbours differ too much to be of one
    surface.
    """
    z = profile[seen, 1]
    limit = tolerance(z)
    if limit == LARGEST_TOLERANCE:
        return seen[:0], limit
    if len(z) < 7:
        return seen, limit
    # a spike is far beyond noise
    return seen[np.abs(z - median_filter(z, 7, mode="nearest")) <= 5 * limit], limit


def stretches(rows, gap: int) -> list[np.ndarray]:
    """Rows (k,) in rising order, apart where more than `gap` steps lie between
    neighbours.
    """
    cuts = np.flatnonzero(np.diff(rows) > gap) + 1
    return [rows[start:stop] for start, stop in pairwise([0, *cuts, len(rows)])]


def correlation(errors) -> float:
    """How many times the variance of a mean of `errors` (k,) exceeds that of
    independent ones: 1 + 2 Σ ρ, up to the first autocorrelation that is not twice its
    own standard error away from zero.
    """
    longest = 40  # lag, in points
    k = len(errors)
    square = (errors**2).sum()
    total = 1.0
    for lag in range(1, min(longest, k // 4)):
        rho = (errors[lag:] * errors[:-lag]).sum() / square if square else 0.0
        if rho < 2 / np.sqrt(k):
            break
        total += 2 * rho
    return total


@dataclass(frozen=True)
class Feature:
    """What one profile shows of the target; no points and a reason where it shows none."""

    # (m, 2) mm; edge: 1; disk: the tips, smaller x first; others: up to 40 on the curve
    points: np.ndarray
    covariance: np.ndarray  # (m, 2, 2) mm²
    used: np.ndarray  # (k,) rows of the profile that it rests on
    shape: str = ""  # corner, step end, tip, chord, arc or line
    reason: str = ""  # why nothing was found
    # (2, 2) mm², disk: covariance of the first tip with the second
    between: np.ndarray | None = None

    @property
    def found(self) -> bool:
        """Whether the profile shows the target."""
        return not self.reason


def nothing(reason: str) -> Feature:
    """No feature."""
    return Feature(
        np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, dtype=int), reason=reason
    )


def block_means(points, off, normals) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbouring points (k, 2) of a curve as up to 40 means (b, 2), how far the
    points of each are off it, (b,) mm, and the means' covariance (b, 2, 2), mm², along
    the curve as across. `off` (k,) are the points' distances from the curve, mm, and
    `normals` (k, 2) its unit normals there.
    """
    # points that stand for an arc or a line; parameters of a curve, at most
    blocks, fitted = 40, 4
    size = np.diff(np.linspace(0, len(off), min(blocks, len(off)) + 1).astype(int))
    variance = (
        variances_across(off, normals)
        * len(off)
        / max(len(off) - fitted, 1)
        * correlation(off)
    )
    values = np.column_stack([points, off, variance])
    means = np.add.reduceat(values, np.cumsum(size) - size) / size[:, None]
    return means[:, :2], means[:, 2], (means[:, 3] / size)[:, None, None] * np.eye(2)


def variances_across(off, normals) -> np.ndarray:
    """Variances (k,), mm², of points across a curve, from their distances `off` it (k,)
    and its normals (k, 2): nx² σx² + nz² σz², fitted to the squares, since a scanner
    errs in x otherwise than in z.
    """
    if len(off) < 100:  # too few to tell the two apart
        return np.full(len(off), np.mean(off**2))
    both, _ = nnls(normals**2, off**2)
    # less is not to be trusted
    return np.maximum(normals**2 @ both, 0.1 * np.mean(off**2))
