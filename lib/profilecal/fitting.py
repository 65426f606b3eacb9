"""Lines and spheres through points."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Line:
    """Lines in any dimension, through `point` along the unit vector `direction`."""

    point: np.ndarray  # (..., d)
    direction: np.ndarray  # (..., d)
    rms: np.ndarray  # (...) of the distances of the points that it was fitted to


def fit_line(points, kept=None) -> Line:
    """The lines with the least sum of squared distances from points (..., n, d), or from those `kept` (..., n).

    NaN where fewer than two are.
    """
    kept = np.ones(points.shape[:-1], dtype=bool) if kept is None else kept
    count = kept.sum(axis=-1)
    share = kept / np.where(count < 2, np.nan, count)[..., None]
    centre = (share[..., None] * points).sum(axis=-2)
    offsets = kept[..., None] * (points - centre[..., None, :])
    direction = np.linalg.eigh(np.nan_to_num(np.swapaxes(offsets, -1, -2) @ offsets))[1][..., -1]
    along = (offsets @ direction[..., None])[..., 0]
    off_line = offsets - along[..., None] * direction[..., None, :]
    return Line(centre, direction, np.sqrt((share * (off_line**2).sum(axis=-1)).sum(axis=-1)))


@dataclass(frozen=True)
class Sphere:
    """Spheres with `centre` and `radius`, mm."""

    centre: np.ndarray  # (..., 3)
    radius: np.ndarray  # (...)
    rms: np.ndarray  # (...) of the distances of the points from the sphere that was fitted to them


def fit_sphere(points) -> Sphere:
    """Spheres through points (..., n, 3), n ≥ 4, not all in one plane.

    The linear least-squares fit of |p|² = 2 c·p + k that the edge paper takes (its ref. [36]), about the points' mean.
    """
    mean = points.mean(axis=-2, keepdims=True)
    p = points - mean
    squares = (p**2).sum(axis=-1)
    A = np.concatenate([2 * p, np.ones_like(p[..., :1])], axis=-1)
    AtA, Atb = np.swapaxes(A, -1, -2) @ A, (np.swapaxes(A, -1, -2) @ squares[..., None])
    solution = np.linalg.solve(AtA, Atb)[..., 0]
    c = solution[..., :3]
    radius = np.sqrt(solution[..., 3] + (c**2).sum(axis=-1))
    residuals = np.linalg.norm(p - c[..., None, :], axis=-1) - radius[..., None]
    return Sphere(c + mean[..., 0, :], radius, np.sqrt((residuals**2).mean(axis=-1)))
