"""Simulated scans and their calibrations, each computed once for all cases that read
it; changes of a scan; how far off an answer is.
"""

from dataclasses import replace
from functools import wraps

import numpy as np

import profilecal as pc
from profilecal.calibration.answer import DEGREES
from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.noise import Systematic, normalised_square
from profilecal.geometry.poses import difference, homogeneous, rotations
from profilecal.simulation.spec import pose_name

SCANNER = {"noise_mm": 0.06}  # of raw profiles; 0.05 is stated
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


def with_values(scan, poses, change):
    """The scan with what was seen from some poses, by number, changed."""
    values = list(scan.values)
    for pose in poses:
        values[pose] = change(values[pose])
    return replace(scan, values=tuple(values))


def few(scan, poses):
    """Some poses of a scan, by number."""
    chosen = np.array(poses)
    return replace(
        scan,
        labels=tuple(scan.labels[k] for k in poses),
        R_base_flange=scan.R_base_flange[chosen],
        p_base_flange=scan.p_base_flange[chosen],
        values=tuple(scan.values[k] for k in poses),
        side=scan.side[chosen],
        group=scan.group[chosen],
        times=np.array([]),
        orientation=None,
    )


def wrongly_seen(rows, error, wrong):
    """Points (n, 2), or a circle (1, 3), with an error of the scanner of that size."""
    is_circle = rows.shape[1] == 3
    points = rows[:, :2]
    if is_circle:
        angle = np.radians(np.linspace(-50, 50, 21))
        points = points + rows[:, 2:] * np.stack([np.sin(angle), -np.cos(angle)], 1)
    moved = points + wrong * np.stack(error.points(*points.T), axis=1)
    return fit_circle(moved)[None] if is_circle else moved


def wrong_by(T, mm, deg):
    """A pose (4, 4) shifted by mm (3,) and turned by deg (3,) in its own frame."""
    return T @ homogeneous(rotations(np.radians(deg)), np.asarray(mm, dtype=float))


def truth_of(scan):
    """The true sensor pose (4, 4), on the flange or in the base."""
    return np.array(scan.truth[pose_name(scan.mount)])


def error_of(found, true):
    """Of an answer from a pose (4, 4): (6,) mm and rad."""
    return difference(found.solution.pose, true)


def squared_error(found):
    """Of an answer from its first scan's truth over its covariance, 6 expected."""
    error = error_of(found, truth_of(found.scans[0]))
    return normalised_square(found.solution.covariance, error)


def printed_square(printed, truth, covariance="covariance"):
    """The same of what is printed as JSON; NaN without a pose or such a covariance."""
    name = "T_base_sensor" if "T_base_sensor" in printed else "T_flange_sensor"
    if not printed.get(name) or not printed.get(covariance):
        return np.nan
    error = DEGREES * difference(np.array(printed[name]), np.array(truth[name]))
    return float(normalised_square(np.array(printed[covariance]), error))
