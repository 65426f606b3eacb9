"""Parameter sweeps: what a grid means, and that nothing is lost, repeated or reused
wrongly, whatever happens.
"""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command import run, write_notebook

from profilecal_pages import notebooks
from profilecal_pages.notebooks import record, recorded
from profilecal_tool import sweep

PARAMETERS = (
    "n: int = 3  # count\nx: float = 0.5  # [mm] width\nseed: int = 7  # of the noise"
)
DRAW = "import random\nfrom profilecal_pages.notebooks import record\nrecord(y=n * x, u=random.Random(seed).gauss(0, 1))"
GRID = {"n": [1, 2], "x": [0.1, 3]}


@pytest.fixture
def notebook(tmp_path):
    return write_notebook(tmp_path / "draw.ipynb", PARAMETERS, DRAW)


def without_duration(table: pd.DataFrame) -> str:
    """All bits of a table but how long its runs took."""
    return table.drop(columns="duration_s").to_csv(index=False)


def landed(folder: Path) -> dict[str, int]:
    """The executed notebooks of a sweep, each with the time it was written."""
    return {
        path.stem: path.stat().st_mtime_ns for path in (folder / "runs").glob("*.ipynb")
    }


def wait_for(condition, seconds: float = 60) -> None:
    """Return as soon as the condition holds; fail after some time."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.02)


# What a grid means


def test_grids_mean_each_value_with_each_other(notebook):
    product = sweep.plan(notebook, {"n": [1, 2], "x": [0.1, 3], "seed": 5}).values()
    assert [tuple(point.values()) for point in product] == [
        (1, 0.1, 5),
        (1, 3.0, 5),
        (2, 0.1, 5),
        (2, 3.0, 5),
    ]
    assert [*sweep.plan(notebook, {"n": 2, "x": [3, 4]}).values()] == [
        {"n": 2, "x": 3.0},
        {"n": 2, "x": 4.0},
    ]


def test_seeds_depend_on_the_point_and_the_repeat_only(notebook):
    small = sweep.plan(notebook, {"n": [1], "x": [0.1, 3]}, 2)
    large = sweep.plan(notebook, {"n": [2, 1], "x": [3, 0.1, 7.0]}, 3)
    assert small.items() < large.items()
    seeds = [point["seed"] for point in large.values()]
    assert len(set(seeds)) == len(seeds) == 18
    other = sweep.plan(notebook, {"n": [1], "x": [0.1, 3], "seed": 8}, 2)
    assert not {point["seed"] for point in other.values()} & set(seeds)


@pytest.mark.parametrize(
    ("grid", "repeat", "sentence"),
    [
        ({}, None, "the grid is empty; plain has the parameters n, x, grain"),
        ({"n": []}, None, "the grid has no values for n"),
        ({"m": [1]}, None, "no parameter named 'm'; there are n, x, grain"),
        ({"n": [1, 2.5]}, None, "parameter n is 2.5; expected int"),
        ({"x": ["wide"]}, None, "parameter x is 'wide'; expected float"),
        ({"x": [1, 1.0]}, None, "names a run twice"),
        (
            {"n": [1]},
            2,
            "plain has no parameter 'seed', so its repeats would all be the same",
        ),
    ],
)
def test_a_grid_that_does_not_fit_is_refused(tmp_path, grid, repeat, sentence):
    notebook = write_notebook(
        tmp_path / "plain.ipynb", PARAMETERS.replace("seed", "grain")
    )
    with pytest.raises(ValueError, match=sentence):
        sweep.plan(notebook, grid, repeat)


def test_a_grid_is_read_from_a_file_and_the_command_line(tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text("n = [1, 2]\nx = 0.5\n")
    assert sweep.read_grid(path, ["x=1,2.5"]) == {"n": [1, 2], "x": [1, 2.5]}
    path.write_text("n: [1, 2]")
    with pytest.raises(ValueError, match=r"grid.toml: .*line 1"):
        sweep.read_grid(path)
    for texts in (["x"], ["x=1", "x=2"]):
        with pytest.raises(ValueError, match="expected name=value"):
            sweep.read_grid(None, texts)
    there = notebooks.folder()
    runs = sweep.plan(
        there / "51_one_plan.ipynb", sweep.read_grid(there / "51_sweeping_grid.toml")
    )
    assert len(runs) == 54  # as the file, the notebook and the README say


def test_recorded_values_come_back_exactly(monkeypatch):
    shown = []
    monkeypatch.setattr(
        "IPython.display.display",
        lambda data, raw: shown.append({"outputs": [{"data": data}]}),
    )
    values = {
        "a": np.float64(0.1) + 0.2,
        "b": np.int64(3),
        "c": "text",
        "d": True,
        "e": None,
        "f": float("inf"),
    }
    record(**values)
    record(pd.DataFrame({"k": [1, 2]}), a=1)
    record(pd.DataFrame({"k": []}), a=2)
    assert recorded({"cells": shown}) == [
        values,
        {"a": 1, "k": 1},
        {"a": 1, "k": 2},
        {"a": 2},
    ]
    assert recorded({"cells": []}) == [{}]
    with pytest.raises(
        TypeError, match="is a set; expected a number, text, true or false"
    ):
        record(a={1})


# What a sweep does


def test_finished_runs_are_kept_and_stale_or_failed_ones_repeated(
    tmp_path, cluster, monkeypatch
):
    output, there = tmp_path / "out", {"scheduler": cluster.scheduler_address}
    notebook = write_notebook(
        tmp_path / "draw.ipynb", PARAMETERS, "assert n < 2, 'too many'\n" + DRAW
    )
    table, failed = sweep.sweep(notebook, {"n": [1, 2]}, output, **there)
    before = landed(output)
    ((name, why),) = failed.items()
    assert why == "error in cell 2: AssertionError: too many"
    assert "Traceback" in (output / "runs" / f"{name}.ipynb").read_text()
    assert list(table["status"]) == ["done", "failed"]
    assert table["y"][0] == 0.5
    assert without_duration(pd.read_csv(output / "table.csv")) == without_duration(
        table
    )

    table, _ = sweep.sweep(notebook, {"n": [0, 1, 2]}, output, **there)
    after = landed(output)
    assert [run for run in before if after[run] != before[run]] == [name]
    assert list(table["n"]) == [0, 1, 2]

    write_notebook(notebook, PARAMETERS, DRAW)  # changed
    assert not sweep.sweep(notebook, {"n": [1, 2]}, output, **there)[1]
    assert sum(time != after[run] for run, time in landed(output).items()) == 2
    other = notebooks.versions() | {"numpy": "another"}
    monkeypatch.setattr(notebooks, "versions", lambda: other)
    with pytest.raises(
        ValueError,
        match=r"a worker has .*; expected .*another.* as where this was started",
    ):
        sweep.sweep(notebook, {"n": [1]}, output, **there)
    assert sorted(path.name for path in output.iterdir()) == ["runs", "table.csv"]


@pytest.mark.parametrize(
    ("code", "why"),
    [
        (
            "from profilecal_pages.notebooks import record\nrecord(x=1)",
            "it records x, which is a parameter's name",
        ),
        ("import os\nos._exit(3)", "Kernel died"),
        (
            "import os, pathlib\nif not pathlib.Path('mark').exists():\n    open('mark', 'w').close()\n    os._exit(3)",
            "",
        ),
        ("import time\ntime.sleep(60)", "a cell took longer than 1 s"),
    ],
    ids=["clash", "dies", "dies once", "hangs"],
)
def test_runs_that_go_wrong(tmp_path, cluster, code, why):
    notebook = write_notebook(tmp_path / "wrong.ipynb", PARAMETERS, code)
    timeout = 1 if "sleep" in code else None
    _, failed = sweep.sweep(
        notebook,
        {"x": 2},
        tmp_path,
        scheduler=cluster.scheduler_address,
        timeout=timeout,
    )
    assert list(failed.values()) == [why] * bool(why)


def test_a_worker_that_is_killed_costs_nothing(tmp_path, cluster):
    code = "import os, time\nos.makedirs(str(n), exist_ok=True)\ntime.sleep(3)"
    notebook = write_notebook(tmp_path / "slow.ipynb", PARAMETERS, code, DRAW)

    def kill():
        wait_for((tmp_path / "1").exists)
        for worker in cluster.workers.values():
            os.kill(worker.pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    table, failed = sweep.sweep(
        notebook, {"n": [1, 2]}, tmp_path, scheduler=cluster.scheduler_address
    )
    killer.join()
    assert not failed
    assert list(table["u"]) == [random.Random(7).gauss(0, 1)] * 2


def test_what_cannot_be_begun(notebook, tmp_path):
    with (
        sweep._alone(tmp_path),
        pytest.raises(ValueError, match="another sweep is writing to"),
    ):
        sweep.sweep(notebook, GRID, tmp_path)
    for nowhere, error in (("localhost", ValueError), ("tcp://127.0.0.1:9", OSError)):
        with pytest.raises(error, match=nowhere):
            sweep.sweep(notebook, GRID, tmp_path, scheduler=nowhere)


def test_stopped_it_leaves_no_kernel_and_goes_on(tmp_path):
    code = "import os, pathlib, time\nif n > 1:\n    pathlib.Path('kernel').write_text(str(os.getpid()))\n"
    code += "    while not pathlib.Path('go').exists():\n        time.sleep(0.1)"
    notebook = write_notebook(tmp_path / "slow.ipynb", PARAMETERS, code, DRAW)
    kernel, output = tmp_path / "kernel", tmp_path / "out"
    command = [
        str(Path(sys.executable).with_name("profilecal")),
        "sweep",
        str(notebook),
        "-p",
        "n=1,2",
    ]
    command += ["--output", str(output)]
    kept = {}
    for stop in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT):
        if signal.getsignal(stop) == signal.SIG_IGN:
            continue  # what a shell starts in the background ignores Ctrl-C
        with subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, start_new_session=True
        ) as process:
            wait_for(
                lambda: kernel.exists() and kernel.read_text() and len(landed(output))
            )
            os.killpg(
                process.pid, stop
            ) if stop == signal.SIGINT else process.send_signal(
                stop
            )  # as a terminal does
            _, said = process.communicate(timeout=30)
        if stop != signal.SIGKILL:
            assert process.returncode == 130
            assert said.strip().endswith(
                "Interrupted. The same command goes on from here."
            )
            assert "Traceback" not in said
        wait_for(lambda: not Path("/proc", kernel.read_text()).exists(), 10)
        kernel.unlink()
        kept = kept or landed(output)
        assert landed(output) == kept  # one run, and never again
    assert len(kept) == 1

    (tmp_path / "go").touch()
    finished = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert finished.returncode == 0, finished.stderr
    assert kept.items() < landed(output).items()
    assert list(pd.read_csv(output / "table.csv")["n"]) == [1, 2]
    assert sorted(path.name for path in output.iterdir()) == ["runs", "table.csv"]


def test_the_command(tmp_path, cluster):
    notebook = write_notebook(
        tmp_path / "draw.ipynb", PARAMETERS, "assert n < 3, 'too many'\n" + DRAW
    )
    output = tmp_path / "out"
    start = [
        "sweep",
        notebook,
        "--output",
        output,
        "--scheduler",
        cluster.scheduler_address,
    ]
    refused = run(*start, "-p", "m=1")
    assert (refused.exit_code, refused.stderr) == (
        2,
        "profilecal: no parameter named 'm'; there are n, x, seed\n",
    )
    assert not output.exists()
    done = run(*start, "-p", "n=1,3", "-p", "x=0.5,2", "--plot", "x", "y", "--hue", "n")
    assert done.exit_code == 1
    assert f"Runs: 2 done, 2 failed: {output}/table.csv" in done.output
    assert "FAILED n=3_x=0.5_" in done.output
    assert "AssertionError: too many" in done.output
    assert (output / "y_over_x.png").exists()
    refused = run(*start, "-p", "n=1", "-p", "x=0.5", "--plot", "x", "z")
    assert "no column named 'z'; there are n, x, y, u, status" in refused.stderr
