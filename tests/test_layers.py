"""Rooms import only from the rooms before them, and the library imports without heavy company."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import profilecal

PACKAGE = Path(profilecal.__file__).parent
CONTRIBUTING = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
ROOMS = re.findall(r"^\| `(\w+)` \|", CONTRIBUTING, re.M)  # in reading order, as its "Layout" lists them


def imported_rooms(path):
    for node in ast.walk(ast.parse(path.read_text())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
        if isinstance(node, ast.ImportFrom) and node.module == "profilecal":
            yield from names
        for module in [node.module] if isinstance(node, ast.ImportFrom) else names:
            if module and module.startswith("profilecal."):
                yield module.split(".")[1]


def test_rooms_import_from_earlier_rooms_alone():
    for path in PACKAGE.rglob("*.py"):
        room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if room != "__init__":
            for other in imported_rooms(path):
                assert ROOMS.index(other) <= ROOMS.index(room), f"{path.name} imports {other}, which is a later room"


def test_matplotlib_is_imported_by_report_alone():
    users = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if "matplotlib" in path.read_text()]
    assert {path.parts[0] for path in users} == {"report"}


def test_the_command_line_starts_without_heavy_imports():
    heavy = {"numpy", "scipy", "matplotlib", "pandas", "jupyter_client", "papermill", "dask", "sympy"}
    code = "import sys, profilecal.cli; print(*{name.split('.')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not heavy & set(loaded)
