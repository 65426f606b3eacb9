"""Plans of sweeps, as a user drives them."""

import re

import numpy as np
import pytest
from command import run
from numpy.random import default_rng
from scipy.stats import chi2

import profilecal as pc
from profilecal.geometry.noise import normalised_square
from profilecal.geometry.poses import pose_error
from profilecal.simulation.scene import Setup
from profilecal.simulation.spec import read_spec, record_sweeps
from profilecal_tool.plan.simulation import straight_sweeps
from profilecal_tool.plan.specification import planned_poses

SPEC = """
kind = "{kind}"
seed = 2
mount = "{mount}"
[guess]
mount = [{sensor}]
target = [{target}]
[noise]
profile_mm = 0.05
[motion]
delay_ms = -80.0
sweeps = 16
profiles = 30
"""
PLACES = {
    "eye-in-hand": ("60, -40, 110, 170, 10, 30", "900, 50, 300"),
    "eye-to-hand": ("900, 0, 700, 180, 0, 0", "20, 0, 150"),
}


@pytest.mark.parametrize(
    ("kind", "mount"), [("edge", "eye-to-hand"), ("ball", "eye-in-hand")]
)
def test_planned_sweeps_give_what_is_predicted(tmp_path, kind, mount):
    sensor, target = PLACES[mount]
    text = SPEC.format(kind=kind, mount=mount, sensor=sensor, target=target)
    (tmp_path / "spec.toml").write_text(text)
    said = run("plan", tmp_path / "spec.toml", tmp_path / "plan").stdout
    count = int(re.search(r"sweeps +(\d+), driven there and back", said)[1])
    assert 8 <= count <= 16  # lines that leave the limits are left out
    mm, deg = re.search(r"worst +([\d.]+) mm and ([\d.]+)°", said).groups()
    run("simulate", tmp_path / "plan" / "simulate.toml", tmp_path / "scan")
    scan = pc.read_scan(tmp_path / "scan")
    found = pc.calibrate(scan)
    assert found.status == "ok"
    solution = found.solution
    assert abs(-80 - 1e3 * solution.delay_s) < 4e3 * solution.delay_sd_s < 4
    for part, predicted in ((slice(3), mm), (slice(3, 6), np.radians(float(deg)))):
        stated = np.sqrt(np.linalg.norm(solution.covariance[part, part], 2))
        assert 2 / 3 < stated / float(predicted) < 3 / 2


def test_sweeps_are_as_many_as_it_takes_and_limits_cost_some(tmp_path):
    sensor, target = PLACES["eye-in-hand"]
    text = SPEC.format(kind="edge", mount="eye-in-hand", sensor=sensor, target=target)
    spec = tmp_path / "spec.toml"
    spec.write_text(text)
    counts = []
    for wish in ((0.3, 0.2), (0.08, 0.06)):
        said = run("plan", spec, "--until", *wish).stdout
        mm, deg = re.search(r"worst +([\d.]+) mm and ([\d.]+)°", said).groups()
        assert float(mm) <= wish[0]
        assert float(deg) <= wish[1]
        counts.append(int(re.search(r"sweeps +(\d+),", said)[1]))
    assert counts[0] < counts[1]
    spec.write_text(text + "[plan]\nlow = [880, -60, 380]\n")
    said = run("plan", spec, "--poses", "6").stdout
    left_out = sum(map(int, re.findall(r"left out +(\d+) line", said)))
    assert 2 * (6 - left_out) == int(re.search(r"sweeps +(\d+),", said)[1]) < 12
    spec.write_text(text + "[plan]\nlow = [880, -60, 419]\nhigh = [2000, 60, 420]\n")
    said = run("plan", spec, "--poses", "3").output
    assert "no straight sweep fits within the limits" in said
    assert "are outside the box" in said


def test_the_way_back_of_a_scan_tells_its_delay(tmp_path):
    entries = {"kind": "edge", "seed": 1, "noise": {"profile_mm": 0.05}}
    entries["motion"] = {"pattern": "one way", "sweeps": 16, "profiles": 30}
    scan, truth = pc.simulate(**entries)
    assert pc.calibrate(scan).status == "unobservable"
    pc.write_scan(scan, tmp_path / "scan")
    said = run("plan", tmp_path / "scan", tmp_path / "back").stdout
    assert "sweeps         16, those of the scan backwards" in said
    R, T = truth.pose[:3, :3], truth.pose[:3, 3]
    setup = Setup(truth.target, np.eye(3), R, T)
    _, *ends = planned_poses(tmp_path / "back" / "sweeps.csv", to_hand=False)
    sweeps = straight_sweeps(setup, *ends, 100.0)
    back = record_sweeps(setup, read_spec(entries), default_rng(3), sweeps)
    found = pc.calibrate([scan, back])
    assert found.status == "ok"
    error = pose_error(found.pose[:3, :3], found.pose[:3, 3], R, T)
    assert normalised_square(found.solution.covariance, error) < chi2.isf(1e-3, 6)
