"""Parameter sweeps: what a grid means, and what is kept, repeated and reused.

Nothing is lost, repeated or reused wrongly, whatever happens.
"""

import functools
import os
import signal
import sys
import time
from pathlib import Path
from threading import get_ident

import numpy as np
import pandas as pd
import pytest
from command import run, stopped, write_notebook

from profilecal_pages import notebooks
from profilecal_pages.notebooks import record, recorded
from profilecal_tool import sweep

PARAMETERS = """
n: int = 3  # count
x: float = 0.5  # [mm] width
seed: int = 7  # of the noise
""".strip()
DRAW = """
import random
from profilecal_pages.notebooks import record
record(y=n * x, u=random.Random(seed).gauss(0, 1))
""".strip()
AT_MOST_1 = "assert n < 2, 'too many'"
AT_MOST_2 = "assert n < 3, 'too many'"


@pytest.fixture
def notebook(tmp_path):
    return write_notebook(tmp_path / "draw.ipynb", PARAMETERS, DRAW)


def without_duration(table: pd.DataFrame) -> str:
    """All bits of a table but how long its runs took."""
    return table.drop(columns="duration_s").to_csv(index=False)


def written_at(folder: Path) -> dict[str, int]:
    """The executed notebooks of a sweep, each with the time it was written."""
    paths = (folder / "runs").glob("*.ipynb")
    return {path.stem: path.stat().st_mtime_ns for path in paths}


def wait_for(condition, seconds: float = 60) -> None:
    """Return as soon as the condition holds; fail after some time."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.02)


# What a grid means


def test_each_value_meets_each_other_with_seeds_of_the_point_and_the_repeat(notebook):
    small = sweep.plan(notebook, {"n": [1], "x": [0.1, 3]}, 2)
    large = sweep.plan(notebook, {"n": [2, 1], "x": [3, 0.1, 7.0]}, 3)
    assert small.items() < large.items()
    seeds = [point["seed"] for point in large.values()]
    assert len(set(seeds)) == len(seeds) == 18
    other = sweep.plan(notebook, {"n": [1], "x": [0.1, 3], "seed": 8}, 2)
    assert not {point["seed"] for point in other.values()} & set(seeds)


REFUSED = [
    ({}, None, "the grid is empty; plain has the parameters n, x, grain"),
    ({"n": []}, None, "the grid has no values for n"),
    ({"n": [1, 2.5]}, None, "parameter n is 2.5; expected int"),
    ({"x": [1, 1.0]}, None, "names a run twice"),
    ({"n": [1]}, 2, "plain has no parameter 'seed', so its repeats would all be the"),
]


@pytest.mark.parametrize(("grid", "repeat", "sentence"), REFUSED)
def test_a_grid_that_does_not_fit_is_refused(tmp_path, grid, repeat, sentence):
    without_seed = PARAMETERS.replace("seed", "grain")
    notebook = write_notebook(tmp_path / "plain.ipynb", without_seed)
    with pytest.raises(ValueError, match=sentence):
        sweep.plan(notebook, grid, repeat)


def test_a_grid_is_read_from_a_file_and_the_command_line(tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text("n = [1, 2]\nx = 0.5\n")
    assert sweep.read_grid(path, ["x=1,2.5"]) == {"n": [1, 2], "x": [1, 2.5]}
    path.write_text("n: [1, 2]")
    for grid, texts, sentence in (
        (path, [], r"grid.toml: .*line 1"),
        (None, ["x"], "-p x; expected name=value"),
        (None, ["x=1", "x=2"], "-p x=2; expected name=value"),
    ):
        with pytest.raises(ValueError, match=sentence):
            sweep.read_grid(grid, texts)


@pytest.mark.parametrize(("page", "runs"), [("51", 54), ("44", 12)])
def test_grids_that_come_along_have_so_many_runs(page, runs):
    """As the file, the notebook and CONTRIBUTING say."""
    (notebook,) = notebooks.find([page])
    grid = sweep.read_grid(notebooks.folder() / f"{page}_sweeping_grid.toml")
    assert len(sweep.plan(notebook, grid)) == runs


@pytest.fixture
def outputs(monkeypatch):
    """What notebooks hand out while they run, as an executed one has it."""
    shown = []

    def display(data, raw):
        shown.append({"outputs": [{"data": data}]})

    monkeypatch.setattr("IPython.display.display", display)
    return {"cells": shown}


def test_recorded_values_and_tables_come_back_exactly(outputs):
    values = {"a": np.float64(0.1) + 0.2, "b": np.int64(3), "c": "text", "d": True}
    values |= {"e": None, "f": float("inf")}
    assert recorded(outputs) == [{}]
    record(**values)
    assert recorded(outputs) == [values]
    record(pd.DataFrame({"k": [1, 2]}), a=1)
    record(pd.DataFrame({"k": []}), a=2)
    assert recorded(outputs)[1:] == [{"a": 1, "k": 1}, {"a": 1, "k": 2}, {"a": 2}]
    sentence = "is a set; expected a number, text, true or false"
    with pytest.raises(TypeError, match=sentence):
        record(a={1})


# What a sweep does


@pytest.fixture
def swept(tmp_path, cluster):
    """What a sweep into a folder of pytest's returns."""
    scheduler = cluster.scheduler_address
    return functools.partial(sweep.sweep, output=tmp_path, scheduler=scheduler)


