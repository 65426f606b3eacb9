import numpy as np
import pytest
import sensing_data as scenes
from scipy.spatial.transform import Rotation

from profilecal.closed_form.ball import solve_ball
from profilecal.closed_form.fixed_point import fixed_point_equations, solve_fixed_point
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.poses import angle_between, rotation_from_xyz_angles


def point_data(rng, poses=10, translating=0):
    """(R_sensor, T_sensor), (R_tcp, T_tcp, q): a point in the scan plane, the first `translating` poses in one
    orientation."""
    R_sensor, T_sensor = scenes.sensor(rng)
    around = 2 * np.pi * np.arange(poses) / poses
    turns = Rotation.from_rotvec(0.5 * np.column_stack([np.cos(around), np.sin(around), np.cos(3 * around)]))
    R_tcp = (Rotation.random(rng=rng) * turns).as_matrix()
    R_tcp[:translating] = R_tcp[:1]
    q = np.column_stack([40 * np.cos(2 * around + 1), 0 * around, 40 * np.sin(2 * around + 1)])
    q += rng.uniform(-15, 15, (poses, 3)) * [1, 0, 1]
    point = rng.uniform(-500, 500, 3)
    return (R_sensor, T_sensor), (R_tcp, point - np.einsum("nab,nb->na", R_tcp, q @ R_sensor.T + T_sensor), q)


@pytest.fixture
def data():
    return point_data(np.random.default_rng(5))[1]


@pytest.mark.parametrize("poses", [6, 10, 20])
def test_noise_free_readings_give_the_answer_exactly(poses):
    rng = np.random.default_rng(poses)
    for _ in range(200):
        (R_sensor, T_sensor), data = point_data(rng, poses)
        solution = solve_fixed_point(*data)
        assert angle_between(solution.R_sensor, R_sensor) < 1e-10
        assert np.linalg.norm(solution.T_sensor - T_sensor) < 1e-8
        assert solution.translation.accuracy < 1e-8


def test_the_ball_s_two_steps_give_the_same_of_readings_without_noise():
    (R_sensor, T_sensor), data = point_data(np.random.default_rng(3), poses=9, translating=4)
    for solution in (solve_fixed_point(*data), solve_ball(*data, 4)):
        assert angle_between(solution.R_sensor, R_sensor) < 1e-10
        assert np.linalg.norm(solution.T_sensor - T_sensor) < 1e-8


def test_a_batch_equals_its_members():
    rng = np.random.default_rng(6)
    members = [point_data(rng)[1] for _ in range(5)]
    noisy = [(R, T, q + rng.normal(scale=[0.1, 0, 0.1], size=q.shape)) for R, T, q in members]
    batch = fixed_point_equations(*(np.stack(arrays) for arrays in zip(*noisy, strict=True)))
    for k, member in enumerate(noisy):
        np.testing.assert_allclose(batch.flat()[k], solve_fixed_point(*member).flat(), rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda R, T, q: (R[:3], T[:3], q[:3]), "readings of the point: 3 given, at least 4 needed"),
        (lambda R, T, q: (R, T, q + np.array([0, 0.5, 0])), r"q\[0\] is .*expected y = 0"),
        (lambda R, T, q: (R, T, q * np.nan), r"q\[0\] is .*expected finite"),
        (lambda R, T, q: (R[:, ::-1], T, q), r"R_tcp\[0\] is a reflection"),
    ],
)
def test_malformed_input_is_refused_in_words(data, change, sentence):
    with pytest.raises(ValueError, match=sentence):
        solve_fixed_point(*change(*data))


def test_poses_that_cannot_determine_the_answer_are_refused(data):
    R_tcp, T_tcp, q = data
    with pytest.raises(UnobservableError, match="all 10 poses have one orientation"):
        solve_fixed_point(R_tcp[[0] * 10], T_tcp, q)
    about_x = rotation_from_xyz_angles(np.outer(np.arange(10) / 10, [1, 0, 0]))
    with pytest.raises(UnobservableError, match="turn about one axis"):
        solve_fixed_point(about_x, T_tcp, q)
    with pytest.raises(UnobservableError, match="all 10 readings lie on one line of the scan plane"):
        solve_fixed_point(R_tcp, T_tcp, q * [1, 0, 0])
    small = rotation_from_xyz_angles(0.05 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    with pytest.raises(UnobservableError, match="together leave a combination of rotation and translation open"):
        solve_fixed_point(small, T_tcp[:4], q[:4])
