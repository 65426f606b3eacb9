"""What a robot's errors do to simulated scans: which measurements share them."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import rotations
from profilecal.simulation.robot import Robot, actual_poses
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal.simulation.sweeps import Motion

NOISELESS = Noise()


def points(noise=NOISELESS, **entries):
    """The points (n, 2) of a scan of an edge, and the scan."""
    scan = simulate_scan(Spec(groups=3, positions=4, noise=noise, **entries))
    return np.concatenate(scan.values), scan


def test_repeats_share_the_error_of_their_pose_and_not_the_noise_of_the_scanner():
    noise = Noise(position_mm=0.5)
    thrice, scan = points(noise, repeats=3)
    once, _ = points(noise)
    assert_array_equal(thrice, np.repeat(once, 3, axis=0))
    assert_array_equal(scan.p_base_flange[::3], scan.p_base_flange[2::3])
    assert scan.labels[:4] == ("g1p1m1", "g1p1m2", "g1p1m3", "g1p2m1")
    assert scan.group.tolist() == np.repeat([0, 1, 2], 12).tolist()
    noisy, _ = points(Noise(profile_mm=0.1), repeats=2)
    assert np.abs(noisy[::2] - noisy[1::2]).min() > 0


def test_pose_errors_have_their_sizes_and_groups_share_theirs():
    """Each standard deviation within four of its own standard errors, or less."""
    groups, positions = 2000, 10
    within = 4 / np.sqrt(3 * groups)
    noise = Noise(0, 0.3, 0.2, group_position_mm=0.4, group_orientation_deg=0.1)
    none = np.zeros((groups, positions, 3))
    same = np.arange(groups) // 2
    R, shifts = actual_poses(rotations(none[:, 0]), none, noise, default_rng(3), same)
    turns = Rotation.from_matrix(R).as_rotvec(degrees=True)
    for error, own, shared in ((shifts, 0.3, 0.4), (turns, 0.2, 0.1)):
        mean = error.reshape(groups // 2, 2 * positions, 3).mean(axis=1)
        of_mean = np.hypot(shared, own / np.sqrt(2 * positions))
        assert mean.std() == pytest.approx(of_mean, rel=within)
        assert error.std() == pytest.approx(np.hypot(own, shared), rel=within)


@pytest.mark.parametrize("error", ["repeatability_mm", "repeatability_deg"])
@pytest.mark.parametrize("motion", [None, Motion(sweeps=2, profiles=5, stops=3)])
def test_whenever_a_robot_comes_to_a_pose_it_errs_anew(error, motion):
    erring, _ = points(Noise(**{error: 0.3}), motion=motion)
    perfect, _ = points(motion=motion)
    assert np.abs(erring - perfect).max(axis=1).min() > 0


def test_an_arm_errs_alike_wherever_it_meets_a_pose_again():
    erring, _ = points(repeats=2, robot=Robot(joint_deg=0.05, link_mm=0.3))
    perfect, _ = points(repeats=2)
    assert_array_equal(erring[::2], erring[1::2])
    assert 0.01 < np.abs(erring - perfect).mean() < 5


def test_a_robot_that_carries_the_target_errs_at_its_flange():
    rng = default_rng(4)
    T = rng.uniform(500, 900, (20, 1, 3))
    base, noise = (rotations(0 * T[:, 0]), -T), Noise(orientation_deg=1.0)
    R_found, T_found = actual_poses(*base, noise, rng, to_hand=True)
    assert_allclose(T_found, T, atol=1e-9)
    turns = Rotation.from_matrix(R_found).as_rotvec(degrees=True)
    assert 1 < np.linalg.norm(turns, axis=-1).mean() < 2.5
