"""States of least loss: as scipy finds them, efficient, and honest about their
uncertainty.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import KINDS, KNOWN, SIGMA, errors, many
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, f

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.geometry.poses import angle_between, pose_error
from profilecal.joint.descent import refine, thin
from profilecal.joint.prior import prior_from
from profilecal.joint.problem import Problem
from profilecal.joint.solve import contradicting, solve
from profilecal.simulation.scene import random_scene
from profilecal.targets.disk import Disk
from profilecal_papers.edge_study import EdgePlan, edge_scenes, observations_of
from profilecal_papers.monte_carlo import estimate


def test_agrees_with_scipy_on_residuals_of_its_own():
    """scipy's least_squares on observed minus `Disk.meet`, with numerical derivatives."""
    rng = np.random.default_rng(9)
    scene = random_scene("disk", rng, positions=30)
    seen = scene.noisy(SIGMA, rng)
    fit = refine(Problem([seen], Noise(SIGMA)), scene.truth)

    def residual(x):
        R = scene.truth.rotation[0] @ Rotation.from_rotvec(x[3:6]).as_matrix()
        rotation = seen.R_flange[0] @ R
        origin = (
            seen.R_flange[0] @ (scene.truth.translation[0] + x[:3]) + seen.T_flange[0]
        )
        normal = scene.target.normal + np.r_[x[9:], 0]
        disk = Disk(
            scene.truth.placements[0][0][0] + x[6:9],
            normal / np.linalg.norm(normal),
            *seen.sizes,
        )
        return (seen.points[0] - disk.meet(rotation, origin)).ravel() / SIGMA

    x = least_squares(
        residual,
        np.zeros(11),
        jac="3-point",
        x_scale="jac",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    ).x
    assert (
        np.abs(fit.state.translation[0] - scene.truth.translation[0] - x[:3]).max()
        < 1e-6
    )
    turned = scene.truth.rotation[0] @ Rotation.from_rotvec(x[3:6]).as_matrix()
    assert angle_between(fit.state.rotation[0], turned) < 1e-8
    np.testing.assert_allclose(fit.loss[0], (residual(x) ** 2).sum(), rtol=1e-10)


def test_points_of_a_few_poses_keep_their_precision():
    seen = random_scene("plane", np.random.default_rng(2)).observations
    few = thin(replace(seen, covariance=1 + seen.points[..., 0] ** 2), 5)
    np.testing.assert_array_equal(few.covariance, 1 + few.points[..., 0] ** 2)


def test_points_of_a_batch_are_moved_onto_the_targets_of_their_own_problems():
    scene, rng = many("plane", 3, 5), np.random.default_rng(1)
    (term,), (placement,) = (
        Problem([scene.noisy(SIGMA, rng)], KNOWN).terms,
        scene.truth.placements,
    )
    z = term.linearise(scene.truth, placement)
    left = term.on_target(z).linearise(scene.truth, placement)
    assert np.abs(left[:, -1]).max() < 1e-9 < SIGMA < np.abs(z[:, -1]).max()


def of_unlike_precision(scene, rng):
    """Noisy observations of which each point has a covariance of its own, between 1/10
    and 3 noise levels large.
    """
    clean = scene.observations
    *batch, m, _ = clean.points.shape
    if clean.on_curve:
        covariance = rng.uniform(0.1, 3, (*batch, m)) ** 2
        noise = np.sqrt(covariance)[..., None] * rng.normal(size=clean.points.shape)
    else:
        root = (
            rng.uniform(0.1, 3, (*batch, 2 * m, 1))
            * np.linalg.qr(rng.normal(size=(*batch, 2 * m, 2 * m)))[0]
        )
        covariance = np.swapaxes(root, -1, -2) @ root
        noise = (rng.normal(size=(*batch, 1, 2 * m)) @ root).reshape(clean.points.shape)
    return replace(clean, points=clean.points + SIGMA * noise, covariance=covariance)


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_stated_uncertainty_is_honest_where_points_differ_in_precision(kind):
    """As below, and forgetting the covariances makes the errors larger."""
    trials = 300
    scene, rng = many(kind, trials, 12), np.random.default_rng(14)
    seen = of_unlike_precision(scene, rng)
    state, found, square = estimate([seen], Noise(SIGMA), scene.truth)
    error = errors(state, scene.truth)
    dof = Problem([seen], Noise(SIGMA)).counts.sum() - found.parameters
    assert abs(normalised_square(found.covariance, error).mean() - 6) < 3 * np.sqrt(
        12 / trials
    )
    assert abs((square / dof).mean() - 1) < 3 * np.sqrt(2 / dof / trials) + 1e-3
    forgotten = estimate([replace(seen, covariance=None)], Noise(SIGMA), scene.truth)[0]
    worse = errors(forgotten, scene.truth)
    assert (
        np.sqrt(np.mean(worse**2, axis=0)) > 1.2 * np.sqrt(np.mean(error**2, axis=0))
    ).all()


