"""A sweep against papermill alone: wall time, because a sweep's gain is the other cores
and its cost is waiting.
"""

import tempfile
import time
from pathlib import Path

from bench import at_most, seconds
from command import write_notebook
from dask.system import CPU_COUNT

from profilecal_tool.sweep import sweep

RUNS = 40
WALL = time.perf_counter
SECOND = """import time
from profilecal_pages.notebooks import record
time.sleep(1)
record(y=n)"""


def serial(notebook: Path, folder: Path) -> None:
    """papermill alone, in this process, one run after the other."""
    import papermill

    quiet = {"progress_bar": False, "extra_arguments": ["--log-level=CRITICAL"]}
    for n in range(RUNS):
        papermill.execute_notebook(
            str(notebook), str(folder / "out.ipynb"), {"n": n}, **quiet
        )


def rows() -> list[dict]:
    """A sweep with all cores, against serial papermill of the same notebook."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        notebook = write_notebook(folder / "second.ipynb", "n: int = 0", SECOND)
        grid = {"n": list(range(RUNS))}
        alone = seconds(lambda: serial(notebook, folder), WALL)
        every = seconds(lambda: sweep(notebook, grid, folder / "every"), WALL)
    cores = f"sweep: {RUNS} runs of 1 s on {CPU_COUNT} cores"
    return [at_most(0.6, cores, every, "papermill, serial", alone)]
