"""The fast paths of the disk's noise study equal the plain loop, and say what went
wrong.
"""

import tracemalloc

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.closed_form.disk import disk_equations, sensing_data
from profilecal_papers.disk_study import DiskScans, disk_study, fig15_scans

TRIALS = 12


def scans() -> DiskScans:
    return fig15_scans((-0.9, 0.3))


def loop(scans, tips, heights):
    """Centre, rotation and translation errors of one trial, tips (n, m, 2, 2), scan by
    scan.
    """
    scan_by_scan = zip(tips, scans.T_start, scans.T_end, scans.s, strict=True)
    data = [sensing_data(*scan, scans.disk.radius, heights) for scan in scan_by_scan]
    T_tcp = np.array([scan.T_tcp for scan in data])
    q = np.array([scan.q for scan in data])
    D_i = np.array([scan.D_i for scan in data])
    D_b = np.array([scan.D_b for scan in data])
    found = disk_equations(scans.R_tcp, T_tcp, q, D_i, D_b)
    centre = found.translation.q_b - scans.disk.centre
    turn = Rotation.from_matrix(found.R_sensor @ scans.R_sensor.T).as_rotvec()
    return *centre, *turn, *(found.T_sensor - scans.T_sensor)


def noisy_tips(scans, sigma, m, noise, rng, trials=TRIALS):
    """The tips (trials, n, m, 2, 2) that the engine's stream stands for, put together
    as Eq. 52 says.
    """
    exact = scans.tips(m)
    chords = exact[:, :, 1] - exact[:, :, 0]
    directions = chords / np.linalg.norm(chords, axis=-1, keepdims=True)
    tips = np.repeat(exact[None], trials, axis=0)
    for i, along in enumerate(directions):
        if noise == "chord":
            u = sigma * rng.standard_normal((trials, 2, m, 1))
            moved = u * along
        else:
            u, v = sigma * rng.standard_normal((trials, 2, 2, m, 1)).swapaxes(0, 1)
            across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
            moved = u * along + v * across
        tips[:, i] += moved.swapaxes(1, 2)
    return tips


@pytest.mark.parametrize("m", [5, 40])
@pytest.mark.parametrize(
    ("noise", "heights"),
    [("chord", "regression"), ("isotropic", "regression"), ("isotropic", "published")],
)
def test_disk_study_equals_the_plain_loop(noise, heights, m):
    scene, sigma, rng = scans(), 0.3, default_rng(5)
    kind = {"noise": noise, "heights": heights}
    study = disk_study(scene, sigma, m, TRIALS, rng, workers=1, **kind)
    tips = noisy_tips(scene, sigma, m, noise, default_rng(5).spawn(1)[0])
    expected = np.array([loop(scene, trial, heights) for trial in tips])
    errors = study.centre_error, study.rotation_error, study.translation_error
    found = np.concatenate(errors, axis=-1)[0, 0]
    assert np.abs(expected).max() > 0.01  # there is something to compare
    assert_allclose(found, expected, rtol=0, atol=1e-10)
    assert study.failed.sum() == 0


def test_a_large_study_stays_under_500_mb():
    rng = default_rng(9)
    tracemalloc.start()
    disk_study(scans(), [0.4], [1000], 5000, rng, noise="isotropic")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 500e6


def test_an_impossible_arccos_leaves_a_finite_result():
    scene, rng = scans(), default_rng(10)
    sigma = 10.0  # mm: beyond what any scanner does
    kind = {"noise": "isotropic", "heights": "published"}
    study = disk_study(scene, sigma, 10, 500, rng, workers=1, **kind)
    (stream,) = default_rng(10).spawn(1)
    tips = noisy_tips(scene, sigma, 10, "isotropic", stream, 500)
    way = scene.T_start, scene.T_end, scene.s
    plain = sensing_data(tips, *way, scene.disk.radius, "published")
    assert plain.clipped.any()
    assert np.isfinite(study.centre_error).all()