@pytest.mark.parametrize("kind", KINDS)
def test_stated_uncertainty_is_honest(kind):
    """Over 1,000 random scenes: the normalised error squared averages 6, its 95 %
    regions hold, χ²/dof is one; the bounds are three standard errors. The same with the
    noise estimated, where F replaces χ².
    """
    trials = 1000
    scene, rng = many(kind, trials, 12, steering_mm=0.2), np.random.default_rng(13)
    seen = scene.noisy(SIGMA, rng)
    state, found, square = estimate([seen], KNOWN, scene.truth)
    nees = normalised_square(found.covariance, errors(state, scene.truth))
    dof = Problem([seen], KNOWN).counts.sum() - found.parameters
    assert abs(nees.mean() - 6) < 3 * np.sqrt(12 / trials)
    assert 0.93 < (nees < chi2.ppf(0.95, 6)).mean() < 0.97
    assert abs((square / dof).mean() - 1) < min(
        0.05, 3 * np.sqrt(2 / dof / trials) + 1e-3
    )
    assert (found.status != "ok").mean() < 0.01

    scaled = nees / (square / dof)  # covariance with the noise that the residuals show
    mean, sd = f.stats(6, dof, moments="mv")
    assert abs(scaled.mean() / 6 - mean) < 3 * np.sqrt(sd / trials)
    assert 0.93 < (scaled / 6 < f.ppf(0.95, 6, dof)).mean() < 0.97


@pytest.mark.parametrize("kind", ["ball", "plane"])
def test_poses_that_leave_a_flat_valley_take_no_longer(kind, monkeypatch):
    """48 times nearly one pose: the loss hardly changes along most directions; descents
    go to their limits, no more.
    """
    rng = np.random.default_rng(3)
    one = random_scene(kind, rng).observations.keep(np.zeros(48, dtype=int))
    T, points = (
        a + sd * rng.normal(size=a.shape)
        for a, sd in ((one.T_flange, 1e-3), (one.points, SIGMA))
    )
    seen, evaluations, moments = (
        replace(one, T_flange=T, points=points, group=None),
        [],
        Problem.moments,
    )
    monkeypatch.setattr(
        Problem,
        "moments",
        lambda *args, **more: evaluations.append(1) or moments(*args, **more),
    )
    assert solve([seen], prior_from({}, features_mm=SIGMA)).status == "unobservable"
    assert (
        len(evaluations) <= 18 * (kind == "plane") + 7 + 9 + 17 + 6 + 61 + 1
    )  # coarse, grid's rounds, fits, a look


@pytest.mark.parametrize(
    "choices", [{"motion": "line"}, {"tilt_deg": 0.0}, {"frame": "tool"}], ids=str
)
def test_motions_that_leave_the_two_phase_method_without_rank_are_solved_and_honest(
    choices,
):
    """Straight lines, arcs whose plane contains the edge, arcs that turn with the tool."""
    trials = 300
    scene = edge_scenes(
        EdgePlan(**choices), Noise(SIGMA), np.random.default_rng(23), (trials,)
    )
    seen = observations_of(scene)
    start = Problem([seen], Noise(SIGMA)).place(scene.R_sensor, scene.T_sensor)
    state, found, _ = estimate([seen], Noise(SIGMA), start)
    error = pose_error(
        state.rotation, state.translation, scene.R_sensor, scene.T_sensor
    )
    nees = normalised_square(found.covariance, error)
    assert abs(nees.mean() - 6) < 3 * np.sqrt(12 / trials)
    closed = edge_equations(
        scene.poses.rotations, scene.poses.positions, scene.points
    ).R_sensor
    assert np.median(angle_between(closed, scene.R_sensor)) > 5 * np.median(
        np.linalg.norm(error[:, 3:], axis=1)
    )


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane", "rod"])
def test_the_typical_residual_is_as_large_as_the_noise_whatever_it_was_taken_for(kind):
    scene = random_scene(kind, np.random.default_rng(3), groups=20, positions=20)
    seen = scene.noisy(SIGMA, np.random.default_rng(4))
    seen.points[0, 7] += 10 * SIGMA
    problem = Problem([seen], Noise(1.0))
    fit = problem.moments(scene.truth)
    np.testing.assert_allclose(problem.typical(fit), SIGMA, rtol=0.1)
    assert np.flatnonzero(contradicting(problem, fit)).tolist() == [7]
