"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Noise:
    """Standard deviations of all errors; the entries that a scan folder's [noise] table has."""

    profile_mm: float = 0.0  # scanner, in x and in z
    position_mm: float = 0.0  # robot position, each axis, fresh at each pose
    orientation_deg: float = 0.0  # robot orientation, about each axis, fresh at each pose
    group_position_mm: float = 0.0  # the part of the position error that a rotation group shares
    group_orientation_deg: float = 0.0
    steering_mm: float = 0.0  # marked points: how far the operator leaves the scan plane from the point


def variances(position_mm: float, orientation_deg: float) -> np.ndarray:
    """Of the six components of a flange pose's error, mm² and rad²."""
    return np.repeat([position_mm, np.radians(orientation_deg)], 3) ** 2
