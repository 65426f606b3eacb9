"""Standard deviations of what goes wrong in a measurement."""

from dataclasses import dataclass

import numpy as np

FALSE_ALARM = 0.01  # the chance that one kind of test doubts anything at all of a good scan


@dataclass(frozen=True)
class Noise:
    """Standard deviations of all errors; the entries that a scan folder's [noise] table has."""

    profile_mm: float = 0.0  # scanner, in x and in z
    position_mm: float = 0.0  # robot position, each axis, fresh at each pose
    orientation_deg: float = 0.0  # robot orientation, about each axis, fresh at each pose
    group_position_mm: float = 0.0  # the part of the position error that a rotation group shares
    group_orientation_deg: float = 0.0
    steering_mm: float = 0.0  # marked points: how far the operator leaves the scan plane from the point

    @property
    def of_robot(self) -> bool:
        """Whether any error of the robot is stated."""
        return bool(self.position_mm or self.orientation_deg or self.group_position_mm or self.group_orientation_deg)


def variances(position_mm: float, orientation_deg: float) -> np.ndarray:
    """Of the six components of a flange pose's error, mm² and rad²."""
    return np.repeat([position_mm, np.radians(orientation_deg)], 3) ** 2
