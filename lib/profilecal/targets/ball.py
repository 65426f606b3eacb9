"""A ball: the scan plane meets it in a circle, of which the scanner sees an arc."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Ball:
    """The ball around `centre` (3,) with `radius`, base frame, mm."""

    centre: np.ndarray
    radius: float

    def meet(self, rotation, origin) -> np.ndarray:
        """The circles that scan planes cut from the ball, (..., 3): x, z, r; r NaN where they miss it."""
        c = ((self.centre - origin)[..., None, :] @ rotation)[..., 0, :]
        with np.errstate(invalid="ignore"):
            r = np.sqrt(self.radius**2 - c[..., 1] ** 2)
        return np.stack([c[..., 0], c[..., 2], r], axis=-1)

    def centre_from_circle(self, circle, side) -> np.ndarray:
        """The ball's centre in the sensor frame, (..., 3), from circles (..., 3) x, z, r.

        `side` is +1 where the centre lies towards the sensor's +y, else -1 (disk paper, Section IV-A). A circle
        larger than the ball, which noise can give, puts the centre into the scan plane.
        """
        circle = np.asarray(circle, dtype=float)
        y = side * np.sqrt(np.maximum(self.radius**2 - circle[..., 2] ** 2, 0))
        return np.stack([circle[..., 0], y, circle[..., 1]], axis=-1)
