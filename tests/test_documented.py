"""The examples in docstrings run, and pictures are those of their pages."""

import base64
import doctest
import json
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "lib" / "profilecal"
MODULES = sorted(PACKAGE.rglob("[a-z]*.py"))


def test_examples_run():
    examples = 0
    for path in MODULES:
        place = path.relative_to(PACKAGE.parent).with_suffix("")
        module = import_module(".".join(place.parts))
        ran = doctest.testmod(module)
        assert not ran.failed, place
        examples += ran.attempted
    assert examples >= 5


def test_the_page_on_python_runs():
    page = doctest.testfile(str(ROOT / "docs" / "python.md"), module_relative=False)
    assert page.attempted > 20
    assert not page.failed


@pytest.mark.parametrize(
    ("picture", "page"), [("answer", "00_start_here"), ("tiles", "01_side_by_side")]
)
def test_pictures_of_the_front_page_are_the_first_of_their_pages(picture, page):
    notebook = (ROOT / "notebooks" / f"{page}.ipynb").read_text(encoding="utf-8")
    outputs = [
        output["data"]
        for cell in json.loads(notebook)["cells"]
        for output in cell.get("outputs", [])
        if "image/png" in output.get("data", {})
    ]
    first = base64.b64decode(outputs[0]["image/png"])
    # said as true or false: a comparison of bytes would take minutes to print
    same = (ROOT / "docs" / f"{picture}.png").read_bytes() == first
    assert same, f"docs/{picture}.png is not the first picture of {page}"
