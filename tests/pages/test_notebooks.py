"""The notebooks under other parameters: any number halved or doubled, the sizes of
studies down to 8.

The suite runs each once with all of them altered, whole numbers halved, which saves
time; `PROFILECAL_ALTERED=5 pytest -s tests/running/test_notebooks.py` runs each five
times with some altered, either way. `PROFILECAL_ALTERED_SEED` chooses other ones.
"""

import ast
import json
import math
import os
import sys
import warnings
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from traitlets.config import Config

from profilecal.scan.folder import write_scan
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal_pages import notebooks
from profilecal_pages.notebooks import recorded
from profilecal_tool.report import page

RUNS = int(os.environ.get("PROFILECAL_ALTERED", "1"))
SEED = int(os.environ.get("PROFILECAL_ALTERED_SEED", "1"))
# an integer from there on is the size of a study, which goes down to this
SIZE, LEAST = 20, 8
THERE = notebooks.find([])
# 00 reads what the others found
RUNNABLE = [path for path in THERE if not path.stem.startswith("00")]


def declared(path) -> dict:
    """The parameters of a notebook and their values."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    (source,) = [
        "".join(c["source"])
        for c in cells
        if "parameters" in c["metadata"].get("tags", [])
    ]
    return {
        node.target.id: ast.literal_eval(node.value) for node in ast.parse(source).body
    }


def altered(value, rng, name=""):
    """Another value of a parameter; text and truth stay."""
    if isinstance(value, bool | str):
        return value
    if name == "seed":
        return int(rng.integers(1000))
    if isinstance(value, int) and value >= SIZE:
        return (
            int(rng.integers(LEAST, max(LEAST, value // 2) + 1)) if RUNS > 1 else LEAST
        )
    several = value if isinstance(value, list) else [value]
    whole = all(isinstance(v, int) for v in several)
    factor = 0.5 if whole and RUNS == 1 else float(rng.choice([0.5, 2]))
    changed = [max(1, math.ceil(v * factor)) if whole else v * factor for v in several]
    return changed if isinstance(value, list) else changed[0]


class Shell(InteractiveShell):
    """An IPython shell in this process, as a kernel has one: no process to start,
    nothing imported twice.
    """

    def enable_gui(self, gui=None):
        """There is none."""


@pytest.fixture
def shell(monkeypatch, tmp_path):
    monkeypatch.chdir(notebooks.folder())
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.setitem(sys.modules, "__main__", sys.modules["__main__"])
    with warnings.catch_warnings(), plt.rc_context():
        warnings.simplefilter("ignore")
        found = Shell.instance(
            config=Config(
                HistoryManager={"enabled": False}, InteractiveShell={"cache_size": 0}
            )
        )
        found.run_line_magic("matplotlib", "inline")
        yield found
    found.reset()
    Shell.clear_instance()
    plt.close("all")
    plt.switch_backend("agg")


def outcomes(shell, path, parameters: dict) -> list[dict]:
    """What a notebook records under other parameters."""
    shell.push({"__spec__": None})  # as in a kernel, for the processes of a sweep
    cells = [
        cell
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        if cell["cell_type"] == "code"
    ]
    for cell in cells:
        with capture_output() as shown:
            shell.run_cell("".join(cell["source"])).raise_error()
        cell["outputs"] = [{"data": output.data} for output in shown.outputs]
        if "parameters" in cell["metadata"].get("tags", []):
            shell.push(parameters)
    return recorded({"cells": cells})


def has_numbers(path) -> bool:
    """Whether any parameter can be altered."""
    return not all(isinstance(value, bool | str) for value in declared(path).values())


@pytest.mark.parametrize(
    "path", [*filter(has_numbers, RUNNABLE)], ids=lambda path: path.stem
)
def test_other_parameters_are_lived_with_and_outcomes_recorded(path, shell):
    for run in range(RUNS):
        rng = np.random.default_rng([SEED, run, THERE.index(path)])
        given = declared(path)
        chosen = {
            name: altered(value, rng, name)
            for name, value in given.items()
            if rng.uniform() < 0.5 or RUNS == 1
        }
        chosen = {name: value for name, value in chosen.items() if value != given[name]}
        print(f"PROFILECAL_ALTERED_SEED={SEED}: {path.stem} with {chosen}")
        shell.reset()
        (first, *_) = outcomes(shell, path, chosen)
        assert first


@pytest.mark.parametrize(
    ("given", "status", "drawn"),
    [
        ([{"spread_deg": 0.4}], "weak", 4),
        ([{"groups": 1, "positions": 12}], "unobservable", 4),
        (
            [{"groups": 1, "positions": 4}],
            "unobservable",
            2,
        ),  # fewer measurements than unknowns
        ([{"mount": "eye-to-hand"}], "ok", 4),
        ([{"measured": "profiles"}, {"kind": "ball", "measured": "arcs"}], "ok", 4 + 3),
    ],
)
def test_the_report_is_whole_whatever_the_scans(tmp_path, shell, given, status, drawn):
    """And writes all of its figures."""
    folders = [str(tmp_path / str(number)) for number, _ in enumerate(given)]
    for folder, changed in zip(folders, given, strict=True):
        scan = simulate_scan(Spec(**{"groups": 8, "positions": 6, "seed": 3} | changed))
        spoiled = tuple(
            values + 9.0 * (i == 20) for i, values in enumerate(scan.values)
        )
        write_scan(replace(scan, values=spoiled), folder)
    (recorded,) = outcomes(
        shell, page.notebook(), {"scan": folders, "results_dir": str(tmp_path)}
    )
    assert recorded["status"] == status
    assert len([*(tmp_path / "figures").glob("*.png")]) == drawn
