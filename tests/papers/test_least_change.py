"""The search for the least change: right where the answer is known, linear or curved, reachable or not."""

import numpy as np
import pytest

from profilecal.papers.published import least_change


def test_a_linear_system_takes_what_its_norm_says():
    """Of all x with a·x = 1 the largest entry is at least 1 / sum |a|."""
    a = np.random.default_rng(1).normal(size=30)
    x, size = least_change(lambda x: (x @ a)[..., None], np.array([1.0]), np.array([1.0 + 1e-6]), 30)
    assert size == pytest.approx(1 / np.abs(a).sum(), rel=1e-5)
    assert 1 <= x @ a <= 1 + 1e-6


def test_a_curved_one_is_followed():
    """Of all points at distance 5, the one reached by equal steps takes the smallest largest step."""
    start = np.array([0.1, 0.2, 0.3, 0.4])
    x, size = least_change(lambda x: ((start + x) ** 2).sum(axis=-1)[..., None], *ends(25, 1e-6), 4)
    assert ((start + x) ** 2).sum() == pytest.approx(25, abs=1e-6)
    assert size == pytest.approx(np.roots([4, 2, 0.3 - 25]).max(), rel=1e-4)


def test_what_lies_inside_already_needs_no_change():
    _, size = least_change(lambda x: x, *ends(np.zeros(3), 0.1), 3)
    assert size == pytest.approx(0, abs=1e-9)


def test_a_value_that_cannot_be_had_is_infinitely_far():
    assert np.isinf(least_change(lambda x: (x**2).sum(axis=-1)[..., None], *ends(-1, 0.1), 2)[1])


def ends(target, unit):
    """An interval about a target."""
    return np.atleast_1d(target) - unit, np.atleast_1d(target) + unit
