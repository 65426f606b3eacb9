"""Standard deviations of what goes wrong in a measurement, and χ²."""

from dataclasses import dataclass, replace
from numbers import Real
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from scipy.special import chdtri


def is_sd(value: Any) -> bool:
    """Whether this is a standard deviation: one that is there is no rounding error."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    return is_number and (value == 0 or 1e-6 <= value <= 100)


# the chance that one kind of test doubts anything at all of a good scan
FALSE_ALARM = 0.01
Sd = Annotated[float, (is_sd, "zero, or 1e-06 to 100")]
# the robot's: fresh at each visit, at each commanded pose, at each orientation
ROBOT = (
    "repeatability_mm",
    "repeatability_deg",
    "position_mm",
    "orientation_deg",
    "group_position_mm",
    "group_orientation_deg",
)
# by how much an error of such a unit shifts and turns the flange, mm and rad
UNITS = {"mm": (1, 0), "deg": (0, np.radians(1)), "ms": (0, 0)}
SMOOTH = "accuracy_mm"  # varies smoothly with the pose; that of orientations with it
# all whose sizes the residuals tell, but for the scanner's noise
ESTIMATED = (*ROBOT, "jitter_ms", SMOOTH)


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the errors that differ from pose to pose.

    Their names are entries of a scan folder's [noise].
    """

    # of the scanner, in x and in z
    profile_mm: Sd = 0.0
    # of the robot's position along each axis, fresh at each commanded pose
    position_mm: Sd = 0.0
    # of the robot's orientation about each axis, fresh at each commanded pose
    orientation_deg: Sd = 0.0
    # the part of the position error that the poses of one orientation share
    group_position_mm: Sd = 0.0
    group_orientation_deg: Sd = 0.0
    # the part of the position error that is fresh whenever the robot comes to a pose
    repeatability_mm: Sd = 0.0
    repeatability_deg: Sd = 0.0
    # marked points: how far the operator leaves the scan plane from the point
    steering_mm: Sd = 0.0
    # in motion: of the time of each profile, beside a delay that all have
    jitter_ms: Sd = 0.0
    # of the robot over its workspace, along and about each axis: errors that vary
    # smoothly with the pose
    accuracy_mm: Sd = 0.0
    accuracy_deg: Sd = 0.0

    @property
    def of_robot(self) -> dict[str, float]:
        """The errors of the robot that are not zero, by name."""
        return {name: sd for name in ROBOT if (sd := getattr(self, name))}

    def of_sizes(self, sizes: dict[str, float]) -> "Noise":
        """With errors of these sizes, and the smooth ones of both kinds in the same
        proportion as before.
        """
        sized = replace(self, **sizes)
        turn = self.accuracy_deg * sized.accuracy_mm / (self.accuracy_mm or 1)
        return replace(sized, accuracy_deg=turn)


@dataclass(frozen=True)
class Systematic:
    """Standard deviations of what is wrong in the same way at all poses.

    Their names are entries of [noise] too.
    """

    scale_percent: Sd = 0.0  # of the profiles, along x and along z
    shear_percent: Sd = 0.0  # of the profiles: x that grows with z
    bend_mm: Sd = 0.0  # of the profiles: z, 50 mm from the middle
    tolerance_mm: Sd = 0.0  # of the target's sizes


def by_unit(name: str) -> ndarray:
    """The shift and the turn (6,) of the flange, mm and rad, of which an entry of
    `Noise` counts so many.
    """
    return np.repeat(UNITS[name.split("_")[-1]], 3)


def in_mm(name: str) -> float:
    """By how much, mm, an entry of `Noise` that is one shifts what is 100 mm from the
    flange; errors of time count nothing.
    """
    return float(by_unit(name)[::3] @ [1, 100])


def chi2_limit(chance: float | ndarray, freedom: float | ndarray) -> Any:
    """What χ² of some degrees of freedom exceeds by a chance.

    It is `chi2.isf` without the long import of `scipy.stats`.
    """
    return chdtri(freedom, chance)


def normalised_square(covariance: ndarray, error: ndarray) -> ndarray:
    """Errors (..., n) squared over their covariances (..., n, n).

    Follows χ² with n degrees of freedom where the covariances are honest.
    """
    return np.vecdot(error, np.linalg.solve(covariance, error[..., None])[..., 0])
