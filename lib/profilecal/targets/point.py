"""A marked point, a cross-hair or the apex of a pin, through which the operator steers
the laser line: the fixed-point method (disk paper's ref. [16]). How far the scan plane
misses it is noise like the scanner's own.
"""

from dataclasses import dataclass

import numpy as np

from profilecal.targets.target import Target, in_sensor


@dataclass(frozen=True)
class Point(Target):
    """The marked point `point` (3,), base frame, mm."""

    point: np.ndarray

    kind, shape, tables = "point", "one point", ("points",)
    shifts, turns, points, rows, affine, steered = "xyz", "", 1, 3, True, True
    groups, positions, with_tool = 20, 1, True

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """x and z of the scan, and the distance from the scan plane."""
        (x, z), (px, py, pz) = seen, origin
        return (
            [x - px, z - pz, -py],
            [[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
            None,
        )

    residual_in_space = residual

    @classmethod
    def residual_sd(cls, noise):
        known = noise.steering_mm and noise.profile_mm
        return (1.0, 1.0, noise.steering_mm / noise.profile_mm if known else 1.0)

    @staticmethod
    def fit(points):
        middle = points.mean(axis=-2)
        return middle, np.broadcast_to(np.eye(3), (*middle.shape, 3)), ()

    def distance(self, points):
        return np.linalg.norm(points - self.point, axis=-1)

    def meet(self, rotation, origin) -> np.ndarray:
        """The point's x and z in the sensor frames, (..., 2), wherever the scan planes
        pass it.
        """
        return in_sensor(rotation, self.point - origin)[..., [0, 2]]

    @staticmethod
    def offsets(shape, motion, normals, sizes, steering_mm, rng):
        x, y, z = (
            rng.uniform(-25, 25, shape),
            steering_mm * rng.normal(size=shape),
            rng.uniform(-25, 25, shape),
        )
        return np.stack([x, y, z], axis=-1)

    def lines(self, points):
        """A cross."""
        return [self.point + 10 * np.outer([-1, 1], axis) for axis in np.eye(3)]
