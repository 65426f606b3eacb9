"""Every public name says what it is, and the examples in docstrings run."""

import ast
import doctest
import functools
import re
from importlib import import_module
from pathlib import Path

import pytest
from command import run

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "lib" / "profilecal"
MODULES = sorted(PACKAGE.rglob("[a-z]*.py"))
CONTRACTS = ("Target", "Curve")  # what their methods do is said there, once


def public(tree):
    """Public classes and functions of a module, and the public methods of those
    classes, by name.
    """
    for node in tree.body:
        if isinstance(
            node, ast.FunctionDef | ast.ClassDef
        ) and not node.name.startswith("_"):
            yield node.name, node
            for method in getattr(node, "body", []):
                if (
                    isinstance(node, ast.ClassDef)
                    and isinstance(method, ast.FunctionDef)
                    and method.name[0] != "_"
                ):
                    yield f"{node.name}.{method.name}", method


@functools.cache
def promised() -> set[str]:
    """The methods that contracts describe."""
    entries = [
        entry
        for path in MODULES
        for entry in public(ast.parse(path.read_text(encoding="utf-8")))
    ]
    described = [
        name.split(".")
        for name, node in entries
        if "." in name and ast.get_docstring(node)
    ]
    return {method for owner, method in described if owner in CONTRACTS}


@pytest.mark.parametrize(
    "path", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix()
)
def test_public_names_are_documented(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    described = promised()
    bare = [
        n
        for n, node in public(tree)
        if not ast.get_docstring(node) and n.split(".")[-1] not in described
    ]
    assert not bare
    assert ast.get_docstring(tree) or not tree.body


def test_examples_run():
    examples = 0
    for path in MODULES:
        if path.name == "__main__.py":
            continue
        name = ".".join(
            ("profilecal", *path.relative_to(PACKAGE).with_suffix("").parts)
        )
        found = doctest.testmod(import_module(name))
        assert not found.failed, name
        examples += found.attempted
    assert examples >= 5


def test_the_page_on_python_runs():
    page = doctest.testfile(str(ROOT / "docs" / "python.md"), module_relative=False)
    assert page.attempted > 20
    assert not page.failed


def test_the_readme_shows_what_the_command_prints():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"^```\n(status .*?)^```", text, re.DOTALL | re.MULTILINE)
    assert "profilecal calibrate data/examples/edge --to kuka " in text
    printed = run(
        "calibrate", ROOT / "data" / "examples" / "edge", "--to", "kuka"
    ).stdout
    # processors differ in later digits
    short = [re.sub(r"(\.\d{4})\d+", r"\1", said) for said in (printed, shown)]
    assert short[0] == short[1]
