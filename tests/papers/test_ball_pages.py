"""The ball's pages hold what the paper prints, and all pages together compare each result of both papers once."""

import json
import re
from collections import Counter
from pathlib import Path

import pytest

from profilecal.papers import published
from profilecal.papers.items import MIME, from_json, items_of

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"


@pytest.mark.parametrize("paper", published.FILES)
def test_the_pages_compare_each_printed_result_of_a_paper_once(paper):
    pages = sorted(NOTEBOOKS.rglob("*.ipynb"))
    items = [item for page in pages for item in items_of(page) if item.paper == paper]
    compared = Counter(item.item for item in items)
    results = published.table(paper).query("role == 'result'")
    assert compared == dict.fromkeys(results["item"], 1)
    for item in items:
        readings = Counter(row.reading for row in item.rows)
        quantities = results[results["item"] == item.item].groupby("quantity", sort=False)["printed"]
        printed = [text for _, of_one in quantities for text in of_one]
        for reading in readings:
            assert [row.printed for row in item.rows if row.reading == reading] == printed


def test_an_item_shows_the_numbers_that_it_holds():
    """In its table, as the paper prints them: what a reader sees is what is compared."""
    outputs = [
        output["data"]
        for page in sorted(NOTEBOOKS.rglob("*.ipynb"))
        for cell in json.loads(page.read_text(encoding="utf-8"))["cells"]
        for output in cell.get("outputs", [])
        if MIME in output.get("data", {})
    ]
    results = [published.table(paper).query("role == 'result'") for paper in published.FILES]
    assert len(outputs) == sum(of_paper["item"].nunique() for of_paper in results)
    for data in outputs:
        cells = re.findall(r"<td>(?:<b>)?([^<\n]+)", "".join(data["text/html"]))
        rows = from_json(data[MIME]).rows
        missing = Counter(row.as_printed for row in rows) - Counter(cell.split(" ")[0] for cell in cells)
        assert not missing, (data[MIME]["item"], missing)


@pytest.mark.parametrize("item", ["Table III", "Table IV"])
def test_the_measured_page_shows_the_tables_as_printed(item):
    cells = json.loads((NOTEBOOKS / "30_ball_measured.ipynb").read_text(encoding="utf-8"))["cells"]
    outputs = [output.get("data", {}) for cell in cells for output in cell.get("outputs", [])]
    shown = "".join("".join(data.get("text/markdown", "")) for data in outputs)
    vectors = published.table("disk").query("item == @item").groupby(["quantity", "row"])["printed"]
    assert len(vectors) in (18, 24)
    for _, vector in vectors:
        assert f"({', '.join(vector)})".replace("-", "−") in shown


def test_a_number_that_differs_says_why():
    rows = [row for page in sorted(NOTEBOOKS.rglob("*.ipynb")) for item in items_of(page) for row in item.rows]
    assert [row for row in rows if not row.inside and not row.why] == []


def test_the_derivation_numbers_its_equations_one_by_one():
    cells = json.loads((NOTEBOOKS / "29_ball_derivation.ipynb").read_text(encoding="utf-8"))["cells"]
    text = "".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    assert re.findall(r"\\tag\{B(\d+)\}", text) == [str(n) for n in range(1, 23)]
