"""Errors of a robot that vary smoothly with its pose."""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import IN_PROFILES
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.linalg import lstsq
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import carry, inverse, pose_error, rotations
from profilecal.joint.residuals import Residuals
from profilecal.joint.smooth import REACH_MM, VIEW_MM, shifting, smooth_errors
from profilecal.simulation.scene import random_scene

SEEN = np.array([5.0, 0.0, 120.0])


def some_errors(to_hand=False):
    """Smooth errors at random poses of a flange, or `to_hand` of a base in its frame;
    the poses, and the sensor's.
    """
    rng = default_rng(1)
    R = rotations(rng.normal(size=(12, 3)) * 0.4)
    T = rng.normal(size=(12, 3)) * 60 + [900, 0, 300]
    sensor = rotations(rng.normal(size=3)), np.array([60.0, -40.0, 110.0])
    return smooth_errors((R, T), sensor, SEEN, 0.002, to_hand), (R, T), sensor


def of_view(errors, chosen=slice(None)):
    """Motions of the middle of the view, by steps and by coefficients; what takes those
    of the flange to them.
    """
    chosen = np.arange(12)[chosen]
    to_view = shifting(errors.arms(chosen) + SEEN)
    return *(to_view @ motions for motions in errors.motions(chosen)), to_view


def view(poses, sensor):
    """Sensor orientations in the base and the middle of the view."""
    R, T = poses
    R_sensor, T_sensor = sensor
    return R @ R_sensor, carry(R, T, R_sensor @ SEEN + T_sensor)


def test_steps_of_mount_and_base_move_the_view_as_moved_frames_do():
    errors, poses, (R_sensor, T_sensor) = some_errors()
    rigid, *_ = of_view(errors)
    (R, T), tiny = poses, 1e-6
    before = view(poses, (R_sensor, T_sensor))
    for k, step in enumerate(np.eye(6) * tiny):
        turned, shift = rotations(step[3:]), step[:3]
        mount = R_sensor @ turned, T_sensor + R_sensor @ shift
        by_mount = pose_error(*before, *view(poses, mount)) / tiny
        assert_allclose(rigid[..., k], by_mount, atol=1e-3)
        base = turned @ R, T @ turned.T + shift
        by_base = pose_error(*before, *view(base, (R_sensor, T_sensor))) / tiny
        assert_allclose(rigid[..., 6 + k], by_base, atol=2e-3)


def test_what_a_mount_and_a_base_take_up_is_left_out():
    """By least squares over the poses kept, as scipy has it."""
    errors, *_ = some_errors()
    kept = np.arange(12) < 9
    weight = np.repeat([1.0, VIEW_MM], 3)[:, None]
    rigid, moved, to_view = of_view(errors, kept)
    rigid, moved = (weight * rigid).reshape(-1, 12), (weight * moved).reshape(-1, 27)
    steps = lstsq(rigid, moved)[0]
    of_kept = errors.keeping(kept)
    assert_allclose(of_kept.steps, steps, rtol=1e-6, atol=1e-6 * np.abs(steps).max())
    columns = of_kept.columns(np.tile(np.eye(6), (12, 1, 1)))[kept]
    left = (to_view @ columns * weight).reshape(moved.shape)
    assert_allclose(left, moved - rigid @ steps, atol=1e-9)


@pytest.mark.parametrize("kind", IN_PROFILES)
def test_the_middle_of_what_a_pose_sees_is_where_the_target_is(kind):
    """In a ball's centre and on a rod's axis, which lie deeper than their points."""
    scene = random_scene(kind, default_rng(1))
    seen, (placement,) = scene.observations.keep([3]), scene.truth.placements
    of_pose = Residuals(seen, Noise(1.0))
    middle = of_pose.middle(scene.truth, placement)
    on_flange = carry(scene.R_sensor, scene.T_sensor, middle)
    in_base = carry(seen.R_flange[0, 0], seen.T_flange[0, 0], on_flange)
    origin, axes = placement
    off = axes[0].T @ (in_base - origin[0])
    assert_allclose(off[of_pose.shifts], 0, atol=1e-9)


@pytest.mark.parametrize("to_hand", [False, True])
def test_a_scale_of_the_robot_s_positions_is_such_an_error(to_hand):
    """Along an axis of the base, however the flange is turned."""
    errors, (R, T), (R_sensor, _) = some_errors(to_hand=to_hand)
    positions = inverse(R, T)[1] if to_hand else T
    scaled = (positions - positions.mean(axis=0)) * [0.001, 0, 0]
    to_sensor = R_sensor.T if to_hand else (R @ R_sensor).mT
    motions = np.zeros((12, 6))
    motions[:, :3] = (to_sensor @ scaled[..., None])[..., 0]
    columns = of_view(errors)[1].reshape(72, 27)
    sizes = np.linalg.lstsq(columns, motions.ravel(), rcond=1e-9)[0]
    assert_allclose(columns @ sizes, motions.ravel(), atol=1e-9)
    # beside turns, which come with ways here
    assert_allclose(np.linalg.norm(sizes), REACH_MM * 0.001, rtol=0.01)


def test_an_axis_that_turns_with_the_pose_errs_by_bends():
    """As it is seen from the flange, less what is of no or first order; each bend is as
    likely as the smooth error that it belongs to.
    """
    rng = default_rng(1)
    turns = rng.normal(size=(12, 3)) * 0.05
    poses = rotations(turns), np.tile([900.0, 0.0, 300.0], (12, 1))
    errors = smooth_errors(poses, (np.eye(3), np.zeros(3)), SEEN, 1.0)
    relative = Rotation.from_matrix(errors.middle[0].T @ poses[0])
    axis = np.array([0.0, 0.0, 1.0])
    seen = relative.inv().apply(axis)
    second = (seen + np.cross(relative.as_rotvec(), axis) - axis).ravel()
    bends = replace(errors, bends=True).motions(np.arange(12))[1][:, 3:]
    sizes = np.linalg.lstsq(bends.reshape(36, 81), second, rcond=1e-9)[0]
    left = bends.reshape(36, 81) @ sizes - second
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(second)  # of third order
    assert np.abs(sizes).max() == pytest.approx(1, abs=0.05)
