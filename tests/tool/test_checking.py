"""What a scan holds, before any calibration."""

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import run
from scipy.spatial.transform import RigidTransform
from simulated import scan_of

import profilecal as pc
from profilecal.geometry.poses import homogeneous, rotations
from profilecal.scan.scan import MOUNTS
from profilecal_tool.checking import check
from profilecal_tool.words import printed


def said_of(scan):
    return printed(check(scan))


def test_check_says_about_which_axis_the_flange_turns():
    scan = scan_of("edge", seed=7, groups=5, positions=5)
    degrees = np.repeat([-20.0, -10, 0, 10, 20], 5)
    about_x = rotations(np.outer(np.radians(degrees), [1.0, 0, 0]))
    turned = replace(scan, R_base_flange=scan.R_base_flange[0] @ about_x)
    said = said_of(turned)
    turns = "14.1, 0.0, 0.0° rms about three axes, most about the flange's x"
    assert f"\nturns          {turns}\n" in said
    assert "add poses tilted by 15° or more about two axes" in said


@pytest.mark.parametrize(
    ("measured", "sentence"), [("profiles", "by the scatter"), ("points", "unknown")]
)
def test_check_says_what_tells_the_noise(measured, sentence):
    assert sentence in said_of(scan_of("edge", groups=5, measured=measured))


@pytest.mark.parametrize(
    ("motion", "sentence"),
    [
        ({"pattern": "both ways"}, "these motions determine it"),
        ({"pattern": "one way", "stops": 3}, "these motions determine it"),
        ({"pattern": "one way"}, "leave it open, and the sensor's pose with it"),
    ],
)
def test_check_says_whether_motions_tell_the_delay(motion, sentence):
    small = {"sweeps": 8, "profiles": 20} | motion
    scan = scan_of("edge", mount="eye-to-hand", motion=small)
    said = said_of(scan)
    assert "motion         160 profiles in 8 sweeps, up to 100 mm/s" in said
    assert sentence in said
    refused = pc.calibrate(scan).status == "unobservable"
    assert refused == ("with it" in sentence)


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("screw_in", MOUNTS.values())
def test_check_knows_which_screw_hides_the_delay(mount, screw_in):
    rng = np.random.default_rng(1)
    turns = rotations(0.5 * rng.normal(size=(6, 1, 3)))
    starts = homogeneous(turns, 100 * rng.normal(size=(6, 1, 3)) + [500, 100, 400])
    t = np.arange(0, 1, 0.01)
    screw = np.array([0.2, 0.1, -0.3, 60, -30, 20])
    steps = RigidTransform.from_exp_coords(np.outer(t, screw)).as_matrix()
    T = steps @ starts if screw_in == "base" else starts @ steps
    times = np.add.outer(10.0 * np.arange(6), t).ravel()
    scan = pc.Scan.of(
        "edge",
        points=rng.normal([0, 90], size=(len(times), 2)),
        log=(times, T.reshape(-1, 4, 4)),
        times=times,
        sweeps=np.repeat([*"abcdef"], len(t)),
        mount=mount,
    )
    moves = "with it" if screw_in == MOUNTS[mount] else "shifts the target"
    assert moves in dict(check(scan))["delay"]


@pytest.mark.skipif(
    os.name != "posix" or os.getuid() != 0, reason="gives up root's permissions"
)
def test_without_permission_the_command_says_so():
    # not below pytest's folder, which is root's alone
    with tempfile.TemporaryDirectory() as above:
        os.chmod(above, 0o755)
        folder = Path(above) / "scan"
        pc.write_scan(scan_of("edge"), folder)
        run("check", folder)  # which imports what root alone may read
        poses = folder / "poses.csv"
        poses.chmod(0)
        os.seteuid(65534)
        try:
            done = run("check", folder)
        finally:
            os.seteuid(0)
        assert (done.exit_code, done.stdout) == (2, "")
        assert done.stderr == f"profilecal: {poses}: Permission denied\n"
