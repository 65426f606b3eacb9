"""Has the sensor moved between two scans? How often that is told, and how often in error.

The suite takes 5 cells of each kind, and as many as PROFILECAL_DRIFT says:
`PROFILECAL_DRIFT=1000 pytest -s tests/calibrate/test_drift.py`.
"""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from command import run
from scipy.stats import binom

from profilecal.calibrate.drift import drift
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import homogeneous, rotations
from profilecal.scan.folder import write_scan
from profilecal.scan.scan import ScanError
from profilecal.simulate.poses import actual_poses
from profilecal.simulate.scene import random_scene
from profilecal.simulate.spec import WIDE, Spec, record, sizes_of

CELLS = int(os.environ.get("PROFILECAL_DRIFT", "5"))
NOISE_MM = 0.03
ROBOT = {"position_mm": 0.05, "orientation_deg": 0.02}  # the same at both visits
KNOWN = np.diag([0.05**2] * 3 + [np.radians(0.03) ** 2] * 3)  # of the sensor pose
FALSE_ALARMS, POWER = (0.005, 0.02), 0.99


def cell(kind, seed, repeatability=0.0):
    """The scans that five poses give before and after the sensor has moved by mm and degrees, and its first pose."""
    noise = Noise(NOISE_MM, **ROBOT, repeatability_mm=repeatability, repeatability_deg=repeatability / 4)
    scanner = replace(WIDE, noise_mm=NOISE_MM, resolution=NOISE_MM * np.sqrt(12))  # as much in x as in z
    spec = Spec(kind=kind, groups=5, positions=1, measured="profiles", noise=noise, scanner=scanner)
    rng = np.random.default_rng(seed)
    scene = random_scene(kind, rng, groups=5, positions=1, sizes=sizes_of(spec), spread_deg=40)
    poses = [part.reshape(-1, *part.shape[2:]) for part in actual_poses(scene.poses, noise, rng)]
    R, t = scene.truth.rotation[0], scene.truth.translation[0]

    def scan(mm=0.0, deg=0.0):
        """Of a sensor moved by mm and turned by deg, along and about random axes."""
        along, about = (axis / np.linalg.norm(axis) for axis in rng.normal(size=(2, 3)))
        return moved_by(mm * along, np.radians(deg) * about)

    def moved_by(shift, turn):
        truth = replace(scene.truth, rotation=(R @ rotations(turn))[None], translation=(t + R @ shift)[None])
        found = record(replace(scene, truth=truth), poses, spec, spec.robot, rng)
        stated = {"repeatability_mm": repeatability, "repeatability_deg": repeatability / 4}
        return replace(found, noise=found.noise | stated)

    return scan, moved_by, homogeneous(R, t)


@pytest.mark.parametrize("repeatability", [0.0, 0.02])
@pytest.mark.parametrize("kind", ["ball", "disk", "plane"])
def test_a_movement_is_told_and_rest_is_not_taken_for_one(kind, repeatability):
    said = {"rest": 0, "0.1 mm": 0, "0.05°": 0}
    for seed in range(CELLS):
        scan, _, T = cell(kind, seed, repeatability)
        before = scan()
        for what, moved in (("rest", (0, 0)), ("0.1 mm", (0.1, 0)), ("0.05°", (0, 0.05))):
            said[what] += not drift(before, scan(*moved), T, KNOWN, NOISE_MM).as_expected
    print(f"{kind}, the robot comes back to {repeatability} mm: {said} of {CELLS}")
    assert binom.ppf(1e-4, CELLS, FALSE_ALARMS[0]) <= said["rest"] <= binom.isf(1e-4, CELLS, FALSE_ALARMS[1])
    if not repeatability:
        assert min(said["0.1 mm"], said["0.05°"]) >= binom.ppf(1e-4, CELLS, POWER)


def test_the_movement_found_is_the_one_made():
    """And a slightly wrong sensor pose changes nothing: it is in both scans."""
    scan, moved_by, T = cell("ball", 3)
    made = np.array([0.3, 0, -0.2, 0, 0.002, 0])
    before, after = scan(), moved_by(made[:3], made[3:])
    wrong = T @ homogeneous(rotations([0.001, 0, -0.0005]), np.array([0.1, 0.05, -0.1]))
    for pose in (T, wrong):
        found = drift(before, after, pose, KNOWN, NOISE_MM)
        assert np.abs((found.delta - made) / np.sqrt(np.diag(found.expected.covariance))).max() < 4


def test_scans_that_cannot_be_compared_are_refused():
    scan, _, T = cell("ball", 1)
    other, _, _ = cell("disk", 1)
    with pytest.raises(ScanError, match="expected one target and mount"):
        drift(scan(), other(), T, KNOWN, NOISE_MM)
    elsewhere, _, _ = cell("ball", 2)
    with pytest.raises(ScanError, match="expected the same poses again"):
        drift(scan(), elsewhere(), T, KNOWN, NOISE_MM)


def test_the_command_tells_rest_from_movement(tmp_path):
    scan, _, T = cell("ball", 5)
    for name, moved in {"before": (0, 0), "later": (0, 0), "last": (0.3, 0)}.items():
        write_scan(scan(*moved), tmp_path / name)
    units = np.r_[1, 1, 1, np.full(3, 180 / np.pi)]
    covariance = KNOWN * units[:, None] * units
    found = {"T_flange_sensor": T.tolist(), "covariance": covariance.tolist(), "noise_mm": NOISE_MM}
    (tmp_path / "T.json").write_text(json.dumps(found))
    given = ("--with", tmp_path / "T.json", "--before", tmp_path / "before")
    still, moved = (run("verify", tmp_path / name, *given) for name in ("later", "last"))
    assert still.exit_code == 0, still.output
    assert "not moved; a false alarm in 1 % of all checks" in still.output
    assert moved.exit_code == 1
