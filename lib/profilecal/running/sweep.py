"""One notebook over a grid of parameters, here or on a cluster, and one tidy table of what its runs record.

An executed notebook holds all there is to know about its run: parameters, seed, versions, what it recorded. It appears
under `runs/` in one move, so a sweep that is killed leaves whole runs or none, and goes on from there.
"""

import contextlib
import itertools
import json
import logging
import os
import platform
import shutil
import tempfile
import time
from dataclasses import dataclass
from hashlib import sha256
from importlib import metadata
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from profilecal.running import notebooks
from profilecal.running.grid import Run, digest, plan
from profilecal.running.record import recorded
from profilecal.scan.files import whole

ATTEMPTS = 2  # at a run whose kernel dies or hangs
PATIENCE_S = 10  # with a scheduler that does not answer
BAR = "{l_bar}{bar}| {n}/{total} runs{postfix}, {elapsed} gone, {remaining} left"


@dataclass(frozen=True)
class Sweep:
    """What a sweep found: the table and where it is written, by name of the run why some failed, and how many runs of
    other grids are beside them."""

    path: Path
    table: pd.DataFrame
    failed: dict[str, str]
    others: int


# One run


def versions() -> dict[str, str]:
    """What a run's result depends on beside its notebook; a change of profilecal's source shows in its version."""
    source = sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        source.update(path.read_bytes())
    found = {name: metadata.version(name) for name in ("profilecal", "numpy", "scipy", "pandas")}
    found["profilecal"] += f"+{source.hexdigest()[:8]}"
    return {"python": platform.python_version()} | found


def without_outputs(path: Path) -> str:
    """A notebook as it is before its execution."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            cell.update(outputs=[], execution_count=None)
    return json.dumps(notebook, sort_keys=True)


def execute(run: Run, key: str, source: str, folder: str, expected: dict, timeout: float | None) -> str:
    """Carry out one run, wherever this is called, and return the executed notebook's text.

    Raises ValueError where other versions are installed than where the sweep was started.
    """
    from distributed import get_worker

    there = versions()
    for name, version in expected.items():
        if there[name] != version:
            raise ValueError(f"a worker has {name} {there[name]}; expected {version}, as where the sweep was started")
    with tempfile.TemporaryDirectory(prefix="run-", dir=get_worker().local_directory) as scratch:
        begin, end = Path(scratch, "source.ipynb"), Path(scratch, "executed.ipynb")
        begin.write_text(source, encoding="utf-8")
        cwd = Path(folder) if Path(folder).is_dir() else begin.parent
        for attempt in range(1, ATTEMPTS + 1):
            start = time.perf_counter()
            error = ""
            try:
                notebooks.run(begin, end, run.parameters, folder=cwd, timeout=timeout, keep=True)
            except notebooks.NotebookLost as lost:
                error = f"{lost} ({attempt} attempts)"
                continue
            except notebooks.NotebookError as failure:
                error = str(failure)
            break
        took = time.perf_counter() - start
        executed = _read(end) or json.loads(source)
    clash = sorted(set(run.parameters) & {name for row in recorded(executed) for name in row})
    if clash and not error:
        error = f"it records {', '.join(clash)}, which is a parameter's name"
    return _stamp(executed, key, error, took)


def _stamp(notebook: dict, key: str, error: str, took: float) -> str:
    """The notebook's text, with what the sweep knows about the run."""
    notebook["metadata"]["profilecal"] = {"key": key, "error": error, "duration_s": round(took, 3)}
    return json.dumps(notebook, indent=1, ensure_ascii=False)


