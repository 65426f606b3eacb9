"""A marked point, a cross-hair or the apex of a pin, through which the operator steers the laser line.

The fixed-point method that the disk paper cites as its ref. [16]. The scan plane passes through the point only as well
as the operator steers: that error, across the plane, is noise like the scanner's own.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Point:
    """The marked point `point` (3,), base frame, mm."""

    point: np.ndarray

    def meet(self, rotation, origin) -> np.ndarray:
        """The point's x and z in the sensor frames, (..., 2), wherever the scan planes pass it."""
        return ((self.point - origin)[..., None, :] @ rotation)[..., 0, [0, 2]]


MOVES = "anywhere"
TURNS = False  # whether it has a direction


def residual(point, direction, seen, size, in_plane=True):
    """How far the sensed point is from the marked one; see `profilecal.targets`.

    x and z of the scan, and the distance from the scan plane times `size`: the scanner's noise over the operator's.
    """
    x, z = seen[0]
    px, py, pz = point
    zero, one = np.zeros_like(px), np.ones_like(px)
    return [x - px, z - pz, -size * py], [[-one, zero, zero], [zero, zero, -one], [zero, -size * one, zero]], None


def place(points, size=None):
    """The middle of points (..., n, 3), and no direction."""
    middle = points.mean(axis=-2)
    return middle, np.zeros_like(middle)
