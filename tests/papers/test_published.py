import numpy as np
import pytest

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
    assert set(published.table("disk").query("role == 'input'")["item"]) == {
        "Table I",
        "Table III",
        "Table IV",
    }


def test_rotations_and_unit_vectors_are_what_they_should_be_within_their_digits():
    for item, name in (("Eq. 49", "Lambda"), ("Eq. 53", "Upsilon")):
        R = published.values("disk", item, name)[:, :3]
        assert np.abs(R @ R.T - np.eye(3)).max() < 4e-5
    for name in ("D_i", "D_b"):
        assert (
            np.abs(
                np.linalg.norm(published.values("disk", "Table I", name), axis=1) - 1
            ).max()
            < 1e-3
        )


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
    drawn = box.draw(500, np.random.default_rng(1))
    printed = published.values("disk", "Table I", "q")
    assert drawn["q"].shape == (500, 4, 3)
    np.testing.assert_array_equal(
        drawn["q"].round(3), np.broadcast_to(printed, drawn["q"].shape)
    )
    np.testing.assert_array_equal(box.at(np.zeros(box.size))["q"], printed)
    np.testing.assert_array_equal(
        np.ptp(drawn["q"], axis=0) > 0, np.tile([True, False, True], (4, 1))
    )  # y is exact


def test_reach_finds_a_place_where_there_is_one_and_says_how_far_out_another_is():
    box = published.RoundingBox("disk", "Table I", ("q",))
    place = np.random.default_rng(2).uniform(-0.9, 0.9, box.size)
    total = lambda t: t["q"].sum(axis=-2)  # noqa: E731
    found, size = box.reach(total, total(box.at(place)), np.full(3, 1e-6))
    np.testing.assert_allclose(
        total(box.at(found)), total(box.at(place)), rtol=0, atol=1e-6
    )
    assert np.abs(found).max() == size <= 0.9
    four_rows = total(box.at(np.zeros(box.size))) + 4 * 0.0005 * np.array([0, 0, 5])
    assert box.reach(total, four_rows, np.full(3, 1e-6))[1] == pytest.approx(
        5, abs=1e-3
    )
    assert np.isinf(
        box.reach(lambda t: 0 * total(t), total(box.at(place)) + 1, np.full(3, 1e-6))[1]
    )


def test_of_several_values_the_largest_is_brought_to_its_target():
    box = published.RoundingBox("disk", "Table I", ("q",))
    x = lambda t: (
        1000 * (t["q"][..., 0] - published.values("disk", "Table I", "q")[:, 0])
    )
    found, size = box.reach(x, [0.25], [0.01], largest_of=4)
    assert x(box.at(found)).max() == pytest.approx(0.25, abs=0.01)
    assert size == pytest.approx(0.5, abs=0.02)


def test_the_least_change_of_a_curved_value_is_found_and_none_where_it_suffices():
    """Of all points at distance 5, the one reached by equal steps takes the smallest
    largest step.
    """
    start, square = np.array([0.1, 0.2, 0.3, 0.4]), np.array([25.0])
    x, size = published.least_change(
        lambda x: ((start + x) ** 2).sum(axis=-1)[..., None], square, square + 1e-6, 4
    )
    assert ((start + x) ** 2).sum() == pytest.approx(25, abs=2e-6)
    assert size == pytest.approx(np.roots([4, 2, 0.3 - 25]).max(), rel=1e-4)
    assert published.least_change(lambda x: x, np.full(3, -0.1), np.full(3, 0.1), 3)[
        1
    ] == pytest.approx(0, abs=1e-9)
