"""Straight runs of a profile, from either end."""

import numpy as np
import pytest

from profilecal.profiles.runs import straight_runs


def test_a_run_goes_on_behind_a_gap_and_spikes():
    x = np.linspace(0, 40, 400)
    z = 100 + 0.3 * x
    z[[50, 120, 121]] += 15
    z[200:260] = np.nan
    ((run,), _) = straight_runs(np.column_stack([x, z]))
    assert len(run.rows) == 400 - 3 - 60
    assert run.length == pytest.approx(np.hypot(40, 12), abs=1e-9)
    np.testing.assert_allclose(run.direction, np.array([1, 0.3]) / np.hypot(1, 0.3), atol=1e-12)


def test_a_run_is_the_same_from_its_other_end():
    profile = np.column_stack([np.linspace(0, 40, 400), np.random.default_rng(1).normal(100, 0.05, 400)])
    ((run,), _) = straight_runs(profile)
    other = run.reversed()
    np.testing.assert_array_equal(other.points, run.points[::-1])
    np.testing.assert_array_equal(other.along, -run.along[::-1])
    np.testing.assert_array_equal(other.direction, -run.direction)
    ((seen,), _) = straight_runs(profile[::-1])
    np.testing.assert_array_equal(seen.rows, other.rows)
    np.testing.assert_allclose(seen.off, other.off, rtol=0, atol=1e-12)
