"""Items: the paper's table with ours beside it, as shown and as data."""

import json

import numpy as np
import pytest

from profilecal_pages import items
from profilecal_papers import published
from profilecal_papers.comparison import compare

MEAN = "mean of delta d"


def within(quantity, ours, half, **about):
    """A quantity of Table 2 beside ours, as far off, with a range of ±half."""
    printed = published.values("edge", "Table 2", quantity)
    three = [printed + ours + off for off in (0, -half, half)]
    about = {"range_from": "Monte Carlo"} | about
    return compare("edge", "Table 2", "distances", {quantity: three}, **about)


def table(ours, half=0.02, **about):
    half_of_it = {MEAN: [published.values("edge", "Table 2", MEAN) / 2] * 3}
    return within(MEAN, ours, half, **{"otherwise": {"half": half_of_it}} | about)


def test_every_verdict_follows_from_the_numbers():
    inside = table(0.01)
    outside = table(0.03, why="drawn too large", free="radius")
    assert {*inside.verdicts} == {"reproduced"}
    assert inside.summary == (
        "Inside our ranges (Monte Carlo): 12 of 12. If we change one thing: half, "
        "0 of 12."
    )
    assert {*outside.verdicts} == {"differs"}
    assert {row.why for row in outside.rows} == {"drawn too large"}
    assert outside.summary.endswith("Free settings: radius. ✗: drawn too large.")
    assert table(0.01, free="radius").verdicts[0] == "compatible"
    assert outside.rows[0].over_tolerance == pytest.approx(0.03 / (0.02 + 0.005))


def test_what_rounds_to_the_printed_number_is_inside():
    assert table(0.0049, half=0.0).rows[0].inside
    assert not table(0.0062, half=0.0).rows[0].inside


def test_what_nothing_makes_fail_does_not_count():
    """Nor what cannot fail, whatever is tried."""
    printed = published.values("edge", "Table 2", MEAN)
    wide = {"wide": {MEAN: [printed, printed - 1, printed + 1]}}
    untried, unmoved = table(0.01, otherwise={}), table(0.01, otherwise=wide)
    for item in (untried, unmoved, table(0.01, apart="a recount of Table 1")):
        assert {*item.verdicts} == {"not testable"}
        assert "0.27</b> (✓)" in shown(item, "html")
    some = {"some": {MEAN: [printed + np.array([1.0, 0, 0])] * 3}}
    counted = table(0.01, otherwise=wide | some)
    assert counted.verdicts == ["reproduced", "not testable", "not testable"] * 4
    told = items.sentence([("11", counted)])
    assert "4 of 4 are reproduced" in told
    assert "compatible" not in told  # there is none of these
    assert told.startswith("Of 12 printed results 8 could hardly have failed")
    assert items.scorecard([("11", counted)])["would have failed"][0] == "some"


def test_the_reading_counts_that_the_item_names():
    """Alone in a run or not, and whether or not another agrees more often."""
    printed = published.values("edge", "Table 2", MEAN)
    found = {(MEAN, "mean"): [printed] * 3, (MEAN, "rms"): [printed + np.eye(4, 3)] * 3}
    item = compare("edge", "Table 2", "", found, why="off", reading="rms")
    assert {row.reading for row in item.counted.rows} == {"rms"}
    (line,) = items.tally([("11", item)]).to_dict("records")
    assert (line["printed"], line["differs"]) == (12, 3)
    assert "As ours: 9 of 12. The reading that counts: rms." in item.summary


def shown(item, kind):
    return item._repr_mimebundle_()[f"text/{kind}"]


def test_a_table_is_shown_as_the_paper_prints_it():
    html = shown(table(0.01, labels={MEAN: "mean(Δd)"}), "html")
    assert "mean(Δd)" in html
    for text in published.entries("edge", "Table 2", MEAN)["printed"]:
        assert f"<b>{text}</b> ✓<br>" in html


def test_what_we_found_once_for_all_columns_is_shown_once():
    mean = "mean of delta alpha"
    printed = np.abs(published.values("edge", "Table 1", mean))
    three = [np.full_like(printed, value) for value in (1.5, 0.25, 2.75)]
    html = shown(compare("edge", "Table 1", "", {mean: three}, why="narrow"), "html")
    assert html.count("<td>1.50<br>[0.25, 2.75]</td>") == 4
    assert html.count("<br>") == 4
    assert "<b>−1.03</b> ✗" in html


def test_a_matrix_stands_in_its_rows_with_ours_below():
    pose = published.values("disk", "Eq. 49", "Lambda")
    three = [pose, pose - 0.00123, pose + 0.00123]
    html = shown(compare("disk", "Eq. 49", "pose", {"Lambda": three}), "html")
    assert "<td><b>6.02520</b>" not in html  # as printed
    assert "<td><b>6.0252</b> (✓)<br>6.02520<br>[6.02397, 6.02643]</td>" in html


def test_readings_stand_side_by_side():
    key = "standard deviation from Eq. 49"
    found = {
        (key, "mean of the norms"): [0.326] * 3,
        (key, "root mean square"): [0.342] * 3,
    }
    about = {"why": "the paper computed the other", "reading": "root mean square"}
    item = compare("disk", "Section V-D2", "spread", found, **about)
    assert item.verdicts == ["differs", "not testable"]
    (line,) = [line for line in shown(item, "plain").splitlines() if key in line]
    assert line.endswith("0.342 ✗ | 0.326  0.342 (✓) | 0.342")
    assert "the other" not in item.summary


def test_read_back_from_a_notebook(tmp_path):
    item = table(0.01)
    data = json.loads(json.dumps(item._repr_mimebundle_()))
    notebook = {"cells": [{"cell_type": "code", "outputs": [{"data": data}]}]}
    (tmp_path / "11.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    gathered = items.gather(tmp_path)
    assert gathered == [("11", item)]
    (line,) = items.tally(gathered).to_dict("records")
    assert (line["paper"], line["item"]) == ("Xu 2021", "Table 2")
    assert (line["printed"], line["reproduced"], line["notebook"]) == (12, 12, "11")
    assert line["compatible"] == line["differs"] == 0
    assert items.sentence(gathered).count("12 of 12 are reproduced")
    frame = items.scorecard(gathered)
    assert (frame["verdict"] == "reproduced").all()
    printed = published.entries("edge", "Table 2", MEAN)["printed"]
    assert frame["printed"].tolist() == printed.tolist()
