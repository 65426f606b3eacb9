"""Batches of scans with bad points against the same done one by one."""

from dataclasses import replace

import numpy as np
import pytest

from profilecal.calibrate.check import affine_noise, affine_outliers
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import directions, rotations
from profilecal.joint.problem import Problem
from profilecal.joint.solve import solve
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_scenes, observations_of, second_edge
from profilecal.papers.outlier_study import (
    compare,
    screen,
    solve_robustly,
    solve_without,
    truth_of,
    two_phase_without,
)

NOISE, PLAN = Noise(0.05), EdgePlan(motion="space", groups=12, positions=8)


def planted(rng, shape, what):
    """A fifth of the points, or of the groups, of each scan."""
    B, G, N = shape
    chosen = rng.permuted(np.tile(np.arange(G * N if what == "points" else G) < G * N // 5, (B, 1)), axis=1)
    if what == "groups":
        chosen = rng.permuted(np.tile(np.arange(G) < G // 5, (B, 1)), axis=1)[..., None] & np.ones(N, bool)
    return chosen.reshape(shape)


def by_hand(scene, rng):
    off = (len(scene.R_sensor),)
    R = scene.R_sensor @ rotations(np.radians(5) * directions(rng, off))
    return Problem([observations_of(scene)], NOISE).place(R, scene.T_sensor + 10 * directions(rng, off))


@pytest.mark.parametrize("what", ["points", "groups"])
def test_robust_solutions_from_a_rough_mount_are_those_of_the_search_without_any(what):
    rng = np.random.default_rng(1)
    bad = planted(rng, (4, 12, 8), what)
    scene = second_edge(PLAN, NOISE, bad, rng)
    seen = observations_of(scene)
    found = solve_robustly(seen, NOISE, by_hand(scene, rng))
    for k in range(4):
        alone = solve([seen.take(slice(k, k + 1))], NOISE)
        np.testing.assert_array_equal(found.rejected[k], alone.rejected[0])
        np.testing.assert_allclose(found.state.rotation[k], alone.rotation, atol=1e-7)
        np.testing.assert_allclose(found.covariance[k], alone.covariance, rtol=1e-4, atol=1e-5 * alone.covariance.max())
        assert found.status[k] == alone.status


def test_least_squares_of_the_good_poses_is_that_of_a_scan_without_the_others():
    rng = np.random.default_rng(2)
    bad = planted(rng, (2, 12, 8), "points")
    scene = second_edge(PLAN, NOISE, bad, rng)
    seen, flat = observations_of(scene), bad.reshape(2, -1)
    found = solve_without(seen, NOISE, truth_of(scene), flat)
    for k in range(2):
        alone = solve([seen.take(slice(k, k + 1)).keep(~flat[k])], NOISE, robust=False)
        np.testing.assert_allclose(found.state.rotation[k], alone.rotation, atol=1e-7)
        np.testing.assert_allclose(found.covariance[k], alone.covariance, rtol=1e-4, atol=1e-5 * alone.covariance.max())


def test_nothing_is_known_where_nothing_is_left():
    scene = edge_scenes(PLAN, NOISE, np.random.default_rng(3), (2,))
    everything = np.ones((2, 96), dtype=bool)
    found = solve_without(observations_of(scene), NOISE, truth_of(scene), everything)
    assert (found.status == "unobservable").all()


def test_the_screen_of_a_batch_is_that_of_single_scans_and_takes_out_what_was_planted():
    rng = np.random.default_rng(4)
    scene = edge_scenes(PLAN, NOISE, rng, (6,))
    bad = np.zeros((6, 12, 8), dtype=bool)
    bad[:, ::3, 2] = True
    points = scene.points + bad[..., None] * rng.uniform(2, 10, scene.points.shape)
    seen = observations_of(scene)
    for k, found in enumerate(screen(scene.poses.positions, points, 0.05)):
        np.testing.assert_array_equal(found, bad[k])
        one = seen.take(slice(k, k + 1))
        alone = affine_outliers(replace(one, points=points[k].reshape(1, 96, 1, 2)))
        assert affine_noise(one)[0] == pytest.approx(0.05, rel=0.3)
        assert alone == [[k] for k in np.flatnonzero(found)]


def test_the_screen_names_no_point_where_all_fit_equally_badly():
    rng = np.random.default_rng(5)
    scene = edge_scenes(EdgePlan(motion="space", groups=4, positions=5), NOISE, rng, (3,))
    points = scene.points.copy()
    points[:, 1, 2] += 10.0
    assert not screen(scene.poses.positions, points, 0.05).any()


def test_the_two_phase_method_without_bad_points_is_exact_where_the_others_are():
    rng = np.random.default_rng(6)
    bad = planted(rng, (3, 12, 8), "points")
    bad &= bad.sum(axis=-1, keepdims=True) <= 4
    scene = second_edge(PLAN, Noise(), bad, rng)
    found = two_phase_without(scene, bad)
    np.testing.assert_allclose(found.R_sensor, scene.R_sensor, atol=1e-9)
    np.testing.assert_allclose(found.T_sensor, scene.T_sensor, atol=1e-6)


def test_a_comparison_counts_what_was_missed_and_what_was_lost():
    rng = np.random.default_rng(7)
    bad = planted(rng, (3, 12, 8), "points")
    scene = second_edge(PLAN, NOISE, bad, rng)
    table = compare(scene, bad, NOISE, by_hand(scene, rng)).groupby("method").mean(numeric_only=True)
    assert table.loc["good points alone", ["missed", "lost"]].tolist() == [0, 0]
    assert table.loc["least squares", ["missed", "lost"]].tolist() == [1, 0]
    assert table.loc["robust joint", "rotation"] < 0.3 * table.loc["least squares", "rotation"]
