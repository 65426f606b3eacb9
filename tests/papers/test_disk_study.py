"""The fast paths of the disk's noise study equal the plain loop, and say what went
wrong.
"""

import numpy as np
import pytest
from disk_trials import one_by_one
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal_papers import monte_carlo
from profilecal_papers.disk_study import disk_study, fig15_scans

TRIALS = 12
SCANS = fig15_scans((-0.9, 0.3))


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
def test_disk_study_equals_the_plain_loop(noise, heights, sigma, m, monkeypatch):
    """In blocks of 7 trials, and of one."""
    monkeypatch.setattr(monte_carlo, "BLOCK", 70)
    kind = {"noise": noise, "heights": heights}
    study = disk_study(SCANS, sigma, m, TRIALS, default_rng(5), **kind)
    expected = one_by_one(SCANS, sigma, m, TRIALS, default_rng(5), **kind)
    errors = study.centre_error, study.rotation_error, study.translation_error
    found = np.concatenate(errors, axis=-1)[0, 0]
    assert np.abs(expected).max() > 0.01  # there is something to compare
    assert_allclose(found, expected, rtol=0, atol=1e-10)
    assert study.failed.sum() == 0
