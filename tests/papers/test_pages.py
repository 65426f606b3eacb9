"""The pages hold what the papers print, every numbered equation, every table, every
result; and the front page's pictures.
"""

import base64
import json
import re
from collections import Counter, defaultdict
from pathlib import Path

import pandas as pd
import pytest

from profilecal_pages.items import MIME, from_json
from profilecal_papers import monte_carlo, published

ROOT = Path(__file__).parents[2]
CELLS = {
    path.stem: json.loads(path.read_text(encoding="utf-8"))["cells"]
    for path in sorted((ROOT / "notebooks").glob("*.ipynb"))
}
# what each page shows: the data of its outputs
SHOWN = {
    page: [out.get("data", {}) for cell in cells for out in cell.get("outputs", [])]
    for page, cells in CELLS.items()
}
OF_ITEMS = [data for shown in SHOWN.values() for data in shown if MIME in data]
ITEMS = [from_json(data[MIME]) for data in OF_ITEMS]
# the items that are read in three ways, all others in one
AMBIGUOUS = "Fig. 15", "Section V-C", "Section V-D2"


@pytest.mark.parametrize(
    ("page", "letter", "last"),
    [
        ("10_edge_derivation", "", 35),
        ("20_disk_derivation", "", 48),
        ("29_ball_derivation", "B", 22),
    ],
)
def test_every_equation_is_typeset_once(page, letter, last):
    prose = [cell["source"] for cell in CELLS[page] if cell["cell_type"] == "markdown"]
    text = "\n".join(map("".join, prose))
    displayed = "".join(re.findall(r"\$\$(.*?)\$\$", text, re.S))
    tags = re.findall(rf"\\tag\{{{letter}(\d+)\}}", displayed)
    assert sorted(map(int, tags)) == list(range(1, last + 1))


@pytest.mark.parametrize("paper", published.FILES)
def test_the_pages_compare_each_printed_result_of_a_paper_once(paper):
    """In the paper's order, and under the names that the paper gives its rows and
    columns.
    """
    items = [item for item in ITEMS if item.paper == paper]
    results = published.table(paper).query("role == 'result'")
    assert Counter(item.item for item in items) == dict.fromkeys(results["item"], 1)
    for item in items:
        of_item = results[results["item"] == item.item]
        quantities = [part for _, part in of_item.groupby("quantity", sort=False)]
        entries = pd.concat(quantities)
        rows = entries["row"].str.removeprefix("G=")
        printed = [*zip(entries["component"], rows, entries["printed"], strict=True)]
        readings = defaultdict(list)
        for row in item.rows:
            readings[row.reading].append((row.column, row.row, row.printed))
        assert len(readings) == (3 if item.item in AMBIGUOUS else 1)
        assert all(of_reading == printed for of_reading in readings.values())


def test_an_item_shows_the_numbers_that_it_holds():
    """As the paper prints them: what a reader sees is what is compared."""
    for data, item in zip(OF_ITEMS, ITEMS, strict=True):
        cells = re.findall(r"<td>(?:<b>)?([^<\n]+)", "".join(data["text/html"]))
        shown = Counter(cell.split(" ")[0] for cell in cells)
        missing = Counter(row.as_printed for row in item.rows) - shown
        assert not missing, (item.item, missing)


@pytest.mark.parametrize(
    ("page", "item"),
    [
        ("21_disk_measured", "Table I"),
        ("30_ball_measured", "Table III"),
        ("30_ball_measured", "Table IV"),
    ],
)
def test_a_measured_page_shows_the_tables_as_printed(page, item):
    shown = "".join("".join(data.get("text/markdown", "")) for data in SHOWN[page])
    names = published.table("disk").query("item == @item")["quantity"].unique()
    printed = [text for name in names for text in published.vectors("disk", item, name)]
    assert len(printed) > 10
    assert [vector for vector in printed if vector not in shown] == []


CANNOT_FAIL = "Eq. 54", "Eq. 55", "Table II"
ROWS = [(item, row) for item in ITEMS for row in item.rows]


def test_a_number_of_the_disk_paper_counts_only_where_something_wrong_fails():
    """All that was done wrong on purpose made some number fail; what cannot fail is
    apart. An ambiguous word is read in one way.
    """
    rows = [row for item, row in ROWS if item.paper == "disk"]
    tried = {name for row in rows for name in row.otherwise}
    assert tried == {name for row in rows for name in row.failed}
    assert tuple(item.item for item in ITEMS if item.apart) == CANNOT_FAIL
    read = {item.item: item.reading for item in ITEMS if item.reading}
    assert read == dict.fromkeys(AMBIGUOUS, monte_carlo.COUNTED)


def test_only_numbers_that_were_seen_to_fail_count_and_those_that_differ_say_why():
    """Each that counts lies outside a range of ours that was made wrong on purpose."""
    counted = 0
    for item, row in ROWS:
        assert row.inside or row.why
        if item.verdict(row) in ("reproduced", "compatible"):
            assert item.item not in ("Table 3", *CANNOT_FAIL)
            room, value = 0.5 * 10.0**-row.decimals, float(row.printed)
            ranges = row.otherwise.values()
            inside = [low - room <= value <= high + room for _, low, high in ranges]
            assert not all(inside), (item.item, row)
            counted += 1
    assert counted > 60


@pytest.mark.parametrize(
    ("picture", "page"), [("answer", "00_start_here"), ("tiles", "01_side_by_side")]
)
def test_pictures_of_the_front_page_are_the_first_of_their_pages(picture, page):
    first = next(data["image/png"] for data in SHOWN[page] if "image/png" in data)
    of_front_page = (ROOT / "docs" / f"{picture}.png").read_bytes()
    # said as true or false: a comparison of bytes would take minutes to print
    same = of_front_page == base64.b64decode(first)
    assert same
