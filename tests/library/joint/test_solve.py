"""From observations to a solution: outliers, several targets, gaps, the noise it rests
on.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import SIGMA
from numpy.random import default_rng

from profilecal.geometry.noise import Noise, normalised_square
from profilecal.geometry.poses import directions, pose_error, rotations
from profilecal.joint.solution import Solution
from profilecal.joint.solve import solve
from profilecal.simulation.scene import random_scene
from profilecal_papers.edge_study import (
    EdgePlan,
    edge_scenes,
    observations_of,
    sense_edge,
)

NOISE = Noise(SIGMA)


def error_of(solution: Solution, R, T):
    """δ (6,) from a solution to the true sensor pose."""
    return pose_error(solution.rotation, solution.translation, R, T)


def mixed_with_another_edge(scene, wrong, rng):
    """The scene with points of a second edge, 10 mm away, where `wrong` (250,) says."""
    across = np.cross(scene.edge.direction, directions(rng, ()))
    point = scene.edge.point + 10 * across / np.linalg.norm(across)
    other = replace(scene.edge, point=point)
    points = sense_edge(other, scene.R_sensor, scene.T_sensor, scene.poses, NOISE, rng)
    mask = wrong.reshape(25, 10, 1)
    return replace(scene, points=np.where(mask, points, scene.points))


@pytest.mark.parametrize("what", ["points", "groups"])
def test_bad_points_and_groups_are_found_and_left_out(what):
    """A tenth of the points, or 5 of 25 groups, lie on a second edge 10 mm away."""
    rng = default_rng(17)
    trials = 5
    errors, exact = [], 0
    for _ in range(trials):
        if what == "points":
            planted = rng.permutation(np.arange(250) < 25)
        else:
            planted = rng.permutation(25).repeat(10) < 5
        scene = edge_scenes(EdgePlan(motion="space"), NOISE, rng)
        scene = mixed_with_another_edge(scene, planted, rng)
        solution = solve([observations_of(scene)], NOISE)
        errors.append(error_of(solution, scene.R_sensor, scene.T_sensor))
        exact += (solution.rejected[0] == planted).all()
    shift, turn = np.linalg.norm(np.reshape(errors, (trials, 2, 3)), axis=2).T
    assert np.degrees(np.median(turn)) < 0.15
    assert np.median(shift) < 0.12
    assert exact == trials


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


def test_two_targets_together_know_more_than_either_alone():
    rng = default_rng(19)
    squares = []
    for _ in range(10):
        mount = rotations(rng.normal(size=3)), rng.uniform(-100, 100, 3)
        edge = random_scene("edge", rng, mount=mount, groups=8).noisy(SIGMA, rng)
        scene = random_scene("ball", rng, mount=mount, groups=4, count=20)
        ball = scene.noisy(SIGMA, rng)
        by_edge = solve([edge], NOISE).observability.sd
        by_ball = solve([ball], NOISE).observability.sd
        both = solve([edge, ball], NOISE)
        assert (both.observability.sd < np.minimum(by_edge, by_ball)).all()
        squares.append(normalised_square(both.covariance, error_of(both, *mount)))
    assert abs(np.mean(squares) - 6) < 3 * np.sqrt(12 / 10)
    assert len(both.placements) == 2


def relative_sd(freedom: int) -> float:
    """Of a standard deviation that is estimated with so many degrees of freedom."""
    return np.sqrt(0.5 / freedom)


def test_noise_is_estimated_and_said_how():
    rng = default_rng(18)
    edge = random_scene("edge", rng).noisy(SIGMA, rng)
    solution = solve([edge], Noise())
    assert solution.noise_source == "estimated"
    within = 4 * relative_sd(solution.dof)
    assert solution.noise_mm == pytest.approx(SIGMA, rel=within)

    solution = solve([random_scene("ball", rng, count=20).noisy(SIGMA, rng)], Noise())
    assert solution.prior.source == "residuals"
    assert abs(solution.noise_mm / SIGMA - 1) < 4 * relative_sd(solution.dof)
    assert abs(solution.chi2_per_dof - 1) < np.sqrt(2 / solution.dof)
