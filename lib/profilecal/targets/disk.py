"""A planar disk: the scan plane meets it in a chord."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Disk:
    """The disk around `centre` (3,) with unit `normal` (3,) and `radius`, base frame, mm."""

    centre: np.ndarray
    normal: np.ndarray
    radius: float

    def meet(self, rotation, origin) -> np.ndarray:
        """The chords that scan planes cut from the disk, (..., 2, 2).

        The two tips, the one of smaller x first, each as x and z in the sensor frame; NaN where the disk is missed.
        """
        c = ((self.centre - origin)[..., None, :] @ rotation)[..., 0, :]
        n = self.normal @ rotation
        along = np.stack([n[..., 2], np.zeros_like(n[..., 0]), -n[..., 0]], axis=-1)  # of the chord: y × n
        along *= np.where(along[..., :1] < 0, -1, 1) / np.linalg.norm(along, axis=-1, keepdims=True)
        across = np.cross(n, along)  # from the centre to the chord, within the disk
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -c[..., 1] / across[..., 1]
            half = np.sqrt(self.radius**2 - distance**2)
        middle = c + distance[..., None] * across
        tips = np.stack([middle - half[..., None] * along, middle + half[..., None] * along], axis=-2)
        return tips[..., [0, 2]]
