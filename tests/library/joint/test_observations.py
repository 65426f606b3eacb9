"""What observations are to a problem."""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import SIGMA
from numpy.random import default_rng
from numpy.testing import assert_allclose
from simulated import wrongly_seen

import profilecal as pc
from profilecal.calibration.observe import observe_all
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal.joint.prior import OF_SCANNER
from profilecal.joint.problem import Problem
from profilecal.joint.solve import solve
from profilecal.simulation.scene import random_scene
from profilecal.targets.observations import State


def test_what_cannot_be_solved_is_refused():
    few = random_scene("point", default_rng(22), groups=3).observations
    sentence = "9 measured coordinates cannot determine 9 unknowns and noise; add"
    with pytest.raises(UnobservableError, match=sentence):
        solve([few], Noise(SIGMA))


def test_points_that_are_missing_do_not_move_the_place_of_an_edge():
    rng = default_rng(5)
    scene = random_scene("edge", rng)
    points = scene.observations.points.copy()
    poses = points.shape[1]
    points[:, rng.permutation(poses)[: poses // 5]] = np.nan
    problem = Problem([replace(scene.observations, points=points)], Noise(SIGMA))
    state = problem.place(scene.truth.rotation, scene.truth.translation)
    ((origin, axes),) = state.placements
    truth = scene.target
    assert np.linalg.norm(np.cross(axes[0, :, 2], truth.direction)) < 1e-9
    assert truth.distance(origin).max() < 1e-9


@pytest.mark.parametrize("error", OF_SCANNER, ids=lambda error: error.words[:30])
def test_a_scanner_errs_in_circles_as_in_the_arcs_that_it_saw(error):
    """The derivative by its error, against circles through arcs that have it."""
    scan, truth = pc.simulate("ball", seed=1, noise={"profile_mm": 0.0})
    placed = tuple(part[None] for part in truth.target.frame)
    state = State(truth.pose[None, :3, :3], truth.pose[None, :3, 3], (placed,))
    residuals = []
    for size in (1e-6, -1e-6):
        values = tuple(wrongly_seen(rows, error, size) for rows in scan.values)
        (term,) = Problem(
            observe_all([replace(scan, values=values)])[1], Noise(SIGMA)
        ).terms
        residuals.append(term.linearise(state, placed)[0, term.residual])
    by_error = (residuals[0] - residuals[1]) / 2e-6
    columns = term.linearise(state, placed)
    by_flange = term.by_flange(columns, state)
    (found,) = term.by_error(error, state, placed, columns, by_flange)
    assert_allclose(found, by_error, atol=0.01 * np.abs(by_error).max())
