"""The truth lies in the stated regions: raw profiles with an instrument's noise, from a
scan folder to the JSON.

The suite takes 3 scans of each target, and as many as PROFILECAL_COVERAGE says:
`PROFILECAL_COVERAGE=300 pytest -s tests/calibrate/test_coverage.py`.
"""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2
from simulated import EXACT_SCANNER, printed_square, scan_of

from profilecal.calibration.calibration import calibrate
from profilecal.geometry.noise import Noise
from profilecal.scan.folder import read_scan, write_scan
from profilecal.simulation.robot import Scanner
from profilecal.simulation.spec import Spec

SCANS = int(os.environ.get("PROFILECAL_COVERAGE", "3"))
EDGE = {"kind": "edge", "scanner": Scanner(), "groups": 12, "positions": 5}
CASES = {
    "bar": EDGE,
    "scale": EDGE | {"specimen": "straight scale", "spread_deg": 20.0},
    "disk": {"kind": "disk", "positions": 12},
    "ball": {"kind": "ball"},
    "plane": {"kind": "plane"},
    "rod": {"kind": "rod"},
}


ROBOTS = {
    "position and orientation": ({"position_mm": 0.05, "orientation_deg": 0.02}, {}),
    "five repeats": ({"position_mm": 0.05, "orientation_deg": 0.02}, {"repeats": 5}),
    "shared by an orientation": (
        {"group_position_mm": 0.05, "group_orientation_deg": 0.01},
        {},
    ),
}


def assert_held(scans, folder):
    """By the printed covariance, from scan folders. Inside: as often as a binomial law
    allows, 1 in 10⁴ at either end. The sum of n squared errors follows χ² of 6 n
    degrees of freedom: its bounds also see regions that are too large.
    """
    squares = []
    for k, scan in enumerate(scans):
        write_scan(scan, folder / str(k))
        printed = calibrate([read_scan(folder / str(k))]).to_json()
        squares.append(printed_square(json.loads(json.dumps(printed)), scan.truth))
    inside = np.sum(np.array(squares) < chi2.ppf(0.95, 6))
    mean = np.mean(squares)
    print(f"{folder.name}: {inside} of {SCANS} inside, mean square {mean:.2f} of 6")
    assert inside >= binom.ppf(1e-4, SCANS, 0.95)
    assert chi2.ppf(1e-4, 6 * SCANS) < np.sum(squares) < chi2.isf(1e-4, 6 * SCANS)


@pytest.mark.parametrize(
    ("case", "position_mm"), [*((case, 0.0) for case in CASES), ("disk", 0.05)]
)
def test_the_truth_lies_in_the_stated_region_of_raw_profiles(
    case, position_mm, tmp_path
):
    noise = Noise(profile_mm=0.05, position_mm=position_mm)
    specs = [
        Spec(measured="profiles", seed=seed, noise=noise, **CASES[case])
        for seed in range(SCANS)
    ]
    assert_held(map(scan_of, specs), tmp_path)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("kind", ["edge", "disk"])
def test_the_truth_lies_in_the_stated_region_whatever_the_robot_does(
    kind, robot, tmp_path
):
    """Nothing of the robot is stated. All cells of the kind:
    `tests/benchmarks/bench_uncertainty.py`.
    """
    errors, entries = ROBOTS[robot]
    noise = Noise(profile_mm=0.05, **errors)
    specs = [
        Spec(kind=kind, seed=k, noise=noise, groups=15, positions=3, **entries)
        for k in range(SCANS)
    ]
    stated = {"profile_mm": 0.05} | EXACT_SCANNER
    assert_held([replace(scan_of(spec), noise=stated) for spec in specs], tmp_path)
