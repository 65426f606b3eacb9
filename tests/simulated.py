"""Simulated scans and their calibrations, each computed once for all cases that read
it; changes of a scan; how far off an answer is.
"""

from dataclasses import replace
from functools import wraps

import numpy as np

import profilecal as pc
from profilecal.calibration.answer import DEGREES
from profilecal.geometry.noise import Systematic, normalised_square
from profilecal.geometry.poses import difference, homogeneous, rotations
from profilecal.simulation.spec import truth_of
from profilecal.targets.state import State

SCANNER = {"noise_mm": 0.06}  # of raw profiles; 0.05 is stated
ERRING = {"profile_mm": 0.05, "position_mm": 0.05, "orientation_deg": 0.02}
EXACT_SCANNER = vars(Systematic())  # and target


def once(function):
    """A function that remembers its answers, by the text of its arguments: one may be a
    dict.
    """
    answers = {}

    @wraps(function)
    def remembering(*arguments, **entries):
        key = repr((arguments, entries))
        if key not in answers:
            answers[key] = function(*arguments, **entries)
        return answers[key]

    return remembering


@once
def scan_of(kind, **entries):
    """What `pc.simulate` makes of the same."""
    scan, _ = pc.simulate(kind, **entries)
    return scan


@once
def calibration_of(kind, **entries):
    """The answer of that scan alone."""
    return pc.calibrate(scan_of(kind, **entries))


def with_values(scan, change, poses=None):
    """The scan with what was seen changed: from all poses, or from some, by number."""
    values = list(scan.values)
    for pose in range(len(values)) if poses is None else poses:
        values[pose] = change(values[pose])
    return replace(scan, values=tuple(values))


def deformed(A, shift=0):
    """What makes a scan of which each profile's (x, z) are times a matrix (2, 2), and
    shifted.
    """
    return lambda scan: with_values(scan, lambda rows: rows @ np.array(A) + shift)


def moved(scan, shifts):
    """The scan with the flange's positions (P, 3) shifted in the base frame."""
    return replace(scan, p_base_flange=scan.p_base_flange + shifts)


def few(scan, poses):
    """Some poses of a scan, by number."""
    arrays = "R_base_flange", "p_base_flange", "side", "group", "times"
    kept = {name: getattr(scan, name)[[*poses]] for name in arrays}
    for name in ("labels", "values", "sweeps"):
        kept[name] = tuple(getattr(scan, name)[k] for k in poses)
    return replace(scan, **kept, orientation=None)


def wrong_by(T, mm, deg):
    """A pose (4, 4) shifted by mm (3,) and turned by deg (3,) in its own frame."""
    return T @ homogeneous(rotations(np.radians(deg)), np.asarray(mm, dtype=float))


def state_of(truth):
    """What is true of a simulated scan, as a state."""
    pose, placed = truth.pose[None], tuple(part[None] for part in truth.target.frame)
    return State(pose[:, :3, :3], pose[:, :3, 3], (placed,))


def error_of(found, true):
    """Of an answer from a pose (4, 4): (6,) mm and rad."""
    return difference(found.solution.pose, true)


def squared_error(found):
    """Of an answer from its first scan's truth over its covariance, 6 expected."""
    error = error_of(found, truth_of(found.scans[0]).pose)
    return normalised_square(found.solution.covariance, error)


def printed_square(printed, truth, covariance="covariance"):
    """The same of what is printed as JSON; NaN without a pose or such a covariance."""
    name = "T_base_sensor" if "T_base_sensor" in printed else "T_flange_sensor"
    if not printed.get(name) or not printed.get(covariance):
        return np.nan
    error = DEGREES * difference(np.array(printed[name]), np.array(truth[name]))
    return float(normalised_square(np.array(printed[covariance]), error))
