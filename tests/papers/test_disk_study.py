"""The fast paths of the disk's noise study equal the plain loop, and say what went
wrong.
"""

import numpy as np
import pytest
from disk_trials import noisy_tips, solved
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.closed_form.disk import sensing_data
from profilecal_papers.disk_study import disk_study, fig15_scans

TRIALS = 12


SCANS = fig15_scans((-0.9, 0.3))


def loop(scans, tips, heights):
    """Centre, rotation and translation errors of one trial, tips (n, m, 2, 2), scan by
    scan.
    """
    scan_by_scan = zip(tips, scans.T_start, scans.T_end, scans.s, strict=True)
    data = [sensing_data(*scan, scans.disk.radius, heights) for scan in scan_by_scan]
    found = solved(scans, data)
    centre = found.translation.q_b - scans.disk.centre
    turn = Rotation.from_matrix(found.R_sensor @ scans.R_sensor.T).as_rotvec()
    return *centre, *turn, *(found.T_sensor - scans.T_sensor)


@pytest.mark.parametrize("m", [5, 40])
@pytest.mark.parametrize(
    ("noise", "heights", "sigma"),
    [
        ("chord", "regression", 0.3),
        ("isotropic", "regression", 0.3),
        ("isotropic", "published", 0.3),
        ("isotropic", "published", 15.0),  # too much: some arccos is impossible
    ],
)
def test_disk_study_equals_the_plain_loop(noise, heights, sigma, m):
    kind = {"noise": noise, "heights": heights}
    study = disk_study(SCANS, sigma, m, TRIALS, default_rng(5), **kind)
    tips = noisy_tips(SCANS, sigma, m, noise, default_rng(5).spawn(1)[0], TRIALS)
    expected = np.array([loop(SCANS, trial, heights) for trial in tips])
    errors = study.centre_error, study.rotation_error, study.translation_error
    found = np.concatenate(errors, axis=-1)[0, 0]
    assert np.abs(expected).max() > 0.01  # there is something to compare
    assert_allclose(found, expected, rtol=0, atol=1e-10)
    assert study.failed.sum() == 0
