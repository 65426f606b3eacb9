"""The notebooks under other parameters: any number halved or doubled, the sizes of
studies down to 8.

The suite runs each but the longest once with all of them altered, whole numbers halved,
which saves time. `PROFILECAL_ALTERED=5 pytest tests/pages/test_notebooks.py` runs each
five times with some altered, either way.
"""

import json
import math
import os
import sys
import warnings
from functools import partial

import matplotlib.pyplot as plt
import pytest
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from numpy.random import default_rng
from simulated import scan_of
from traitlets.config import Config

import profilecal as pc
from profilecal_pages import figures, notebooks
from profilecal_pages.notebooks import recorded
from profilecal_tool.report import page

RUNS = int(os.environ.get("PROFILECAL_ALTERED", "1"))
# an integer from there on is the size of a study, which goes down to this
SIZE, LEAST = 20, 8


def altered(rng, _, value):
    """Another value of a parameter that is a number or a list of them."""
    if isinstance(value, bool | str) or (RUNS > 1 and rng.uniform() < 0.5):
        return value
    factor = float(rng.choice([0.5, 2]))
    if isinstance(value, list):
        return [factor * entry for entry in value]
    if isinstance(value, float):
        return factor * value
    if value < SIZE:
        return math.ceil(value * (0.5 if RUNS == 1 else factor))
    most = max(LEAST, value // 2) if RUNS > 1 else LEAST
    return int(rng.integers(LEAST, most + 1))


WITHOUT_NUMBERS = ["00", "01"]
LONG = ["42", "43", "44", "50", "60", "61"]  # whatever the numbers
SKIPPED = WITHOUT_NUMBERS + LONG * ("PROFILECAL_ALTERED" not in os.environ)
ALTERABLE = [path for path in notebooks.find([]) if path.stem[:2] not in SKIPPED]


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
        config = Config()
        config.HistoryManager.enabled = False
        config.InteractiveShell.cache_size = 0
        instance = Shell.instance(config=config)
        instance.run_line_magic("matplotlib", "inline")
        yield instance
    instance.reset()
    Shell.clear_instance()
    plt.close("all")
    plt.switch_backend("agg")


def outcomes(shell, path, alter) -> list[dict]:
    """What a notebook records whose parameters are altered, by name and value."""
    shell.push({"__spec__": None})  # as in a kernel, for the processes of a sweep
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    cells = [cell for cell in cells if cell["cell_type"] == "code"]
    for cell in cells:
        known = {*shell.user_ns}
        with capture_output() as shown:
            shell.run_cell("".join(cell["source"])).raise_error()
        cell["outputs"] = [{"data": output.data} for output in shown.outputs]
        if "parameters" in cell["metadata"].get("tags", []):
            names = shell.user_ns.keys() - known
            own = sorted(name for name in names if not name.startswith("_"))
            shell.push({name: alter(name, shell.user_ns[name]) for name in own})
    return recorded({"cells": cells})


@pytest.mark.parametrize("path", ALTERABLE, ids=lambda path: path.stem)
def test_other_parameters_are_lived_with_and_outcomes_recorded(path, shell):
    for run in range(RUNS):
        rng = default_rng([run, ALTERABLE.index(path)])
        shell.reset()
        (first, *_) = outcomes(shell, path, partial(altered, rng))
        assert first


def test_the_report_is_whole_where_there_is_no_answer(tmp_path, shell):
    """And writes all of its figures."""
    few = scan_of("edge", groups=1, positions=4)  # fewer measurements than unknowns
    pc.write_scan(few, tmp_path / "scan")
    parameters = {"scan": [str(tmp_path / "scan")], "results_dir": str(tmp_path)}
    (recorded,) = outcomes(shell, page.notebook(), lambda *of: parameters.get(*of))
    assert recorded["status"] == "unobservable"
    assert len([*(tmp_path / "figures").glob("*.png")]) == 2


def test_a_limit_in_words_stops_a_page_under_its_own_parameters_alone(monkeypatch):
    assert figures.below([1e-12, -1e-11], 1e-9) == "below 1e-9"
    monkeypatch.setattr(figures, "at_defaults", lambda: False)
    assert figures.below([0, -2e-9], 1e-9) == "2e-9, not below 1e-9"
    monkeypatch.setattr(figures, "at_defaults", lambda: True)
    with pytest.raises(ValueError, match="a value is 2e-09; expected less than 1e-09"):
        figures.below([0, -2e-9], 1e-9)
