"""From a scan folder to the answer, through the command line where the contract is the
command line's.
"""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import run
from scipy.stats import binom, chi2
from simulated import EXACT_SCANNER, calibration_of, scan_of, squared_error, truth_of

from profilecal.calibration.calibration import calibrate
from profilecal.calibration.observe import observe
from profilecal.geometry.noise import Noise
from profilecal.scan.folder import write_scan
from profilecal.scan.scan import ScanError
from profilecal.simulation.spec import WIDE, Spec, simulate_scan

README = (Path(__file__).parents[3] / "data" / "README.md").read_text(encoding="utf-8")
FIRST_COLUMN = re.findall(
    r"^\| (`.*?`) \|", README.partition("## What comes back")[2], re.M
)
KEYS = re.findall(r"`(\w+)`", " ".join(FIRST_COLUMN))  # as promised, in this order


@pytest.mark.parametrize("kind", ["edge", "disk", "point", "ball"])
@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_the_truth_lies_in_the_stated_region(kind, mount):
    """The sum of n squared errors is χ² of 6 n degrees of freedom at most: regions
    allow for errors not made here.
    """
    found = [
        calibration_of(Spec(kind=kind, mount=mount, seed=seed, groups=10, positions=6))
        for seed in range(3)
    ]
    assert not any(f.messages for f in found)
    assert {f.solution.noise_source for f in found} == {
        "estimated" if kind == "ball" else "given"
    }
    assert sum(squared_error(f.scans[0], f) for f in found) < chi2.isf(1e-4, 6 * 3)


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_the_json_is_the_contract(mount, tmp_path):
    scan = simulate_scan(Spec(seed=5, mount=mount))
    write_scan(scan, tmp_path / "scan")
    result = run("calibrate", tmp_path / "scan", "--json")
    assert result.exit_code == 0
    found = json.loads(result.output)
    pose = "T_flange_sensor" if mount == "eye-in-hand" else "T_base_sensor"
    assert list(found) == [pose if key == "T_flange_sensor" else key for key in KEYS]
    assert found["status"] == "ok"
    np.testing.assert_allclose(found[pose], truth_of(scan), atol=0.5)
    covariance = np.array(found["covariance"])
    assert covariance.shape == (6, 6)
    np.testing.assert_allclose(
        np.sqrt(np.diag(covariance)),
        found["translation_sd_mm"] + found["rotation_sd_deg"],
    )
    assert (found["noise_mm"], found["noise_source"]) == (0.05, "given")
    assert (found["poses_used"], found["poses_rejected"]) == (list(scan.labels), [])
    assert found["target"]["kind"] == "edge"
    assert len(found["observability"]["singular_values"]) == 6


@pytest.mark.parametrize("few", [{"spread_deg": 0.0}, {"groups": 4, "positions": 1}])
def test_poses_that_determine_nothing_are_unobservable_with_status_3_and_the_cure(
    few, tmp_path
):
    write_scan(simulate_scan(Spec(seed=8, **few)), tmp_path / "scan")
    result = run("calibrate", tmp_path / "scan", "--json")
    assert result.exit_code == 3
    found = json.loads(result.output)
    assert list(found) == KEYS
    assert found["status"] == "unobservable"
    assert found["T_flange_sensor"] is None
    assert "add poses" in " ".join(found["messages"])
    if few == {"spread_deg": 0.0}:
        assert "add poses tilted" in run("check", tmp_path / "scan").output


def test_poses_without_a_measurement_are_left_out_and_named_by_scan():
    edge = simulate_scan(Spec(seed=9, title="edge"))
    edge = replace(
        edge, values=tuple(v[:0] if i == 4 else v for i, v in enumerate(edge.values))
    )
    disk = simulate_scan(Spec(kind="disk", measured="profiles", seed=9, title="disk"))
    disk = replace(disk, values=(np.full((9, 2), np.nan), *disk.values[1:]))
    found = calibrate([edge, disk])
    assert found.messages[0] == "edge: no point from pose g1p5"
    assert found.messages[1].startswith("disk: 1 left out, nothing in this profile")
    assert "edge: g1p5" not in found.poses_used


def test_several_targets_have_one_answer():
    edge, disk = (
        simulate_scan(Spec(kind=kind, seed=6, title=kind)) for kind in ("edge", "disk")
    )
    together = calibrate([edge, disk])
    assert squared_error(edge, together) < chi2.ppf(0.9999, 6)
    assert together.poses_used[0] == "edge: g1p1"
    assert [target["kind"] for target in together.to_json()["target"]] == [
        "edge",
        "disk",
    ]


