"""From observations to a solution: outliers, several targets, gaps, the noise it rests
on.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import SIGMA, mount_of

from profilecal.calibration.observe import affine_noise
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.geometry.poses import directions, pose_error, rotations
from profilecal.joint.solve import solve
from profilecal.simulation.scene import random_scene
from profilecal_papers.edge_study import (
    EdgePlan,
    edge_scenes,
    observations_of,
    sense_edge,
)


@pytest.mark.parametrize("what", ["points", "groups"])
def test_bad_points_and_groups_are_found_and_left_out(what):
    """A tenth of the points, or 5 of 25 groups, lie on a second edge 10 mm away."""
    rng, trials = np.random.default_rng(17), 20
    error, exact = [], 0
    for _ in range(trials):
        planted = (
            rng.permutation(np.arange(250) < 25)
            if what == "points"
            else rng.permutation(25).repeat(10) < 5
        )
        scene = edge_scenes(EdgePlan(motion="space"), Noise(SIGMA), rng)
        across = np.cross(scene.edge.direction, directions(rng, ()))
        other = replace(
            scene.edge, point=scene.edge.point + 10 * across / np.linalg.norm(across)
        )
        wrong = sense_edge(
            other, scene.R_sensor, scene.T_sensor, scene.poses, Noise(SIGMA), rng
        )
        scene = replace(
            scene, points=np.where(planted.reshape(25, 10, 1), wrong, scene.points)
        )
        found = solve([observations_of(scene)], Noise(SIGMA))
        error.append(
            pose_error(
                found.rotation, found.translation, scene.R_sensor, scene.T_sensor
            )
        )
        exact += (found.rejected[0] == planted).all()
    error = np.array(error)
    assert np.degrees(np.median(np.linalg.norm(error[:, 3:], axis=1))) < 0.15
    assert np.median(np.linalg.norm(error[:, :3], axis=1)) < 0.12
    assert exact >= 0.95 * trials


@pytest.mark.parametrize(
    ("kind", "stated"), [("ball", SIGMA), ("ball", SIGMA / 20), ("plane", SIGMA)]
)
def test_another_sensor_pose_that_fits_as_well_is_told(kind, stated):
    """As happens with few poses; the groups and seed are such."""
    groups, seed = {"ball": (3, 1), "plane": (5, 19)}[kind]
    rng = np.random.default_rng(seed)
    scene = random_scene(kind, rng, groups=groups, positions=1)
    found = solve([scene.noisy(SIGMA, rng)], Noise(stated))
    assert found.status == "weak"
    assert any(
        "another sensor pose explains the data as well" in message
        for message in found.messages
    )


def test_two_targets_together_know_more_than_either_alone():
    rng, inside = np.random.default_rng(19), []
    for _ in range(20):
        mount = rotations(rng.normal(size=3)), rng.uniform(-100, 100, 3)
        edge = random_scene("edge", rng, mount=mount, groups=8).noisy(SIGMA, rng)
        ball = random_scene("ball", rng, mount=mount, groups=4, count=20).noisy(
            SIGMA, rng
        )
        alone, other, both = (
            solve(o, Noise(SIGMA)) for o in ([edge], [ball], [edge, ball])
        )
        assert (
            both.observability.sd
            < np.minimum(alone.observability.sd, other.observability.sd)
        ).all()
        inside.append(
            normalised_square(
                both.covariance, pose_error(both.rotation, both.translation, *mount)
            )
        )
    assert abs(np.mean(inside) - 6) < 3 * np.sqrt(12 / 20)
    assert len(both.placements) == 2


def test_missing_points_are_left_out():
    rng = np.random.default_rng(21)
    scene = random_scene("ball", rng, count=20)
    seen = scene.noisy(SIGMA, rng)
    gaps = rng.uniform(size=seen.points.shape[:-1]) < 0.3
    points = np.where(gaps[..., None], np.nan, seen.points)
    found = solve([replace(seen, points=points)], Noise(SIGMA))
    assert found.dof == (~gaps).sum() - 9
    assert (
        normalised_square(
            found.covariance,
            pose_error(found.rotation, found.translation, *mount_of(scene)),
        )
        < 30
    )


def test_noise_is_estimated_and_said_how():
    rng = np.random.default_rng(18)
    edge = random_scene("edge", rng).noisy(SIGMA, rng)
    level, freedom = affine_noise(edge)
    assert freedom == 25 * (10 - 4) * 2
    assert abs(level / SIGMA - 1) < 4 * np.sqrt(0.5 / freedom) * np.sqrt(
        np.pi / 2
    )  # of a median over the groups
    found = solve([edge])
    assert found.noise_source == "estimated"
    assert found.noise_mm == pytest.approx(SIGMA, rel=4 * np.sqrt(0.5 / found.dof))
    ball = solve([random_scene("ball", rng, count=20).noisy(SIGMA, rng)])
    assert ball.prior.how == "from the residuals"
    assert abs(ball.noise_mm / SIGMA - 1) < 4 * np.sqrt(0.5 / ball.dof)
    assert abs(ball.chi2_per_dof - 1) < np.sqrt(2 / ball.dof)
