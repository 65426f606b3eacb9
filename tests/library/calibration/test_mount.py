"""What is known of the mount: compared with the answer, and filling what it leaves."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform
from simulated import deformed, moved, squared_error

import profilecal as pc
from profilecal.geometry.poses import homogeneous, rotations


def near(pose, seed, sd_mm=15.0, sd_deg=8.0):
    """A guess as good as it is said to be."""
    rng = default_rng(seed)
    guess = pose.copy()
    guess[:3, 3] += sd_mm * rng.normal(size=3)
    guess[:3, :3] @= rotations(np.radians(sd_deg) * rng.normal(size=3))
    return guess


def of_a_tool(scan):
    return moved(scan, 180 * scan.R_base_flange[:, :, 2])


def in_a_user_frame(scan):
    """The base that poses are in is not the one that the guess is in."""
    R = rotations(np.radians([10.0, 20.0, 30.0]))
    return replace(
        scan,
        R_base_flange=R @ scan.R_base_flange,
        p_base_flange=scan.p_base_flange @ R.T + [50, 60, 70],
    )


WRONG = {
    "the poses were of a tool whose axes are at about ": of_a_tool,
    "the poses were in a user frame whose axes are at about ": in_a_user_frame,
    "z of the profiles were negated": deformed(np.diag([1, -1])),
    "x of the profiles were negated": deformed(np.diag([-1, 1])),
    "x and z of the profiles were negated": deformed(-np.eye(2)),
    "x and z of the profiles were exchanged": deformed(np.eye(2)[::-1]),
    "z of the profiles were about +": deformed(np.eye(2), [0, 130]),
    "the guess were of the flange in the sensor's frame": deformed(np.eye(2)),
}


@pytest.mark.parametrize("words", WRONG)
def test_what_no_residual_shows_is_named_beside_a_guess(words):
    mount = "eye-to-hand" if "user frame" in words else "eye-in-hand"
    scan, truth = pc.simulate("edge", seed=3, groups=12, positions=3, mount=mount)
    wrong, guess = WRONG[words](scan), near(truth.pose, 3)
    if "guess" in words:
        guess = np.linalg.inv(guess)
    silent = pc.calibrate(wrong)
    assert (silent.status, silent.messages) == ("ok", ())
    found = pc.calibrate(wrong, guess)
    assert found.status == "weak"
    assert found.messages[0].startswith("the answer lies ")
    assert f"as if {words}" in found.messages[0]
    assert_allclose(found.pose, silent.pose, atol=1e-9)


@pytest.mark.parametrize("kind", ["edge", "plane", "disk"])
def test_what_the_scan_leaves_open_rests_on_the_guess_and_says_so(kind):
    plan = {"groups": 6, "positions": 4, "spread_deg": 0.0}
    scan, truth = pc.simulate(kind, seed=2, **plan)
    assert not pc.calibrate(scan).is_known
    guess = near(truth.pose, 2, 0.5, 0.2)
    found = pc.calibrate(replace(scan, guess=guess, guess_sd=(0.5, 0.2)))
    assert found.is_known
    assert "rests on the guess more than on the scan" in found.messages[0]
    assert squared_error(found) < 16.8  # χ² of 6, 1 %


def test_a_guess_is_held_against_what_a_scan_determines_of_the_pose():
    """One orientation leaves translations open; the turns are known."""
    scan, truth = pc.simulate("ball", seed=1, spread_deg=0.0)
    turned = truth.pose @ homogeneous(rotations(np.radians([0.0, 0, 40])), np.zeros(3))
    found = pc.calibrate(scan, turned)
    assert found.status == "unobservable"
    assert found.misread
    assert "from the guess, which is said to be good to" in found.messages[0]


PARTS = [
    ((np.inf, 8), "z of the profiles were negated", "good to 8°;"),
    ((15, np.inf), "the poses were of a tool whose axes are at about ", "to 15 mm;"),
]


@pytest.mark.parametrize(("sd", "words", "good"), PARTS)
def test_a_guess_of_which_only_a_part_is_said_counts_with_that(sd, words, good):
    scan, truth = pc.simulate("edge", seed=3, groups=12, positions=3)
    guess = RigidTransform.from_matrix(near(truth.pose, 3))
    right = pc.calibrate(scan, guess, sd)
    assert (right.status, right.messages) == ("ok", ())
    assert_allclose(right.pose, pc.calibrate(scan).pose, atol=1e-9)
    found = pc.calibrate(WRONG[words](scan), guess, sd)
    assert found.status == "weak"
    assert good in found.messages[0]


def test_how_good_a_guess_is_counts_whoever_has_the_guess():
    scan, truth = pc.simulate("edge", seed=1)
    off = truth.pose + np.eye(4, k=3) * [0, 0, 0, 20]
    roughly = replace(scan, guess=off, guess_sd=(50, 8))
    assert pc.calibrate(roughly).status == "ok"
    assert pc.calibrate(roughly, guess_sd=(0.5, 8)).status == "weak"
    for scans, guess, sd, sentence in (
        ([], None, None, "no scans given; expected at least one"),
        (scan, None, (0.5, 8), "but no guess is given"),
        (scan, off, (0.0, 8.0), "expected mm and degrees above 0"),
        (scan, off, (15.0, np.nan), "expected mm and degrees above 0"),
    ):
        with pytest.raises(ValueError, match=sentence):
            pc.calibrate(scans, guess, sd)
