"""A straight edge: the scan plane meets it in a point."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Edge:
    """The line through `point` (..., 3) along the unit vector `direction` (..., 3), base frame, mm."""

    point: np.ndarray
    direction: np.ndarray

    def meet(self, rotation, origin) -> np.ndarray:
        """Where scan planes meet the line: x and z in the sensor frame, (..., 2); infinite where they are parallel."""
        p = ((self.point - origin)[..., None, :] @ rotation)[..., 0, :]
        d = (self.direction[..., None, :] @ rotation)[..., 0, :]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -p[..., 1] / d[..., 1]
        return (p + along[..., None] * d)[..., [0, 2]]
