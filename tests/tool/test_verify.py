"""`profilecal verify` reads what `profilecal calibrate --json` prints."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command import run
from numpy.random import default_rng
from simulated import calibration_of, scan_of, wrong_by

import profilecal as pc


def printed_of(scan, folder):
    """What `calibrate` prints of a scan, written to a folder."""
    pc.write_scan(scan, folder)
    return json.loads(run("calibrate", folder, "--json").output)


def held_against_the_ball(printed, folder):
    """What `verify` says of the scan there named so, with what `calibrate` printed."""
    (folder / "T.json").write_text(json.dumps(printed))
    return run("verify", folder / "ball", "--with", folder / "T.json")


def test_two_answers_are_compared_and_what_they_share_is_said(tmp_path):
    for number in (1, 2):
        scan = scan_of("edge", seed=5, scan=number)
        pc.write_answer(pc.calibrate(scan), tmp_path / f"{number}.json")
    command = "verify", tmp_path / "2.json", "--with", tmp_path / "1.json"
    refused = run(*command, "--cloud", tmp_path / "cloud.ply")
    assert "--cloud is of a scan; expected a folder" in refused.stderr
    result = run(*command)
    assert result.exit_code == 0, result.output
    assert "other pose     ok" in result.output
    assert "of the edge if it is one: no difference shows them" in result.output


def test_verify_reads_what_calibrate_printed(tmp_path):
    pc.write_scan(scan_of("ball", seed=5), tmp_path / "ball")
    printed = printed_of(scan_of("edge", seed=5), tmp_path / "edge")
    printed |= {"status": "weak"}
    result = held_against_the_ball(printed, tmp_path)
    assert result.exit_code == 0, result.output
    assert result.output.startswith("pose           weak\n")
    assert "from a sphere" in result.output
    pose = np.array(printed["T_flange_sensor"])
    turned = wrong_by(pose, [0, 0, 0], [0, 1, 0])
    shifted = wrong_by(pose, [0, 0, 2], [0, 0, 0])
    for wrong in (turned, shifted):
        entry = {"T_flange_sensor": wrong.tolist()}
        result = held_against_the_ball(printed | entry, tmp_path)
        assert result.exit_code == 1
    assert "most apart     translation along" in result.output


def test_a_scan_that_contradicts_itself_verifies_nothing(tmp_path):
    ball = scan_of("ball", seed=5)
    off = 3 * default_rng(0).normal(size=ball.p_base_flange.shape)
    wrong = replace(ball, p_base_flange=ball.p_base_flange + off, noise={})
    pc.write_scan(wrong, tmp_path / "ball")
    printed = calibration_of("edge", seed=5).to_json()
    result = held_against_the_ball(printed, tmp_path)
    assert result.exit_code == 2, result.output
    assert "in 6 of 6 directions" in result.output
    assert "no contradiction, but this scan contradicts itself" in result.output


def test_a_scan_that_leaves_a_direction_open_verifies_nothing(tmp_path):
    few = scan_of("edge", seed=5, scan=2, groups=6, positions=1, spread_deg=1.0)
    pc.write_scan(few, tmp_path / "ball")
    printed = printed_of(scan_of("edge", seed=5), tmp_path / "edge")
    result = held_against_the_ball(printed, tmp_path)
    assert result.exit_code == 2, result.output
    assert "no contradiction, but this scan leaves" in result.output
    wrong = wrong_by(np.array(printed["T_flange_sensor"]), [20, 20, 20], [8, 8, 8])
    contradicted = printed | {"T_flange_sensor": wrong.tolist()}
    assert held_against_the_ball(contradicted, tmp_path).exit_code == 1


NO_ANSWER = "not what `profilecal calibrate --json` prints"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, NO_ANSWER),
        ({"T_flange_sensor": None}, NO_ANSWER),
        ({"noise_mm": np.nan}, "noise_mm is nan; expected 1e-09 to"),
    ],
)
def test_verify_refuses_what_is_no_pose(change, said, tmp_path):
    found = calibration_of("ball", seed=5)
    pc.write_scan(found.scans[0], tmp_path / "ball")
    printed = change and found.to_json() | change
    result = held_against_the_ball(printed, tmp_path)
    assert result.exit_code == 2
    assert said in result.output
    assert "T.json" in result.output
    assert result.output.count("\n") == 1
