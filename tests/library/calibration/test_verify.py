"""A pose held against a scan that it is not from."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from simulated import (
    SCANNER,
    calibration_of,
    few,
    scan_of,
    wrong_by,
)

import profilecal as pc
from profilecal.calibration.answer import answer_of as answer_of_entries

pytestmark = pytest.mark.usefixtures("read_rightly")
ERRING = {"position_mm": 0.05, "orientation_deg": 0.01}
SMALL = {"noise": ERRING, "groups": 12, "positions": 4}
OTHER = SMALL | {"groups": 14, "scanner": SCANNER}
SIX = OTHER | {"groups": 6, "positions": 1}


def untold(kind, **entries):
    """A scan that does not state its noise. The same seed: the same mount."""
    return replace(scan_of(kind, **entries), noise={})


def answer_of(calibration, mm=(0, 0, 0), deg=(0, 0, 0)):
    """What a calibration states, of a pose that is wrong by so much."""
    return replace(calibration.answer, pose=wrong_by(calibration.pose, mm, deg))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"pose": np.eye(3)}, r"Answer: the sensor pose has shape \(3, 3\)"),
        ({"pose": np.diag([2, 2, 2, 1])}, "not orthonormal"),
        ({"pose": np.eye(4) + np.eye(4, k=-3)}, "last row"),
        ({"covariance_total_mm_deg": np.zeros((6, 6))}, "Answer: holds no covariance"),
        ({"covariance_total_mm_deg": np.diag([1, 1, 1, 1, 1, -1])}, "no covariance"),
        ({"covariance_total_mm_deg": np.eye(6) + np.eye(6, k=5)}, "no covariance"),
        ({"covariance_total_mm_deg": None}, r"its covariance has shape \(\)"),
        ({"mount": "hand"}, "Answer: mount is 'hand'; expected eye-in-hand or"),
    ],
)
def test_an_answer_made_by_hand_is_checked(change, sentence):
    right = {"pose": np.eye(4), "covariance_total_mm_deg": np.eye(6)}
    right |= {"noise_mm": 0.05, "mount": "eye-in-hand"}
    with pytest.raises(pc.ScanError, match=sentence):
        pc.Answer(**right | change)


def test_an_answer_of_lists_is_one_of_arrays():
    pose, square = np.eye(4).tolist(), np.eye(6).tolist()
    answer = pc.Answer(pose, square, 0.05, "eye-in-hand", covariance_mm_deg=square)
    assert pc.verify(answer, answer).chance == 1


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_six_poses_suffice_for_the_directions_that_they_determine(kind):
    found = calibration_of("edge", seed=0, **SMALL)
    six = untold(kind, seed=0, **SIX)
    verification = pc.verify(found, six)
    assert verification.as_expected
    assert 3 <= len(verification.apart) <= 6
    assert verification.is_conclusive == (len(verification.apart) == 6)
    wrong = answer_of(found, mm=[20, 20, 20], deg=[8, 8, 8])
    assert not pc.verify(wrong, six).as_expected


def refused(sentence, *arguments, asked=pc.verify):
    with pytest.raises(pc.ScanError, match=sentence):
        asked(*arguments)


def test_what_cannot_be_compared_is_refused():
    found = calibration_of("edge", seed=0, **SMALL)
    for poses in (3, 5):
        scan = untold("edge", seed=0, **SIX | {"groups": poses})
        refused(f"from {poses} poses; expected 6 or more, or check-mount", found, scan)
    to_hand = scan_of("ball", seed=5, mount="eye-to-hand")
    refused("the mount is eye-to-hand; expected eye-in-hand", found, to_hand)
    refused("the other answer: the pose in question is from the same", found, found)
    scan, truth = pc.simulate("ball", groups=1, positions=1, repeats=6)
    known, vague = (
        pc.Answer(truth.pose, np.diag(np.full(6, square)), 0.05, scan.mount)
        for square in (1e-4, 1e6)
    )
    for other in (scan, vague):
        refused("determines no direction of the sensor's pose", known, other)


def test_an_answer_knows_its_own_scan_again_and_old_files_are_read(tmp_path):
    found = calibration_of("edge", seed=0, **SMALL)
    pc.write_answer(found, tmp_path / "T.json")
    answer = pc.read_answer(tmp_path / "T.json")
    (scan,) = found.scans
    rounded = replace(scan, p_base_flange=scan.p_base_flange.round(3))
    own = "is from the same measurements; expected others"
    for asked in (pc.verify, pc.check_mount):
        for one in (found, answer):
            for some in (rounded, few(rounded, [2, 9, 20])):
                refused(own, one, some, asked=asked)
    entries = json.loads((tmp_path / "T.json").read_text())
    entries |= {"covariance": None, "made": None}
    (tmp_path / "old.json").write_text(json.dumps(entries))
    assert pc.verify(found, pc.read_answer(tmp_path / "old.json")).chance > 0.9
    bad = tmp_path / "bad.json"
    bad.write_text(json.dumps(entries | {"covariance": [1.0]}))
    refused(r"its covariance has shape \(1,\)", bad, asked=pc.read_answer)
    made = [1], {"scans": [1]}
    texts = [json.dumps(entries | {"made": one}) for one in made]
    for text in (*texts, 100_000 * "["):
        bad.write_text(text)
        refused("not what `profilecal", bad, asked=pc.read_answer)


OF_ANOTHER_VERSION = {  # entries of what was found
    "freedom": None,
    "mean": [0.0],
    "targets": [["cube", [], [0, 0, 0], np.eye(3).tolist()]],
    "covariance": [[1.0]],
    "robot_errors": {"wobble_mm": 1.0},
}


@pytest.mark.parametrize("name", OF_ANOTHER_VERSION)
def test_a_file_of_another_version_verifies_and_predicts_nothing(name):
    found = calibration_of("edge", seed=0, **SMALL)
    printed = found.to_json()
    more = printed["joint"] | {"another": 1}
    assert answer_of_entries(printed | {"joint": more}).joint is not None
    del more[name]
    for joint in (more, printed["joint"] | {name: OF_ANOTHER_VERSION[name]}):
        answer = answer_of_entries(printed | {"joint": joint})
        assert answer.joint is None
        assert pc.verify(found, answer).as_expected


@pytest.mark.parametrize("kind", ["edge", "plane"])
def test_two_answers_are_compared_as_an_answer_and_a_scan(kind):
    found = calibration_of("edge", seed=0, **SMALL)
    other = untold(kind, seed=0, **OTHER)
    by_answer = pc.verify(found, pc.calibrate(other)).difference_mm_deg
    assert_allclose(by_answer, pc.verify(found, other).difference_mm_deg, atol=1e-3)
    wrong = answer_of(found, mm=[0, 0, -1.5], deg=[0, 0.5, 0])
    of_wrong = pc.verify(wrong, pc.calibrate(other))
    assert not of_wrong.as_expected
    moved = of_wrong.difference_mm_deg - by_answer
    assert_allclose(moved, [0, 0, 1.5, 0, -0.5, 0], atol=0.02)
