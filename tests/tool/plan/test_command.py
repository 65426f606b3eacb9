"""`profilecal plan`, as a user runs it."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from command import edited, run
from scipy.stats import chi2
from simulated import printed_square

from profilecal.geometry.noise import Noise
from profilecal.scan.folder import write_scan
from profilecal.scan.toml import read_toml
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal_tool.plan.task import read_task

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
MANY = ("poses = 8", "poses = 40")  # fewer hardly show how large the robot's errors are
TO_HAND = (
    ("mount = [60, -40, 110, 170, 10, 30]", "mount = [900, 0, 700, 180, 0, 0]"),
    ("target = [900, 50, 300]", "target = [20, 0, 150]"),
    ("seed = 2", 'seed = 2\nmount = "eye-to-hand"'),
)


def spec_in(folder, *changes):
    text = SPEC
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "spec.toml").write_text(text)
    return folder / "spec.toml"


def said(output):
    """The predicted worst standard deviations, mm and degrees."""
    return np.array(
        re.search(r"worst +([\d.]+) mm and ([\d.]+)°", output).groups(), dtype=float
    )


@pytest.mark.parametrize(
    ("changes", "convention", "columns"),
    [
        (
            [MANY, ("seed = 2", 'seed = 2\nmeasured = "profiles"')],
            "FANUC angles",
            ["w", "p", "r"],
        ),
        ([MANY, *TO_HAND], "rotation vector", ["rx", "ry", "rz"]),
    ],
)
def test_plan_simulate_calibrate_states_what_was_predicted_and_holds_the_truth(
    tmp_path, changes, convention, columns
):
    plan, scan = tmp_path / "plan", tmp_path / "scan"
    planned = run(
        "plan",
        spec_in(
            tmp_path, *changes, ("seed = 2", f'seed = 2\nconvention = "{convention}"')
        ),
        plan,
    )
    assert planned.exit_code == 0, planned.output
    assert {p.name for p in plan.iterdir()} == {
        "plan.png",
        "poses.csv",
        "scan.toml",
        "simulate.toml",
    }
    assert run("simulate", plan / "simulate.toml", scan).exit_code == 0
    found = json.loads(run("calibrate", scan, "--json").output)
    assert found["status"] == "ok"
    assert len(found["poses_used"]) == 40
    assert printed_square(found, read_toml(scan / "truth.toml")) < chi2.ppf(0.99, 6)
    C = np.array(found["covariance"])
    stated = np.sqrt([np.linalg.eigvalsh(part)[-1] for part in (C[:3, :3], C[3:, 3:])])
    assert np.abs(np.log(stated / said(planned.output))).max() < np.log(
        1.4
    )  # the calibration finds its own noise
    poses, driven = (pd.read_csv(folder / "poses.csv") for folder in (plan, scan))
    assert list(poses)[4:] == list(driven)[4:] == columns
    assert np.allclose(poses, driven)
    for table in scan.glob(
        "*.csv"
    ):  # a plan's folder is a scan folder once measurements are in it
        shutil.copy(table, plan)
    assert run("calibrate", plan).exit_code == 0


def test_a_weak_scan_is_told_which_poses_would_help_and_given_them(tmp_path):
    scan, more, noise = (
        tmp_path / "scan",
        tmp_path / "more",
        Noise(profile_mm=0.05, position_mm=0.05),
    )
    write_scan(
        simulate_scan(Spec(kind="edge", seed=3, spread_deg=2, groups=5, noise=noise)),
        scan,
    )
    advice = re.search(
        r"(\d+) poses more would give ([\d.]+) mm and ([\d.]+)°: (.+)",
        run("calibrate", scan).output,
    )
    assert advice[4] == f"profilecal plan {scan} NEW-FOLDER --poses {advice[1]}"
    assert run("plan", scan, more, "--poses", advice[1]).exit_code == 0
    assert len(pd.read_csv(more / "poses.csv")) == int(advice[1])
    assert not (more / "simulate.toml").exists()


def test_a_plan_after_a_scan_counts_with_the_robot_errors_that_it_shows(tmp_path):
    predicted = []
    for position_mm in (0.02, 0.5):
        spec = Spec(
            kind="edge",
            seed=3,
            positions=3,
            noise=Noise(profile_mm=0.05, position_mm=position_mm),
        )
        folder = tmp_path / f"{position_mm}"
        write_scan(
            replace(simulate_scan(spec), noise={}), folder
        )  # which does not state them
        predicted.append(read_task(folder, poses=3).plan().predicted.mm)
    assert predicted[1] > 4 * predicted[0]


def test_an_open_scan_is_planned_from_a_specification(tmp_path):
    scan = tmp_path / "scan"
    write_scan(
        simulate_scan(Spec(kind="edge", seed=3, spread_deg=0, groups=1, positions=20)),
        scan,
    )
    refused = run("plan", scan).output
    assert (
        "the scan leaves the mount open, or contradicts itself: profilecal calibrate says how; else plan"
        in refused
    )
    assert "from a SPEC.toml whose [guess] states it roughly" in refused


def test_poses_of_any_file_or_scan_are_predicted(tmp_path):
    spec, plan, scan = spec_in(tmp_path), tmp_path / "plan", tmp_path / "scan"
    planned = run("plan", spec, plan)
    assert run("simulate", plan / "simulate.toml", scan).exit_code == 0
    shutil.copy(plan / "poses.csv", tmp_path / "mine.csv")
    for place in (tmp_path / "mine.csv", plan, scan):
        result = run("plan", spec, "--of", place)
        assert "predicted for 8 poses" in result.output
        assert said(result.output) == pytest.approx(said(planned.output), rel=0.02)
    assert "predicted for 16 poses" in run("plan", scan, "--of", plan).output
    edited("mine.csv", "pose,x,y,z", "pose,y,x,z")(tmp_path)
    assert (
        "mine.csv: no pose has the target in view"
        in run("plan", spec, "--of", tmp_path / "mine.csv").output
    )
    assert "already in use; name a new folder" in run("plan", spec, plan).output
    assert (
        "nowhere: no such file"
        in run("plan", spec, "--of", tmp_path / "nowhere").output
    )


def test_an_accuracy_takes_as_many_poses_as_it_takes(tmp_path):
    spec = spec_in(tmp_path)
    few, many = (
        run("plan", spec, "--until", *until).output
        for until in ((0.3, 0.2), (0.15, 0.1))
    )
    assert (said(few) <= [0.3, 0.2]).all()
    assert (said(many) <= [0.15, 0.1]).all()
    assert "note           few poses" in few
    missed = run(
        "plan", spec_in(tmp_path, ("poses = 8", "most = 9\nuntil = [0.01, 0.01]"))
    )
    assert "9 poses are not enough for 0.01 mm and 0.01°" in missed.output


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "[guess]\nmount = [60, -40, 110, 170, 10, 30]\ntarget = [900, 50, 300]\n",
            "",
            "a plan needs [guess]",
        ),
        ("poses = 8", "pose = 8", "unknown entry 'pose' in [plan]; there are poses"),
        ("poses = 8", "low = [0, 0, 9]\nhigh = [9, 9, 0]", "the box is empty along z"),
        ("poses = 8", "until = [0.1, 0]", "expected mm and degrees, both positive"),
        ("poses = 8", "avoid = [[1, 2, 3]]", "each of four numbers: x, y, z, radius"),
        ("poses = 8", "tilt_deg = 90", "tilt_deg is 90 in [plan]; expected 0 to 80"),
        ("poses = 8", "low = [0, 0, 0]\nhigh = [9, 9, 9]", "are outside the box"),
        (
            "poses = 8",
            "poses = 3000",
            "poses is 3000 in [plan]; expected a whole number, 0 to 1000",
        ),
        (
            "poses = 8",
            "tilt_deg = 0\nspin_deg = 0",
            "differs by 1° or more from those of the 1 chosen",
        ),
        ("profile_mm = 0.05", "profile_mm = 0", "a plan needs the scanner's noise"),
        (
            "[plan]\nposes = 8",
            "[[plan]]\nposes = 8",
            "plan is [{'poses': 8}]; expected a table",
        ),
    ],
)
def test_wishes_that_cannot_be_granted_are_refused_in_words(
    tmp_path, old, new, sentence
):
    result = run("plan", spec_in(tmp_path, (old, new)), tmp_path / "plan")
    assert result.exit_code == 2
    assert sentence in result.output
    assert not (tmp_path / "plan").exists()
