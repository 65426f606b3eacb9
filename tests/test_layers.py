"""Rooms import from the rooms before them alone, and the library in light company."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LIB = ROOT / "lib"
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ROOMS = re.findall(r"^\| `(\w+\.\w+)` \|", CONTRIBUTING, re.M)  # as "Layout" lists them
OF_USERS = {"profilecal", "profilecal_pages", "matplotlib", "pandas"}
MAY_IMPORT = {
    "profilecal": set(),  # and numpy, scipy
    "profilecal_pages": OF_USERS,
    "profilecal_papers": OF_USERS,
    "profilecal_tool": OF_USERS,
}
MODULES = sorted(LIB.rglob("*.py"))


def imported_modules(path):
    """The modules of ours and of OF_USERS that a file imports, by their full names, in
    functions, too.
    """
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            package = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
            names = [package + alias.name for alias in node.names]
            starts = tuple(OF_USERS)
            yield from (name for name in names if name.startswith(starts))


def room_of(module):
    """The room that a module is in: a folder or a file of a package."""
    package, *inside = module.split(".")
    return f"{package}.{inside[0]}" if inside else package


def module_of(path):
    inside = path.relative_to(LIB).with_suffix("").parts
    return ".".join(part for part in inside if part != "__init__")


def test_every_room_is_listed():
    rooms = {room_of(module_of(path)) for path in MODULES}
    assert rooms - MAY_IMPORT.keys() == set(ROOMS)


@pytest.mark.parametrize("path", MODULES, ids=module_of)
def test_a_room_imports_from_other_packages_it_may_and_from_earlier_rooms(path):
    room = room_of(module_of(path))
    package = room.split(".")[0]
    for name in imported_modules(path):
        other = room_of(name)
        its_package = other.split(".")[0]
        if its_package != package:
            assert its_package in MAY_IMPORT[package]
        elif room != package:  # the first page of a package may import any
            assert ROOMS.index(other) <= ROOMS.index(room), f"{other} is a later room"


LIBRARY = [module_of(path) for path in MODULES if "profilecal/" in path.as_posix()]


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        (LIBRARY, "pandas matplotlib click tqdm jupyter_client"),
        (
            ["profilecal_tool.cli"],
            "numpy scipy matplotlib pandas jupyter_client papermill dask sympy",
        ),
    ],
    ids=["the library stands on numpy and scipy", "the command line starts at once"],
)
def test_modules_load_nothing_heavy(modules, heavy):
    """In a fresh interpreter."""
    code = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = {name.split(".")[0] for name in run.stdout.split()}
    assert not loaded & set(heavy.split())
