"""Errors of a robot that vary smoothly with its pose."""

from dataclasses import replace

import numpy as np
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import carry, rotations
from profilecal.joint.smooth import VIEW_MM, smooth_errors

SEEN = np.array([5.0, 0.0, 120.0])


def some_errors(seed=1, count=12):
    """Smooth errors at random poses of a flange, the poses, and the sensor's."""
    rng = default_rng(seed)
    R = rotations(rng.normal(size=(count, 3)) * 0.4)
    T = rng.normal(size=(count, 3)) * 60 + [900, 0, 300]
    R_sensor, T_sensor = rotations(rng.normal(size=3)), np.array([60.0, -40.0, 110.0])
    arms = np.tile(T_sensor @ R_sensor, (count, 1))
    sensor = R_sensor, T_sensor
    return smooth_errors((R, T), sensor, arms, SEEN, 0.002, T), (R, T), sensor


def view(poses, sensor):
    """Sensor orientations in the base and the middle of the view."""
    R, T = poses
    R_sensor, T_sensor = sensor
    return R @ R_sensor, carry(R, T, R_sensor @ SEEN + T_sensor)


def motion(before, after):
    """By how much views have moved (P, 6), about the sensor's axes."""
    (R, p), (R_after, p_after) = before, after
    turn = Rotation.from_matrix(R.mT @ R_after).as_rotvec()
    return np.hstack([(R.mT @ (p_after - p)[..., None])[..., 0], turn])


def test_steps_of_mount_and_base_move_the_view_as_moved_frames_do():
    errors, poses, (R_sensor, T_sensor) = some_errors()
    (R, T), tiny = poses, 1e-6
    before = view(poses, (R_sensor, T_sensor))
    for k, step in enumerate(np.eye(6) * tiny):
        turned, shift = rotations(step[3:]), step[:3]
        mount = R_sensor @ turned, T_sensor + R_sensor @ shift
        by_mount = motion(before, view(poses, mount)) / tiny
        assert_allclose(errors.rigid[..., k], by_mount, atol=1e-3)
        base = turned @ R, T @ turned.T + shift
        by_base = motion(before, view(base, (R_sensor, T_sensor))) / tiny
        assert_allclose(errors.rigid[..., 6 + k], by_base, atol=2e-3)


def test_what_a_mount_and_a_base_take_up_is_left_out():
    """By least squares over the poses kept; all of it, where errors are such steps."""
    errors, *_ = some_errors()
    kept = np.arange(12) < 9
    of_kept = errors.keeping(kept)
    weight = np.repeat([1.0, VIEW_MM], 3)[:, None]
    left = weight * (errors.errors - errors.rigid @ of_kept.steps)[kept]
    flat, rigid = (
        part.reshape(-1, part.shape[2]) for part in (left, weight * errors.rigid[kept])
    )
    assert np.abs(rigid.T @ flat).max() < 1e-9 * np.linalg.norm(rigid) ** 2
    steps = default_rng(2).normal(size=(12, 27))
    rigid_errors = replace(errors, errors=errors.rigid @ steps).keeping(kept)
    assert_allclose(rigid_errors.steps, steps, atol=1e-6)
    assert np.abs(rigid_errors.left).max() < 1e-6
