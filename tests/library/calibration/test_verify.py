"""A pose held against a scan that it is not from."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command import run
from simulated import calibration_of, scan_of, truth_of

from profilecal.calibration.answer import Answer
from profilecal.calibration.verify import linearised, verify
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.geometry.poses import homogeneous, pose_error, rotations
from profilecal.scan.folder import write_scan
from profilecal.scan.scan import ScanError
from profilecal.simulation.spec import Spec, simulate_scan

ERRING = Noise(profile_mm=0.05, position_mm=0.05, orientation_deg=0.01)
SMALL = {"noise": ERRING, "groups": 12, "positions": 4}


def untold(spec: Spec):
    """A scan that does not state its noise."""
    return replace(scan_of(spec), noise={})


def wrong_by(T, mm, deg):
    """A pose (4, 4) shifted by mm (3,) and turned by deg (3,) in its own frame."""
    return T @ homogeneous(rotations(np.radians(deg)), np.asarray(mm, dtype=float))


def answer_of(calibration, mm=(0, 0, 0), deg=(0, 0, 0)):
    """What a calibration states, of a pose that is wrong by so much."""
    return Answer(
        pose=wrong_by(calibration.pose, mm, deg),
        covariance_total_mm_deg=calibration.covariance_total_mm_deg,
        noise_mm=calibration.noise_mm,
        mount=calibration.mount,
    )


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "point"])
def test_verify_believes_a_right_pose_and_doubts_a_wrong_one(kind):
    for seed in range(2):
        first = calibration_of(Spec(seed=seed, **SMALL))
        # the same seed: the same mount
        other = untold(Spec(kind=kind, seed=seed, **SMALL | {"groups": 14}))
        assert verify(first, other).as_expected
        assert not verify(answer_of(first, mm=[1, 1, 1]), other).as_expected


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_five_poses_suffice_for_the_directions_that_they_determine(kind):
    for seed in range(2):
        first = calibration_of(Spec(seed=seed, **SMALL))
        five = untold(Spec(kind=kind, seed=seed, noise=ERRING, groups=5, positions=1))
        found = verify(first, five)
        assert found.as_expected
        assert 3 <= len(found.apart) <= 6
        wrong = answer_of(first, mm=[20, 20, 20], deg=[8, 8, 8])
        assert not verify(wrong, five).as_expected


def test_near_the_answer_the_first_order_says_the_same():
    found = calibration_of(Spec(kind="ball", seed=5, **SMALL))
    s = found.solution
    T = wrong_by(s.pose, [0.2, -0.1, 0.1], [0.02, 0.03, -0.02])
    delta, covariance = linearised(found, s.kept, T, 0.0)
    exact = pose_error(T[:3, :3], T[:3, 3], s.rotation, s.translation)
    assert normalised_square(covariance, delta - exact) < 0.3


def test_one_pose_determines_nothing():
    scan = simulate_scan(Spec(kind="ball", groups=1, positions=1, repeats=5))
    known = Answer(truth_of(scan), np.diag(np.full(6, 1e-4)), 0.05, scan.mount)
    with pytest.raises(ScanError, match="determines no direction of the sensor's pose"):
        verify(known, scan)


def test_another_mount_is_refused():
    found = calibration_of(Spec(kind="ball", seed=5))
    scan = simulate_scan(Spec(kind="ball", seed=5, mount="eye-to-hand"))
    with pytest.raises(ScanError, match="disagree about the mount, which is eye-to-"):
        verify(found, scan)


def test_a_verification_says_its_difference_in_mm_and_degrees():
    found = calibration_of(Spec(seed=0, **SMALL))
    other = untold(Spec(kind="ball", seed=0, **SMALL | {"groups": 14}))
    moved = verify(answer_of(found, mm=[0, 0, -1], deg=[0, 0.5, 0]), other)
    difference = moved.difference_mm_deg - verify(found, other).difference_mm_deg
    np.testing.assert_allclose(difference, [0, 0, 1, 0, -0.5, 0], atol=0.02)
    assert len(repr(moved).splitlines()) < 5


def held_against_the_ball(found, folder):
    """What `verify` says of the scan there named so, with what `calibrate` printed."""
    (folder / "T.json").write_text(json.dumps(found))
    return run("verify", folder / "ball", "--with", folder / "T.json")


def test_the_scan_that_the_pose_is_from_cannot_verify_it(tmp_path):
    write_scan(
        replace(scan_of(Spec(kind="ball", seed=5)), title="mine"), tmp_path / "ball"
    )
    result = held_against_the_ball(
        json.loads(run("calibrate", tmp_path / "ball", "--json").output), tmp_path
    )
    assert result.exit_code == 2
    refused = "the pose was found from this very scan; expected another"
    assert result.output == f"profilecal: mine: {refused}\n"


@pytest.mark.parametrize("old", [False, True])
def test_verify_reads_what_calibrate_printed(old, tmp_path):
    write_scan(simulate_scan(Spec(seed=5)), tmp_path / "edge")
    write_scan(simulate_scan(Spec(kind="ball", seed=5)), tmp_path / "ball")
    found = json.loads(run("calibrate", tmp_path / "edge", "--json").output)
    if old:
        del found["covariance_total"]
    result = held_against_the_ball(found, tmp_path)
    assert result.exit_code == 0, result.output
    assert "from a sphere" in result.output
    for shift, turn in (([0, 0, 0], [0, 1, 0]), ([0, 0, 2], [0, 0, 0])):
        wrong = wrong_by(np.array(found["T_flange_sensor"]), shift, turn).tolist()
        result = held_against_the_ball(found | {"T_flange_sensor": wrong}, tmp_path)
        assert result.exit_code == 1
    assert "most apart     translation along" in result.output


def changed(name, change):
    """What `calibrate` printed, with one entry changed."""
    return lambda found: found | {name: change(np.array(found[name])).tolist()}


WRONG = {
    "nothing": (lambda found: {}, "not what `profilecal calibrate --json` prints"),
    "no pose": (
        lambda found: found | {"T_flange_sensor": None},
        "where it finds a sensor pose",
    ),
    "a scaled pose": (
        changed("T_flange_sensor", lambda T: T @ np.diag([2, 2, 2, 1])),
        "not orthonormal",
    ),
    "a reflection": (
        changed("T_flange_sensor", lambda T: T @ np.diag([-1, 1, 1, 1])),
        "a reflection",
    ),
    "a row lost": (
        changed("T_flange_sensor", lambda T: T[:3]),
        "the sensor pose has shape (3, 4); expected (4, 4)",
    ),
    "transposed": (changed("T_flange_sensor", np.transpose), "last row"),
    "no variance": (
        changed("covariance_total", lambda C: C * np.nan),
        "its covariance[0, 0] is nan; expected finite",
    ),
    "no noise": (
        changed("noise_mm", lambda noise: noise * np.nan),
        "noise_mm is nan; expected finite",
    ),
    "a negative variance": (changed("covariance_total", np.negative), "positive"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_verify_refuses_what_is_no_pose(wrong, tmp_path):
    change, why = WRONG[wrong]
    found = calibration_of(Spec(kind="ball", seed=5))
    write_scan(found.scans[0], tmp_path / "ball")
    result = held_against_the_ball(change(found.to_json()), tmp_path)
    assert result.exit_code == 2
    assert why in result.output
    assert "T.json" in result.output
    assert result.output.count("\n") == 1
