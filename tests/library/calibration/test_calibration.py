"""From scans to an answer that can be believed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2
from simulated import EXACT_SCANNER, calibration_of, scan_of, squared_error, truth_of

from profilecal.calibration.calibration import calibrate
from profilecal.calibration.observe import observe
from profilecal.geometry.noise import Noise
from profilecal.scan.scan import ScanError
from profilecal.simulation.spec import WIDE, Spec, simulate_scan


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


def test_poses_without_a_measurement_are_left_out_and_named_by_scan():
    edge = simulate_scan(Spec(seed=9, title="edge"))
    values = list(edge.values)
    values[4] = values[4][:0]
    edge = replace(edge, values=tuple(values))
    disk = simulate_scan(Spec(kind="disk", measured="profiles", seed=9, title="disk"))
    disk = replace(disk, values=(np.full((9, 2), np.nan), *disk.values[1:]))
    found = calibrate([edge, disk])
    assert found.messages[0] == "edge: no point from pose g1p5"
    assert found.messages[1].startswith("disk: 1 left out, nothing in this profile")
    assert "edge: g1p5" not in found.poses_used


def test_several_targets_have_one_answer():
    edge = simulate_scan(Spec("edge", seed=6, title="edge"))
    disk = simulate_scan(Spec("disk", seed=6, title="disk"))
    together = calibrate([edge, disk])
    assert squared_error(edge, together) < chi2.ppf(0.9999, 6)
    assert together.poses_used[0] == "edge: g1p1"
    kinds = [target["kind"] for target in together.to_json()["target"]]
    assert kinds == ["edge", "disk"]


def test_features_of_different_precision_are_weighed():
    spec = Spec(seed=6, measured="profiles", groups=8, positions=4)
    edge = simulate_scan(replace(spec, kind="edge", title="edge"))
    ball = simulate_scan(replace(spec, kind="ball", title="ball"))
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
    two = r"noise profile_mm is 0\.05 in one scan and 0\.1 in another"
    with pytest.raises(ScanError, match=two):
        calibrate([scan, replace(scan, noise={"profile_mm": 0.1})])


def test_a_scan_that_shows_nothing_is_refused():
    scan = simulate_scan(Spec(seed=1))
    blind = replace(scan, values=tuple(rows[:0] for rows in scan.values))
    with pytest.raises(ScanError, match="was found from 0 poses; expected 3 or more"):
        calibrate(blind)


def with_first_pose_again(scan):
    """The scan with its first pose and what it saw once more, under another name."""
    rows = [*range(len(scan.labels)), 0]
    return replace(
        scan,
        labels=(*scan.labels, "again"),
        R_base_flange=scan.R_base_flange[rows],
        p_base_flange=scan.p_base_flange[rows],
        values=tuple(scan.values[k] for k in rows),
        group=scan.group[rows],
        side=scan.side[rows],
    )


def test_a_measurement_given_twice_is_refused():
    scan = replace(scan_of(Spec(kind="ball")), title="first")
    labels = tuple(reversed(scan.labels))
    digits = scan.p_base_flange + 1e-9  # as another convention's digits have it
    copy = replace(scan, title="a copy", labels=labels, p_base_flange=digits)
    same = "holds the same measurement as pose g1p1 of scan 1"
    for scans, which in (
        ([scan, scan], r"pose g1p1 of scan 2 \(first\)"),
        ([scan, copy], r"of scan 2 \(a copy\)"),
        ([with_first_pose_again(scan)], r"pose again of scan 1 \(first\)"),
    ):
        with pytest.raises(ScanError, match=f"{which} {same}"):
            calibrate(scans)


def test_robot_errors_are_part_of_the_stated_uncertainty():
    noise = Noise(
        profile_mm=0.05, position_mm=0.05, orientation_deg=0.01, group_position_mm=0.2
    )
    spec = Spec(noise=noise, groups=12, positions=4)
    scans = [simulate_scan(replace(spec, seed=seed)) for seed in range(12)]
    squares = np.array([squared_error(scan, calibrate(scan)) for scan in scans])
    inside = np.sum(squares < chi2.ppf(0.95, 6))
    assert binom.ppf(1e-4, 12, 0.95) <= inside


def test_the_status_is_the_same_for_poses_of_the_flange_and_of_a_tool():
    """In a scan whose status hangs on where the robot's errors act: so is the seed."""
    noise = Noise(profile_mm=0.03, position_mm=0.1, orientation_deg=0.05)
    spec = Spec("plane", seed=1031, groups=12, positions=1, noise=noise)
    scan = replace(simulate_scan(spec), noise={})
    at_sensor = scan.p_base_flange + scan.R_base_flange @ truth_of(scan)[:3, 3]
    of_flange = calibrate(scan)
    of_tool = calibrate(replace(scan, p_base_flange=at_sensor))
    assert (of_flange.status, of_tool.status) == ("weak", "weak")
    remark = "the origin of the poses' frame"
    assert remark in " ".join(of_flange.messages)
    assert remark not in " ".join(of_tool.messages)
    assert of_flange.solution.observability.status == "ok"


def test_few_poses_are_kept_where_robots_err_and_one_that_is_wrong_is_not():
    """A robust fit to 14 poses comes near to most of them; what it leaves out, a
    robot's usual errors explain.
    """
    noise = Noise(profile_mm=0.05, position_mm=0.05, orientation_deg=0.02)
    spec = Spec(noise=noise, groups=14, positions=1)
    squares, rejected = 0.0, 0
    for seed in range(8):
        simulated = simulate_scan(replace(spec, seed=seed))
        scan = replace(simulated, noise={"profile_mm": 0.05})
        found = calibrate(scan)
        squares += squared_error(scan, found)
        rejected += len(found.poses_rejected)
        values = list(scan.values)
        values[5] = values[5] + 3.0
        wrong = replace(scan, values=tuple(values))
        assert calibrate(wrong).poses_rejected == [scan.labels[5]]
    assert rejected <= 1
    assert squares < chi2.isf(1e-4, 6 * 8)


def test_too_small_a_statement_is_no_excuse_for_a_bad_pose():
    """What is stated of a robot may be far too small; a pose that is 1 mm off is none
    the less more likely wrong.
    """
    noise = Noise(profile_mm=0.05, position_mm=0.02, orientation_deg=0.005)
    spec = Spec("plane", groups=14, positions=1, noise=noise)
    told = 0
    for seed in range(8):
        scan = simulate_scan(replace(spec, seed=seed))
        off = np.random.default_rng(seed).normal(size=3)
        positions = scan.p_base_flange.copy()
        positions[5] += off / np.linalg.norm(off)
        found = calibrate(replace(scan, p_base_flange=positions))
        told += scan.labels[5] in found.poses_rejected
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
