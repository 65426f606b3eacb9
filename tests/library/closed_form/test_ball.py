"""Ball and fixed point, from their sensing data: the paper's table, exact without
noise, refused in words where nothing follows.
"""

import numpy as np
import pytest
import sensing_data as scenes
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.linalg import orthogonal_procrustes

from profilecal.closed_form.ball import (
    solve_ball,
    solve_fixed_point,
    solve_tetra_ball,
)
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.poses import (
    angle_between,
    nearest_rotation,
    rotation_from_xyz_angles,
)
from profilecal_papers import published


def test_table_III_gives_equations_53_and_56():
    R_tcp, T_tcp, q = (
        published.values("disk", "Table III", name) for name in ("R_tcp", "T_tcp", "q")
    )
    Upsilon = published.values("disk", "Eq. 53", "Upsilon")
    solution = solve_ball(rotation_from_xyz_angles(R_tcp), T_tcp, q)
    turn = angle_between(solution.R_sensor, nearest_rotation(Upsilon[:, :3]))
    assert np.degrees(turn) < 0.04
    box = published.RoundingBox("disk", "Table III", ("R_tcp", "T_tcp", "q"))
    alike = box.draw(500, default_rng(1))
    R_tcp = rotation_from_xyz_angles(alike["R_tcp"])
    R_tcp[:, 1:4] = R_tcp[:, :1]  # they translate, which their rounding hides
    drawn = zip(R_tcp, alike["T_tcp"], alike["q"], strict=True)
    accuracies = [solve_ball(*one).translation.accuracy for one in drawn]
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


def fixed_point(R, T, q):
    return solve_fixed_point(R, T, q[:, ::2])


GUARDED = {
    "ball": (solve_ball, scenes.ball_data),
    "fixed point": (fixed_point, scenes.point_data),
}


EXACT = [  # numbers of poses, of a ball that translate and that turn; rounding
    *(("ball", poses, 1e-12) for poses in ((3, 3), (4, 4), (6, 8))),
    *(("fixed point", poses, 1e-10) for poses in ((6,), (10,), (20,))),
]


@pytest.mark.parametrize(("method", "poses", "rounding"), EXACT)
def test_without_noise_the_answer_is_exact_in_any_order(method, poses, rounding):
    """But for rounding in a hundred mm."""
    solve, data = GUARDED[method]
    rng = default_rng(poses[0])
    for _ in range(200):
        (R_sensor, T_sensor), given = data(rng, *poses)
        rows = rng.permutation(sum(poses))  # a ball's that translate are found
        found = solve(*(part[rows] for part in given))
        off = np.linalg.norm(found.T_sensor - T_sensor), found.translation.accuracy
        assert max(off) / 100 < rounding
        assert angle_between(found.R_sensor, R_sensor) < rounding


def about_x(R):
    """As many orientations as R, turned about one axis."""
    return rotation_from_xyz_angles(np.outer(np.linspace(0, 1, len(R)), [1, 0, 0]))


ONE_LINE = np.outer(np.arange(8), [10.0, 20, 30])
SMALL = rotation_from_xyz_angles(
    0.05 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
)
OPEN = [
    ("ball", lambda R, *d: [R[[0] * len(R)], *d], "turning poses: 0 given, at least 3"),
    (
        "fixed point",
        lambda *data: [values[:3] for values in data],
        "readings of the point: 3 given, at least 4 needed",
    ),
    (
        "fixed point",
        lambda R, *d: [R[[0] * len(R)], *d],
        "poses have one orientation",
    ),
    (
        "ball",
        lambda R, *d: [np.concatenate([R[:4] * 0 + np.eye(3), about_x(R[4:])]), *d],
        "turn about one axis",
    ),
    (
        "fixed point",
        lambda R, *d: [about_x(R), *d],
        r"turn about one axis, \[.*1.*\] of the flange",
    ),
    (
        "ball",
        lambda R, T, q: [R, T, ONE_LINE],
        "all 3 translations are parallel in the sensor frame",
    ),
    (
        "fixed point",
        lambda R, T, q: [R, T, q * [1, 0, 0] + [0, 0, 9]],
        "all 10 readings lie on one line of the scan",
    ),
    (
        "fixed point",
        lambda R, T, q: [SMALL, T[:4], q[:4]],
        "leave a combination of rotation and translation open",
    ),
]


@pytest.mark.parametrize("sigma", [0, 1e-4])
@pytest.mark.parametrize(("method", "change", "sentence"), OPEN)
def test_poses_that_cannot_determine_the_answer_are_refused_with_noise_too(
    method, change, sentence, sigma
):
    solve, data = GUARDED[method]
    rng = default_rng(8)
    R, T, q = change(*data(rng)[1])
    R = R @ rotation_from_xyz_angles(rng.normal(scale=sigma, size=(len(R), 3)))
    q = q + sigma * rng.normal(size=q.shape) * [1, 0, 1]
    with pytest.raises(UnobservableError, match=sentence):
        solve(R, T, q)
