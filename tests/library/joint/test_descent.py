"""States of least loss: as scipy finds them, efficient, and honest about their
uncertainty.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import IN_PROFILES, KINDS, KNOWN, SIGMA, errors, many
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from profilecal.geometry.noise import Noise, normalised_square
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import refine, thin
from profilecal.joint.first_fit import contradicting, typical_mm
from profilecal.joint.problem import Problem
from profilecal.simulation.scene import random_scene
from profilecal.targets.disk import Disk
from profilecal_papers.monte_carlo import estimate

NOISE = Noise(SIGMA)


def test_agrees_with_scipy_on_residuals_of_its_own():
    """Observed minus `Disk.meet`, by the sensor pose and the disk's place."""
    rng = default_rng(9)
    scene = random_scene("disk", rng, positions=30)
    seen = scene.noisy(SIGMA, rng)
    R_flange, T_flange = seen.R_flange[0], seen.T_flange[0]
    R, T = scene.truth.rotation[0], scene.truth.translation[0]
    ((centre, _),) = scene.truth.placements

    def turned(x):
        return R @ Rotation.from_rotvec(x[3:6]).as_matrix()

    def residual(x):
        rotation = R_flange @ turned(x)
        origin = R_flange @ (T + x[:3]) + T_flange
        normal = scene.target.normal + np.r_[x[9:], 0]
        normal = normal / np.linalg.norm(normal)
        disk = Disk(centre[0] + x[6:9], normal, *seen.sizes)
        return (seen.points[0] - disk.meet(rotation, origin)).ravel() / SIGMA

    exactly = dict.fromkeys(["xtol", "ftol", "gtol"], 1e-15)
    start = np.zeros(11)
    x = least_squares(residual, start, "3-point", x_scale="jac", **exactly).x
    fit = refine(Problem([seen], NOISE), scene.truth)
    assert np.abs(fit.state.translation[0] - T - x[:3]).max() < 1e-6
    assert angle_between(fit.state.rotation[0], turned(x)) < 1e-8
    assert_allclose(fit.loss[0], (residual(x) ** 2).sum(), rtol=1e-10)


def test_points_of_a_few_poses_keep_their_precision():
    seen = random_scene("plane", default_rng(2)).observations
    few = thin(replace(seen, covariance=1 + seen.points[..., 0] ** 2), 5)
    assert_array_equal(few.covariance, 1 + few.points[..., 0] ** 2)


def test_points_of_a_batch_are_moved_onto_the_targets_of_their_own_problems():
    scene = many("plane", 3, 5)
    seen = scene.noisy(SIGMA, default_rng(1))
    (term,) = Problem([seen], KNOWN).terms
    (placement,) = scene.truth.placements
    z = term.linearise(scene.truth, placement)
    moved = term.on_target(z).linearise(scene.truth, placement)
    before, after = (np.abs(columns[:, -1]).max() for columns in (z, moved))
    assert after < 1e-9 < SIGMA < before


def of_unlike_precision(scene, rng):
    """Noisy observations of which each point on a curve has a precision of its own,
    between 1/10 and 3 noise levels.
    """
    clean = scene.observations
    sizes = rng.uniform(0.1, 3, clean.points.shape[:-1])
    noise = SIGMA * sizes[..., None] * rng.normal(size=clean.points.shape)
    return replace(clean, points=clean.points + noise, covariance=sizes**2)


@pytest.mark.parametrize("kind", [*KINDS, "uneven ball", "uneven plane"])
def test_stated_uncertainty_is_honest(kind):
    """Over random scenes: the normalised error squared averages 6, its 95 % regions
    hold, χ²/dof is one; the bounds are three standard errors.
    """
    trials, rng = 400, default_rng(13)
    scene = many(kind.removeprefix("uneven "), trials, 12, steering_mm=0.2)
    is_uneven = kind.startswith("uneven")
    seen = of_unlike_precision(scene, rng) if is_uneven else scene.noisy(SIGMA, rng)
    state, known, square = estimate([seen], KNOWN, scene.truth)
    nees = normalised_square(known.covariance, errors(state, scene.truth))
    assert abs(nees.mean() - 6) < 3 * np.sqrt(12 / trials)
    inside = (nees < chi2.ppf(0.95, 6)).mean()
    assert abs(inside - 0.95) < 3 * np.sqrt(0.95 * 0.05 / trials)
    dof = Problem([seen], KNOWN).counts.sum() - known.parameters
    bound = min(0.05, 3 * np.sqrt(2 / dof / trials) + 1e-3)
    assert abs((square / dof).mean() - 1) < bound
    assert (known.status != "ok").mean() < 0.01


@pytest.mark.parametrize("kind", IN_PROFILES)
def test_the_typical_residual_is_as_large_as_the_noise_whatever_it_was_taken_for(kind):
    scene = random_scene(kind, default_rng(3), groups=20, positions=20)
    seen = scene.noisy(SIGMA, default_rng(4))
    seen.points[0, 7] += 10 * SIGMA
    problem = Problem([seen], Noise(1.0))
    fit = problem.moments(scene.truth)
    assert_allclose(problem.typical(fit), SIGMA, rtol=0.1)
    assert_allclose(typical_mm(problem, fit), SIGMA, rtol=0.1)
    assert np.flatnonzero(contradicting(problem, fit, 0.0)).tolist() == [7]
    if kind == "disk":  # in mm the same where z counts for more
        uneven = np.broadcast_to(np.diag([1, 1e-4, 1, 1e-4]), (1, 400, 4, 4))
        problem = Problem([replace(seen, covariance=uneven)], Noise(1.0))
        fit = problem.moments(scene.truth)
        assert_allclose(typical_mm(problem, fit), SIGMA, rtol=0.1)
