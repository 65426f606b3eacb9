"""The pages hold what the papers print: every numbered equation, or why it is left out;
every table; every result.
"""

import json
import re
from collections import Counter
from pathlib import Path

import pytest

from profilecal_pages.items import MIME, from_json
from profilecal_papers import published

PAGES = {
    path.stem: json.loads(path.read_text(encoding="utf-8"))["cells"]
    for path in sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
}
SHOWN = {
    page: [out.get("data", {}) for cell in cells for out in cell.get("outputs", [])]
    for page, cells in PAGES.items()
}
ITEMS = [
    (data, from_json(data[MIME]))
    for shown in SHOWN.values()
    for data in shown
    if MIME in data
]
READINGS = {
    "Fig. 15": 3,
    "Fig. 16": 2,
    "Section V-C": 2,
    "Section V-D2": 2,
    "Table II": 2,
}  # of others one
LEFT_OUT = {  # of the disk paper
    23: "Eq. 4 again, in the frame of chord j",
    25: "Eq. 24 in that frame",
    26: "Eq. 22 of a point of the shifted chord",
    34: "Eq. 1 of two points",
    37: "Eq. 36 with the turn to the frame along the chords, the next step to Eq. 39",
    38: "parallel frames give a vector the same components, said with Eq. 22",
    44: "Eq. 36 of all scans, which Eqs 14 and 45 say",
    46: "Eq. 47 written out",
    48: "names of positions that are not printed",
}


@pytest.mark.parametrize(
    ("page", "letter", "last", "left_out"),
    [
        ("10_edge_derivation", "", 35, ()),
        ("20_disk_derivation", "", 48, LEFT_OUT),
        ("29_ball_derivation", "B", 22, ()),
    ],
)
def test_every_equation_is_typeset_once_or_left_out_for_a_reason(
    page, letter, last, left_out
):
    """In the paper's order where all are there."""
    text = "\n".join(
        "".join(cell["source"])
        for cell in PAGES[page]
        if cell["cell_type"] == "markdown"
    )
    displayed = "".join(re.findall(r"\$\$(.*?)\$\$", text, re.S))
    typeset = [
        int(number) for number in re.findall(rf"\\tag\{{{letter}(\d+)\}}", displayed)
    ]
    assert sorted([*typeset, *left_out]) == list(range(1, last + 1))
    assert left_out or typeset == sorted(typeset)


@pytest.mark.parametrize("paper", published.FILES)
def test_the_pages_compare_each_printed_result_of_a_paper_once(paper):
    """In the paper's order, and under the names that the paper gives its rows and
    columns.
    """
    items = [item for _, item in ITEMS if item.paper == paper]
    results = published.table(paper).query("role == 'result'")
    assert Counter(item.item for item in items) == dict.fromkeys(results["item"], 1)
    for item in items:
        of_item = results[results["item"] == item.item].groupby("quantity", sort=False)
        entries = [entry for _, of_one in of_item for entry in of_one.itertuples()]
        printed = [
            (entry.component, entry.row.removeprefix("G="), entry.printed)
            for entry in entries
        ]
        readings = dict.fromkeys(row.reading for row in item.rows)
        assert len(readings) == READINGS.get(item.item, 1)
        for reading in readings:
            assert [
                (r.column, r.row, r.printed) for r in item.rows if r.reading == reading
            ] == printed


def test_an_item_shows_the_numbers_that_it_holds():
    """In its table, as the paper prints them: what a reader sees is what is compared."""
    for data, item in ITEMS:
        cells = re.findall(r"<td>(?:<b>)?([^<\n]+)", "".join(data["text/html"]))
        missing = Counter(row.as_printed for row in item.rows) - Counter(
            cell.split(" ")[0] for cell in cells
        )
        assert not missing, (item.item, missing)


@pytest.mark.parametrize(
    ("page", "item", "count"),
    [
        ("21_disk_measured", "Table I", 20),
        ("30_ball_measured", "Table III", 24),
        ("30_ball_measured", "Table IV", 18),
    ],
)
def test_a_measured_page_shows_the_tables_as_printed(page, item, count):
    shown = "".join("".join(data.get("text/markdown", "")) for data in SHOWN[page])
    vectors = (
        published.table("disk")
        .query("item == @item")
        .groupby(["quantity", "row"])["printed"]
    )
    assert len(vectors) == count
    for _, vector in vectors:
        assert f"({', '.join(vector)})".replace("-", "−") in shown


def test_a_number_that_differs_says_why():
    assert [
        row for _, item in ITEMS for row in item.rows if not row.inside and not row.why
    ] == []
