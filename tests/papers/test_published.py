"""The numbers that the papers print, and what their rounding allows."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal

from profilecal_papers import published

BOX = published.RoundingBox("disk", "Table I", ("q",))
HALF = published.half_unit("disk", "Table I", "q")
PRINTED = published.values("disk", "Table I", "q")


def test_the_rounding_box_holds_the_tables_that_print_alike():
    box = published.RoundingBox("disk", "Table I", ("q", "R_tcp"))
    drawn = box.draw(500, default_rng(1))["q"]
    assert drawn.shape == (500, 4, 3)
    assert (drawn.round(3) == PRINTED).all()
    assert_array_equal(box.at(np.zeros(box.size))["q"], PRINTED)
    free = np.ptp(drawn, axis=0) > 1.5 * HALF
    assert (free == [True, False, True]).all()  # y is zero by definition


def sums(tables):
    return tables["q"].sum(axis=-2)


def test_reach_finds_a_place_where_there_is_one_and_says_how_far_out_another_is():
    near = np.full(3, 1e-6)
    target = sums(BOX.at(default_rng(2).uniform(-0.9, 0.9, BOX.size)))
    found, change = BOX.reach(sums, target, near)
    assert_allclose(sums(BOX.at(found)), target, rtol=0, atol=1e-6)
    assert np.abs(found).max() == change <= 0.9
    beyond = (PRINTED + np.array([0, 0, 5 * HALF])).sum(axis=0)
    assert BOX.reach(sums, beyond, near)[1] == pytest.approx(5, abs=1e-3)
    assert np.isinf(BOX.reach(lambda tables: 0 * sums(tables), target + 1, near)[1])
