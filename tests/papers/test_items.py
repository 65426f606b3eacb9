"""Items: the paper's table with ours beside it, as shown and as data."""

import json
from dataclasses import replace

import numpy as np
import pytest

from profilecal_pages import items
from profilecal_papers import published
from profilecal_papers.comparison import compare

MEAN = "mean of delta d"


def table(ours, half=0.02, **about):
    printed = published.values("edge", "Table 2", MEAN)
    three = ({MEAN: printed + ours + off} for off in (0, -half, half))
    half_of_it = {"half": ({MEAN: printed / 2},) * 3}
    about = {"range_from": "Monte Carlo", "otherwise": half_of_it} | about
    return compare("edge", "Table 2", "distances", *three, **about)


def test_every_verdict_follows_from_the_numbers():
    inside = table(0.01)
    outside = table(0.03, why={MEAN: "drawn too large"}, free="radius")
    assert {inside.verdict(row) for row in inside.rows} == {"reproduced"}
    assert inside.summary.endswith(f"inside our 95 % ranges: {MEAN} 12 of 12.")
    as_list = replace(inside, layout="list").summary
    assert as_list.endswith("If we change one thing, this many agree: half, 0 of 12.")
    assert {outside.verdict(row) for row in outside.rows} == {"differs"}
    assert {row.why for row in outside.rows} == {"drawn too large"}
    assert table(0.01, free="radius").verdict(inside.rows[0]) == "compatible"
    assert outside.rows[0].over_tolerance == pytest.approx(0.03 / (0.02 + 0.005))


def test_what_rounds_to_the_printed_number_is_inside():
    assert table(0.0049, half=0.0).rows[0].inside
    sentence = r"Table 2, G=10, parallel bar, .*: .* differs from 0.27; say why"
    with pytest.raises(ValueError, match=sentence):
        table(0.0062, half=0.0)


def test_what_nothing_makes_fail_does_not_count():
    """Nor what cannot fail, whatever is tried."""
    printed = published.values("edge", "Table 2", MEAN)
    wide = {"wide": tuple({MEAN: printed + end} for end in (0, -1, 1))}
    untried, unmoved = table(0.01, otherwise={}), table(0.01, otherwise=wide)
    for item in (untried, unmoved, table(0.01, apart="a recount of Table 1")):
        assert {item.verdict(row) for row in item.rows} == {"not testable"}
        assert "0.27</b> (✓)" in shown(item, "html")
    some = {"some": ({MEAN: printed + np.array([1.0, 0, 0])},) * 3}
    counted = table(0.01, otherwise=wide | some)
    verdicts = [counted.verdict(row) for row in counted.rows]
    assert verdicts == ["reproduced", "not testable", "not testable"] * 4
    told = items.sentence([("11", counted)])
    assert "4 of 4 are reproduced" in told
    assert "compatible" not in told  # there is none of these
    assert told.startswith("Of 12 printed results 8 could hardly have failed")
    assert items.scorecard([("11", counted)])["would have failed"][0] == "some"


def test_one_reading_of_a_word_counts_for_all_its_items():
    """The one with most agreements, over all items."""

    def read(first, second):
        ours = {(MEAN, "mean"): first, (MEAN, "rms"): second}
        printed = published.values("edge", "Table 2", MEAN)
        three = (
            {key: printed + off + end for key, off in ours.items()}
            for end in (0, -0.01, 0.01)
        )
        about = {"why": dict.fromkeys(ours, "off"), "word": "spread"}
        return compare("edge", "Table 2", "", *three, layout="list", **about)

    one_row_off = 0.1 * np.eye(4, 3)
    pair = [("11", read(0.0, one_row_off)), ("12", read(1.0, 0.0))]
    first, second = items.under_one_reading(pair)
    assert {row.reading for _, item in (first, second) for row in item.rows} == {"rms"}
    assert [sum(item.inside) for _, item in (first, second)] == [9, 12]


def shown(item, kind):
    return item._repr_mimebundle_()[f"text/{kind}"]


def test_a_table_is_shown_as_the_paper_prints_it():
    html = shown(table(0.01, labels={MEAN: "mean(Δd)"}), "html")
    assert "mean(Δd)" in html
    for text in published.entries("edge", "Table 2", MEAN)["printed"]:
        assert f"<b>{text}</b> ✓<br>" in html


def test_what_we_found_once_for_all_columns_is_shown_once():
    """Whatever the sign of the printed number."""
    mean = "mean of delta alpha"
    printed = published.values("edge", "Table 1", mean)
    ours = np.sign(printed) * 1.5
    ends = (ours - 1.25, ours + 1.25)
    low, high = np.minimum(*ends), np.maximum(*ends)
    three = ({mean: numbers} for numbers in (ours, low, high))
    why = {mean: "too narrow"}
    html = shown(compare("edge", "Table 1", "angles", *three, why=why), "html")
    assert html.count("<td>1.50 [0.25, 2.75]</td>") == 4
    assert html.count("<br>") == 0
    assert "<b>−1.03</b> (✓)" in html
    assert "<b>3.10</b> ✗" in html


def pose_within(half):
    """Eq. 49 beside itself."""
    pose = published.values("disk", "Eq. 49", "Lambda")
    three = ({"Lambda": pose + off} for off in (0, -half, half))
    about = {"range_from": "rounding", "layout": "matrix"}
    return compare("disk", "Eq. 49", "pose", *three, **about)


def test_a_matrix_stands_above_ours_and_their_difference():
    lines = shown(pose_within(0.0), "plain").splitlines()
    last = [line.split()[-1] for line in lines[3:-2:4]]
    assert last == ["364.25534", "364.25534", "(0.00000)"]
    below = [line.split() for line in lines[4:-1:4]]
    assert below == [[*"0001"], [*"0001"], [*"0000"]]
    html = shown(pose_within(0.00123), "html")
    assert "<td>(0.00000<br>±0.0012)</td>" in html


def test_a_quantity_read_in_two_ways_stands_twice():
    key = "standard deviation from Eq. 49"
    ours = {
        (key, "mean of the norms"): np.array(0.326),
        (key, "root mean square"): np.array(0.342),
    }
    why = {(key, "mean of the norms"): "the paper computed the other"}
    about = {"why": why, "range_from": "rounding", "layout": "list"}
    found = compare("disk", "Section V-D2", "spread", ours, **about)
    assert [found.verdict(row) for row in found.rows] == ["differs", "not testable"]
    assert "root mean square" in shown(found, "plain")
    assert found.summary == (
        "Printed numbers inside our ranges (rounding): mean of the norms 0 of 1, root "
        "mean square 1 of 1."
    )


def test_read_back_from_a_notebook(tmp_path):
    item = table(0.01)
    data = json.loads(json.dumps(item._repr_mimebundle_()))
    notebook = {"cells": [{"cell_type": "code", "outputs": [{"data": data}]}]}
    (tmp_path / "11.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    gathered = items.gather(tmp_path)
    assert gathered == [("11", item)]
    (line,) = items.tally(gathered).to_dict("records")
    assert (line["paper"], line["item"]) == ("Xu 2021", f"Table 2, {MEAN}")
    assert (line["printed"], line["reproduced"], line["notebook"]) == (12, 12, "11")
    assert line["compatible"] == line["differs"] == 0
    assert items.sentence(gathered).count("12 of 12 are reproduced")
    frame = items.scorecard(gathered)
    assert (frame["verdict"] == "reproduced").all()
    printed = published.entries("edge", "Table 2", MEAN)["printed"]
    assert frame["printed"].tolist() == printed.tolist()
