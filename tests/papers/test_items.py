"""Items: the paper's table with ours beside it, as shown and as data."""

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


def shown(item):
    return item._repr_mimebundle_()["text/html"]


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


def test_the_reading_counts_that_the_item_names():
    """The readings stand side by side."""
    off = PRINTED + np.eye(4, 3)
    found = {(MEAN, "rms"): [off] * 3, (MEAN, "mean"): [2 * off] * 3}
    item = compare("edge", "Table 2", "", found, why="off", reading="rms")
    assert {row.reading for row in item.counted.rows} == {"rms"}
    (line,) = items.tally([("11", item)]).to_dict("records")
    assert (line["printed"], line["differs"]) == (12, 3)
    assert ", and 3 differ" in items.sentence([("11", item)])
    assert "As ours: 9 of 12. The reading that counts: rms." in item.summary
    html = shown(item)
    assert html.index("<th>rms</th>") < html.index("<th>mean</th>")
