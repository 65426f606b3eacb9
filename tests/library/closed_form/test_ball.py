import numpy as np
import pytest
import sensing_data as scenes
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.linalg import orthogonal_procrustes

from profilecal.closed_form.ball import ball_equations, solve_ball, solve_tetra_ball
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.poses import (
    angle_between,
    nearest_rotation,
    rotation_from_xyz_angles,
)
from profilecal_papers import published


def table_III():
    R_tcp, T_tcp, q = (
        published.values("disk", "Table III", name) for name in ("R_tcp", "T_tcp", "q")
    )
    return rotation_from_xyz_angles(R_tcp), T_tcp, q


def test_table_III_gives_equations_53_and_56():
    Upsilon = published.values("disk", "Eq. 53", "Upsilon")
    solution = solve_ball(*table_III())
    turn = angle_between(solution.R_sensor, nearest_rotation(Upsilon[:, :3]))
    assert np.degrees(turn) < 0.04
    box = published.RoundingBox("disk", "Table III", ("R_tcp", "T_tcp", "q"))
    alike = box.draw(500, default_rng(1))
    R_tcp = rotation_from_xyz_angles(alike["R_tcp"])
    drawn = zip(R_tcp, alike["T_tcp"], alike["q"], strict=True)
    accuracies = [ball_equations(*one, 4).translation.accuracy for one in drawn]
    low, high = np.quantile(accuracies, [0.025, 0.975])
    assert low < published.values("disk", "Eq. 56", "accuracy") < high


def test_tetra_ball_is_exact_and_equals_orthogonal_procrustes():
    rng = default_rng(9)
    for _ in range(200):
        R, T = scenes.sensor(rng)
        q_i = 50 * np.eye(4, 3) + rng.uniform(-10, 10, (4, 3))
        exact, shift = solve_tetra_ball(q_i[:3] @ R.T + T, q_i[:3])
        assert angle_between(exact, R) < 1e-12
        assert np.linalg.norm(shift - T) < 1e-10
        q_b = q_i @ R.T + T + rng.normal(scale=0.1, size=(4, 3))
        found, shift = solve_tetra_ball(q_b, q_i)
        about_mean = (points - points.mean(axis=0) for points in (q_i, q_b))
        expected, _ = orthogonal_procrustes(*about_mean)
        assert_allclose(found, expected.T, atol=1e-12)
        assert_allclose((q_i @ found.T + shift - q_b).mean(axis=0), 0, atol=1e-10)


def test_tetra_ball_refuses_points_on_one_line_and_too_few():
    line = np.outer([0, 40, 120], [1.0, 2, 3])
    with pytest.raises(UnobservableError, match="q_b: all 3 points lie on one line"):
        solve_tetra_ball(line, line)
    with pytest.raises(ValueError, match="conjugate pairs: 2 given, at least 3 needed"):
        solve_tetra_ball(line[:2], line[:2])
    with pytest.raises(ValueError, match=r"q_i has shape \(2, 3\); expected \(3, 3\)"):
        solve_tetra_ball(np.eye(3), line[:2])
