"""Modules import only from the layers above their own, and the library imports without heavy company."""

import ast
import subprocess
import sys
from pathlib import Path

import profilecal

PACKAGE = Path(profilecal.__file__).parent
LAYERS = [
    ["checks", "poses", "conventions", "fitting"],
    ["scanner"],
    ["targets"],
    ["scan", "acquisition", "simulate", "features", "handeyesync"],
    ["closed_form", "joint", "observability", "scenes", "two_phase"],
    ["calibrate", "doubts", "leave_out", "montecarlo", "synthetic", "verify"],
    ["published", "published_scenes", "scorecard", "report", "html", "notebooks", "reproduce", "sweep", "cli"],
]
RANK = {room: rank for rank, rooms in enumerate(LAYERS) for room in rooms}


def imported_rooms(path):
    for node in ast.walk(ast.parse(path.read_text())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
        if isinstance(node, ast.ImportFrom) and node.module == "profilecal":
            yield from names
        for module in [node.module] if isinstance(node, ast.ImportFrom) else names:
            if module and module.startswith("profilecal."):
                yield module.split(".")[1]


def test_imports_point_upwards():
    for path in PACKAGE.rglob("*.py"):
        room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if room != "__init__":
            for other in imported_rooms(path):
                assert RANK[other] <= RANK[room], f"{path.name} imports {other}, which is a later layer"


def test_matplotlib_is_imported_by_report_alone():
    users = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if "matplotlib" in path.read_text()]
    assert {path.parts[0] for path in users} == {"report"}


def test_the_command_line_starts_without_heavy_imports():
    heavy = {"numpy", "scipy", "matplotlib", "pandas", "jupyter_client", "papermill", "dask", "sympy", "rich"}
    code = "import sys, profilecal.cli; print(*{name.split('.')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not heavy & set(loaded)