def test_features_of_different_precision_are_weighed():
    edge, ball = (
        simulate_scan(
            Spec(
                kind=kind,
                seed=6,
                title=kind,
                measured="profiles",
                groups=8,
                positions=4,
            )
        )
        for kind in ("edge", "ball")
    )
    together = calibrate([edge, ball])
    corners, arcs = (observe(scan).covariance for scan in (edge, ball))
    unit = np.median(np.sqrt(np.trace(corners, axis1=1, axis2=2) / 2))
    for entry, covariance in zip(together.observed, (corners, arcs), strict=True):
        np.testing.assert_allclose(entry.covariance[0], covariance / unit**2)
    assert squared_error(edge, together) < chi2.ppf(0.9999, 6)


def test_scans_that_do_not_belong_together_are_refused():
    scan = simulate_scan(Spec(seed=1))
    with pytest.raises(ScanError, match="expected one mount"):
        calibrate([scan, simulate_scan(Spec(seed=1, mount="eye-to-hand"))])
    with pytest.raises(
        ScanError, match=r"noise profile_mm is 0\.05 in one scan and 0\.1 in another"
    ):
        calibrate([scan, replace(scan, noise={"profile_mm": 0.1})])
    with pytest.raises(
        ScanError, match="the target was found from 0 poses; expected 3 or more"
    ):
        calibrate([replace(scan, values=tuple(v[:0] for v in scan.values))])


def test_a_guess_and_a_controller_are_taken(tmp_path):
    scan = simulate_scan(Spec(seed=2))
    write_scan(scan, tmp_path / "scan")
    result = run(
        "calibrate", tmp_path / "scan", "--guess", 0, 0, 0, 10, 20, 30, "--to", "kuka"
    )
    assert result.exit_code == 0
    assert result.output.splitlines()[0] == "status         ok"
    assert result.output.splitlines()[3].startswith("{X ")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            ["--to", "acme"],
            "controller is 'acme'; "
            "expected one of abb, kuka, ur, fanuc, staubli, ros, matrix",
        ),
        (
            ["--json", "--to", "kuka"],
            "--json prints one JSON object and nothing else; ask for --to without it",
        ),
        (
            ["--guess", *["nan"] * 6],
            "--guess is nan nan nan nan nan nan; expected six numbers, mm and degrees",
        ),
    ],
)
def test_options_that_cannot_be_met_are_refused(tmp_path, options, sentence):
    write_scan(simulate_scan(Spec(kind="ball")), tmp_path / "scan")
    result = run("calibrate", tmp_path / "scan", *options)
    assert result.exit_code == 2
    assert result.output.startswith(f"profilecal: {sentence}")


def with_first_pose_again(scan):
    R, T, values = (
        [*part, part[0]]
        for part in (scan.R_base_flange, scan.p_base_flange, scan.values)
    )
    labels = (*scan.labels, "again")
    return replace(
        scan,
        labels=labels,
        R_base_flange=np.array(R),
        p_base_flange=np.array(T),
        values=tuple(values),
        group=np.append(scan.group, scan.group[0]),
        side=np.append(scan.side, scan.side[0]),
    )


def test_a_measurement_given_twice_is_refused(tmp_path):
    scan = replace(scan_of(Spec(kind="ball")), title="first")
    write_scan(scan, tmp_path / "scan")
    twice = run("calibrate", tmp_path / "scan", tmp_path / "scan").output
    same = "pose g1p1 of scan 2 (first) holds the same measurement as pose g1p1 of"
    assert f"{same} scan 1 (first)" in twice
    copy = replace(
        scan,
        title="a copy",
        labels=tuple(reversed(scan.labels)),
        convention="FANUC angles",
    )
    # as another convention's digits have it
    copy = replace(copy, p_base_flange=scan.p_base_flange + 1e-9)
    with pytest.raises(
        ScanError,
        match=r"of scan 2 \(a copy\) holds the same measurement as pose g1p1 of scan 1",
    ):
        calibrate([scan, copy])
    with pytest.raises(
        ScanError,
        match=r"pose again of scan 1 \(first\) .* as pose g1p1 of scan 1 \(first\)",
    ):
        calibrate([with_first_pose_again(scan)])


def test_a_ball_on_the_other_side_is_not_ok(tmp_path):
    scan = simulate_scan(
        Spec(kind="ball", measured="profiles", convention="FANUC angles", seed=1)
    )
    write_scan(replace(scan, side=-scan.side), tmp_path / "scan")
    result = run("calibrate", tmp_path / "scan", "--to", "kuka")
    assert "status         weak" in result.output
    assert "the ball's centre lies on the other side" in result.output
    assert "not to be relied on" in result.output


