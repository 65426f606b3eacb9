"""Which of a profile's points are there, and how their errors go together."""

import numpy as np
import pytest

from profilecal.profiles.points import correlation, present


def test_zeros_are_missing_points_except_among_depths_near_zero():
    x = np.arange(6.0)
    assert present(np.column_stack([x, [9, 0, 9, 9, 0, 0]])).tolist() == [
        True,
        False,
        True,
        True,
        False,
        False,
    ]
    assert present(np.column_stack([x, [0.2, 0, -0.1, 0, 0.1, np.nan]])).tolist() == [
        True
    ] * 5 + [False]


def test_correlation_enlarges_variances_of_means():
    """Means of k neighbours vary k times as much as of independent errors, less (k -
    1/k)/3 … : moving averages.
    """
    rng = np.random.default_rng(9)
    white = rng.normal(size=(200, 1000))
    assert np.mean([correlation(e) for e in white]) == pytest.approx(1, abs=0.05)
    smooth = np.array([np.convolve(e, np.ones(5) / 5, "valid") for e in white])
    actual = smooth.mean(axis=1).var() * smooth.shape[1] / smooth.var()
    assert np.mean([correlation(e) for e in smooth]) == pytest.approx(
        actual, rel=4 * np.sqrt(2 / 200)
    )
