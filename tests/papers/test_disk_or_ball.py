"""The joint solutions of the comparison of disk and ball, and the few points that stand for an arc."""

import numpy as np
import pytest

from profilecal.geometry.poses import rotations
from profilecal.papers.disk_or_ball import (
    arc_nodes,
    closed_form_from_disk,
    error_in_view,
    joint_from_ball,
    joint_from_disk,
    noisy_tips,
    small_turns,
    tip_covariance,
)
from profilecal.papers.settings import fig15_scans, fig17_scans


@pytest.mark.parametrize("pose", range(8))
def test_a_few_points_tell_of_a_circle_what_all_points_of_its_arc_do(pose):
    scans = fig17_scans()
    cx, cz, r = circle = scans.circles(1)[pose, 0]

    def information(x, sd):
        h = np.sqrt(r**2 - (x - cx) ** 2)
        J = np.stack([(x - cx) / h, np.ones_like(x), r / h]) / sd
        return J @ J.T

    x, z, sd = arc_nodes(scans, circle)
    np.testing.assert_allclose(z, cz + np.sqrt(r**2 - (x - cx) ** 2))
    ratio = np.linalg.solve(information(scans.x_seen(circle), 1.0), information(x, sd))
    np.testing.assert_allclose(np.linalg.eigvals(ratio), 1, atol=1e-6)


def test_an_error_in_view_is_how_far_points_are_misplaced():
    scans, rng = fig17_scans(), np.random.default_rng(1)
    points, turn, shift = rng.uniform(-40, 40, (5, 3)), 1e-6 * rng.normal(size=3), rng.normal(size=3)
    wrong = rotations(turn) @ scans.R_sensor
    np.testing.assert_allclose(small_turns(wrong, scans.R_sensor), turn, atol=1e-12)
    moved = points @ (wrong - scans.R_sensor).T + shift
    expected = np.sqrt((moved**2).sum(axis=1).mean())
    np.testing.assert_allclose(error_in_view(turn, shift, scans.R_sensor, points), expected, rtol=1e-5)


def test_joint_solutions_err_in_proportion_to_the_noise():
    rng = np.random.default_rng(2)
    disk, ball = fig15_scans((-0.9, 0.3)), fig17_scans()
    for solve, scans, count in (
        (joint_from_disk, disk, 10),
        (closed_form_from_disk, disk, 10),
        (joint_from_ball, ball, np.full(8, 2)),
    ):
        sizes = [np.abs(solve(scans, count, sigma, 100, rng)[1]).mean() for sigma in (1e-3, 1e-2)]
        assert 8 < sizes[1] / sizes[0] < 12.5


def test_tips_of_a_profile_are_the_ends_of_the_line_through_its_points():
    rng, sigma, step, trials = np.random.default_rng(3), 0.3, 0.5, 4000
    tips = np.array([[-10.0, 2.0], [20.0, 8.0]])
    x = np.arange(-10, 20.1, step)
    z = 2 + 0.2 * (x + 10) + sigma * rng.normal(size=(trials, len(x)))
    slope, height = np.polyfit(x, z.T, 1)
    ends_x = tips[:, 0] + step * rng.uniform(-0.5, 0.5, (trials, 2))  # where along the line it ends
    ends = np.stack([ends_x, height[:, None] + slope[:, None] * ends_x], axis=-1).reshape(trials, 4)
    expected = tip_covariance(tips, sigma, step)
    sd = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.cov(ends.T) / np.outer(sd, sd), expected / np.outer(sd, sd), atol=0.08)
    np.testing.assert_allclose(ends.mean(axis=0), tips.ravel(), atol=0.02)


def test_tips_get_the_noise_of_their_covariance():
    tips = fig15_scans((-0.9, 0.3)).tips(3)
    np.testing.assert_allclose(tip_covariance(tips, 0.2)[1, 2], 0.04 * np.eye(4))
    covariance = tip_covariance(tips, 0.2, 0.1)
    noise = (noisy_tips(tips, covariance, 4000, np.random.default_rng(4)) - tips)[:, 1, 2].reshape(-1, 4)
    sd = np.sqrt(np.diag(covariance[1, 2]))
    np.testing.assert_allclose(np.cov(noise.T) / np.outer(sd, sd), covariance[1, 2] / np.outer(sd, sd), atol=0.08)
