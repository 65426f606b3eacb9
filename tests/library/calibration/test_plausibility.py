"""What is wrong in the same way everywhere is named, and no wrong answer claims to be
right.
"""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, chi2
from simulated import EXACT_SCANNER, calibration_of, error_of, squared_error, truth_of

from profilecal.calibration.calibration import calibrate
from profilecal.calibration.plausibility import Finding, accusation
from profilecal.geometry.noise import FALSE_ALARM, Noise
from profilecal.scan.folder import read_scan
from profilecal.scan.toml import read_toml
from profilecal.simulation.spec import Spec, simulate_scan

EXAMPLES = Path(__file__).parents[3] / "data" / "examples"


@functools.cache
def example(kind):
    return replace(
        read_scan(EXAMPLES / kind), truth=read_toml(EXAMPLES / kind / "truth.toml")
    )


@functools.cache
def calibrated_example(kind):
    return calibrate([example(kind)])


def distance(scan, found):
    """Of the answer from the truth, in standard deviations, and the largest of a
    component.
    """
    delta, sd = (
        error_of(found, truth_of(scan)),
        np.sqrt(np.diag(found.solution.covariance)),
    )
    return np.sqrt(squared_error(scan, found)), np.max(np.abs(delta) / sd)


def profiles(scan, A):
    return replace(scan, values=tuple(points @ np.array(A) for points in scan.values))


def moved(scan, T):
    return replace(scan, p_base_flange=scan.p_base_flange + T)


def steps(scan):
    return np.linspace(0, 1, len(scan.labels))[:, None]


WRONG = {
    "edge scale": (
        "edge",
        lambda s: profiles(s, [[1.01, 0], [0, 1.01]]),
        "the robot's positions were too close together by 1 %",
    ),
    "x": (
        "ball",
        lambda s: profiles(s, [[0.995, 0], [0, 1]]),
        "the profiles' x were too small by 0.4",
    ),
    "z": (
        "ball",
        lambda s: profiles(s, [[1, 0], [0, 1.01]]),
        "the profiles' z were too large by 0.9",
    ),
    "shear": (
        "disk",
        lambda s: profiles(s, [[1, 0], [0.006, 1]]),
        "the profiles' x grew with z by +0.6",
    ),
    "drift": (
        "disk",
        lambda s: moved(s, [0.8, 0, 0] * steps(s)),
        "drifted along the base's x by 0.6",
    ),  # sd 0.17
    "robot": (
        "edge",
        lambda s: moved(s, 0.01 * s.p_base_flange),
        "positions were too far apart by 0.9",
    ),
    "one axis": (
        "ball",
        lambda s: moved(s, [0, 0.01, 0] * s.p_base_flange),
        "base's y were too far apart by 0.9",
    ),
}


@pytest.mark.parametrize(
    ("kind", "wrong", "right"), [("disk", 50.5, "50"), ("ball", 40.0, "25")]
)
def test_a_wrong_radius_is_answered_by_the_one_that_fits_and_by_no_poses(
    kind, wrong, right
):
    found = calibrate([replace(example(kind), sizes=(wrong,))])
    assert found.status != "ok"
    assert found.misread
    assert found.messages[0].startswith(f"with a radius of {right}")
    assert found.messages[0].endswith(f"; {wrong:g} mm was given")
    assert not any(
        "add poses" in message or "tilt" in message for message in found.messages
    )


def test_a_robot_s_scale_is_named_where_the_scanner_stands_still_too():
    scan = simulate_scan(
        Spec(kind="disk", mount="eye-to-hand", groups=12, positions=5, seed=4)
    )
    found = calibrate([moved(scan, 0.01 * scan.p_base_flange)])
    assert any(
        "the robot's positions were too far apart by" in message
        for message in found.messages
    )


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_everywhere_is_named_and_widens_the_region(wrong):
    kind, change, sentence = WRONG[wrong]
    scan = change(example(kind))
    found = calibrate([scan])
    named = [message for message in found.messages if sentence in message]
    assert named, found.messages
    assert named[0].endswith("the covariance is enlarged to match")
    assert distance(scan, found)[1] < 5 or found.status == "weak"


