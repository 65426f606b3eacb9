import numpy as np
import pytest
import sensing_data as scenes

from profilecal.closed_form.disk import disk_equations, solve_disk
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.poses import angle_between, nearest_rotation, rotation_from_xyz_angles
from profilecal.papers import published


@pytest.fixture
def data():
    return scenes.disk_data(np.random.default_rng(5))[1]


def table_I():
    table = {name: published.values("disk", "Table I", name) for name in ("R_tcp", "T_tcp", "q", "D_i", "D_b")}
    return rotation_from_xyz_angles(table.pop("R_tcp")), *table.values()


@pytest.mark.parametrize("poses", [3, 4, 8])
@pytest.mark.parametrize("pairs", ["consecutive", "first", "all"])
def test_noise_free_data_give_the_answer_exactly(poses, pairs):
    rng = np.random.default_rng(poses)
    for _ in range(200):
        (R_sensor, T_sensor), data = scenes.disk_data(rng, poses)
        solution = solve_disk(*data, pairs=pairs)
        assert angle_between(solution.R_sensor, R_sensor) < 1e-12
        assert np.linalg.norm(solution.T_sensor - T_sensor) < 1e-10
        assert solution.translation.accuracy < 1e-10


def test_table_I_gives_equations_49_to_51():
    Lambda = published.values("disk", "Eq. 49", "Lambda")
    solution = solve_disk(*table_I())
    assert np.degrees(angle_between(solution.R_sensor, nearest_rotation(Lambda[:, :3]))) < 0.07
    assert np.linalg.norm(solution.T_sensor - Lambda[:, 3]) < 0.30
    assert np.linalg.norm(solution.translation.q_b - published.values("disk", "Eq. 50", "q_b")) < 0.20
    assert 0.19 < solution.translation.accuracy < 0.21


def test_the_paper_quantities_satisfy_their_equations(data):
    solution = solve_disk(*data)
    r, t = solution.rotation, solution.translation
    np.testing.assert_allclose(r.U * r.S @ r.V.T, r.H, atol=1e-12)
    np.testing.assert_allclose(r.R_sensor @ r.X, r.Y, atol=1e-12)
    np.testing.assert_allclose(t.M @ t.T_sensor, t.N, atol=1e-10)
    np.testing.assert_allclose(t.q_b_i.mean(axis=0), t.q_b)


def test_a_batch_equals_its_members():
    rng = np.random.default_rng(6)
    members = [scenes.disk_data(rng)[1] for _ in range(5)]
    noisy = [(*m[:2], m[2] + rng.normal(size=m[2].shape), *m[3:]) for m in members]
    batch = disk_equations(*(np.stack(arrays) for arrays in zip(*noisy, strict=True)))
    for k, member in enumerate(noisy):
        np.testing.assert_allclose(batch.flat()[k], solve_disk(*member).flat(), rtol=1e-12, atol=1e-10)


def test_coplanar_directions_give_reflections_as_printed_and_rotations_as_corrected():
    rng = np.random.default_rng(7)
    printed = []
    for _ in range(200):
        (R_sensor, _), (R_tcp, T_tcp, q, D_i, _) = scenes.disk_data(rng)
        D_i = D_i - D_i.mean(axis=0)
        U, S, Vt = np.linalg.svd(D_i, full_matrices=False)
        D_i = U[:, :2] * S[:2] @ Vt[:2]
        D_b = np.einsum("nab,bc,nc->na", R_tcp, R_sensor, D_i) + rng.normal(scale=0.1, size=D_i.shape)
        printed.append(np.linalg.det(disk_equations(R_tcp, T_tcp, q, D_i, D_b, proper=False).R_sensor))
        assert np.degrees(angle_between(solve_disk(R_tcp, T_tcp, q, D_i, D_b).R_sensor, R_sensor)) < 1
    assert 70 < np.sum(np.array(printed) < 0) < 130  # half of 200, within more than four standard deviations


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda d: [a[:2] for a in d], "disk sensing data: 2 given, at least 3 needed"),
        (lambda d: [d[0][:3], *d[1:]], "R_tcp has 3 matrices; expected 4"),
        (lambda d: [d[0], d[1][:, :2], *d[2:]], r"T_tcp has shape \(4, 2\); expected \(n, 3\)"),
        (lambda d: [-d[0], *d[1:]], r"R_tcp\[0\] is a reflection"),
        (lambda d: [d[0] * 1.01, *d[1:]], r"R_tcp\[0\] is not orthonormal: R Rᵀ differs from the identity by 0.02"),
        (lambda d: [d[0], d[1], np.where(np.eye(4, 3) > 0, np.nan, d[2]), *d[3:]], "q row 0 is .*expected finite"),
        (lambda d: [d[0] * np.nan, *d[1:]], r"R_tcp\[0\] holds a value that is not finite"),
        (lambda d: [*d[:3], d[3] * [[0], [1], [1], [1]], d[4]], "D_i 0 has zero length"),
    ],
)
def test_malformed_input_is_refused_in_words(data, change, sentence):
    with pytest.raises(ValueError, match=sentence):
        solve_disk(*change(data))


@pytest.mark.parametrize("sigma", [0, 1e-4])
def test_poses_that_cannot_determine_the_answer_are_refused_with_noise_too(data, sigma):
    rng = np.random.default_rng(8)
    R_tcp, T_tcp, q, D_i, D_b = data
    wobble = rotation_from_xyz_angles(rng.normal(scale=sigma, size=(4, 3)))
    with pytest.raises(UnobservableError, match="all 4 poses have one orientation"):
        solve_disk(R_tcp[[0, 0, 0, 0]] @ wobble, T_tcp, q, D_i, D_b)
    about_z = rotation_from_xyz_angles([[0, 0, 0], [0, 0, 0.5], [0, 0, 1], [0, 0, 1.5]])
    with pytest.raises(UnobservableError, match=r"turn about one axis, \[.*1.*\] of the flange"):
        solve_disk(about_z @ wobble, T_tcp, q, D_i, D_b)
    with pytest.raises(UnobservableError, match="D_i: all 4 are parallel"):
        solve_disk(R_tcp, T_tcp, q, D_i[[0, 0, 0, 0]] + rng.normal(scale=sigma, size=(4, 3)), D_b)


def test_an_unknown_set_of_pairs_is_refused(data):
    with pytest.raises(ValueError, match="pairs is 'some'; expected 'consecutive', 'first' or 'all'"):
        solve_disk(*data, pairs="some")
