"""Parameter sweeps: what a grid means, and that nothing is lost, repeated or reused wrongly, whatever happens."""

import errno
import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from profilecal.cli import main
from profilecal.running import notebooks, sweep
from profilecal.running.grid import plan, read_grid
from profilecal.running.record import record, recorded

DRAW = "import random\nfrom profilecal.running.record import record\nrecord(y=n * x, u=random.Random(seed).gauss(0, 1))"
GRID = {"n": [1, 2], "x": [0.1, 3]}


def write_notebook(path: Path, code: str = DRAW) -> Path:
    """A notebook with parameters n, x, seed and one cell of code."""
    parameters = "n: int = 3  # count\nx: float = 0.5  # [mm] width\nseed: int = 7  # of the noise"
    cells = [
        {"cell_type": "code", "id": f"c{k}", "metadata": {"tags": tags}, "source": source}
        for k, (source, tags) in enumerate([(parameters, ["parameters"]), (code, [])])
    ]
    for cell in cells:
        cell.update(execution_count=None, outputs=[])
    kernel = {"kernelspec": {"name": "python3", "language": "python", "display_name": "Python 3"}}
    path.write_text(json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}))
    return path


@pytest.fixture
def notebook(tmp_path):
    return write_notebook(tmp_path / "draw.ipynb")


def without_duration(table: pd.DataFrame) -> str:
    """All bits of a table but how long its runs took."""
    return table.drop(columns="duration_s").to_csv(index=False)


def landed(folder: Path) -> dict[str, int]:
    """The executed notebooks of a sweep, each with the time it was written."""
    return {path.stem: path.stat().st_mtime_ns for path in (folder / "runs").iterdir()}


def wait_for(condition, seconds: float = 30) -> None:
    """Return as soon as the condition holds; fail after some time."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.02)


def is_there(process: int) -> bool:
    """Whether there is a process of that number."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


# What a grid means


def test_product_and_zip(notebook):
    grid = {"n": [1, 2], "x": [0.1, 3], "seed": 5}
    product = [tuple(run.parameters.values()) for run in plan(notebook, grid)]
    assert product == [(1, 0.1, 5), (1, 3.0, 5), (2, 0.1, 5), (2, 3.0, 5)]
    zipped = [tuple(run.parameters.values()) for run in plan(notebook, grid, zipped=True)]
    assert zipped == [(1, 0.1, 5), (2, 3.0, 5)]


def test_seeds_depend_on_the_point_and_the_repeat_only(notebook):
    small = plan(notebook, {"n": [1], "x": [0.1, 3]}, repeat=2)
    large = plan(notebook, {"n": [2, 1], "x": [3, 0.1, 7.0]}, repeat=3)
    assert set(run.name for run in small) < set(run.name for run in large)
    seeds = [run.parameters["seed"] for run in large]
    assert len(set(seeds)) == len(seeds) == 18
    assert {run.parameters["seed"] for run in small} < set(seeds)
    other = plan(notebook, {"n": [1], "x": [0.1, 3], "seed": 8}, repeat=2)
    assert not {run.parameters["seed"] for run in other} & set(seeds)


def test_without_repeats_the_notebooks_own_seed_stays(notebook):
    assert {run.parameters["seed"] for run in plan(notebook, GRID)} == {7}


