"""What a profile shows of the target: a point, a chord, an arc or a line, or why there
is none.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.optimize import nnls

from profilecal.profiles.points import variance_inflation, visible


@dataclass(frozen=True)
class Feature:
    """What one profile shows of the target: points, or a reason why it shows none."""

    # (m, 2) mm. One of an edge; of a disk both tips, smaller x first; of others means
    # of points along the curve
    points: ndarray
    covariance: ndarray  # (m, 2, 2) mm²
    used: ndarray  # (k,) rows of the profile that it rests on
    shape: str = ""  # corner, step end, chord, arc or line
    reason: str = ""  # why nothing was found
    between: ndarray | None = None  # (2, 2) mm², of a disk's first tip with the second

    @property
    def found(self) -> bool:
        """Whether the profile shows the target."""
        return not self.reason


def nothing(reason: str) -> Feature:
    """The feature of a profile that does not show the target."""
    none = np.zeros(0, dtype=int)
    return Feature(np.zeros((0, 2)), np.zeros((0, 2, 2)), none, reason=reason)


def block_means(
    points: ndarray, off: ndarray, normals: ndarray
) -> tuple[ndarray, ndarray, ndarray]:
    """Points (k, 2) along a curve as means of blocks of neighbours.

    `off` (k,) are the distances of the points from the curve, mm, and `normals` (k, 2)
    its unit normals there. Returns the means (b, 2); the mean distance of each block
    from the curve, (b,) mm; and the covariance of the means (b, 2, 2), mm², which is as
    large along the curve as across it.

    A scanner errs in x otherwise than in z, so that the variance of a point across the
    curve is nx² σx² + nz² σz², fitted to the squared distances.
    """
    most_blocks = 40
    fitted = 4  # parameters of a curve, at most
    k = len(off)
    mean_square = visible(np.mean(off**2))
    variance = np.full(k, mean_square)
    if k >= 100:  # enough to tell x from z
        both, _ = nnls(normals**2, off**2)
        # less than a tenth of the mean is not to be trusted
        variance = np.maximum(normals**2 @ both, 0.1 * mean_square)
    variance = variance * k / max(k - fitted, 1)

    bounds = np.linspace(0, k, min(most_blocks, k) + 1).astype(int)
    size = np.diff(bounds)
    values = np.column_stack([points, off, variance * variance_inflation(off)])
    means = np.add.reduceat(values, bounds[:-1]) / size[:, None]
    mean_variance = means[:, 3] / size
    return means[:, :2], means[:, 2], mean_variance[:, None, None] * np.eye(2)
