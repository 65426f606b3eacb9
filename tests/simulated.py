"""Simulated scans and what calibrating one gives, each computed once for all cases that
read it; how far off it is.
"""

from functools import wraps

import numpy as np

from profilecal.calibration.calibration import Calibration, calibrate
from profilecal.geometry.noise import normalised_square
from profilecal.geometry.poses import pose_error
from profilecal.scan.scan import Scan
from profilecal.simulation.spec import Spec, simulate_scan

EXACT_SCANNER = dict.fromkeys(
    ("scale_percent", "shear_percent", "bend_mm", "tolerance_mm"), 0.0
)  # and target


def once(function):
    """A function of a specification that remembers its answers, by the specification's
    text: it may hold a dict.
    """
    known = {}

    @wraps(function)
    def remembering(spec: Spec):
        key = repr(spec)
        if key not in known:
            known[key] = function(spec)
        return known[key]

    return remembering


@once
def scan_of(spec: Spec) -> Scan:
    return simulate_scan(spec)


@once
def calibration_of(spec: Spec) -> Calibration:
    return calibrate([scan_of(spec)])


def truth_of(scan: Scan) -> np.ndarray:
    """The true sensor pose (4, 4), on the flange or in the base."""
    return np.array(
        scan.truth[
            "T_flange_sensor" if scan.mount == "eye-in-hand" else "T_base_sensor"
        ]
    )


def error_of(found, T) -> np.ndarray:
    """Of an answer or solution from a pose (4, 4): (6,) mm and rad."""
    solution = getattr(found, "solution", found)
    return pose_error(solution.rotation, solution.translation, T[:3, :3], T[:3, 3])


def squared_error(scan: Scan, found: Calibration) -> float:
    """Of the answer from the truth over its covariance, 6 expected."""
    return normalised_square(found.solution.covariance, error_of(found, truth_of(scan)))


def printed_square(printed: dict, truth: dict, covariance: str = "covariance") -> float:
    """The same of what is printed as JSON; NaN without a pose or such a covariance."""
    name = "T_base_sensor" if "T_base_sensor" in printed else "T_flange_sensor"
    if not printed.get(name) or not printed.get(covariance):
        return np.nan
    T, true = np.array(printed[name]), np.array(truth[name])
    units = np.r_[1, 1, 1, np.full(3, 180 / np.pi)]
    error = units * pose_error(T[:3, :3], T[:3, 3], true[:3, :3], true[:3, 3])
    return float(normalised_square(np.array(printed[covariance]), error))
