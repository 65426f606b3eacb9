"""The truth lies in the stated regions: raw profiles with an instrument's noise, from a scan folder to the JSON.

The suite takes 3 scans of each target, and as many as PROFILECAL_COVERAGE says:
`PROFILECAL_COVERAGE=300 pytest -s tests/calibrate/test_coverage.py`.
"""

import functools
import json
import os
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.stats import binom, chi2
from simulated import scan_of

from profilecal.calibrate.calibration import calibrate
from profilecal.calibrate.observe import covariances
from profilecal.geometry.noise import Noise, Systematic
from profilecal.joint.state import pose_error
from profilecal.profiles.edges import LEAST_SIDE
from profilecal.scan.folder import read_scan, write_scan
from profilecal.simulate.scanner import Scanner
from profilecal.simulate.spec import Spec
from profilecal.targets.disk import Disk
from profilecal.targets.edge import Edge
from profilecal.targets.target import find_features

SCANS = int(os.environ.get("PROFILECAL_COVERAGE", "3"))
BESIDE = 8.0  # mm from an edge, in which LEAST_SIDE points of a face show it
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
    "rod": {"kind": "rod"},
}


def spec(case, seed, position_mm=0.0):
    noise = Noise(profile_mm=0.05, position_mm=position_mm)
    return Spec(measured="profiles", seed=seed, noise=noise, **CASES[case])


def normalised_square(scan, folder):
    """The squared error of the printed pose over its printed covariance, from a scan folder."""
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
    scans = [scan_of(spec(case, seed, position_mm)) for seed in range(SCANS)]
    squares = np.array([normalised_square(s, tmp_path / str(i)) for i, s in enumerate(scans)])
    inside = np.sum(squares < chi2.ppf(0.95, 6))
    print(f"{case}: {inside} of {SCANS} inside, mean square {squares.mean():.2f} of 6")
    assert inside >= binom.ppf(1e-4, SCANS, 0.95)
    assert chi2.ppf(1e-4, 6 * SCANS) < squares.sum() < chi2.isf(1e-4, 6 * SCANS)


ROBOTS = {
    "position and orientation": ({"position_mm": 0.05, "orientation_deg": 0.02}, {}),
    "five repeats": ({"position_mm": 0.05, "orientation_deg": 0.02}, {"repeats": 5}),
    "shared by an orientation": ({"group_position_mm": 0.05, "group_orientation_deg": 0.01}, {}),
}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("kind", ["edge", "disk"])
def test_the_truth_lies_in_the_stated_region_whatever_the_robot_does(kind, robot, tmp_path):
    """Nothing of the robot is stated. All cells of the kind: `tests/benchmarks/bench_uncertainty.py`."""
    errors, entries = ROBOTS[robot]
    noise, exact = Noise(profile_mm=0.05, **errors), {field.name: 0.0 for field in fields(Systematic)}
    squares = []
    for seed in range(SCANS):
        scan = scan_of(Spec(kind=kind, seed=seed, noise=noise, groups=15, positions=3, **entries))
        stated = {"profile_mm": 0.05} | exact
        squares.append(normalised_square(replace(scan, noise=stated), tmp_path / str(seed)))
    print(f"{kind}, {robot}: mean square {np.mean(squares):.2f} of 6")
    assert np.sum(np.array(squares) < chi2.ppf(0.95, 6)) >= binom.ppf(1e-4, SCANS, 0.95)
    assert chi2.ppf(1e-4, 6 * SCANS) < np.sum(squares) < chi2.isf(1e-4, 6 * SCANS)


@functools.cache
def features_in_view(case, seed):
    """A scan's features with the true points (m, 2) of each, where they are in view and what is beside them, too."""
    chosen = spec(case, seed)
    scan = scan_of(chosen)
    T = np.array(scan.truth["T_flange_sensor"])
    planes = scan.R_base_flange @ T[:3, :3], scan.T_base_flange + scan.R_base_flange @ T[:3, 3]
    target = {"edge": Edge, "disk": Disk}[scan.kind](**{k: np.array(v) for k, v in scan.truth["target"].items()})
    true = target.meet(*planes).reshape(len(scan.labels), -1, 2)
    x, z = true[..., 0], true[..., 1]
    scanner, margin = chosen.scanner, 1.0 if scan.kind == "disk" else 5.0
    inside = (np.abs(x) < scanner.half_width(z) - margin) & (scanner.near + margin < z) & (z < scanner.far - margin)
    shown = inside.all(axis=1)
    if scan.kind == "edge":  # faces that are tilted away are out of sight
        beside = [profile - point for profile, point in zip(scan.values, true, strict=True)]
        near = [b[np.linalg.norm(b, axis=1) < BESIDE, 0] for b in beside]
        sides = np.array([[(x < 0).sum(), (x > 0).sum()] for x in near])
        shown &= (sides.min(axis=1) if case == "bar" else sides.max(axis=1)) >= LEAST_SIDE
    found = find_features(scan.target, scan.values, scan.sizes)
    return [(feature, truth) for feature, truth, show in zip(found, true, shown, strict=True) if show]


@pytest.mark.parametrize("case", ["bar", "scale", "disk"])
def test_features_in_view_are_found_and_nothing_else_is(case):
    """False: more than 0.5 mm and eight standard deviations away."""
    pairs = [pair for seed in range(SCANS) for pair in features_in_view(case, seed)]
    found = [(feature, truth) for feature, truth in pairs if feature.found]
    assert len(found) >= 0.99 * len(pairs)
    false = 0
    for feature, truth in found:
        error = feature.points - truth
        squares = np.einsum("ma,mab,mb->m", error, np.linalg.inv(feature.covariance), error)
        false += bool(((np.linalg.norm(error, axis=1) > 0.5) & (squares > 8**2)).any())
    assert false <= 0.005 * len(found)


def test_both_tips_of_a_chord_together_are_as_exact_as_stated():
    """They lie on one fitted line, so that they err across it together: the mean of n squared errors in four
    dimensions has the standard deviation √(8 / n)."""
    found = [pair for seed in range(8) for pair in features_in_view("disk", seed) if pair[0].found]
    good = [(f, truth) for f, truth in found if np.linalg.norm(f.points - truth, axis=1).max() < 1]
    error = np.array([(f.points - truth).ravel() for f, truth in good])
    covariance = covariances([f for f, _ in good], 2, on_curve=False)
    squares = np.einsum("na,na->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert abs(squares.mean() - 4) < 4 * np.sqrt(8 / len(squares))


def test_a_disk_of_another_radius_is_not_ok():
    """Nor is any disk made so badly."""
    found = calibrate([replace(scan_of(spec("disk", 0)), sizes=(51.0,))])
    assert found.status != "ok"
    assert "the radius was too large by 1 mm" in " ".join(found.messages)
