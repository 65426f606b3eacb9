"""The truth lies in the stated regions: raw profiles with an instrument's noise, from a
scan folder to the JSON.

The suite takes 3 scans of each target, and as many as PROFILECAL_COVERAGE says:
`PROFILECAL_COVERAGE=300 pytest -s tests/library/calibration/test_coverage.py`.
"""

import json
import os
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.stats import binom, chi2
from simulated import EXACT_SCANNER, SCANNER, printed_square

import profilecal as pc
from profilecal.simulation.robot import Scanner

SCANS = int(os.environ.get("PROFILECAL_COVERAGE", "3"))
EDGE = {"kind": "edge", "scanner": asdict(Scanner()), "groups": 12, "positions": 5}
DISK = {"kind": "disk", "scanner": SCANNER, "positions": 12}
TARGETS = {
    "bar": EDGE,
    "scale": EDGE | {"specimen": "straight scale", "spread_deg": 20.0},
    "disk": DISK,
    "disk and a robot's errors": DISK | {"noise": {"position_mm": 0.05}},
    "ball": {"kind": "ball", "scanner": SCANNER},
    "plane": {"kind": "plane", "scanner": SCANNER},
    "rod": {"kind": "rod", "scanner": SCANNER},
}
AT_EACH_POSE = {"position_mm": 0.05, "orientation_deg": 0.02}
OF_AN_ORIENTATION = {"group_position_mm": 0.05, "group_orientation_deg": 0.01}
ROBOTS = {
    "position and orientation": {"noise": AT_EACH_POSE},
    "five repeats": {"noise": AT_EACH_POSE, "repeats": 5},
    "shared by an orientation": {"noise": OF_AN_ORIENTATION},
}


SHARED = {"profile_mm": 0.05, "group_position_mm": 0.05}
MOTIONS = {
    "weave": {"pattern": "weave"},
    "both ways": {"pattern": "both ways"},
    "random": {"pattern": "random"},
    "one way and stops": {"pattern": "one way", "stops": 12},
}
DRIVEN = {
    "edge": {"motion": {"sweeps": 24}},
    "ball": {"motion": {"sweeps": 12}},
    "plane": {"motion": {"sweeps": 12}, "scanner": {"points": 200}},
}


def simulated(**entries):
    """A scan of these entries for each seed."""
    for seed in range(SCANS):
        scan, _ = pc.simulate(seed=seed, **entries)
        yield scan


def assert_held(scans, folder):
    """By the printed covariance, from scan folders. Inside: as often as a binomial law
    allows, 1 in 10⁴ at either end. The sum of n squared errors follows χ² of 6 n
    degrees of freedom: its bounds also see regions that are too large.
    """
    squares = []
    for k, scan in enumerate(scans):
        pc.write_scan(scan, folder / str(k))
        found = pc.calibrate(pc.read_scan(folder / str(k)))
        printed = json.loads(json.dumps(found.to_json()))
        squares.append(printed_square(printed, scan.truth))
    inside = np.sum(np.array(squares) < chi2.ppf(0.95, 6))
    mean = np.mean(squares)
    print(f"{folder.name}: {inside} of {SCANS} inside, mean square {mean:.2f} of 6")
    assert inside >= binom.ppf(1e-4, SCANS, 0.95)
    assert chi2.ppf(1e-4, 6 * SCANS) < np.sum(squares) < chi2.isf(1e-4, 6 * SCANS)


@pytest.mark.parametrize("target", TARGETS)
def test_the_truth_lies_in_the_stated_region_of_raw_profiles(target, tmp_path):
    assert_held(simulated(measured="profiles", **TARGETS[target]), tmp_path)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("kind", ["edge", "disk"])
def test_the_truth_lies_in_the_stated_region_whatever_the_robot_does(
    kind, robot, tmp_path
):
    """Nothing of the robot is stated. All cells of the kind:
    `tests/benchmarks/bench_uncertainty.py`.
    """
    stated = {"profile_mm": 0.05} | EXACT_SCANNER
    recorded = simulated(kind=kind, groups=15, positions=3, **ROBOTS[robot])
    assert_held((replace(scan, noise=stated) for scan in recorded), tmp_path)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("kind", DRIVEN)
def test_pose_and_delay_lie_in_the_stated_regions_of_scans_in_motion(kind, motion):
    """Delays of up to 150 ms, at 100 mm/s; fewer scans than above, as each has many
    profiles. No answer that says "ok" is far off.
    """
    squares, of_delays = [], []
    for seed in range(max(1, SCANS // 3)):
        delay = np.random.default_rng([seed, 99]).uniform(-150, 150)
        entries = DRIVEN[kind]
        how = entries["motion"] | MOTIONS[motion] | {"delay_ms": delay}
        entries = entries | {"noise": SHARED, "motion": how}
        scan, _ = pc.simulate(kind, seed=seed, **entries)
        printed = pc.calibrate(scan).to_json()
        squares.append(printed_square(printed, scan.truth))
        late = (printed["delay_ms"] - delay) / printed["delay_sd_ms"]
        of_delays.append(late**2)
        assert printed["status"] != "ok" or squares[-1] < 40
    count = len(squares)
    for freedom, found in ((6, squares), (1, of_delays)):
        inside = np.sum(np.array(found) < chi2.ppf(0.95, freedom))
        print(f"{kind}, {motion}: {inside} of {count} inside, {np.mean(found):.2f}")
        assert inside >= binom.ppf(1e-4, count, 0.95)
