"""`profilecal plan`, as a user runs it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command import run
from scipy.stats import chi2

from profilecal.geometry.noise import Noise
from profilecal.joint.state import normalised_square, pose_error
from profilecal.plan.command import designed, task
from profilecal.scan.folder import write_scan
from profilecal.scan.toml import read_toml
from profilecal.simulate.spec import Spec, simulate_scan

PLANNED = Path(__file__).parents[2] / "data" / "examples" / "planned.toml"
SPEC = """
kind = "edge"
seed = 2
[guess]
mount = [60, -40, 110, 170, 10, 30]
target = [900, 50, 300]
[noise]
profile_mm = 0.05
position_mm = 0.05
orientation_deg = 0.02
[plan]
poses = 8
"""


def spec_in(folder, *changes):
    text = SPEC
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "spec.toml").write_text(text)
    return folder / "spec.toml"


def as_covariance(found):
    """Of `calibrate --json`, mm and rad."""
    unit = np.r_[np.ones(3), np.full(3, np.pi / 180)]
    return np.array(found["covariance"]) * unit * unit[:, None]


def test_plan_simulate_calibrate_gives_the_truth_within_its_region(tmp_path):
    plan, scan = tmp_path / "plan", tmp_path / "scan"
    planned = run("plan", PLANNED, plan)
    assert planned.exit_code == 0, planned.output
    assert {p.name for p in plan.iterdir()} == {
        "curve.csv", "plan.csv", "plan.html", "plan.png", "poses.csv", "scan.toml", "simulate.toml"
    }  # fmt: skip
    assert run("simulate", plan / "simulate.toml", scan).exit_code == 0
    result = run("calibrate", scan, "--json")
    found = json.loads(result.output)
    assert found["status"] == "ok"
    T, truth = np.array(found["T_flange_sensor"]), np.array(read_toml(scan / "truth.toml")["T_flange_sensor"])
    delta = pose_error(T[:3, :3], T[:3, 3], truth[:3, :3], truth[:3, 3])
    assert normalised_square(as_covariance(found), delta) < chi2.ppf(0.99, 6)
    assert np.linalg.norm(truth[:3, 3] - [60, -40, 110]) > 0.1  # the guess was wrong
    worst = np.sqrt(np.linalg.eigvalsh(np.array(found["covariance"])[:3, :3])[-1])
    said = float(re.search(r"worst +([\d.]+) mm", planned.output)[1])
    assert 0.5 < worst / said < 2  # the calibration finds its own noise
    assert len(found["poses_used"]) == len(pd.read_csv(plan / "poses.csv"))  # both sides of every corner were seen
    poses, driven = (pd.read_csv(folder / "poses.csv") for folder in (plan, scan))
    assert (poses.columns == driven.columns).all()
    assert np.allclose(poses, driven)


def test_a_plans_folder_is_a_scan_folder_once_profiles_are_in_it(tmp_path):
    plan, scan = tmp_path / "plan", tmp_path / "scan"
    assert run("plan", spec_in(tmp_path), plan).exit_code == 0
    assert run("simulate", plan / "simulate.toml", scan).exit_code == 0
    (plan / "points.csv").write_text((scan / "points.csv").read_text())
    assert run("calibrate", plan).exit_code == 0


@pytest.mark.parametrize("convention", ["FANUC angles", "rotation vector"])
def test_plans_are_in_the_robots_convention(tmp_path, convention):
    spec = spec_in(tmp_path, ("seed = 2", f'seed = 2\nconvention = "{convention}"'))
    assert run("plan", spec, tmp_path / "plan").exit_code == 0
    columns = list(pd.read_csv(tmp_path / "plan" / "poses.csv"))
    assert columns[4:] == {"FANUC angles": ["w", "p", "r"], "rotation vector": ["rx", "ry", "rz"]}[convention]


def test_eye_to_hand_is_planned_simulated_and_calibrated(tmp_path):
    spec = spec_in(
        tmp_path,
        ("mount = [60, -40, 110, 170, 10, 30]", "mount = [900, 0, 700, 180, 0, 0]"),
        ("target = [900, 50, 300]", "target = [20, 0, 150]"),
        ("seed = 2", 'seed = 2\nmount = "eye-to-hand"'),
        ("poses = 8", "poses = 40"),  # fewer hardly show how large the robot's errors are
    )
    assert run("plan", spec, tmp_path / "plan").exit_code == 0
    assert run("simulate", tmp_path / "plan" / "simulate.toml", tmp_path / "scan").exit_code == 0
    found = json.loads(run("calibrate", tmp_path / "scan", "--json").output)
    T = np.array(found["T_base_sensor"])
    truth = np.array(read_toml(tmp_path / "scan" / "truth.toml")["T_base_sensor"])
    delta = pose_error(T[:3, :3], T[:3, 3], truth[:3, :3], truth[:3, 3])
    assert normalised_square(as_covariance(found), delta) < chi2.ppf(0.999, 6)


def test_the_page_needs_nothing_else(tmp_path):
    assert run("plan", spec_in(tmp_path), tmp_path / "plan").exit_code == 0
    page = (tmp_path / "plan" / "plan.html").read_text()
    assert not re.search(r"https?:|src=|href=|import |@import|url\(", page)
    data = json.loads(re.search(r"const data = (\{.*\});", page)[1])
    assert len(data["T"]) == len(data["R"]) == len(data["rows"]["pose"]) == 8
    assert "<script>" in page
    assert page.rstrip().endswith("</html>")


def test_a_weak_scan_is_told_what_would_mend_it_and_given_the_poses(tmp_path):
    text = 'kind = "edge"\nseed = 3\nspread_deg = 2\ngroups = 5\n[noise]\nprofile_mm = 0.05\nposition_mm = 0.05\n'
    (tmp_path / "weak.toml").write_text(text)
    scan, more = tmp_path / "scan", tmp_path / "more"
    assert run("simulate", tmp_path / "weak.toml", scan).exit_code == 0
    for command in ("check", "calibrate"):
        output = run(command, scan).output
        said = re.search(r"(\d+) more poses would mend it, predicted: ([\d.]+) mm, ([\d.]+)°; (.+) writes them", output)
        assert said, output
        assert said[4] == f"profilecal plan {scan} NEW-FOLDER"
    assert run("plan", scan, more, "--poses", said[1]).exit_code == 0
    assert len(pd.read_csv(more / "poses.csv")) == int(said[1])


def test_a_plan_after_a_scan_counts_with_the_robot_errors_that_it_shows(tmp_path):
    predicted = []
    for position_mm in (0.02, 0.5):
        spec = Spec(kind="edge", seed=3, positions=3, noise=Noise(profile_mm=0.05, position_mm=position_mm))
        folder = tmp_path / f"{position_mm}"
        write_scan(replace(simulate_scan(spec), noise={}), folder)  # which does not state them
        (plan,) = designed(task(folder, poses=3))
        predicted.append(plan.predicted.mm)
    assert predicted[1] > 4 * predicted[0]


def test_an_open_scan_is_planned_after_with_a_mount_measured_by_hand(tmp_path):
    (tmp_path / "open.toml").write_text('kind = "edge"\nseed = 3\nspread_deg = 0\ngroups = 1\npositions = 20\n')
    scan = tmp_path / "scan"
    assert run("simulate", tmp_path / "open.toml", scan).exit_code == 0
    found = run("calibrate", scan)
    assert found.exit_code == 3
    assert f"profilecal plan SPEC.toml NEW-FOLDER --after {scan}" in found.output
    refused = run("plan", scan, tmp_path / "more")
    assert refused.exit_code == 2
    assert "the scan leaves the mount open" in refused.output


def test_what_exists_is_counted_and_predicted(tmp_path):
    spec = spec_in(tmp_path)
    assert run("plan", spec, tmp_path / "plan").exit_code == 0
    alone = run("plan", spec, "--of", tmp_path / "plan" / "poses.csv")
    assert "predicted for 8 poses" in alone.output
    assert run("simulate", tmp_path / "plan" / "simulate.toml", tmp_path / "scan").exit_code == 0
    after = run("plan", spec, tmp_path / "next", "--after", tmp_path / "scan", "--poses", 4)
    assert "predicted for 12 poses" in after.output
    assert len(pd.read_csv(tmp_path / "next" / "poses.csv")) == 4
    enough = re.search(r"until +(\d+) poses for 0.3 mm and 0.2°", run("plan", spec, "--until", 0.3, 0.2).output)
    assert 4 <= int(enough[1]) <= 8


PAIR = """
seed = 3
measured = "profiles"
[guess]
mount = [60, -40, 110, 170, 10, 30]
[[targets]]
kind = "plane"
target = [900, 50, 300]
[[targets]]
kind = "ball"
radius = 20
target = [850, -60, 320]
[noise]
profile_mm = 0.05
position_mm = 0.05
orientation_deg = 0.02
[plan]
poses = 14
"""


def test_two_targets_are_planned_simulated_and_calibrated_together(tmp_path):
    (tmp_path / "spec.toml").write_text(PAIR)
    plan, scan = tmp_path / "plan", tmp_path / "scan"
    planned = run("plan", tmp_path / "spec.toml", plan)
    assert planned.exit_code == 0, planned.output
    said = re.search(r"(\d+) over plane, (\d+) over ball", planned.output)
    poses = [len(pd.read_csv(plan / name / "poses.csv")) for name in ("plane", "ball")]
    assert poses == [int(said[1]), int(said[2])]
    assert sum(poses) == 14
    assert run("simulate", plan / "simulate.toml", scan).exit_code == 0
    plane, ball = (read_toml(scan / name / "truth.toml")["T_flange_sensor"] for name in ("plane", "ball"))
    assert plane == ball  # one mount
    found = json.loads(run("calibrate", scan / "plane", scan / "ball", "--json").output)
    T, truth = np.array(found["T_flange_sensor"]), np.array(plane)
    delta = pose_error(T[:3, :3], T[:3, 3], truth[:3, :3], truth[:3, 3])
    assert normalised_square(as_covariance(found), delta) < chi2.ppf(0.99, 6)

    worst = re.search(r"worst .+", planned.output)[0]
    ball = tmp_path / "ball.toml"
    ball.write_text(PAIR.replace('[[targets]]\nkind = "plane"\ntarget = [900, 50, 300]\n', ""))
    for predicted in (
        run("plan", tmp_path / "spec.toml", "--of", plan / "plane", "--of", plan / "ball"),
        run("plan", ball, "--of", plan / "ball", "--after", scan / "plane"),
    ):
        assert "predicted for 14 poses" in predicted.output, predicted.output
        values = [float(re.search(r"worst +([\d.]+)", text)[1]) for text in (worst, predicted.output)]
        assert values[1] == pytest.approx(values[0], rel=0.15)
    one = run("plan", tmp_path / "spec.toml", "--of", plan / "plane")
    assert one.exit_code == 2
    assert "there are 2 targets; expected --of as often" in one.output


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('kind = "plane"\n', 'kind = "plane"\ncolour = 1\n', "unknown entry 'colour' in [[targets]]"),
        ('kind = "plane"\n', 'kind = "plane"\nradius = 1\n', "unknown entry 'radius' in [[targets]]"),
        ("target = [900, 50, 300]\n", "", "target is missing in [guess]"),
    ],
)
def test_targets_that_are_not_described_are_refused_in_words(tmp_path, old, new, sentence):
    (tmp_path / "spec.toml").write_text(PAIR.replace(old, new))
    refused = run("plan", tmp_path / "spec.toml", tmp_path / "plan")
    assert refused.exit_code == 2
    assert sentence in refused.output


def test_a_plan_of_few_poses_says_that_its_errors_will_hardly_show(tmp_path):
    few = "few poses: only 6 measurements more than unknowns"
    assert few in run("plan", spec_in(tmp_path)).output  # 8 points x, z of an edge, 10 unknowns
    assert "few poses" not in run("plan", spec_in(tmp_path, ("poses = 8", "poses = 16"))).output


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[guess]", "[plans]", "unknown entry 'plans'"),
        ("target = [900, 50, 300]", "", "target is missing in [guess]"),
        ("target = [900, 50, 300]", "target = [900, 50]", "expected 3 numbers"),
        ("target = [900, 50, 300]", "target = [900, 50, 300]\nup = [0, 2, 0]", "axis and up in [guess] are parallel"),
        ("target = [900, 50, 300]", "target = [900, 50, 300]\nmount_mm = -1", "mount_mm is -1 in [guess]"),
        ("poses = 8", "pose = 8", "unknown entry 'pose' in [plan]; there are poses"),
        ("poses = 8", "low = [0, 0, 9]\nhigh = [9, 9, 0]", "the box is empty along z"),
        ("poses = 8", "until = [0.1, 0]", "expected mm and degrees, both positive"),
        ("poses = 8", 'criterion = "best"', "criterion is 'best'; expected one of worst, A, D"),
        ("poses = 8", "avoid = [[1, 2, 3]]", "each of four numbers: x, y, z, radius"),
        ("poses = 8", "tilt_deg = 90", "tilt_deg is 0 to 80"),
        ("poses = 8", "low = [0, 0, 0]\nhigh = [9, 9, 9]", "are outside the box"),
        ("poses = 8", "poses = 3000", "poses is 3000"),
        ("poses = 8", "tilt_deg = 0\nspin_deg = 0", "differs by 1° or more from those of the 1 chosen"),
        ("profile_mm = 0.05", "profile_mm = 0", "a plan needs the scanner's noise"),
    ],
)
def test_wishes_that_cannot_be_granted_are_refused_in_words(tmp_path, old, new, sentence):
    result = run("plan", spec_in(tmp_path, (old, new)), tmp_path / "plan")
    assert result.exit_code == 2
    assert sentence in result.output
    assert not (tmp_path / "plan").exists()


def test_a_plan_is_not_written_over_anything(tmp_path):
    (tmp_path / "plan").mkdir()
    (tmp_path / "plan" / "mine").touch()
    result = run("plan", spec_in(tmp_path), tmp_path / "plan")
    assert result.exit_code == 2
    assert "not empty; name a new folder" in result.output
