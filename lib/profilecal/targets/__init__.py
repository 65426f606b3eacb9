"""Calibration targets, one file each: where they are, and where the scan plane meets them.

A scan plane is y = 0 of a sensor frame given by `rotation` (..., 3, 3) and `origin` (..., 3) in the base frame, mm.

For the joint calibration each file offers

- `residual(point, direction, seen, size, in_plane)`: K residuals, mm, and their derivatives by `point` and `direction`
  (K × 3 each, None without a direction). The target's point and direction, (3, ...), are in the *sensor* frame;
  `seen` (m, 2, ...) are the observed points, x and z; `size` is a known radius. `in_plane=True`: distances in the scan
  plane, where noise arises; False: distances in space, which exist for any pose and serve a search;
- `place(points, size)`: a first placement through observed points (..., n, 3) in the base frame;
- `MOVES` and `TURNS`: which of a placement's coordinates are free.
"""

import numpy as np


def root(square, least):
    """The square root and its derivative, continued as its tangent below `least`².

    A scan plane that misses a ball or a disk has no circle or chord; a solver that tries such a pose needs a residual
    all the same, one that leads back.
    """
    inside = square > least**2
    value = np.sqrt(np.where(inside, square, least**2))
    slope = 0.5 / value
    return np.where(inside, value, (square + least**2) * slope), slope


def algebraic_centre(points):
    """The centre (..., 3) of the sphere nearest to points (..., n, 3) algebraically: |p|² = 2 p·c + constant.

    Where the points leave it open, as those on one circle do, it is the nearest to their middle.
    """
    middle = points.mean(axis=-2, keepdims=True)
    p = points - middle
    square = np.sum(p**2, axis=-1, keepdims=True)
    square = square - square.mean(axis=-2, keepdims=True)
    H = np.swapaxes(p, -1, -2) @ p
    ridge = 1e-6 * np.trace(H, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    return middle[..., 0, :] + 0.5 * np.linalg.solve(H + ridge, np.swapaxes(p, -1, -2) @ square)[..., 0]
