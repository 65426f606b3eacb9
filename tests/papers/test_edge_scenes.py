import numpy as np
import pytest
from raw_profiles import edge_profiles

from profilecal.geometry.noise import Noise
from profilecal.papers.edge_study import (
    STANDOFF,
    EdgePlan,
    ball_points,
    edge_scenes,
    plan_ball,
    sense_edge,
)
from profilecal.simulate.poses import actual_poses
from profilecal.simulate.scanner import Scanner
from profilecal.targets.ball import Ball
from profilecal.targets.edge import SPECIMENS


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


def test_ball_points_lie_on_the_ball_when_carried_to_the_base():
    scene = edge_scenes(EdgePlan(), Noise(), np.random.default_rng(6), (3,))
    mount, ball = (scene.R_sensor, scene.T_sensor), Ball(scene.edge.point, 20.0)
    poses = plan_ball(ball.centre, 20.0, *mount, np.random.default_rng(7))
    points = ball_points(ball, *mount, poses, Noise(), np.random.default_rng(8))
    assert points.shape == (3, 10, 6, 40, 2)
    distance = np.linalg.norm(poses.carry(points, *mount) - ball.centre[:, None, None, None], axis=-1)
    np.testing.assert_allclose(distance, 20, atol=1e-10)
    assert (points[..., 1] < STANDOFF + 20).all()  # the side that the scanner sees


def test_every_specimen_shows_its_edge_where_the_scene_has_it():
    """Some point of each profile lies within half a millimetre of it."""
    scene = edge_scenes(EdgePlan(spread_deg=5, radius=5), Noise(), np.random.default_rng(9))
    for specimen in SPECIMENS:
        profiles = edge_profiles(scene, specimen, Scanner(), np.random.default_rng(10))
        assert profiles.shape == (25, 10, 980, 2)
        away = np.linalg.norm(profiles - scene.points[..., None, :], axis=-1)
        assert np.nanmin(away, axis=-1).max() < 0.5
