"""States of least loss: exact without noise, efficient, and honest about their
uncertainty.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import IN_PROFILES, KINDS, KNOWN, SIGMA, errors, many
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2

from profilecal.calibration.answer import DEGREES
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.joint.descent import refine, search, thin
from profilecal.joint.first_fit import contradicting, typical_mm
from profilecal.joint.problem import Problem
from profilecal.simulation.scene import random_scene
from profilecal_papers.monte_carlo import estimate


def test_points_of_a_few_poses_keep_their_precision():
    seen = random_scene("plane", default_rng(2)).observations
    few = thin(replace(seen, covariance=1 + seen.points[..., 0] ** 2), 5)
    assert_array_equal(few.covariance, 1 + few.points[..., 0] ** 2)


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
    problem = Problem([seen], KNOWN)
    dof = problem.counts.sum() - problem.n
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
    assert_allclose(problem.typical(fit.per_pose), SIGMA, rtol=0.1)
    assert_allclose(typical_mm(problem, fit), SIGMA, rtol=0.1)
    assert np.flatnonzero(contradicting(problem, fit, 0.0)).tolist() == [7]
    if kind == "disk":  # in mm the same where z counts for more
        uneven = np.broadcast_to(np.diag([1, 1e-4, 1, 1e-4]), (1, 400, 4, 4))
        problem = Problem([replace(seen, covariance=uneven)], Noise(1.0))
        fit = problem.moments(scene.truth)
        assert_allclose(typical_mm(problem, fit), SIGMA, rtol=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_noise_free_from_no_guess_at_all(kind):
    scene = many(kind, 30, 7)
    for i in range(30):
        problem = Problem([scene.observations.take([i])], Noise(SIGMA))
        fits = refine(problem, search(problem), tolerance=1e-12)
        best = fits.state[[np.argmin(fits.loss)]]
        assert_allclose(DEGREES * errors(best, scene.truth[[i]]), 0, atol=1e-9)
