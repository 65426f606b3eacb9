"""A sweep against papermill alone: wall time, because a sweep's gain is the other cores and its cost is waiting."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from profilecal.running import notebooks, sweep

RUNS = 40
SECOND = "import time\nfrom profilecal.running.record import record\ntime.sleep(1)\nrecord(y=n)"


def write_notebook(path: Path, code: str) -> Path:
    """A notebook with a parameter n and one cell of code."""
    cells = [("n: int = 0  # any", ["parameters"]), (code, [])]
    empty = {"cell_type": "code", "execution_count": None, "outputs": []}
    cells = [empty | {"id": f"c{k}", "metadata": {"tags": tags}, "source": s} for k, (s, tags) in enumerate(cells)]
    kernel = {"kernelspec": {"name": "python3", "language": "python", "display_name": "Python 3"}}
    path.write_text(json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}))
    return path


def row(name: str, ours: float, reference: str, other: float, target: float) -> dict:
    """A line of results/bench.csv; the target is the largest ratio wanted."""
    names = ("name", "ours_s", "reference", "reference_s", "ratio", "target", "met")
    ratio = ours / other
    return dict(
        zip(
            names,
            (name, round(ours, 3), reference, round(other, 3), round(ratio, 3), f"ratio ≤ {target:g}", ratio <= target),
            strict=True,
        )
    )


def seconds(function, *arguments, **options) -> float:
    """Wall time of a call."""
    start = time.perf_counter()
    function(*arguments, **options)
    return time.perf_counter() - start


def serial(notebook: Path, folder: Path, runs: int) -> float:
    """Wall time of papermill alone, in this process, one run after the other."""
    import papermill

    def execute():
        for n in range(runs):
            papermill.execute_notebook(str(notebook), str(folder / "out.ipynb"), {"n": n}, progress_bar=False)

    return seconds(execute)


def first_run(folder: Path) -> tuple[float, float]:
    """Of a 1,000-point sweep, started as a command: seconds until its first run starts, and its memory later, MB.

    Ends after ten runs. Linux only, where /proc tells the memory.
    """
    notebook = write_notebook(folder / "quick.ipynb", "pass")
    (folder / "grid.yaml").write_text(f"n: {list(range(1000))}\n")
    output = folder / "thousand"
    command = [str(Path(sys.executable).with_name("profilecal")), "sweep", str(notebook), str(folder / "grid.yaml")]
    start = time.perf_counter()
    with subprocess.Popen([*command, "--output", str(output)], stderr=subprocess.DEVNULL) as process:
        try:
            while not any((output / ".unfinished").glob("**/run-*")):
                time.sleep(0.02)
            took = time.perf_counter() - start
            while len(list((output / "runs").glob("*"))) < 10:
                time.sleep(0.1)
            status = Path(f"/proc/{process.pid}/status").read_text()
        finally:
            process.terminate()
    return took, int(status.split("VmHWM:")[1].split()[0]) / 1024


def rows() -> list[dict]:
    """Sweeps with one and with all cores, against serial papermill of the same notebook; a large grid's start."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        notebook = write_notebook(folder / "second.ipynb", SECOND)
        alone = serial(notebook, folder, RUNS)
        grid = {"n": list(range(RUNS))}
        every = seconds(sweep.sweep, notebook, grid, folder / "every")
        cores, notebooks.cores = notebooks.cores, lambda: 1
        try:
            few, many = (
                seconds(sweep.sweep, notebook, {"n": list(range(n))}, folder / f"one{n}") for n in (4, RUNS // 2)
            )
        finally:
            notebooks.cores = cores
        took, memory = first_run(folder)
    return [
        row(f"sweep: {RUNS} runs of 1 s on {cores()} cores", every, "papermill, serial", alone, 0.6),
        row(
            "sweep: a run more on one core, of 1 s",
            (many - few) / (RUNS // 2 - 4),
            "papermill, serial + 0.3 s",
            alone / RUNS + 0.3,
            1.0,
        ),
        row("sweep: first of 1,000 runs started", took, "limit", 10.0, 1.0),
        row("sweep: memory of the parent at 1,000 points, MB", memory, "limit", 500.0, 1.0),
    ]


if __name__ == "__main__":
    for line in rows():
        print(line)