@pytest.mark.parametrize("kind", ["edge", "disk", "ball"])
def test_a_scanner_and_a_target_as_they_may_be_are_allowed_for(kind):
    """Errors of one prior's standard deviation move the answer by more than noise does,
    and no alarm is raised.
    """
    scan = profiles(example(kind), [[1.001, 0], [0.001, 0.999]])
    scan = replace(scan, sizes=tuple(s + 0.01 for s in scan.sizes))
    found = calibrate([scan])
    assert found.status == "ok"
    assert distance(scan, found)[0] < np.sqrt(chi2.isf(1e-4, 6))
    assert (
        found.solution.rms_mm < 1.1 * calibrated_example(kind).solution.rms_mm
    )  # what they explain is no residual
    exact = calibrate([replace(scan, noise=scan.noise | EXACT_SCANNER)])
    assert distance(scan, exact)[0] > distance(scan, found)[0]


def test_a_group_that_is_shifted_is_an_error_that_an_orientation_shares():
    scan = example("disk")
    found = calibrate([moved(scan, [0, 1, 0] * (steps(scan) > 0.75))])
    assert found.solution.noise.group_position_mm > 0.1
    assert distance(scan, found)[0] < np.sqrt(chi2.isf(1e-4, 6))


def test_good_scans_are_rarely_doubted():
    plan = {"groups": 12, "positions": 4}
    found = [
        calibration_of(Spec(kind, seed=seed, **plan))
        for kind in ("edge", "disk", "ball")
        for seed in range(6)
    ]
    doubted = sum(bool(f.messages) for f in found)
    assert doubted <= binom.ppf(0.9999, len(found), FALSE_ALARM)


@pytest.mark.parametrize("kind", ["edge", "disk", "ball"])
def test_the_examples_and_robot_errors_are_not_doubted(kind):
    assert calibrated_example(kind).status == "ok"
    scan, rng = example(kind), np.random.default_rng(1)
    found = calibrate([moved(scan, 0.1 * rng.normal(size=(len(scan.labels), 3)))])
    assert found.status == "ok"
    assert distance(scan, found)[0] < np.sqrt(chi2.isf(1e-4, 6))


@pytest.mark.parametrize("kind", ["edge", "disk", "ball"])
def test_contradictions_are_no_robot_errors(kind):
    """An implausible robot position error must not explain a scan whose poses are
    wrong.
    """
    scan, rng = example(kind), np.random.default_rng(1)
    found = calibrate([moved(scan, 10 * rng.normal(size=(len(scan.labels), 3)))])
    assert found.status != "ok"
    assert any(
        "contradict" in m and "check the mount, units and convention of the poses" in m
        for m in found.messages
    )


def test_many_rejected_poses_are_doubted():
    scan = example("ball")
    bad = np.arange(len(scan.labels)) % 5 < 2  # two fifths, in every group
    found = calibrate(
        [
            moved(
                scan,
                np.where(bad, 5.0, 0.0)[:, None]
                * np.random.default_rng(2).normal(size=(30, 3)),
            )
        ]
    )
    assert found.status == "weak"
    assert any("poses contradict the others" in message for message in found.messages)


def test_stated_noise_that_does_not_explain_the_residuals_widens_the_region():
    """What the scanner is said not to do, the robot is taken to do."""
    noise = Noise(profile_mm=0.05)
    scans = [
        simulate_scan(Spec(seed=seed, noise=noise, groups=12, positions=4))
        for seed in range(15)
    ]
    scans = [replace(scan, noise={"profile_mm": 0.02}) for scan in scans]
    found = [calibrate([scan]) for scan in scans]
    robot = [f.solution.noise.position_mm for f in found]
    assert min(robot) > 0.01
    assert np.median(robot) == pytest.approx(np.sqrt(0.05**2 - 0.02**2), rel=0.2)
    inside = sum(
        distance(s, f)[0] ** 2 < chi2.ppf(0.95, 6)
        for s, f in zip(scans, found, strict=True)
    )
    assert inside >= binom.ppf(1e-3, 15, 0.95)


def test_eye_to_hand_drifts_are_named_too():
    scan = simulate_scan(Spec(kind="disk", mount="eye-to-hand", seed=5))
    found = calibrate([moved(scan, [0, 0, 0.5] * steps(scan))])
    assert any(
        "drifted along the base's z by 0.4" in message for message in found.messages
    ), found.messages


def test_an_accusation_names_the_largest_shift_and_its_turn():
    moves = np.array([[3.0, 0, 4, 0.006, 0.008, 0], [0, 1, 0, 9, 0, 0]])
    said = accusation(
        [Finding("it is {:.2g} mm wrong", 0.1, 7.0, row, 2) for row in moves]
    )
    assert (
        "(7 standard deviations), which would move the sensor by up to 5 mm and 0.57°"
        in said
    )
