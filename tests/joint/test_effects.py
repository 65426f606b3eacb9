"""Errors that residuals share, integrated out."""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import KINDS, ROBOT, SIGMA
from scipy.spatial.transform import Rotation

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise, Systematic
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import estimate
from profilecal.joint.effects import inverse_of
from profilecal.joint.problem import Problem
from profilecal.joint.sharing import level_variances
from profilecal.joint.state import normalised_square, pose_error
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_scenes, observations_of
from profilecal.simulate.scene import random_scene


@pytest.mark.parametrize("eye_to_hand", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_left_agrees_with_the_dense_covariance(kind, eye_to_hand):
    """The covariance of all residuals, written out, with pose errors differentiated numerically."""
    rng = np.random.default_rng(10)
    scene = random_scene(kind, rng, groups=3, positions=4, count=5)
    seen = replace(scene.noisy(0.3, rng), eye_to_hand=eye_to_hand)
    problem = Problem([seen], ROBOT)
    term, truth = problem.terms[0], scene.truth
    z = term.linearise(truth, truth.placements[0]).columns[0]
    N, K, P = z.shape

    def residuals(pose, component, h):
        turn, shift = np.eye(3), np.zeros(3)
        shift[component % 3] = h * (component < 3)
        if component >= 3:
            turn = Rotation.from_rotvec(h * np.eye(3)[component - 3]).as_matrix()
        R, T = seen.R_flange[0].copy(), seen.T_flange[0].copy()
        if eye_to_hand:  # (F exp(ε))⁻¹ = exp(-ε) F⁻¹
            R[pose], T[pose] = turn.T @ R[pose], turn.T @ (T[pose] - shift)
        else:
            R[pose], T[pose] = R[pose] @ turn, T[pose] + R[pose] @ shift
        moved = Problem([replace(seen, R_flange=R[None], T_flange=T[None])], ROBOT).terms[0]
        return moved.linearise(truth, truth.placements[0]).residual[0]

    h = 3e-6
    E = np.array([[(residuals(p, c, h) - residuals(p, c, -h)) / (2 * h) for c in range(6)] for p in range(P)])
    E = np.moveaxis(E, 1, -1).reshape(P, K * P, 6)  # by pose, residual, component
    C = SIGMA**2 * np.eye(K * P)
    _, of_pose, of_group = level_variances(ROBOT)
    for p in range(P):
        C += (E[p] * of_pose) @ E[p].T
    for g in range(3):
        shared = E[seen.group == g].sum(axis=0)
        C += (shared * of_group) @ shared.T
    flat = z.reshape(N, -1)
    expected = flat @ np.linalg.solve(C, flat.T)
    ours = problem.moments(truth).normal[0]
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(ours / size / size[:, None], expected / size / size[:, None], atol=1e-6)


@pytest.mark.parametrize("motion", ["arc", "space"])
def test_errors_common_to_a_rotation_group(motion):
    noise = Noise(SIGMA, group_position_mm=0.2)
    scene = edge_scenes(EdgePlan(motion=motion), noise, np.random.default_rng(16), (200,))
    seen = observations_of(scene)
    problem = Problem([seen], noise)
    state, found, square = estimate([seen], noise, problem.place(scene.R_sensor, scene.T_sensor))
    closed = edge_equations(scene.poses.rotations, scene.poses.positions, scene.points).R_sensor
    ours, theirs = (np.sqrt(np.mean(angle_between(R, scene.R_sensor) ** 2)) for R in (state.rotation, closed))
    assert ours < 0.7 * theirs
    dof = int(problem.count()[0]) - problem.n
    assert 0.9 < (square / dof).mean() < 1.1
    nees = normalised_square(
        found.covariance, pose_error(state.rotation, state.translation, scene.R_sensor, scene.T_sensor)
    )
    assert abs(nees.mean() - 6) < 3 * np.sqrt(12 / 200)


@pytest.mark.parametrize("kind", KINDS)
def test_other_noise_is_that_of_a_problem_of_its_own(kind):
    rng = np.random.default_rng(KINDS.index(kind))
    scene, may_be_wrong = random_scene(kind, rng), Systematic(scale_percent=0.5)
    seen = scene.noisy(SIGMA, rng)
    quiet = Problem([seen], Noise(profile_mm=SIGMA, steering_mm=0.2), may_be_wrong)
    before = quiet.moments(scene.truth).normal
    loud = replace(ROBOT, profile_mm=2 * SIGMA, steering_mm=0.3)
    found, own = (
        problem.moments(scene.truth) for problem in (quiet.with_noise(loud), Problem([seen], loud, may_be_wrong))
    )
    np.testing.assert_array_equal(found.normal, own.normal)
    np.testing.assert_array_equal(quiet.moments(scene.truth).normal, before)
    assert not np.allclose(found.normal, before)


@pytest.mark.parametrize("rows", [1, 2, 4])
def test_small_matrices_are_inverted_entry_by_entry(rows):
    factor = np.random.default_rng(5).normal(size=(3, 7, rows, rows))
    matrices = np.eye(rows) + factor @ np.swapaxes(factor, -1, -2)
    inverse, determinant = inverse_of(np.moveaxis(matrices, 1, -1))
    assert np.moveaxis(inverse, -1, 1) == pytest.approx(np.linalg.inv(matrices), rel=1e-9, abs=1e-9)
    assert determinant == pytest.approx(np.linalg.det(matrices), rel=1e-9)


def test_ones_that_rounding_swallows_leave_no_zero_to_divide_by():
    E = np.random.default_rng(6).normal(size=(100, 3, 2))  # three rows, two errors: but for the ones of rank two
    matrices = np.eye(3) + 1e20 * E @ np.swapaxes(E, -1, -2)
    inverse, determinant = inverse_of(np.moveaxis(matrices, 0, -1)[None])
    assert np.isfinite(inverse).all()
    assert (determinant > 0).all()
