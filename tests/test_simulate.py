import numpy as np
import pytest

from profilecal.acquisition import EdgePlan
from profilecal.simulate import Noise, actual_poses, edge_scenes, sense_edge


def test_sensed_points_lie_on_the_edge_when_carried_to_the_base():
    scene = edge_scenes(EdgePlan(), Noise(), np.random.default_rng(1), (5,))
    x, z = np.moveaxis(scene.points, -1, 0)
    in_sensor = np.stack([x, np.zeros_like(x), z], axis=-1)
    in_flange = in_sensor @ np.swapaxes(scene.R_sensor, -1, -2)[:, None] + scene.T_sensor[:, None, None]
    in_base = in_flange @ np.swapaxes(scene.poses.rotations, -1, -2) + scene.poses.positions
    offset = np.cross(in_base - scene.edge.point[:, None, None], scene.edge.direction[:, None, None])
    assert np.abs(offset).max() < 1e-10


def test_pose_errors_have_their_sizes_and_groups_share_theirs():
    """Each standard deviation within four of its own standard errors."""
    poses = edge_scenes(EdgePlan(groups=2000, positions=10), Noise(), np.random.default_rng(2)).poses
    noise = Noise(position_mm=0.3, group_position_mm=0.4, orientation_deg=0.2, group_orientation_deg=0.1)
    rotations, positions = actual_poses(poses, noise, np.random.default_rng(3))
    error = positions - poses.positions
    within = error - error.mean(axis=1, keepdims=True)
    assert np.sqrt((within**2).sum() / (2000 * 9 * 3)) == pytest.approx(0.3, rel=4 / np.sqrt(2 * 2000 * 9 * 3))
    expected = np.hypot(0.4, 0.3 / np.sqrt(10))
    assert error.mean(axis=1).std() == pytest.approx(expected, rel=4 / np.sqrt(2 * 6000))
    turn = rotations @ np.swapaxes(poses.rotations, -1, -2)[:, None]
    angles = np.degrees(np.stack([turn[..., 2, 1], turn[..., 0, 2], turn[..., 1, 0]], axis=-1))
    assert angles.mean(axis=1).std() == pytest.approx(np.hypot(0.1, 0.2 / np.sqrt(10)), rel=4 / np.sqrt(2 * 6000))


def test_profile_noise_is_added_to_both_coordinates():
    scene = edge_scenes(EdgePlan(groups=500), Noise(), np.random.default_rng(4))
    rng = np.random.default_rng(5)
    noisy = sense_edge(scene.edge, scene.R_sensor, scene.T_sensor, scene.poses, Noise(profile_mm=0.05), rng)
    np.testing.assert_allclose((noisy - scene.points).std(axis=(0, 1)), 0.05, rtol=4 / np.sqrt(2 * 5000))
