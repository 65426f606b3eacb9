"""The noise-study engine: each fast path equals the plain loop, and the number of workers changes nothing."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from profilecal.closed_form.ball import solve_ball
from profilecal.closed_form.disk import sensing_data, solve_disk
from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.poses import nearest_rotation
from profilecal.papers.ball_study import PROTOCOLS, ball_study
from profilecal.papers.disk_study import DiskScans, disk_study
from profilecal.papers.monte_carlo import rotations_near
from profilecal.papers.settings import fig15_scans, fig17_scans

TRIALS = 12


def scans() -> DiskScans:
    return fig15_scans((-0.9, 0.3))


def loop(scans, tips, heights):
    """Centre, rotation and translation errors of one trial, tips (n, m, 2, 2), scan by scan."""
    data = [
        sensing_data(*scan, scans.disk.radius, heights)
        for scan in zip(tips, scans.T_start, scans.T_end, scans.s, strict=True)
    ]
    fields = (np.array([getattr(d, name) for d in data]) for name in ("T_tcp", "q", "D_i", "D_b"))
    found = solve_disk(scans.R_tcp, *fields)
    centre = found.translation.q_b - scans.disk.centre
    turn = Rotation.from_matrix(found.R_sensor @ scans.R_sensor.T).as_rotvec()
    return *centre, *turn, *(found.T_sensor - scans.T_sensor)


def noisy_tips(scans, sigma, m, noise, rng, trials=TRIALS):
    """The tips (trials, n, m, 2, 2) that the engine's stream stands for, put together as Eq. 52 says."""
    exact = scans.tips(m)
    tips = np.repeat(exact[None], trials, axis=0)
    along = (exact[:, :, 1] - exact[:, :, 0]) / np.linalg.norm(exact[:, :, 1] - exact[:, :, 0], axis=-1, keepdims=True)
    for i in range(len(exact)):
        if noise == "chord":
            tips[:, i] += sigma * rng.standard_normal((trials, 2, m, 1)).swapaxes(1, 2) * along[i][:, None]
        else:
            x, z = sigma * rng.standard_normal((trials, 2, 2, m, 1)).swapaxes(0, 1)  # along and across the chord
            across = np.stack([-along[i, :, 1], along[i, :, 0]], axis=-1)
            tips[:, i] += (x * along[i] + z * across).swapaxes(1, 2)
    return tips


@pytest.mark.parametrize("m", [5, 40])
@pytest.mark.parametrize(
    ("noise", "heights"), [("chord", "regression"), ("isotropic", "regression"), ("isotropic", "published")]
)
def test_disk_study_equals_the_plain_loop(noise, heights, m):
    scene, sigma = scans(), 0.3
    study = disk_study(scene, sigma, m, TRIALS, np.random.default_rng(5), noise=noise, heights=heights, workers=1)
    tips = noisy_tips(scene, sigma, m, noise, np.random.default_rng(5).spawn(1)[0])
    expected = np.array([loop(scene, trial, heights) for trial in tips])
    found = np.column_stack([study.centre_error[0, 0], study.rotation_error[0, 0], study.translation_error[0, 0]])
    assert np.abs(expected).max() > 0.01  # there is something to compare
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    assert study.failed.sum() == study.by_svd.sum() == 0


@pytest.mark.parametrize("fit", ["taubin", "kasa"])
def test_ball_study_equals_the_plain_loop(fit):
    scene, sigma, m = fig17_scans(), 0.3, 3
    study = ball_study(scene, sigma, [1, m], 4, np.random.default_rng(6), fit=fit, workers=1)
    rng = np.random.default_rng(6).spawn(1)[0]
    q = np.empty((4, len(scene.R_tcp), m, 3))
    for (i, j), side in np.ndenumerate(np.repeat(scene.side[:, None], m, axis=1)):
        cx, cz, r = scene.circles(m)[i, j]
        x = scene.x_seen((cx, cz, r))
        z = cz + np.sqrt(r**2 - (x - cx) ** 2) + sigma * rng.standard_normal((4, len(x)))
        circle = fit_circle(np.stack(np.broadcast_arrays(x, z), axis=-1), fit)
        q[:, i, j] = scene.ball.centre_from_circle(circle, side)
    T = scene.positions(m)
    for protocol, of_rotation in zip(PROTOCOLS, (1, m), strict=True):
        arcs = np.where(np.arange(len(T)) < scene.translating, of_rotation, m)
        T_mean = np.array([T[i, :k].mean(axis=0) for i, k in enumerate(arcs)])
        for trial in range(4):
            q_mean = np.array([q[trial, i, :k].mean(axis=0) for i, k in enumerate(arcs)])
            found = solve_ball(scene.R_tcp, T_mean, q_mean, scene.translating)
            expected = found.translation.q_b - scene.ball.centre
            np.testing.assert_allclose(study[protocol].centre_error[0, 1, trial], expected, rtol=0, atol=1e-10)


def test_the_number_of_workers_changes_nothing():
    def run(workers):
        disk = disk_study(scans(), [0.1, 0.9], [10, 30], 1200, np.random.default_rng(7), workers=workers)
        ball = ball_study(fig17_scans(), 0.2, [1, 2], 600, np.random.default_rng(8), workers=workers)
        return [disk.errors, disk.clipped, *(study.errors for study in ball.values())]

    alone, two, five = run(1), run(2), run(5)
    assert all(np.array_equal(a, b) and np.array_equal(a, c) for a, b, c in zip(alone, two, five, strict=True))


def test_a_large_study_stays_under_500_mb():
    tracemalloc.start()
    disk_study(scans(), [0.4], [1000], 5000, np.random.default_rng(9), noise="isotropic")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 500e6


def test_impossible_arccos_is_counted_not_hidden():
    scene, sigma = scans(), 10.0  # mm: beyond what any scanner does
    kind = {"noise": "isotropic", "heights": "published"}
    study = disk_study(scene, sigma, 10, 500, np.random.default_rng(10), workers=1, **kind)
    tips = noisy_tips(scene, sigma, 10, "isotropic", np.random.default_rng(10).spawn(1)[0], 500)
    plain = sensing_data(tips, scene.T_start, scene.T_end, scene.s, scene.disk.radius, "published")
    assert study.clipped[0, 0] == plain.clipped.any(axis=1).sum() > 0
    assert np.isfinite(study.centre_error).all()


def test_quaternion_equals_svd_and_turns_it_cannot_take_go_to_the_svd():
    rng = np.random.default_rng(12)
    X = rng.normal(size=(500, 4, 3))
    X /= np.linalg.norm(X, axis=-1, keepdims=True)
    angle = np.where(np.arange(500) < 250, rng.uniform(0, 1.5, 500), rng.uniform(1.6, np.pi, 500))
    axis = rng.normal(size=(500, 3))
    turn = Rotation.from_rotvec(angle[:, None] * axis / np.linalg.norm(axis, axis=1, keepdims=True)).as_matrix()
    Y = X @ turn.transpose(0, 2, 1) + 0.01 * rng.normal(size=X.shape)
    Y /= np.linalg.norm(Y, axis=-1, keepdims=True)
    found, by_svd = rotations_near(np.einsum("kna,knb->abk", Y, X), 4)
    found = np.moveaxis(found, -1, 0)
    expected = nearest_rotation(np.einsum("kna,knb->kab", Y, X))
    np.testing.assert_allclose(found, expected, atol=1e-11)
    assert by_svd[angle > 1.65].all()
    assert not by_svd[angle < 1.5].any()
