"""The numbers that the papers print, and what their rounding allows."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal

from profilecal_papers import published


def test_shapes_and_digits():
    assert published.values("disk", "Table I", "T_tcp").shape == (4, 3)
    assert published.values("disk", "Table IV", "nu from Eq. 53").shape == (9, 3)
    assert published.values("disk", "Eq. 49", "Lambda").shape == (3, 4)
    assert published.values("disk", "Eq. 51", "accuracy") == 0.212
    assert published.values("edge", "Table 1", "mean of delta alpha").shape == (4, 3)
    assert published.half_unit("disk", "Table I", "R_tcp") == pytest.approx(0.0005)


@pytest.mark.parametrize("paper", published.FILES)
def test_every_number_is_printed_with_no_more_digits_than_stated(paper):
    table = published.table(paper)
    digits = table["printed"].str.partition(".")[2].str.len()
    exact = table["decimals"] == ""
    assert (table.loc[exact, "printed"] == "0").all()
    assert (digits <= table["decimals"].mask(exact, "0").astype(int)).all()
    assert not table.duplicated(["item", "quantity", "row", "component"]).any()


def test_inputs_of_the_disk_paper_are_its_tables_of_measurements():
    inputs = published.table("disk").query("role == 'input'")
    assert set(inputs["item"]) == {"Table I", "Table III", "Table IV"}


def test_rotations_and_unit_vectors_are_what_they_should_be_within_their_digits():
    for item, name in (("Eq. 49", "Lambda"), ("Eq. 53", "Upsilon")):
        R = published.values("disk", item, name)[:, :3]
        assert np.abs(R @ R.T - np.eye(3)).max() < 4e-5
    for name in ("D_i", "D_b"):
        lengths = np.linalg.norm(published.values("disk", "Table I", name), axis=1)
        assert_allclose(lengths, 1, rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        (("dsk", "Table I", "q"), "paper is 'dsk'; expected one of disk, edge"),
        (
            ("disk", "Table V", "q"),
            "the disk paper has no 'Table V'; there are Table I, ",
        ),
        (("disk", "Table I", "p"), "Table I has no 'p'; there are T_tcp, R_tcp, q"),
    ],
)
def test_what_is_not_there_is_named_with_what_is(entry, sentence):
    with pytest.raises(ValueError, match=sentence):
        published.values(*entry)


def test_the_rounding_box_holds_the_tables_that_print_alike():
    box = published.RoundingBox("disk", "Table I", ("q", "R_tcp"))
    drawn = box.draw(500, default_rng(1))
    printed = published.values("disk", "Table I", "q")
    assert drawn["q"].shape == (500, 4, 3)
    assert (drawn["q"].round(3) == printed).all()
    assert_array_equal(box.at(np.zeros(box.size))["q"], printed)
    x, y, z = np.ptp(drawn["q"], axis=0).T
    assert (x > 0).all()
    assert (y == 0).all()  # by definition
    assert (z > 0).all()


def sums(tables):
    return tables["q"].sum(axis=-2)


def test_reach_finds_a_place_where_there_is_one_and_says_how_far_out_another_is():
    box = published.RoundingBox("disk", "Table I", ("q",))
    near = np.full(3, 1e-6)
    place = default_rng(2).uniform(-0.9, 0.9, box.size)
    target = sums(box.at(place))
    found, change = box.reach(sums, target, near)
    assert_allclose(sums(box.at(found)), target, rtol=0, atol=1e-6)
    assert np.abs(found).max() == change <= 0.9

    # z of four rows, each five half units off
    beyond = sums(box.at(np.zeros(box.size)))
    beyond[2] += 4 * 5 * 0.0005
    _, change = box.reach(sums, beyond, near)
    assert change == pytest.approx(5, abs=1e-3)

    _, change = box.reach(lambda tables: 0 * sums(tables), target + 1, near)
    assert np.isinf(change)


def test_of_several_values_the_largest_is_brought_to_its_target():
    box = published.RoundingBox("disk", "Table I", ("q",))
    printed = published.values("disk", "Table I", "q")

    def change_of_x(tables):
        """In micrometres."""
        return 1000 * (tables["q"][..., 0] - printed[:, 0])

    found, change = box.reach(change_of_x, [0.25], [0.01], largest_of=4)
    assert change_of_x(box.at(found)).max() == pytest.approx(0.25, abs=0.01)
    assert change == pytest.approx(0.5, abs=0.02)


def test_the_least_change_of_a_curved_value_is_found():
    """Of all points at distance 5, the one reached by equal steps takes the smallest
    largest step.
    """
    start = np.array([0.1, 0.2, 0.3, 0.4])
    low = np.array([25.0])

    def square(x):
        return ((start + x) ** 2).sum(axis=-1)[..., None]

    x, change = published.least_change(square, low, low + 1e-6, 4)
    assert square(x) == pytest.approx(25, abs=2e-6)
    equal_steps = np.roots([4, 2, 0.3 - 25]).max()
    assert change == pytest.approx(equal_steps, rel=1e-4)


def test_where_no_change_is_needed_the_least_change_is_none():
    ends = np.full(3, -0.1), np.full(3, 0.1)
    _, change = published.least_change(lambda x: x, *ends, 3)
    assert change == pytest.approx(0, abs=1e-9)