def test_robot_errors_are_part_of_the_stated_uncertainty():
    noise = Noise(
        profile_mm=0.05, position_mm=0.05, orientation_deg=0.01, group_position_mm=0.2
    )
    scans = [
        simulate_scan(Spec(seed=seed, noise=noise, groups=12, positions=4))
        for seed in range(12)
    ]
    inside = sum(
        squared_error(scan, calibrate([scan])) < chi2.ppf(0.95, 6) for scan in scans
    )
    assert binom.ppf(1e-4, 12, 0.95) <= inside


def test_the_status_is_the_same_for_poses_of_the_flange_and_of_a_tool():
    """In a scan whose status hangs on where the robot's errors act: so is the seed."""
    noise = Noise(profile_mm=0.03, position_mm=0.1, orientation_deg=0.05)
    scan = replace(
        simulate_scan(
            Spec(kind="plane", seed=1031, groups=12, positions=1, noise=noise)
        ),
        noise={},
    )
    at_sensor = scan.p_base_flange + scan.R_base_flange @ truth_of(scan)[:3, 3]
    found = [calibrate([one]) for one in (scan, replace(scan, p_base_flange=at_sensor))]
    assert [one.status for one in found] == ["weak", "weak"]
    assert [
        any("the origin of the poses' frame" in m for m in one.messages)
        for one in found
    ] == [True, False]
    assert found[0].solution.observability.status == "ok"


def test_few_poses_are_kept_where_robots_err_and_one_that_is_wrong_is_not():
    """A robust fit to 14 poses comes near to most of them; what it leaves out, a
    robot's usual errors explain.
    """
    noise, stated = (
        Noise(profile_mm=0.05, position_mm=0.05, orientation_deg=0.02),
        {"profile_mm": 0.05},
    )
    squares, rejected = 0.0, 0
    for seed in range(8):
        scan = replace(
            simulate_scan(Spec(seed=seed, noise=noise, groups=14, positions=1)),
            noise=stated,
        )
        found = calibrate([scan])
        squares, rejected = (
            squares + squared_error(scan, found),
            rejected + len(found.poses_rejected),
        )
        wrong = replace(
            scan, values=tuple(v + 3.0 * (k == 5) for k, v in enumerate(scan.values))
        )
        assert calibrate([wrong]).poses_rejected == [scan.labels[5]]
    assert rejected <= 1
    assert squares < chi2.isf(1e-4, 6 * 8)


def test_too_small_a_statement_is_no_excuse_for_a_bad_pose():
    """What is stated of a robot may be far too small; a pose that is 1 mm off is none
    the less more likely wrong.
    """
    told, noise = 0, Noise(profile_mm=0.05, position_mm=0.02, orientation_deg=0.005)
    for seed in range(8):
        scan = simulate_scan(
            Spec(kind="plane", seed=seed, groups=14, positions=1, noise=noise)
        )
        off = np.random.default_rng(seed).normal(size=3)
        T = scan.p_base_flange + np.outer(np.arange(14) == 5, off / np.linalg.norm(off))
        told += (
            scan.labels[5] in calibrate([replace(scan, p_base_flange=T)]).poses_rejected
        )
    assert told > 4


def test_many_poses_out_of_line_are_the_robots_doing():
    """Three of ten orientations differ from the others by far more than is stated."""
    noise = Noise(profile_mm=0.05, group_position_mm=0.05, group_orientation_deg=0.01)
    stated = {
        "profile_mm": 0.05,
        "group_position_mm": 0.01,
        "group_orientation_deg": 0.002,
    }
    spec = Spec(
        kind="disk", seed=27, measured="profiles", groups=10, positions=3, noise=noise
    )
    scan = simulate_scan(replace(spec, scanner=replace(WIDE, points=400)))
    assert not calibrate([replace(scan, noise=stated | EXACT_SCANNER)]).poses_rejected


@pytest.mark.parametrize("seed", [1, 9, 11])
def test_the_noise_of_a_handful_of_poses_is_not_that_of_those_which_any_answer_fits(
    seed,
):
    """Three balls of five leave nothing over: a fit that comes near to most poses is
    exact.
    """
    noise = Noise(profile_mm=0.05, position_mm=0.05, orientation_deg=0.01)
    scan = simulate_scan(
        Spec(kind="ball", seed=seed, noise=noise, groups=5, positions=1)
    )
    assert calibrate([replace(scan, noise={})]).solution.noise.profile_mm > 0.01
