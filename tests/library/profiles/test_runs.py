"""Straight runs of a profile."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from profilecal.profiles.runs import straight_runs


def test_a_run_goes_on_behind_a_gap_and_spikes():
    x = np.linspace(0, 40, 400)
    z = 100 + 0.3 * x
    z[[50, 120, 121]] += 15
    z[200:260] = np.nan
    (run,) = straight_runs(np.column_stack([x, z]))
    assert len(run.rows) == 400 - 3 - 60
    assert run.length == pytest.approx(np.hypot(40, 12), abs=1e-9)
    expected = np.array([1, 0.3]) / np.hypot(1, 0.3)
    assert_allclose(run.direction, expected, atol=1e-12)
