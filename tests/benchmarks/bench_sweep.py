"""A sweep against papermill alone: wall time, because a sweep's gain is the other cores
and its cost is waiting.
"""

import tempfile
import time
from pathlib import Path

from bench import at_most, seconds
from command import write_notebook
from dask.system import CPU_COUNT
from distributed import LocalCluster

from profilecal_tool.sweep import sweep

RUNS = 40
SECOND = """import time
from profilecal_pages.notebooks import record
time.sleep(1)
record(y=n)"""


def wall(function, *arguments, **options) -> float:
    """Wall time of a call."""
    return seconds(lambda: function(*arguments, **options), time.perf_counter)


def serial(notebook: Path, folder: Path) -> None:
    """papermill alone, in this process, one run after the other."""
    import papermill

    quiet = {"progress_bar": False, "extra_arguments": ["--log-level=CRITICAL"]}
    for n in range(RUNS):
        papermill.execute_notebook(
            str(notebook), str(folder / "out.ipynb"), {"n": n}, **quiet
        )


def rows() -> list[dict]:
    """Sweeps with one and with all cores, against serial papermill of the same
    notebook.
    """
    half, few = RUNS // 2, 4
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        notebook = write_notebook(folder / "second.ipynb", "n: int = 0", SECOND)
        alone = wall(serial, notebook, folder)
        every = wall(sweep, notebook, {"n": list(range(RUNS))}, folder / "every")
        with LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        ) as one_core:
            taken = [
                wall(
                    sweep,
                    notebook,
                    {"n": list(range(count))},
                    folder / f"first {count}",
                    scheduler=one_core.scheduler_address,
                )
                for count in (few, half)
            ]
    cores = f"sweep: {RUNS} runs of 1 s on {CPU_COUNT} cores"
    more = (taken[1] - taken[0]) / (half - few)
    serial_and_more = alone / RUNS + 0.3
    return [
        at_most(0.6, cores, every, "papermill, serial", alone),
        at_most(
            1,
            "sweep: a run more on one core, of 1 s",
            more,
            "papermill, serial + 0.3 s",
            serial_and_more,
        ),
    ]
