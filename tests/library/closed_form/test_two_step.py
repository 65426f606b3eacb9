"""Ball and fixed point, from their sensing data: exact without noise, refused in
words where nothing follows.
"""

import numpy as np
import pytest
import sensing_data as scenes
from numpy.random import default_rng

from profilecal.closed_form.ball import solve_ball, solve_fixed_point
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.poses import angle_between, rotation_from_xyz_angles


def fixed_point(R, T, q):
    return solve_fixed_point(R, T, q[:, ::2])


GUARDED = {
    "ball": (solve_ball, scenes.ball_data),
    "fixed point": (fixed_point, scenes.point_data),
}


def exact(solution, sensor, rounding=1e-12):
    """Whether a solution is the sensor's pose, and meets the fixed point, but for
    rounding in a hundred mm.
    """
    off = (
        angle_between(solution.R_sensor, sensor[0]),
        np.linalg.norm(solution.T_sensor - sensor[1]) / 100,
    )
    return max(*off, solution.translation.accuracy / 100) < rounding


EXACT = [  # numbers of poses, of a ball that translate and that turn
    *((scenes.ball_data, poses) for poses in ((3, 3), (4, 4), (6, 8))),
    *((scenes.point_data, poses) for poses in ((6,), (10,), (20,))),
]


@pytest.mark.parametrize(("data", "poses"), EXACT)
def test_without_noise_the_answer_is_exact(data, poses):
    rng = default_rng(poses[0])
    for _ in range(200):
        sensor, given = data(rng, *poses)
        if data is scenes.ball_data:
            assert exact(solve_ball(*given), sensor)
        else:
            assert exact(fixed_point(*given), sensor, 1e-10)


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
        "all 3 differences of ball centres are parallel",
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
