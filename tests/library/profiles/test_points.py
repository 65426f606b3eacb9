"""Which of a profile's points are there, and how their errors go together."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_array_equal

from profilecal.profiles.points import in_order, present, variance_inflation


def present_at(depths):
    x = np.arange(float(len(depths)))
    return present(np.column_stack([x, depths])).tolist()


def test_zeros_are_missing_points_except_among_depths_near_zero():
    assert present_at([9, 0, 9]) == [True, False, True]
    assert present_at([9, 9, 0, 0]) == [True, True, False, False]
    assert present_at([0.2, 0, -0.1, 0, 0.1]) == [True] * 5
    assert present_at([0.2, 0, np.nan]) == [True, True, False]


X = np.arange(30.0)
FOLDED = np.concatenate([X, X[10:]])


@pytest.mark.parametrize(
    ("x", "rows"),
    [
        (X + 1.5 * (np.arange(30) % 9 == 4), np.argsort(X + 1.5 * (X % 9 == 4))),
        (FOLDED, range(50)),
        (FOLDED[::-1], range(49, -1, -1)),
        (FOLDED[::-7], np.argsort(FOLDED[::-7])),
    ],
    ids=["noisy", "folded", "folded back", "few"],
)
def test_points_are_in_the_order_of_x_but_where_it_folds_back(x, rows):
    assert_array_equal(in_order(np.column_stack([x, 100 + x])), rows)


def test_correlation_enlarges_variances_of_means():
    """Means of k neighbours vary k times as much as of independent errors, less (k -
    1/k)/3 … : moving averages.
    """
    rng = default_rng(9)
    white = rng.normal(size=(2000, 1000))
    factors = [variance_inflation(errors) for errors in white]
    assert np.mean(factors) == pytest.approx(1, abs=0.05)
    five = np.ones(5) / 5
    smooth = np.array([np.convolve(errors, five, "valid") for errors in white])
    actual = smooth.mean(axis=1).var() * smooth.shape[1] / smooth.var()
    factors = [variance_inflation(errors) for errors in smooth]
    assert np.mean(factors) == pytest.approx(actual, rel=4 * np.sqrt(2 / 2000))
