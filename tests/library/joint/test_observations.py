"""What observations are to a problem."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from many_scenes import SIGMA
from numpy.random import default_rng
from numpy.testing import assert_allclose
from simulated import state_of, with_values

import profilecal as pc
from profilecal.calibration.observe import observe_all
from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.noise import Noise
from profilecal.joint.prior import OF_SCANNER
from profilecal.joint.problem import Problem
from profilecal.joint.solve import solve
from profilecal.simulation.scene import random_scene


def test_what_cannot_be_solved_is_refused():
    few = random_scene("point", default_rng(22), groups=3).observations
    sentence = "9 measured coordinates cannot determine 9 unknowns and noise; add"
    with pytest.raises(pc.UnobservableError, match=sentence):
        solve([few], Noise(SIGMA))


def test_points_that_are_missing_do_not_move_the_place_of_an_edge():
    scene = random_scene("edge", default_rng(5))
    points = scene.observations.points.copy()
    points[:, ::5] = np.nan
    problem = Problem([replace(scene.observations, points=points)], Noise(SIGMA))
    state = problem.place(scene.truth.rotation, scene.truth.translation)
    ((origin, axes),) = state.placements
    ends = origin + [[0.0], [100.0]] * axes[:, :, 2]
    assert scene.target.distance(ends).max() < 1e-9


def wrongly_seen(error, wrong, circle):
    """The circle (1, 3) of an arc with an error of the scanner of that size."""
    angle = np.radians(np.linspace(-50, 50, 21))
    outwards = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    points = circle[:, :2] + circle[:, 2:] * outwards
    moved = points + wrong * np.stack(error.points(*points.T), axis=1)
    return fit_circle(moved)[None]


@pytest.mark.parametrize("error", OF_SCANNER, ids=lambda error: error.words[:30])
def test_a_scanner_errs_in_circles_as_in_the_arcs_that_it_saw(error):
    """The derivative by its error, against circles through arcs that have it."""
    scan, truth = pc.simulate("ball", seed=1, noise={"profile_mm": 0.0})
    state = state_of(truth)
    (placed,) = state.placements
    residuals = []
    for size in (1e-6, -1e-6):
        wrong = with_values(scan, partial(wrongly_seen, error, size))
        (term,) = Problem(observe_all([wrong])[1], Noise(SIGMA)).terms
        residuals.append(term.linearise(state, placed)[0, -1])
    by_error = (residuals[0] - residuals[1]) / 2e-6
    columns = term.linearise(state, placed)
    by_flange = term.by_flange(columns, state)
    (found,) = term.by_error(error, state, placed, columns, by_flange)
    assert_allclose(found, by_error, atol=0.01 * np.abs(by_error).max())
