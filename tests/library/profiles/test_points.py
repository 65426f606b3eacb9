"""Which of a profile's points are there, and how their errors go together."""

import numpy as np
import pytest
from numpy.random import default_rng

from profilecal.profiles.points import correlation, present


def present_at(depths):
    x = np.arange(float(len(depths)))
    return present(np.column_stack([x, depths])).tolist()


def test_zeros_are_missing_points_except_among_depths_near_zero():
    assert present_at([9, 0, 9]) == [True, False, True]
    assert present_at([9, 9, 0, 0]) == [True, True, False, False]
    assert present_at([0.2, 0, -0.1, 0, 0.1]) == [True] * 5
    assert present_at([0.2, 0, np.nan]) == [True, True, False]


def test_correlation_enlarges_variances_of_means():
    """Means of k neighbours vary k times as much as of independent errors, less (k -
    1/k)/3 … : moving averages.
    """
    rng = default_rng(9)
    white = rng.normal(size=(200, 1000))
    factors = [correlation(errors) for errors in white]
    assert np.mean(factors) == pytest.approx(1, abs=0.05)
    five = np.ones(5) / 5
    smooth = np.array([np.convolve(errors, five, "valid") for errors in white])
    actual = smooth.mean(axis=1).var() * smooth.shape[1] / smooth.var()
    factors = [correlation(errors) for errors in smooth]
    assert np.mean(factors) == pytest.approx(actual, rel=4 * np.sqrt(2 / 200))
