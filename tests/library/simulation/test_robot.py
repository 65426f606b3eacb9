"""What a robot's errors do to simulated scans: which measurements share them."""

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between, inverse, rotations
from profilecal.simulation.robot import Poses, Robot, actual_poses
from profilecal.simulation.spec import Spec, simulate_scan

SHAPE = {"groups": 3, "positions": 4}
NOISELESS = Noise()


def points(kind="edge", **entries):
    """The noiseless points (n, 2) of a scan, and the scan."""
    scan = simulate_scan(Spec(kind=kind, **SHAPE, **({"noise": NOISELESS} | entries)))
    return np.concatenate(scan.values), scan


def test_repeats_share_the_error_of_their_pose_and_not_the_noise_of_the_scanner():
    noise = Noise(position_mm=0.5)
    seen, scan = points(noise=noise, repeats=3)
    once, _ = points(noise=noise)
    np.testing.assert_array_equal(
        seen.reshape(12, 3, 2), np.repeat(once[:, None], 3, axis=1)
    )
    np.testing.assert_array_equal(scan.p_base_flange[::3], scan.p_base_flange[2::3])
    assert scan.labels[:4] == ("g1p1m1", "g1p1m2", "g1p1m3", "g1p2m1")
    assert scan.group.tolist() == np.repeat([0, 1, 2], 12).tolist()
    noisy, _ = points(noise=Noise(profile_mm=0.1), repeats=2)
    assert np.abs(noisy[::2] - noisy[1::2]).min() > 0


def test_a_drift_grows_from_the_first_pose_to_the_last():
    still = np.repeat(np.eye(3)[None], 5, axis=0), np.zeros((5, 3))
    _, moved = Robot(drift_mm=1.0).visiting(*still, NOISELESS, np.random.default_rng(3))
    np.testing.assert_allclose(moved, np.linspace(0, 1, 5)[:, None] * moved[-1])
    assert 0.1 < np.linalg.norm(moved[-1]) < 5


def test_an_arm_errs_alike_wherever_it_meets_a_pose_again():
    seen, _ = points(repeats=2, robot=Robot(joint_deg=0.05, link_mm=0.3))
    still, _ = points(repeats=2)
    np.testing.assert_array_equal(seen[::2], seen[1::2])
    assert 0.01 < np.abs(seen - still).mean() < 5


def test_a_robot_that_carries_the_target_errs_at_its_flange():
    rng = np.random.default_rng(4)
    R, T = rotations(rng.uniform(-0.3, 0.3, (20, 3))), rng.uniform(500, 900, (20, 3))
    R_back, T_back = inverse(R, T)
    actual, position = actual_poses(
        Poses(R_back, T_back[:, None]), Noise(orientation_deg=1.0), rng, to_hand=True
    )
    np.testing.assert_allclose(position[:, 0], T, atol=1e-9)
    assert 1 < np.degrees(angle_between(actual[:, 0], R)).mean() < 2.5
