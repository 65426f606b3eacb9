"""The truth lies in the stated regions: raw profiles with an instrument's noise, from a
scan folder to the JSON; whatever the robot does, and whatever is said of it.

The suite takes 2 scans of each target and of a few robots. With PROFILECAL_COVERAGE it
takes as many as that says, of every robot too: hours for all of them, on all cores.

    export PROFILECAL_COVERAGE=300
    pytest -n auto -rP tests/library/calibration/test_coverage.py -k "plane and repeats"
"""

import json
import os
from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.stats import binom, chi2
from simulated import EXACT_SCANNER, SCANNER, printed_square

import profilecal as pc
from profilecal import targets
from profilecal.geometry.noise import Noise
from profilecal.simulation.robot import Robot, Scanner
from profilecal.simulation.spec import WIDE, Spec, record, taken

SCANS = int(os.environ.get("PROFILECAL_COVERAGE", "2"))
EDGE = {"kind": "edge", "scanner": asdict(Scanner()), "groups": 12, "positions": 5}
TARGETS = {
    "bar": EDGE,
    "scale": EDGE | {"specimen": "straight scale", "spread_deg": 20.0},
    "disk": {"kind": "disk", "scanner": SCANNER, "positions": 12},
    "ball": {"kind": "ball", "scanner": SCANNER},
    "plane": {"kind": "plane", "scanner": SCANNER},
    "rod": {"kind": "rod", "scanner": SCANNER},
}
PRICE = {"plane": 4.0, "disk": 2.0}  # how many times as wide regions may be
BOTH = {"position_mm": 0.05, "orientation_deg": 0.02}
OF_AN_ORIENTATION = {"group_position_mm": 0.05, "group_orientation_deg": 0.01}
# the second target, which stands in the place of the first
BESIDE = {
    "edge": "plane",
    "disk": "edge",
    "ball": "edge",
    "plane": "edge",
    "rod": "plane",
}
SITUATIONS = {  # the robot's errors, and what else there is to say of the scan
    "no error": ({}, {}),
    "position": ({"position_mm": 0.05}, {}),
    "orientation": ({"orientation_deg": 0.02}, {}),
    "both": (BOTH, {}),
    "five repeats": (BOTH, {"repeats": 5, "positions": 2}),
    "two targets": (BOTH, {}),
    "shared by 16 orientations": (OF_AN_ORIENTATION, {"groups": 16, "positions": 2}),
    "shared by 10 orientations": (OF_AN_ORIENTATION, {}),
}
STATED = {"unstated": 0.0, "stated": 1.0, "stated a fifth": 0.2}
# kinds of targets, the robot's errors, what is stated of them, and entries of the
# specification
CELLS = {}
for (kind, beside), (name, how), (words, share) in product(
    BESIDE.items(), SITUATIONS.items(), STATED.items()
):
    errors, entries = how
    kinds = (kind, beside) if name == "two targets" else (kind,)
    stated = {error: share * size for error, size in errors.items() if share}
    CELLS[f"{kind}, {name}, {words}"] = kinds, errors, stated, entries
if "PROFILECAL_COVERAGE" not in os.environ:
    names = ("both", "five repeats", "shared by 16 orientations")
    pairs = product(("edge", "disk"), names)
    CELLS = {name: CELLS[name] for name in [f"{k}, {n}, unstated" for k, n in pairs]}


def assert_held(squares, wide=1.0):
    """Inside: as often as a binomial law allows, 1 in 10⁴ at either end. The sum of n
    squared errors follows χ² of 6 n degrees of freedom: its bounds also see regions
    that are too large, by more than `wide` times in each direction.
    """
    count, inside = len(squares), np.sum(np.array(squares) < chi2.ppf(0.95, 6))
    print(f"{inside} of {count} inside, mean square {np.mean(squares):.2f} of 6")
    assert inside >= binom.ppf(1e-4, count, 0.95)
    assert np.sum(squares) < chi2.isf(1e-4, 6 * count)
    assert np.sum(squares) * wide**2 > chi2.ppf(1e-4, 6 * count)


@pytest.mark.parametrize("target", TARGETS)
def test_the_truth_lies_in_the_stated_region_of_raw_profiles(target, tmp_path):
    """By the printed covariance, from scan folders. Some may be wider than need be:
    their scans do not tell that this robot is exact.
    """
    squares = []
    for seed in range(SCANS):
        scan, _ = pc.simulate(seed=seed, measured="profiles", **TARGETS[target])
        pc.write_scan(scan, tmp_path / str(seed))
        found = pc.calibrate(pc.read_scan(tmp_path / str(seed)))
        printed = json.loads(json.dumps(found.to_json()))
        squares.append(printed_square(printed, scan.truth))
    assert_held(squares, wide=PRICE.get(target, 1.0))


def scans_of(cell, seed):
    """A cell's scans, of raw profiles for one seed in two, by a robot that errs alike
    at each: of targets that stand in one place one after the other.
    """
    kinds, errors, stated, entries = cell
    entries = {"groups": 10, "positions": 3} | entries
    entries["scanner"] = replace(WIDE, points=400)
    entries["measured"] = "profiles" if seed % 2 else ""
    noise = Noise(profile_mm=0.05, **errors)
    first, *others = [Spec(kind, seed=seed, noise=noise, **entries) for kind in kinds]
    rng = default_rng(seed)
    scene = first.scene(rng)
    poses = taken(scene, first, rng)
    scans = [record(scene, poses, first, rng)]
    for spec in others:
        target = targets.TARGETS[spec.kind]
        origin, axes = scene.target.frame[0], scene.facing @ target.stance
        placed = target.at(origin, axes, target.usual_sizes)
        scans.append(record(replace(scene, target=placed), poses, spec, rng))
    stated = {"profile_mm": 0.05} | EXACT_SCANNER | stated
    return [replace(scan, noise=stated) for scan in scans]


@pytest.mark.parametrize("name", CELLS)
def test_the_truth_lies_in_the_stated_region_whatever_the_robot_does(name):
    """Of the answers that say "ok". Up to twice as wide as need be: each robot lacks
    errors that are believed of robots, and ten orientations hardly show their absence.
    """
    cell = CELLS[name]
    squares, rejecting = [], 0
    for seed in range(SCANS):
        scans = scans_of(cell, seed)
        printed = pc.calibrate(scans).to_json()
        rejecting += bool(printed["poses_rejected"])
        if printed["status"] == "ok":
            squares.append(printed_square(printed, scans[0].truth))
    print(f"{name}: {len(squares)} of {SCANS} are ok, {rejecting} reject poses")
    assert_held(squares, wide=2)


@pytest.mark.parametrize("kind", BESIDE)
def test_the_true_mount_lies_in_the_total_region_of_an_arm_that_errs_smoothly(kind):
    """Its joints are wrong by 0.035°, its links by 0.2 mm; residuals hardly show it."""
    arm = {"robot": Robot(joint_deg=0.035, link_mm=0.2)}
    squares = []
    for seed in range(SCANS):
        (scan,) = scans_of(((kind,), {}, {}, arm), seed)
        printed = pc.calibrate(scan).to_json()
        if printed["status"] == "ok":
            squares.append(printed_square(printed, scan.truth, "covariance_total"))
    assert squares
    assert_held(squares, wide=2)
