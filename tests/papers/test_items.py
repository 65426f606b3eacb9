"""Items: the paper's table with ours beside it, as shown and as data."""

import json

import numpy as np
import pytest

from profilecal_pages import items
from profilecal_papers import published
from profilecal_papers.comparison import compare

MEAN = "mean of delta d"
PRINTED = published.values("edge", "Table 2", MEAN)


def table(ours, half=0.02, **about):
    """Table 2 beside ours, as far off, with a range of ±half."""
    about = {"otherwise": {"half": {MEAN: [PRINTED / 2] * 3}}} | about
    three = [PRINTED + ours + off for off in (0, -half, half)]
    found = {MEAN: three}
    return compare("edge", "Table 2", "", found, range_from="Monte Carlo", **about)


def shown(item, kind="html"):
    return item._repr_mimebundle_()[f"text/{kind}"]


@pytest.mark.parametrize(
    ("item", "verdict", "summary"),
    [
        (table(0.01), "reproduced", "12 of 12. If we change one thing: half, 0 of 12."),
        (table(0.01, free="radius"), "compatible", "Free settings: radius."),
        (table(0.03, why="too large"), "differs", "half, 0 of 12. ✗: too large."),
        # what nothing makes fail, or cannot fail, does not count
        (table(0.01, otherwise={}), "not counted", "(Monte Carlo): 12 of 12."),
        (table(0.01, apart="a recount"), "not counted", "Not counted: a recount."),
        (table(0.0049, half=0.0), "reproduced", "0 of 12."),  # rounds to the printed
        (table(0.0062, half=0.0), "differs", "half, 0 of 12."),
    ],
)
def test_every_verdict_follows_from_the_numbers(item, verdict, summary):
    assert {*item.verdicts} == {verdict}
    assert item.summary.endswith(summary)
    assert ("0.27</b> (✓)" in shown(item)) == (verdict == "not counted")


def test_numbers_that_something_makes_fail_count():
    wide = {"wide": {MEAN: [PRINTED, PRINTED - 1, PRINTED + 1]}}
    assert {*table(0.01, otherwise=wide).verdicts} == {"not counted"}
    some = {"some": {MEAN: [PRINTED + np.array([1.0, 0, 0])] * 3}}
    counted = table(0.01, otherwise=wide | some)
    assert counted.verdicts == ["reproduced", "not counted", "not counted"] * 4
    told = items.sentence([("11", counted)])
    assert told.startswith("Of 12 printed results 8 are not counted")
    assert "4 of 4 are reproduced" in told
    assert "compatible" not in told  # there is none of these
    assert items.scorecard([("11", counted)])["would have failed"][0] == "some"
    assert table(0.03).rows[0].over_tolerance == pytest.approx(0.03 / 0.025)


def test_the_reading_counts_that_the_item_names():
    """The readings stand side by side."""
    off = PRINTED + np.eye(4, 3)
    found = {(MEAN, "rms"): [off] * 3, (MEAN, "mean"): [2 * off] * 3}
    item = compare("edge", "Table 2", "", found, why="off", reading="rms")
    assert {row.reading for row in item.counted.rows} == {"rms"}
    (line,) = items.tally([("11", item)]).to_dict("records")
    assert (line["printed"], line["differs"]) == (12, 3)
    assert "0 of 3 are reproduced" in items.sentence([("11", item)])
    assert "As ours: 9 of 12. The reading that counts: rms." in item.summary
    html = shown(item)
    assert html.index("<th>rms</th>") < html.index("<th>mean</th>")


def beside(item, quantity, ours, half, paper="disk", **about):
    """A quantity beside ours, given once for all its numbers or for each."""
    ours = np.broadcast_to(ours, published.values(paper, item, quantity).shape)
    found = {quantity: [ours, ours - half, ours + half]}
    return shown(compare(paper, item, "", found, **about))


def test_a_table_is_shown_as_the_paper_prints_it():
    html = shown(table(0.01, labels={MEAN: "mean(Δd)"}))
    assert "mean(Δd)" in html
    for text in published.entries("edge", "Table 2", MEAN)["printed"]:
        assert f"<b>{text}</b> ✓<br>" in html
    # what we found once for all columns is shown once
    html = beside("Table 1", "mean of delta alpha", 1.5, 1.25, "edge", why="narrow")
    assert html.count("<td>1.50<br>[0.25, 2.75]</td>") == 4 == html.count("<br>")
    assert "<b>−1.03</b> ✗" in html
    # a matrix stands in its rows, with ours below
    pose = published.values("disk", "Eq. 49", "Lambda")
    html = beside("Eq. 49", "Lambda", pose, 0.00123)
    assert "<td><b>6.0252</b> (✓)<br>6.02520<br>[6.02397, 6.02643]</td>" in html


def test_read_back_from_a_notebook(tmp_path):
    item = table(0.01)
    data = json.loads(json.dumps(item._repr_mimebundle_()))
    notebook = {"cells": [{"cell_type": "code", "outputs": [{"data": data}]}]}
    (tmp_path / "11.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    gathered = items.gather(tmp_path)
    assert gathered == [("11", item)]
    (line,) = items.tally(gathered).values.tolist()
    assert line == ["Xu 2021", "Table 2", 12, 12, 0, 0, 0, "11"]
    frame = items.scorecard(gathered)
    assert (frame["verdict"] == "reproduced").all()
    assert (frame["printed"].astype(float) == PRINTED.ravel()).all()