def test_a_sweep_says_which_runs_failed_and_why_and_repeats_those_alone(
    tmp_path, swept
):
    output = tmp_path / "out"
    notebook = write_notebook(tmp_path / "draw.ipynb", PARAMETERS, AT_MOST_1, DRAW)
    table, failed = swept(notebook, {"n": [1, 2]}, output=output)
    ((name, why),) = failed.items()
    assert why == "error in cell 2: AssertionError: too many"
    assert "Traceback" in (output / "runs" / f"{name}.ipynb").read_text()
    assert list(table["status"]) == ["done", "failed"]
    assert table["y"][0] == 0.5
    stored = pd.read_csv(output / "table.csv")
    assert without_duration(stored) == without_duration(table)
    assert sorted(path.name for path in output.iterdir()) == ["runs", "table.csv"]

    before = written_at(output)
    table, _ = swept(notebook, {"n": [0, 1, 2]}, output=output)
    after = written_at(output)
    assert [name for name in before if after[name] != before[name]] == list(failed)
    assert list(table["n"]) == [0, 1, 2]

    write_notebook(notebook, PARAMETERS, DRAW)
    table, _ = swept(notebook, {"n": [1]}, output=output)
    (done,) = table["run"]
    assert written_at(output)[done] > after[done]


def test_workers_have_the_versions_of_where_a_sweep_is_started(
    notebook, swept, monkeypatch
):
    monkeypatch.setattr(notebooks, "versions", lambda: {"thread": get_ident()})
    sentence = r"a worker has .*; expected .* as where this was started"
    with pytest.raises(ValueError, match=sentence):
        swept(notebook, {"n": [1]})


DIES_ONCE = """
import os, pathlib
mark = pathlib.Path("mark")
if not mark.exists():
    mark.touch()
    os._exit(3)
"""
HANGS = "import time\ntime.sleep(60)"


WRONG = {
    "dies once": (DIES_ONCE, None, []),
    "hangs": (HANGS, 1, ["a cell took longer than 1 s"]),
}


@pytest.mark.parametrize("what", WRONG)
def test_runs_that_go_wrong(tmp_path, swept, what):
    code, timeout, reasons = WRONG[what]
    notebook = write_notebook(tmp_path / "wrong.ipynb", PARAMETERS, code)
    _, failed = swept(notebook, {"x": 2}, timeout=timeout)
    assert list(failed.values()) == reasons


def test_a_scheduler_that_is_not_there_is_named(notebook, tmp_path, monkeypatch):
    monkeypatch.setattr(notebooks, "ANSWERS_S", 1)
    nowhere = "tcp://127.0.0.1:9"
    with pytest.raises(OSError, match=nowhere):
        sweep.sweep(notebook, {"n": 1}, tmp_path, scheduler=nowhere)


WAITS = """
import os, pathlib, time
if n > 1:
    pathlib.Path("kernel").write_text(str(os.getpid()))
    while not pathlib.Path("go").exists():
        time.sleep(0.1)
"""


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL], ids=str)
def test_stopped_it_leaves_no_kernel_and_goes_on(tmp_path, cluster, how):
    """Killed, it leaves what runs to the workers."""
    notebook = write_notebook(tmp_path / "slow.ipynb", PARAMETERS, WAITS, DRAW)
    kernel = tmp_path / "kernel"
    output = tmp_path / "out"
    program = Path(sys.executable).with_name("profilecal")
    command = [program, "sweep", notebook, "-p", "n=1,2", "--output", output]
    elsewhere = [*command, "--scheduler", cluster.scheduler_address]

    def a_run_is_there_and_one_begun(_):
        return kernel.exists() and kernel.read_text() and written_at(output)

    if how == signal.SIGKILL:
        stopped(elsewhere, tmp_path, how, a_run_is_there_and_one_begun)
    else:
        core = str(min(os.sched_getaffinity(0)))  # so that it starts one worker
        alone = ["taskset", "-c", core, *command]
        said = stopped(alone, tmp_path, how, a_run_is_there_and_one_begun)
        assert said.strip().endswith("Interrupted. The same command goes on from here.")
        assert "Traceback" not in said
        wait_for(lambda: not Path("/proc", kernel.read_text()).exists(), 10)
    kept = written_at(output)
    assert len(kept) == 1

    (tmp_path / "go").touch()
    finished = run(*elsewhere[1:])
    assert finished.exit_code == 0, finished.output
    assert kept.items() < written_at(output).items()
    assert list(pd.read_csv(output / "table.csv")["n"]) == [1, 2]
    assert sorted(path.name for path in output.iterdir()) == ["runs", "table.csv"]


# The command


def test_the_command_counts_names_draws_and_refuses_before_it_writes(tmp_path, cluster):
    notebook = write_notebook(tmp_path / "draw.ipynb", PARAMETERS, AT_MOST_2, DRAW)
    out = tmp_path / "out"
    start = ["sweep", notebook, "--output", out]
    start += ["--scheduler", cluster.scheduler_address]
    refused = run(*start, "-p", "m=1")
    sentence = "profilecal: no parameter named 'm'; there are n, x, seed\n"
    assert (refused.exit_code, refused.stderr) == (2, sentence)
    refused = run("sweep", "5", *start[2:])
    assert "5 may be 50_which_poses or 51_one_plan" in refused.stderr
    assert not out.exists()

    done = run(*start, "-p", "n=1,3", "--plot", "n", "y")
    assert done.exit_code == 1
    assert f"Runs: 1 done, 1 failed: {out}/table.csv" in done.output
    assert "FAILED n=3_" in done.output
    assert "AssertionError: too many" in done.output
    assert (out / "y_over_n.png").exists()
    assert "Not in it" not in done.output
    smaller = run(*start, "-p", "n=1", "--plot", "n", "z")
    assert "no column named 'z'; there are n, y, u, status" in smaller.stderr
    smaller = run(*start, "-p", "n=1")
    assert f"Not in it: 1 of other grids, kept in {out}/runs" in smaller.output
