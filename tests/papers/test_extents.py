"""The fit of Fig. 15's unpublished extents: chance is stated rightly, and the line found is where e comes out right."""

import numpy as np
import pytest

from profilecal.papers.extents import (
    PAPER_TRIALS,
    errors_at,
    misfit,
    printed_values,
    relative_error,
    scale_off,
    where_it_crosses,
)
from profilecal.papers.settings import READINGS

STD = "standard deviation of the norms"


def test_the_four_printed_values_are_read():
    printed = printed_values()
    assert list(printed["m"]) == [100, 100, 10, 200]
    assert list(printed["sigma_mm"]) == [0.1, 0.9, 0.4, 0.4]
    assert list(printed["published"]) == [0.052, 0.449, 0.591, 0.135]
    assert (printed["half_unit"] == 0.0005).all()


@pytest.mark.parametrize("reading", READINGS)
def test_relative_error_is_the_scatter_of_a_reading(reading):
    errors = np.random.default_rng(1).normal([0.3, 0, 0], [1, 0.5, 2], (2000, 200, 3))
    values = READINGS[reading](errors)
    stated = relative_error(reading, errors.reshape(-1, 3), 200)
    np.testing.assert_allclose(stated, values.std() / values.mean(), rtol=0.1)  # 1.6 % by chance, and its own bias


def test_misfit_is_zero_where_the_ratios_are_met_whatever_the_scale():
    printed = printed_values()
    unit = np.random.default_rng(2).normal(size=(4, 5000, 3))
    errors = unit * (printed["published"].to_numpy() / READINGS[STD](unit))[:, None, None]
    assert misfit(STD, errors, printed) < 1e-20
    assert misfit(STD, 1.1 * errors, printed) < 1e-20
    assert misfit(STD, errors * np.array([1.2, 1, 1, 1])[:, None, None], printed) > 10


def test_the_level_of_the_map_is_that_of_many_trials():
    printed, extent = printed_values(), (-0.8, 0.4)
    errors = errors_at(extent, printed, PAPER_TRIALS, 3)
    tried = np.array([-0.9, -0.85, -0.8, -0.75]), np.array([0.3, 0.35, 0.4, 0.45])
    first, last, off = scale_off(*tried, extent, errors, printed, 50, 4, fine=16)
    for reading, spread in READINGS.items():
        direct = np.log(spread(errors) / printed["published"].to_numpy()).mean()
        (at,) = off[reading][np.isclose(first, -0.8)][:, np.isclose(last, 0.4)].ravel()
        np.testing.assert_allclose(at, direct, atol=1e-12)


def test_crossings():
    assert where_it_crosses(np.array([0.0, 1.0, 2.0]), np.array([2.0, 1.0, -1.0])) == 1.5
    assert np.isnan(where_it_crosses(np.array([0.0, 1.0]), np.array([2.0, 1.0])))
