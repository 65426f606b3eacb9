"""What one profile shows of the target: a point, a chord, an arc or a line, or why there is none."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from profilecal.profiles.points import correlation

BLOCKS = 40  # points that stand for an arc or a line, each the mean of its neighbours


@dataclass(frozen=True)
class Feature:
    """What one profile shows of the target; no points and a reason where it shows none."""

    points: np.ndarray  # (m, 2) mm; edge: 1; disk: the tips, smaller x first; others: up to 40 on the curve
    covariance: np.ndarray  # (m, 2, 2) mm²
    used: np.ndarray  # (n,) which of the profile's points it rests on
    shape: str = ""  # corner, step end, tip, chord, arc or line
    reason: str = ""  # why nothing was found
    between: np.ndarray | None = None  # (2, 2) mm², disk: covariance of the first tip with the second

    @property
    def found(self) -> bool:
        """Whether the profile shows the target."""
        return not self.reason


def nothing(profile, reason: str) -> Feature:
    """No feature."""
    return Feature(np.zeros((0, 2)), np.zeros((0, 2, 2)), mask(profile, []), reason=reason)


def mask(profile, rows) -> np.ndarray:
    """Which points of a profile are the given rows, (n,)."""
    chosen = np.zeros(len(profile), dtype=bool)
    chosen[rows] = True
    return chosen


def block_means(along, off, normals, fitted: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbouring points of a curve as up to `BLOCKS` means: `along` it (b,), `off` it (b,), covariance (b, 2, 2) mm².

    `off` (k,) are the points' distances from the curve, mm, of which `fitted` parameters have been taken, and `normals`
    (k, 2) the curve's unit normals there. Averaged across the curve, they are not drawn inwards by its bend within a
    block. A mean is as uncertain along as across.
    """
    size = np.diff(np.linspace(0, len(off), min(BLOCKS, len(off)) + 1).astype(int))
    starts = np.cumsum(size) - size
    variance = variances_across(off, normals) * len(off) / max(len(off) - fitted, 1) * correlation(off)
    along, off, variance = (np.add.reduceat(values, starts) / size for values in (along, off, variance))
    return along, off, (variance / size)[:, None, None] * np.eye(2)


def variances_across(off, normals) -> np.ndarray:
    """Variances (k,), mm², of points across a curve, from their distances `off` it (k,) and its normals (k, 2):
    nx² σx² + nz² σz², fitted to the squares, since a scanner errs in x otherwise than in z."""
    if len(off) < 100:  # too few to tell the two apart
        return np.full(len(off), np.mean(off**2))
    both, _ = nnls(normals**2, off**2)
    return np.maximum(normals**2 @ both, 0.1 * np.mean(off**2))  # less is not to be trusted
