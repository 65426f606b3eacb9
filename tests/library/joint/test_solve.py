"""From observations to a solution: outliers, several targets, gaps, the noise it rests
on.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import SIGMA
from numpy.random import default_rng

import profilecal as pc
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.geometry.poses import pose_error
from profilecal.joint.solve import UNSETTLED, solve
from profilecal.simulation.scene import random_scene

NOISE = Noise(SIGMA)


@pytest.mark.parametrize("what", ["points", "groups"])
def test_bad_points_and_groups_are_found_and_left_out(what):
    """A tenth of the points, or 9 of 25 groups, see the edge 10 mm aside; the answers
    are as exact as they state.
    """
    squares = []
    for seed in range(5):
        rng = default_rng(seed)
        scene = random_scene("edge", rng, groups=25, positions=10)
        seen = scene.noisy(SIGMA, rng)
        points, groups = np.arange(250) < 25, np.arange(25) < 9
        planted = rng.permutation(points if what == "points" else groups)
        planted = planted.repeat(250 // len(planted))
        _, axes = scene.target.frame
        T_flange = seen.T_flange + 10 * planted[:, None] * axes[:, 0]
        solution = solve([replace(seen, T_flange=T_flange)], NOISE)
        assert (solution.rejected[0] == planted).all()
        found = solution.rotation, solution.translation
        error = pose_error(*found, scene.R_sensor, scene.T_sensor)
        squares.append(normalised_square(solution.covariance, error))
    assert np.mean(squares) < 6 + 3 * np.sqrt(12 / 5)


def test_an_estimate_that_does_not_settle_says_so(monkeypatch):
    """As steps do that leave much to the next one, however many they are."""
    rng = default_rng(1)
    seen = random_scene("ball", rng, positions=12).noisy(SIGMA, rng)
    assert solve([seen], NOISE).status == "ok"
    monkeypatch.setattr("profilecal.joint.solve.leaves_little", lambda *_: False)
    solution = solve([seen], NOISE)
    assert solution.status == "weak"
    assert solution.messages == (UNSETTLED,)


def test_a_pose_between_the_limits_of_rejection_does_not_come_and_go():
    rng = default_rng(12)
    seen = random_scene("edge", rng, groups=8, positions=4).noisy(SIGMA, rng)
    T_flange = seen.T_flange.copy()
    T_flange[0, 5] += 0.08 * rng.normal(size=3)
    assert solve([replace(seen, T_flange=T_flange)], NOISE).status == "ok"


def test_what_cannot_be_solved_is_refused():
    few = random_scene("point", default_rng(22), groups=3).observations
    sentence = "9 measured coordinates cannot determine 9 unknowns and noise; add"
    with pytest.raises(pc.UnobservableError, match=sentence):
        solve([few], NOISE)


@pytest.mark.parametrize(
    ("kind", "stated"), [("ball", SIGMA), ("ball", SIGMA / 20), ("plane", SIGMA)]
)
def test_another_sensor_pose_that_fits_as_well_is_told(kind, stated):
    """As happens with few poses; the groups and seed are such."""
    groups, seed = {"ball": (3, 1), "plane": (5, 19)}[kind]
    rng = default_rng(seed)
    scene = random_scene(kind, rng, groups=groups, positions=1)
    solution = solve([scene.noisy(SIGMA, rng)], Noise(stated))
    assert solution.status == "weak"
    sentence = "another sensor pose explains the data as well"
    assert any(sentence in message for message in solution.messages)


@pytest.mark.parametrize("kind", ["edge", "ball"])
def test_noise_is_estimated_and_said_how(kind):
    rng = default_rng(18)
    scene = random_scene(kind, rng, count=20)
    solution = solve([scene.noisy(SIGMA, rng)], Noise())
    assert solution.noise_source == "estimated"
    assert solution.prior.source == "residuals"
    within = 4 * np.sqrt(0.5 / solution.dof)  # standard deviations of its estimate
    assert solution.noise_mm == pytest.approx(SIGMA, rel=within)
    assert abs(solution.chi2_per_dof - 1) < np.sqrt(2 / solution.dof)
