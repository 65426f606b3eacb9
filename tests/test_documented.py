"""Every public name says what it is, and the examples in docstrings run."""

import ast
import base64
import doctest
import functools
import json
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "lib" / "profilecal"
MODULES = sorted(PACKAGE.rglob("[a-z]*.py"))
CONTRACTS = ("Target", "Curve")  # what their methods do is said there, once


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def public(body, kinds):
    """The public definitions of some kinds in a module or class, by name."""
    for node in body:
        if isinstance(node, kinds) and not node.name.startswith("_"):
            yield node.name, node


def public_names(tree):
    """Public classes and functions of a module, and the public methods of those
    classes, by name.
    """
    for name, node in public(tree.body, (ast.FunctionDef, ast.ClassDef)):
        yield name, node
        if isinstance(node, ast.ClassDef):
            for method, definition in public(node.body, ast.FunctionDef):
                yield f"{name}.{method}", definition


@functools.cache
def promised():
    """The methods that contracts describe."""
    methods = set()
    for path in MODULES:
        for name, node in public_names(tree_of(path)):
            owner, _, method = name.partition(".")
            if owner in CONTRACTS and method and ast.get_docstring(node):
                methods.add(method)
    return methods


@pytest.mark.parametrize(
    "path", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix()
)
def test_public_names_are_documented(path):
    tree = tree_of(path)
    bare = [name for name, node in public_names(tree) if not ast.get_docstring(node)]
    assert not [name for name in bare if name.split(".")[-1] not in promised()]
    assert ast.get_docstring(tree) or not tree.body


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
