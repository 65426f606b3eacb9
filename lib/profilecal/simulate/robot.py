"""What a robot does beyond the errors that a scan's [noise] states: it drifts, it is built differently."""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import rotations
from profilecal.simulate.arm import Arm, where_it_is


@dataclass(frozen=True)
class Robot:
    """Standard deviations of a robot's errors; the entries that a specification's [robot] table has."""

    joint_deg: float = 0.0  # of each joint's zero, for good
    link_mm: float = 0.0  # of the x, y and z of each link, for good
    drift_mm: float = 0.0  # along each axis, from the first pose to the last

    def built(self, rotation, position, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Where an arm built like this has its flange when it reports poses (P, 3, 3), (P, 3), mm. Raises ValueError
        for poses out of reach."""
        if not (self.joint_deg or self.link_mm):
            return rotation, position
        return where_it_is(Arm.erring(self.joint_deg, self.link_mm, rng), rotation, position)

    def visiting(self, rotation, position, noise: Noise, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Where the flange is when the robot goes through poses (P, 3, 3), (P, 3), mm, once and in this order."""
        if self.drift_mm:
            position = position + np.linspace(0, self.drift_mm, len(position))[:, None] * rng.normal(size=3)
        if noise.repeatability_mm:
            position = position + noise.repeatability_mm * rng.normal(size=position.shape)
        if noise.repeatability_deg:
            rotation = rotations(np.radians(noise.repeatability_deg) * rng.normal(size=position.shape)) @ rotation
        return rotation, position
