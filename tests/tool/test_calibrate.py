"""`profilecal calibrate`: the JSON is the contract; options, and what it refuses."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import run
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from simulated import scan_of

import profilecal as pc

ROOT = Path(__file__).parents[2]
README = (ROOT / "data" / "README.md").read_text(encoding="utf-8")
FIRST_COLUMN = re.findall(
    r"^- (`.*?`): ", README.partition("## What comes back")[2], re.M
)
KEYS = re.findall(r"`(\w+)`", " ".join(FIRST_COLUMN))  # in this order


def calibrated(scan, folder, *options):
    """What the command makes of a scan, written to a folder."""
    pc.write_scan(scan, folder)
    return run("calibrate", folder, *options)


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_the_json_is_the_contract(mount, tmp_path):
    scan, truth = pc.simulate(seed=5, mount=mount)
    result = calibrated(scan, tmp_path / "scan", "--json")
    assert result.exit_code == 0
    found = json.loads(result.output)
    pose = "T_flange_sensor" if mount == "eye-in-hand" else "T_base_sensor"
    assert list(found) == [pose if key == "T_flange_sensor" else key for key in KEYS]
    assert [*found["made"]] == ["version", "time", "scans"]
    assert found["status"] == "ok"
    assert_allclose(found[pose], truth.pose, atol=0.5)
    sds = found["translation_sd_mm"] + found["rotation_sd_deg"]
    assert_allclose(np.sqrt(np.diag(found["covariance"])), sds)
    assert (found["noise_mm"], found["noise_source"]) == (0.05, "given")
    assert (found["poses_used"], found["poses_rejected"]) == (list(scan.labels), [])
    assert found["target"]["kind"] == "edge"
    assert len(found["observability"]["singular_values"]) == 6


@pytest.mark.parametrize("few", [{"spread_deg": 0.0}, {"groups": 4, "positions": 1}])
def test_poses_that_determine_nothing_are_unobservable_with_status_3_and_the_cure(
    few, tmp_path
):
    scan, _ = pc.simulate(seed=8, **few)
    result = calibrated(scan, tmp_path / "scan", "--json")
    assert result.exit_code == 3
    found = json.loads(result.output)
    assert list(found) == KEYS
    assert found["status"] == "unobservable"
    assert found["T_flange_sensor"] is None
    assert "add poses" in " ".join(found["messages"])


def guess_of(truth, off_mm=0):
    """The options that state a guess."""
    angles = Rotation.from_matrix(truth.pose[:3, :3]).as_euler("xyz", degrees=True)
    return ["--guess", *(truth.pose[:3, 3] + off_mm), *angles, "--guess-sd"]


def test_the_line_to_paste_has_the_guess_without_which_nothing_is_known(tmp_path):
    scan, truth = pc.simulate(seed=2, spread_deg=0.0)
    folder = tmp_path / "my scan"
    result = calibrated(scan, folder, *guess_of(truth), 0.5, 0.2)
    line = result.output.partition("next: profilecal ")[2].partition(" > T.json")[0]
    assert json.loads(run(*shlex.split(line)).output)["status"] == "ok"
    result = run("calibrate", folder, *guess_of(truth), 3, 2)
    assert result.output.startswith("status         weak")
    assert "profilecal plan" not in result.output  # which knows of no guess


def test_a_guess_is_compared_and_a_controller_taken(tmp_path):
    scan, truth = pc.simulate(seed=2)
    *guess, _ = guess_of(truth, 10)
    result = calibrated(scan, tmp_path / "scan", *guess, "--to", "kuka")
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert lines[0] == "status         ok"
    assert lines[3].startswith("{X ")
    result = run("calibrate", tmp_path / "scan", *guess, "--guess-sd", 1, 1)
    assert result.output.startswith("status         weak")
    assert "which is said to be good to 1 mm and 1°" in result.output


def test_a_self_test_says_whether_to_believe(tmp_path):
    scan = scan_of("ball", seed=5)
    result = calibrated(scan, tmp_path / "scan", "--self-test", 10)
    assert "note           of 10 scans simulated from this answer" in result.output


def test_an_interrupted_self_test_leaves_the_answer_above(tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pc, "self_test", interrupted)
    scan = scan_of("ball", seed=5)
    result = calibrated(scan, tmp_path / "scan", "--self-test", 10)
    assert result.exit_code == 130
    answer, _, said = result.output.partition("Interrupted. ")
    assert answer.startswith("status         ok")
    assert said == "Above is what was found until then.\n"


def test_a_pose_that_contradicts_the_data_is_not_given_to_paste(tmp_path):
    scan = scan_of("ball", seed=5, groups=6, positions=4)
    to_hand = replace(scan, mount="eye-to-hand")
    result = calibrated(to_hand, tmp_path / "scan", "--to", "kuka")
    assert result.exit_code == 3
    assert "no pose to paste: see the notes" in result.output
    assert not re.search("{X|robot errors", result.output)


UNMET = [
    ("--json --to kuka", "--json prints one JSON object and nothing else; ask for"),
    ("--guess 0 0 0 900 0 0", "--guess W P R of the guess: angle of 900; expected"),
]


@pytest.mark.parametrize(("options", "sentence"), UNMET)
def test_options_that_cannot_be_met_are_refused(tmp_path, options, sentence):
    result = calibrated(scan_of("ball"), tmp_path / "scan", *options.split())
    assert result.exit_code == 2
    assert result.output.startswith(f"profilecal: {sentence}")


def other_side():
    scan = scan_of("ball", seed=1, measured="profiles")
    return replace(scan, side=-scan.side)


def swapped():
    scan = pc.read_scan(ROOT / "data/examples/disk")
    return replace(scan, values=[rows[:, ::-1] for rows in scan.values])


@pytest.mark.parametrize(
    ("scan", "sentence"),
    [
        (other_side, "the ball's centre lies on the other side"),
        (swapped, "are their columns swapped?"),
    ],
)
def test_what_more_poses_do_not_mend_is_not_ok(tmp_path, scan, sentence):
    result = calibrated(scan(), tmp_path / "scan", "--to", "kuka")
    assert "status         weak" in result.output
    assert sentence in result.output
    assert "not to be relied on" in result.output
    assert "poses more" not in result.output


def test_the_readme_shows_what_the_command_prints(monkeypatch):
    monkeypatch.chdir(ROOT)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"^```\n(status .*?)^```", text, re.DOTALL | re.MULTILINE)
    assert "profilecal calibrate data/examples/disk --to kuka" in text
    printed = run("calibrate", "data/examples/disk", "--to", "kuka").stdout
    # processors differ in later digits
    short = [re.sub(r"(\.\d{4})\d+", r"\1", said) for said in (printed, shown)]
    assert short[0] == short[1]
