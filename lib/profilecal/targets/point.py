"""A marked point, a cross-hair or the apex of a pin, through which the operator steers
the laser line: the fixed-point method (disk paper's ref. [16]). How far the scan plane
misses it is noise like the scanner's own.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.geometry.noise import Noise
from profilecal.targets.target import Fitted, Linearised, Sight, Target, Views


@dataclass(frozen=True)
class Point(Target):
    """A marked point at `point` (3,) in the base frame, mm.

    A scanner in the base frame that is steered through it sees its x and z:

    >>> import numpy as np
    >>> import profilecal as pc
    >>> mark = pc.Point(np.array([5.0, 0.0, 100.0]))
    >>> mark.meet(rotation=np.eye(3), origin=np.zeros(3)).tolist()
    [5.0, 100.0]
    """

    point: ndarray

    kind = "point"
    shape = "single point"
    shifts = "xyz"
    turns = ""
    points = 1
    rows = 3
    steered = True
    tables = ("points",)
    groups = 20
    positions = 1
    with_tool = True

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """x and z of the scan, and the distance from the scan plane."""
        x, y, z = sight.offset
        return [x, z, y], [(-1.0, 0, 0), (0, 0, -1.0), (0, -1.0, 0)], None

    residual_in_space = residual

    @classmethod
    def residual_sd(cls, noise: Noise) -> tuple[float, ...]:
        # of a scanner without noise, multiples of 1 mm; without an error of steering,
        # which a weight needs, as uncertain as the scanner
        return 1.0, 1.0, noise.steering_mm / (noise.profile_mm or 1.0) or 1.0

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        middle = points.mean(axis=-2)
        return middle, np.broadcast_to(np.eye(3), (*middle.shape, 3)), ()

    def lines(self, points: ndarray) -> list[ndarray]:
        """A cross."""
        return [self.point + np.outer([-10, 10], axis) for axis in np.eye(3)]

    @staticmethod
    def offsets(views: Views, rng: np.random.Generator) -> ndarray:
        """The scan plane misses the point by how well the operator steers."""
        shape = views.shape
        x = rng.uniform(-25, 25, shape)
        y = views.steering_mm * rng.normal(size=shape)
        z = rng.uniform(-25, 25, shape)
        return np.stack([x, y, z], axis=-1)
