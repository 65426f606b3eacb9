"""A pose held against a scan that it is not from."""

import json

import numpy as np
import pytest
from command import run
from simulated import calibration_of, scan_of

from profilecal.calibrate.verify import verify
from profilecal.scan.folder import write_scan
from profilecal.simulate.spec import Spec, simulate_scan


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "point"])
def test_verify_believes_a_right_pose_and_doubts_a_wrong_one(kind):
    rng, believed, doubted = np.random.default_rng(1), 0, 0
    for seed in range(10):
        found = calibration_of(Spec(seed=seed)).solution
        other = scan_of(Spec(kind=kind, seed=seed))  # the same seed: the same mount
        T = found.T_flange_sensor
        believed += verify(other, T, found.covariance, found.noise_mm, rng).as_expected
        wrong = T @ np.block([[np.eye(3), np.full((3, 1), 1.0)], [np.zeros((1, 3)), np.ones((1, 1))]])
        doubted += not verify(other, wrong, found.covariance, found.noise_mm, rng).as_expected
    assert believed >= 8
    assert doubted == 10


def test_verify_reads_what_calibrate_printed(tmp_path):
    write_scan(simulate_scan(Spec(seed=5)), tmp_path / "edge")
    write_scan(simulate_scan(Spec(kind="ball", seed=5)), tmp_path / "ball")
    (tmp_path / "T.json").write_text(run("calibrate", tmp_path / "edge", "--json").output)
    result = run("verify", tmp_path / "ball", "--with", tmp_path / "T.json")
    assert result.exit_code == 0, result.output
    assert "sphere through" in result.output


WRONG = {
    "nothing": (lambda found: {}, "not what `profilecal calibrate --json` prints"),
    "no pose": (lambda found: found | {"T_flange_sensor": None}, "no sensor pose"),
    "a scaled pose": (lambda found: found | {"T_flange_sensor": np.diag([2, 2, 2, 1]).tolist()}, "not orthonormal"),
    "a reflection": (lambda found: found | {"T_flange_sensor": np.diag([-1, 1, 1, 1]).tolist()}, "a reflection"),
    "a row lost": (lambda found: found | {"T_flange_sensor": found["T_flange_sensor"][:3]}, "a 4x4 transform"),
    "transposed": (
        lambda found: found | {"T_flange_sensor": np.transpose(found["T_flange_sensor"]).tolist()},
        "last row",
    ),
    "a negative variance": (
        lambda found: found | {"covariance": (-np.array(found["covariance"])).tolist()},
        "positive",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_verify_refuses_what_is_no_pose(wrong, tmp_path):
    change, why = WRONG[wrong]
    found = calibration_of(Spec(kind="ball", seed=5))
    write_scan(found.scans[0], tmp_path / "ball")
    (tmp_path / "T.json").write_text(json.dumps(change(found.to_json())))
    result = run("verify", tmp_path / "ball", "--with", tmp_path / "T.json")
    assert result.exit_code == 2
    assert why in result.output
    assert "T.json" in result.output
    assert result.output.count("\n") == 1
