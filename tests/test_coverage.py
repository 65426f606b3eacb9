"""The truth lies in the stated regions: raw profiles with an instrument's noise, from a scan folder to the JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

from profilecal.calibrate import calibrate, covariances
from profilecal.features import find_features
from profilecal.joint import pose_error
from profilecal.scan import read_scan, write_scan
from profilecal.scanner import Scanner
from profilecal.simulate import Noise
from profilecal.synthetic import Spec, simulate_scan
from profilecal.targets.disk import Disk

SCANS = 8
CASES = {
    "bar": {"kind": "edge", "scanner": Scanner(), "groups": 12, "positions": 5},
    "scale": {
        "kind": "edge",
        "specimen": "straight scale",
        "scanner": Scanner(),
        "groups": 12,
        "positions": 5,
        "spread_deg": 20.0,
    },
    "disk": {"kind": "disk", "positions": 12},
    "ball": {"kind": "ball"},
    "plane": {"kind": "plane"},
}


def spec(case, seed, position_mm=0.0):
    noise = Noise(profile_mm=0.05, position_mm=position_mm)
    return Spec(measured="profiles", seed=seed, noise=noise, **CASES[case])


def normalised_square(scan, folder):
    """The squared error of the printed pose over its printed covariance."""
    write_scan(scan, folder)
    printed = json.loads(json.dumps(calibrate([read_scan(folder)]).to_json()))
    found, true = np.array(printed["T_flange_sensor"]), np.array(scan.truth["T_flange_sensor"])
    units = np.r_[1, 1, 1, np.full(3, 180 / np.pi)]
    delta = units * pose_error(found[:3, :3], found[:3, 3], true[:3, :3], true[:3, 3])
    return delta @ np.linalg.solve(printed["covariance"], delta)


@pytest.mark.parametrize(("case", "position_mm"), [*((case, 0.0) for case in CASES), ("disk", 0.05)])
def test_the_truth_lies_in_the_stated_region_of_raw_profiles(case, position_mm, tmp_path):
    """Inside: as often as a binomial law allows, 1 in 10⁴ at either end. The sum of n squared errors follows χ² of 6 n
    degrees of freedom: its bounds are narrower, and see regions that are too large, too."""
    scans = [simulate_scan(spec(case, seed, position_mm)) for seed in range(SCANS)]
    squares = np.array([normalised_square(s, tmp_path / str(i)) for i, s in enumerate(scans)])
    assert np.sum(squares < chi2.ppf(0.95, 6)) >= binom.ppf(1e-4, SCANS, 0.95)
    assert chi2.ppf(1e-4, 6 * SCANS) < squares.sum() < chi2.isf(1e-4, 6 * SCANS)


def chords(seed):
    """A scan's chords, and the disk's true ones (P, 2, 2), NaN where they are not in view."""
    chosen = spec("disk", seed)
    scan = simulate_scan(chosen)
    T = np.array(scan.truth["T_flange_sensor"])
    planes = scan.R_base_flange @ T[:3, :3], scan.T_base_flange + scan.R_base_flange @ T[:3, 3]
    points = Disk(**{k: np.array(v) for k, v in scan.truth["target"].items()}).meet(*planes)
    x, z = points[..., 0], points[..., 1]  # (P, 2)
    inside = (np.abs(x) < chosen.scanner.half_width(z) - 1) & (chosen.scanner.near < z) & (z < chosen.scanner.far)
    visible = np.where(inside.all(axis=1)[:, None, None], points, np.nan)
    return find_features("disk", scan.values, scan.radius), visible


def test_chords_in_view_are_found_nothing_else_is_and_both_tips_together_are_as_exact_as_stated():
    """The tips of a chord lie on one fitted line, so that they err across it together: the mean of n squared errors in
    four dimensions has the standard deviation √(8 / n)."""
    pairs = [pair for seed in range(8) for pair in zip(*chords(seed), strict=True) if np.isfinite(pair[1]).all()]
    found = [(feature, truth) for feature, truth in pairs if feature.found]
    assert len(found) >= 0.99 * len(pairs)
    good = [(f, truth) for f, truth in found if np.linalg.norm(f.points - truth, axis=1).max() < 1]
    assert len(found) - len(good) <= 0.005 * len(found)
    error = np.array([(f.points - truth).ravel() for f, truth in good])
    covariance = covariances("disk", [f for f, _ in good], 2)
    squares = np.einsum("na,na->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert abs(squares.mean() - 4) < 4 * np.sqrt(8 / len(squares))


def test_a_disk_of_another_radius_is_not_ok():
    """No robot errs that much."""
    found = calibrate([replace(simulate_scan(spec("disk", 0)), radius=51.0)])
    assert found.status != "ok"
    assert "more than a robot errs" in " ".join(found.messages)
