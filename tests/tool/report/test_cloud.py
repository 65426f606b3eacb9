"""What was seen from all poses, put together."""

import numpy as np
import pytest
from command import run
from simulated import scan_of, with_values

import profilecal as pc
from profilecal_tool.report.cloud import clouds_of


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("kind", ["edge", "plane", "ball", "disk", "rod", "point"])
def test_a_right_pose_makes_the_target_and_a_wrong_one_smears_it(kind, mount):
    plan = {"mount": mount, "groups": 8, "positions": 4, "noise": {"profile_mm": 0.02}}
    scan, truth = pc.simulate(kind, seed=4, **plan)
    found = pc.calibrate(scan)
    (right,) = clouds_of(found, truth.pose)
    assert right.rms_mm < 0.1
    if scan.measured == "profiles":
        near = np.abs(truth.target.distance(right.points)) < 0.2
        assert near.mean() > (0.9 if kind == "plane" else 0.05)
    wrong = truth.pose.copy()
    wrong[:3, 3] += 3
    (smeared,) = clouds_of(found, wrong)
    assert smeared.rms_mm > 3 * right.rms_mm


def test_a_rejected_pose_does_not_count_in_how_thick_a_cloud_is():
    scan = scan_of("plane", seed=4)
    found = pc.calibrate(with_values(scan, lambda rows: rows + np.array([0, 5]), [7]))
    assert found.poses_rejected == [scan.labels[7]]
    assert clouds_of(found, found.pose)[0].rms_mm < 0.1


def test_clouds_are_written(tmp_path):
    scan = scan_of("plane", seed=4)
    pc.write_scan(scan, tmp_path / "scan")
    place = tmp_path / "cloud.ply"
    result = run("calibrate", tmp_path / "scan", "--json", "--cloud", place)
    (tmp_path / "T.json").write_text(result.stdout)
    head, _, rows = place.read_text().partition("end_header\n")
    count = sum(map(len, scan.values))
    assert f"element vertex {count}\n" in head
    points = np.loadtxt(rows.splitlines())
    assert points.shape == (count, 6)
    again = scan_of("plane", seed=4, scan=2)
    pc.write_scan(again, tmp_path / "again")
    options = "--with", tmp_path / "T.json", "--cloud", tmp_path / "again.ply"
    assert run("verify", tmp_path / "again", *options).exit_code == 0
    assert (tmp_path / "again.ply").exists()