@pytest.mark.parametrize(
    ("grid", "options", "sentence"),
    [
        ({}, {}, "the grid is empty; draw has the parameters n, x, seed"),
        ({"n": []}, {}, "the grid has no values for n"),
        ({"m": [1]}, {}, "no parameter named 'm'; there are n, x, seed"),
        ({"n": [1, 2.5]}, {}, "parameter n is 2.5; expected int"),
        ({"x": ["wide"]}, {}, "parameter x is 'wide'; expected float"),
        ({"x": [1, 1.0]}, {}, "names a run twice"),
        ({"n": [1, 2, 3], "x": [0.1, 3]}, {"zipped": True}, "--zip: x has 2 values; expected 3, or one for all"),
    ],
)
def test_a_grid_that_does_not_fit_is_refused(notebook, grid, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        plan(notebook, grid, **options)


def test_repeats_need_a_seed(tmp_path):
    notebook = write_notebook(tmp_path / "plain.ipynb")
    notebook.write_text(notebook.read_text().replace("seed: int", "grain: int"))
    with pytest.raises(ValueError, match="plain has no parameter 'seed', so its repeats would all be the same"):
        plan(notebook, {"n": [1]}, repeat=2)


def test_a_grid_is_read_from_yaml_and_the_command_line(tmp_path):
    path = tmp_path / "grid.yaml"
    path.write_text("n: [1, 2]\nx: 0.5\n")
    assert read_grid(path, ["x=1,2.5"]) == {"n": [1, 2], "x": [1, 2.5]}
    for text, sentence in (("- 1\n", "expected parameters"), ("n: [1", "is not YAML")):
        path.write_text(text)
        with pytest.raises(ValueError, match=sentence):
            read_grid(path)
    with pytest.raises(ValueError, match="expected name=value"):
        read_grid(None, ["x"])


# What a notebook hands out


def output_of(capture) -> dict:
    """A notebook that displayed what was captured."""
    return {"cells": [{"outputs": [{"data": {kind: [text] for kind, text in capture.items()}}]}]}


def test_recorded_values_come_back_exactly(monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", lambda data, raw: shown.append(data))
    values = {"a": np.float64(0.1) + 0.2, "b": np.int64(3), "c": "text", "d": True, "e": None, "f": float("inf")}
    record(**values)
    (row,) = recorded(output_of(shown[0]))
    assert row == values
    record(pd.DataFrame({"k": [1, 2], "v": [0.1, np.nan]}), a=1)
    rows = recorded(output_of(shown[1]))
    assert [row["k"] for row in rows] == [1, 2]
    assert [row["a"] for row in rows] == [1, 1]
    assert np.isnan(rows[1]["v"])
    with pytest.raises(TypeError, match="is a set; expected a number, text, true or false"):
        record(a={1})


# What a sweep does


def test_finished_runs_are_kept_and_stale_or_failed_ones_repeated(tmp_path, monkeypatch):
    output = tmp_path / "out"
    notebook = write_notebook(tmp_path / "draw.ipynb", "assert n < 2, 'too many'\n" + DRAW)
    grid = {"n": [1, 2]}
    first = sweep.sweep(notebook, grid, output)
    before = landed(output)
    ((name, why),) = first.failed.items()
    assert why == "error in cell 2: AssertionError: too many"
    assert "Traceback" in (output / "runs" / f"{name}.ipynb").read_text()
    assert list(first.table["status"]) == ["done", "failed"]
    assert first.table["y"][0] == 0.5
    assert without_duration(pd.read_csv(output / "table.csv")) == without_duration(first.table)

    sweep.sweep(notebook, {"n": [0, 1, 2]}, output, parquet=True)
    after = landed(output)
    assert [run for run in before if after[run] != before[run]] == [name]
    assert len(after) == 3
    assert list(pd.read_parquet(output / "table.parquet")["n"]) == [0, 1, 2]

    write_notebook(notebook, DRAW)  # changed
    assert not sweep.sweep(notebook, grid, output).failed
    changed = landed(output)
    assert sum(changed[run] != after[run] for run in after) == 2
    present = sweep.versions() | {"numpy": "another"}
    monkeypatch.setattr(sweep, "versions", lambda: present)
    table = sweep.sweep(notebook, {"n": [1]}, output).table
    assert list(table["numpy"]) == ["another"]
    assert sum(time != changed[run] for run, time in landed(output).items()) == 1
    assert sorted(path.name for path in output.iterdir()) == ["runs", "table.csv", "table.parquet"]


def test_a_recorded_name_that_is_a_parameter_fails_the_run(tmp_path):
    notebook = write_notebook(tmp_path / "clash.ipynb", "from profilecal.running.record import record\nrecord(x=1)")
    done = sweep.sweep(notebook, {"x": [2]}, tmp_path / "out")
    assert list(done.failed.values()) == ["it records x, which is a parameter's name"]


def test_dead_kernels_are_tried_once_more(tmp_path):
    code = """
import os, pathlib
mark = pathlib.Path("mark")
if n == 2 or not mark.exists():
    mark.touch()
    os._exit(3)
"""
    notebook = write_notebook(tmp_path / "die.ipynb", code)
    first = sweep.sweep(notebook, {"n": [1]}, tmp_path / "out")
    assert not first.failed
    second = sweep.sweep(notebook, {"n": [2]}, tmp_path / "out")
    assert list(second.failed.values()) == ["Kernel died (2 attempts)"]


def test_a_hung_kernel_is_ended_and_its_run_tried_once_more(tmp_path, monkeypatch):
    code = """
import os, pathlib, time
mark = pathlib.Path("mark")
again = mark.exists()
mark.write_text(str(os.getpid()))
while not again:
    time.sleep(1)
"""
    notebook, mark, fired = write_notebook(tmp_path / "hang.ipynb", code), tmp_path / "mark", []

    class Clock(threading.Timer):
        """Runs out as soon as the notebook hangs, however slow the machine is."""

        def run(self):
            wait_for(lambda: self.finished.is_set() or (mark.exists() and mark.read_text()), 120)
            if not self.finished.is_set() and not fired:
                fired.append(int(mark.read_text()))
                self.function()

    monkeypatch.setattr(notebooks, "threading", SimpleNamespace(Timer=Clock, Event=threading.Event))
    done = sweep.sweep(notebook, {"n": [1]}, tmp_path / "out", timeout=1000)
    assert not done.failed
    wait_for(lambda: not is_there(fired[0]))


def test_a_run_that_takes_too_long(notebook, tmp_path):
    with pytest.raises(notebooks.NotebookLost, match=r"not done after 0.1 s"):
        notebooks.run(notebook, tmp_path / "out.ipynb", {}, timeout=0.1)
    assert not notebooks._running


def test_disk_full_stops_and_goes_on_later(notebook, tmp_path, monkeypatch):
    output, whole, written = tmp_path / "out", sweep.whole, []

    def full(path, scratch):
        written.append(path)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        return whole(path, scratch)

    with monkeypatch.context() as patch:
        patch.setattr(sweep, "whole", full)
        with pytest.raises(OSError, match="No space left on device"):
            sweep.sweep(notebook, GRID, output)
    kept = landed(output)
    assert len(kept) == 2  # whole
    assert not (output / ".unfinished").exists()
    assert len(sweep.sweep(notebook, GRID, output).table) == 4
    assert kept.items() < landed(output).items()


def test_errors_of_the_system_come_through_as_such(notebook, tmp_path):
    with pytest.raises(OSError, match=r"No such file|doesn't exist"):
        notebooks.run(notebook, tmp_path / "nowhere" / "out.ipynb", {})


def test_two_sweeps_do_not_share_a_folder(notebook, tmp_path):
    with sweep._alone(tmp_path), pytest.raises(ValueError, match="another sweep is writing to"):
        sweep.sweep(notebook, GRID, tmp_path)


def test_killed_at_any_moment_it_goes_on(notebook, tmp_path):
    output = tmp_path / "out"
    command = [
        str(Path(sys.executable).with_name("profilecal")),
        "sweep",
        str(notebook),
        "-p",
        "n=1,2,3,4",
        "--output",
        str(output),
    ]
    rng = np.random.default_rng(3)
    for _ in range(2):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            wait_for((output / ".unfinished").exists)
            time.sleep(rng.uniform(0, 4))
        finally:
            process.kill()
            process.wait()
        for path in (output / "runs").iterdir():
            json.loads(path.read_text())
    before = landed(output)
    finished = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert finished.returncode == 0, finished.stderr
    assert before.items() <= landed(output).items()
    table = pd.read_csv(output / "table.csv")
    assert list(table["n"]) == [1, 2, 3, 4]
    assert set(table["run"]) == set(landed(output))
    assert sorted(path.name for path in output.iterdir()) == ["runs", "table.csv"]


# On a cluster


@pytest.fixture
def cluster(tmp_path):
    """Address and two worker processes of a scheduler on the loopback."""
    where = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0"]
    file = tmp_path / "scheduler.json"
    python = [sys.executable, "-m"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    with ExitStack() as stack:

        def start(*command):
            process = subprocess.Popen([*python, *command], **quiet)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        start("distributed.cli.dask_scheduler", *where, "--port", "0", "--scheduler-file", str(file))
        wait_for(lambda: file.exists() and file.read_text())  # it is there before its text is
        address = json.loads(file.read_text())["address"]
        workers = [
            start(
                "distributed.cli.dask_worker",
                address,
                *where,
                "--no-nanny",
                "--nthreads",
                "1",
                "--local-directory",
                f"w{k}",
            )
            for k in range(2)
        ]
        yield address, workers


def test_a_cluster_gives_the_same_table_even_when_a_worker_is_killed(notebook, tmp_path, cluster, monkeypatch):
    address, workers = cluster
    monkeypatch.setattr(notebooks, "cores", lambda: 1)
    grid = {"n": [1, 2]}
    here = sweep.sweep(notebook, grid, tmp_path / "here")
    there = sweep.sweep(notebook, grid, tmp_path / "there", scheduler=address)
    assert without_duration(here.table) == without_duration(there.table)

    def kill_a_worker_at_work():
        wait_for(lambda: list((tmp_path / "w0").glob("**/run-*/*.ipynb")))
        workers[0].send_signal(signal.SIGKILL)

    killer = threading.Thread(target=kill_a_worker_at_work)
    killer.start()
    again = sweep.sweep(notebook, grid, tmp_path / "again", scheduler=address)
    killer.join()
    assert workers[0].wait(30) == -signal.SIGKILL
    assert without_duration(again.table) == without_duration(here.table)


def test_a_scheduler_that_is_not_there(notebook, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep, "PATIENCE_S", 1)
    with pytest.raises(OSError, match="no Dask scheduler answers at tcp"):
        sweep.sweep(notebook, GRID, tmp_path, scheduler="tcp://127.0.0.1:9")


# The command


def test_the_command(tmp_path):
    notebook = write_notebook(tmp_path / "draw.ipynb", "assert n < 3, 'too many'\n" + DRAW)
    output = tmp_path / "out"
    start = ["sweep", str(notebook), "--output", str(output)]
    refused = CliRunner().invoke(main, [*start, "-p", "m=1"])
    assert (refused.exit_code, refused.stderr) == (2, "profilecal: no parameter named 'm'; there are n, x, seed\n")
    assert not output.exists()
    done = CliRunner().invoke(main, [*start, "-p", "n=1,3", "-p", "x=0.5,2", "--plot", "x", "y", "--hue", "n"])
    assert done.exit_code == 1
    assert f"2 runs done, 2 failed: {output}/table.csv" in done.output
    assert "FAILED n=3_x=0.5_" in done.output
    assert "AssertionError: too many" in done.output
    assert (output / "y_over_x.png").exists()
    assert "other grids" not in done.output
    refused = CliRunner().invoke(main, [*start, "-p", "n=1", "-p", "x=0.5", "--plot", "x", "z"])
    assert "no column named 'z'; there are n, x, seed, y, u, status" in refused.stderr
    fewer = CliRunner().invoke(main, [*start, "-p", "n=1", "-p", "x=0.5"])
    assert f"3 runs of other grids stay in {output}/runs; the table holds this grid's alone" in fewer.output


def test_the_large_grid_fits_its_notebook():
    folder = notebooks.folder()
    runs = plan(folder / "51_one_plan.ipynb", read_grid(folder / "50_sweeping_grid.yaml"))
    assert len(runs) == 54  # as the file, the notebook and the README say
