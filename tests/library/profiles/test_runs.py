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


def test_a_spike_that_is_on_the_line_behind_a_step_is_no_part_of_the_run():
    """What is farther away has larger x."""
    x, z = np.linspace(0, 40, 400), np.full(400, 100.0)
    x[300:] += 2
    z[300:] = 120
    z[304] = 100
    first, _ = straight_runs(np.column_stack([x, z]))
    assert first.rows[-1] == 299
