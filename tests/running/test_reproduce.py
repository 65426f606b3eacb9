"""The runner and its command, on small notebooks made here."""

import json
import re
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

from profilecal.cli import main
from profilecal.running import notebooks

PARAMETERS = 'count: int = 2  # [1] how many\nscale: float = 0.5  # [mm]\nresults_dir: str = ""  # [folder]'
SCORE = """
from profilecal.papers import scorecard
from profilecal.report import figures
results = figures.Results("10_good", results_dir)
import pandas as pd
results.table(pd.DataFrame({"x": [count]}), "counts")
"""
ROWS = 'results.scorecard([scorecard.row("disk", "Eq. 1", "x", 1.0, count * scale, "mm", 0.1)])'


def write(path, *cells, parameters=PARAMETERS):
    def cell(source, tags=()):
        return {
            "cell_type": "code",
            "id": str(abs(hash(source))),
            "metadata": {"tags": list(tags)},
            "execution_count": None,
            "outputs": [],
            "source": source,
        }

    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    made = [cell(parameters, ["parameters"]), *map(cell, cells)]
    path.write_text(json.dumps({"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}))


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A clone with one good notebook, seen by the command. The notebook hands nothing out, and so imports nothing."""
    place = tmp_path / "notebooks"
    place.mkdir()
    write(place / "10_good.ipynb", "count * scale")
    monkeypatch.setattr(notebooks, "folder", lambda: place)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def scored(clone):
    """The same, whose notebook hands out a table and a row of the scorecard."""
    write(clone / "notebooks/10_good.ipynb", SCORE, ROWS)
    return clone


def run(*arguments):
    return CliRunner().invoke(main, ["reproduce", *arguments])


def test_notebooks_run_and_their_results_are_gathered(scored, monkeypatch):
    stopped = []
    monkeypatch.setattr(notebooks, "stop_idle", lambda: stopped.extend(notebooks._idle))
    result = run("-p", "count", "3")
    assert result.exit_code == 0, result.output
    assert "differs" in result.output
    assert "1.5" in result.output
    assert (scored / "results/tables/10_good_counts.csv").read_text() == "x\n3\n"
    assert "1.5" in (scored / "results/scorecard.csv").read_text()
    executed = json.loads((scored / "results/notebooks/10_good.ipynb").read_text())
    assert all(cell["execution_count"] for cell in executed["cells"])
    assert stopped  # the process that ran it


def test_a_failing_notebook_keeps_its_traceback_and_the_others_run(scored):
    write(scored / "notebooks/05_bad.ipynb", 'raise RuntimeError("the reason")')
    result = run()
    assert result.exit_code == 1
    assert "reproduced" in result.output
    last = result.output.strip().splitlines()[-1]
    assert re.match(r"FAILED 05_bad: error in cell \d: RuntimeError: the reason \(see results/notebooks/05_bad", last)
    assert "the reason" in (scored / "results/notebooks/05_bad.ipynb").read_text()


def test_a_second_run_starts_clean(clone):
    assert run().exit_code == 0
    stale = clone / "results/tables/99_old.csv"
    stale.write_text("old")
    (clone / "results/bench.csv").write_text("kept")
    assert run().exit_code == 0
    assert not stale.exists()
    assert (clone / "results/bench.csv").read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["12"], "no notebook named '12'; there are 10_good"),
        (["-p", "cuont", "3"], "no parameter named 'cuont'; there are count, results_dir, scale"),
        (["-p", "count", "many"], "parameter count is 'many'; expected int"),
        (["-p", "scale", "true"], "parameter scale is True; expected float"),
        (["--output", "."], "was not written by this command; name a new or empty folder"),
        (["--output", "notebooks/10_good.ipynb"], "Not a directory"),
    ],
)
def test_mistakes_are_one_sentence_and_touch_nothing(clone, arguments, sentence):
    before = sorted(clone.rglob("*"))
    result = run(*arguments)
    assert result.exit_code == 2
    assert sentence in result.output
    assert result.output.startswith("profilecal: ")
    assert len(result.output.strip().splitlines()) == 1
    assert sorted(clone.rglob("*")) == before


def test_a_notebook_on_measurements_that_are_not_here_is_left_out_and_named(clone, monkeypatch):
    needs = 'real_data: str = ""  # [folder]'
    write(clone / "notebooks/61_real.ipynb", "open('ran', 'w').close()", parameters=needs)
    monkeypatch.delenv("PROFILECAL_REAL_DATA", raising=False)
    result = run()
    assert result.exit_code == 0
    assert "Left out 61_real: PROFILECAL_REAL_DATA is not set" in result.output
    assert not (clone / "notebooks/ran").exists()

    monkeypatch.setenv("PROFILECAL_REAL_DATA", str(clone))
    assert "Left out" not in run().output
    assert (clone / "notebooks/ran").exists()


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_stops_its_notebooks_and_the_next_starts_clean(clone, stop):
    write(clone / "notebooks/20_slow.ipynb", 'open("started", "w").close()', "import time; time.sleep(120)")
    code = (
        "from pathlib import Path; from profilecal import cli; from profilecal.running import notebooks;"
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"  # else ignored in the background
        "notebooks.folder = lambda: Path('notebooks').resolve(); cli.main()"
    )
    with subprocess.Popen([sys.executable, "-c", code, "reproduce"], stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 60
        while not (clone / "notebooks/started").exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        process.send_signal(stop)
        _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Interrupted. The next run starts clean." in said
    assert not (clone / "results/scorecard.csv").exists()
    (clone / "notebooks/20_slow.ipynb").unlink()
    assert run().exit_code == 0
    assert [path.name for path in (clone / "results/notebooks").iterdir()] == ["10_good.ipynb"]


@pytest.mark.parametrize(
    ("text", "value"),
    [("3", 3), ("1e-3", 0.001), ("true", True), ("False", False), ("[1, 2]", [1, 2]), ("plane", "plane"), ("", "")],
)
def test_parameters_typed_at_the_command_line(text, value):
    parsed = notebooks.parse_value(text)
    assert parsed == value
    assert type(parsed) is type(value)


def test_help_and_version_answer():
    for option in ("--help", "-h", "--version"):
        assert CliRunner().invoke(main, [option]).exit_code == 0