def _read(path: Path) -> dict | None:
    """A notebook, or None where there is none that can be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None


def _state(path: Path, key: str) -> str:
    """ "done", "failed", or "missing", which a run with another notebook or other versions is too."""
    about = (_read(path) or {}).get("metadata", {}).get("profilecal", {})
    if about.get("key") != key:
        return "missing"
    return "failed" if about["error"] else "done"


# All of them


def sweep(
    notebook: Path,
    grid: dict,
    output: Path,
    *,
    zipped: bool = False,
    repeat: int | None = None,
    scheduler: str | None = None,
    timeout: float | None = None,
    parquet: bool = False,
) -> Sweep:
    """Carry out the runs of a grid that are not there yet, and gather all of them in a table.

    `output` gets the executed notebooks under `runs/` and `table.csv` (or `.parquet`). A run is there when it did not
    fail and its notebook, parameters and versions are the present ones. The runs share this machine's cores, or go to
    the Dask scheduler at the address `scheduler`. A run whose kernel dies, or that takes longer than `timeout`
    seconds, is tried once more. See `grid.plan` for the grid.

    Raises ValueError for a grid that does not fit, OSError where something cannot be written or reached.
    """
    runs = plan(notebook, grid, zipped=zipped, repeat=repeat)
    source, present, folder = without_outputs(notebook), versions(), output / "runs"
    code = _code(source)
    keys = {run.name: digest([code, run.parameters, present], 16) for run in runs}
    folder.mkdir(parents=True, exist_ok=True)

    with _alone(output) as scratch:
        missing = [run for run in runs if _state(folder / run.file, keys[run.name]) != "done"]
        if missing:
            arguments = source, str(notebook.resolve().parent), present, timeout
            with _cluster(scheduler, scratch) as client:
                _carry_out(client, missing, keys, arguments, folder, scratch)
        table, failed = gather(folder, runs, present)
        path = output / f"table.{'parquet' if parquet else 'csv'}"
        with whole(path, scratch) as part:
            table.to_parquet(part) if parquet else table.to_csv(part, index=False)
    others = {file.stem for file in folder.glob("*.ipynb")} - keys.keys()
    return Sweep(path, table, failed, len(others))


def gather(folder: Path, runs: list[Run], present: dict[str, str]) -> tuple[pd.DataFrame, dict[str, str]]:
    """The table of runs that have ended, in the order of the grid, and why some failed."""
    rows, failed = [], {}
    for run in runs:
        notebook = _read(folder / run.file)
        about = notebook["metadata"]["profilecal"]
        if about["error"]:
            failed[run.name] = about["error"]
        begin = run.parameters if run.repeat is None else {"repeat": run.repeat} | run.parameters
        end = {"status": "failed" if about["error"] else "done", "duration_s": about["duration_s"]}
        end |= present | {"run": run.name}
        rows += [begin | row | end for row in ([{}] if about["error"] else recorded(notebook))]
    columns = [name for name in dict.fromkeys(itertools.chain(*rows)) if name not in end]
    return pd.DataFrame(rows, columns=columns + list(end)), failed


def _code(source: str) -> str:
    """What a run's result depends on in a notebook: not how it was last executed, nor its metadata."""
    return digest([(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(source)["cells"]], 64)


def _carry_out(client, runs: list[Run], keys: dict[str, str], arguments: tuple, folder: Path, scratch: Path) -> None:
    """Write each run's executed notebook into a folder as it ends; on the way out, call off the rest.

    `arguments` are those of `execute` that all runs share.
    """
    from distributed import KilledWorker, as_completed

    jobs, failures = {}, 0
    for run in runs:
        key = keys[run.name]
        jobs[client.submit(execute, run, key, *arguments, key=f"{run.name}-{key}", pure=False)] = run
    bar = tqdm(total=len(runs), disable=None, bar_format=BAR)
    try:
        for future in as_completed(list(jobs), loop=client.loop):
            run = jobs.pop(future)
            try:
                text = future.result()
            except KilledWorker:
                text = _stamp(json.loads(arguments[0]), keys[run.name], "its worker died each time", 0.0)
            except ImportError as error:
                raise ValueError(f"a worker cannot load the library: {error}; install it there") from error
            with whole(folder / run.file, scratch) as part:
                part.write_text(text, encoding="utf-8")
            del future  # or the cluster keeps its text
            failures += _state(folder / run.file, keys[run.name]) == "failed"
            running = min(len(jobs), sum(client.nthreads().values()))
            bar.set_postfix_str(f"{failures} failed, {running} running", refresh=False)
            bar.update()
    finally:
        bar.close()
        client.cancel(list(jobs))


@contextlib.contextmanager
def _cluster(scheduler: str | None, scratch: Path):
    """A client of the scheduler at an address, else of this machine's cores.

    Here the workers are threads, for each run is a process anyway, that listen on no network but the loopback.
    """
    from distributed import Client, LocalCluster

    if scheduler:
        try:
            client = Client(scheduler, timeout=PATIENCE_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise OSError(f"no Dask scheduler answers at {scheduler}") from error
        with client:
            yield client
            client.run(notebooks.stop_idle, on_error="ignore")
        return
    workers = {"processes": False, "n_workers": 1, "threads_per_worker": notebooks.cores(), "memory_limit": None}
    address = {"protocol": "tcp", "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    here = LocalCluster(**workers, **address, silence_logs=logging.CRITICAL, local_directory=str(scratch))
    with here as cluster, Client(cluster, set_as_default=False) as client:
        try:
            yield client
        finally:
            notebooks.stop_all()


@contextlib.contextmanager
def _alone(output: Path):
    """A folder for what is unfinished, gone before and after; refuses while another sweep writes to `output`."""
    scratch = output / ".unfinished"
    with contextlib.ExitStack() as stack:
        if os.name == "posix":
            import fcntl

            handle = os.open(output, os.O_RDONLY)
            stack.callback(os.close, handle)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the system frees it, however we end
            except BlockingIOError:
                raise ValueError(f"another sweep is writing to {output}; wait for it or name another folder") from None
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(exist_ok=True)
        stack.callback(shutil.rmtree, scratch, ignore_errors=True)
        yield scratch
