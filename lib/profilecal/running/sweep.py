"""One notebook over a grid of parameters, here or on a cluster, and one tidy table of what its runs record.

An executed notebook holds all there is to know about its run: parameters, seed, versions, what it recorded. It appears
under `runs/` in one move, so a sweep that is killed leaves whole runs or none, and goes on from there.
"""

import contextlib
import hashlib
import itertools
import json
import logging
import os
import platform
import shutil
import tempfile
import time
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from profilecal.running import notebooks

if TYPE_CHECKING:  # notebooks import this module for `record`, which should not cost them a second
    import pandas as pd


MIME = "application/vnd.profilecal.record"
ATTEMPTS = 2  # at a run whose kernel dies or hangs
PATIENCE_S = 10  # with a scheduler that does not answer


@dataclass(frozen=True)
class Run:
    """One execution: a file name that says what it is, every parameter given, and which of the repeats it is."""

    name: str
    parameters: dict
    repeat: int | None


@dataclass(frozen=True)
class Sweep:
    """What a sweep found: the table and where it is written, by name of the run why some failed, and how many runs of
    other grids are beside them."""

    path: Path
    table: "pd.DataFrame"
    failed: dict[str, str]
    others: int


# What a notebook says


def record(table: "pd.DataFrame | None" = None, /, **values) -> None:
    """Hand out values, or a table, of the notebook that calls this: they become columns of the sweep's table.

    A run with a table gets one row for each of the table's. Raises TypeError for a value that no table can hold.
    """
    from IPython.display import display

    rows = [] if table is None else table.to_dict("records")
    payload = json.dumps({"values": values, "rows": rows}, default=_plain)
    display({"text/plain": f"recorded: {', '.join([*values, *(table if rows else ())])}", MIME: payload}, raw=True)


def _plain(value):
    """NumPy's numbers as Python's."""
    if hasattr(value, "dtype") and value.ndim == 0:
        return value.item()
    raise TypeError(f"recorded value {value!r} is a {type(value).__name__}; expected a number, text, true or false")


def recorded(notebook: dict) -> list[dict]:
    """The rows an executed notebook recorded; without any, its own figures of the scorecard."""
    from profilecal.papers import scorecard

    outputs = [output for cell in notebook["cells"] for output in cell.get("outputs", [])]
    stored = [json.loads("".join(output["data"][MIME])) for output in outputs if MIME in output.get("data", {})]
    values = {name: value for entry in stored for name, value in entry["values"].items()}
    if not stored:
        ours = [row for output in outputs for row in output.get("data", {}).get(scorecard.MIME, [])]
        values = {f"{row['item']}: {row['quantity']}": row["ours"] for row in ours}
    return [values | row for entry in stored for row in entry["rows"]] or [values]


# Which runs


def read_grid(path: Path | None, texts=()) -> dict:
    """The grid of a YAML file (a list of values, or one value, for each name), then of texts NAME=A,B,…

    Raises ValueError where it is something else.
    """
    grid = {}
    if path:
        import yaml

        try:
            grid = yaml.safe_load(path.read_text(encoding="utf-8"))
        except yaml.YAMLError as error:
            raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
        if not isinstance(grid, dict):
            raise ValueError(f"{path} holds {grid!r}; expected parameters, each with its list of values")
    for text in texts:
        name, equals, values = text.partition("=")
        if not equals:
            raise ValueError(f"-p {text}; expected name=value,value,…")
        grid[name] = [notebooks.parse_value(value) for value in values.split(",")]
    return grid


def plan(notebook: Path, grid: dict, *, zipped: bool = False, repeat: int | None = None) -> list[Run]:
    """The runs of a grid: the product of its values, or with `zipped` the first ones, the second ones and so on.

    With `repeat`, each is run that often, with seeds spawned from its parameter `seed`. They depend on the parameters
    and the count of the repeat, on nothing else: a grid that grows keeps the runs it has.

    Raises ValueError for a grid that does not fit the notebook's parameters.
    """
    kinds = notebooks.parameters_of(notebook)
    if not grid and not repeat:
        raise ValueError(f"the grid is empty; {notebook.stem} has the parameters {', '.join(kinds) or '(none)'}")
    lists = {name: values if isinstance(values, list) else [values] for name, values in grid.items()}
    for name, values in lists.items():
        if not values:
            raise ValueError(f"the grid has no values for {name}")
        if name not in kinds:
            raise ValueError(f"no parameter named {name!r}; there are {', '.join(kinds) or 'none'}")
        for value in values:
            notebooks.check_value(name, value, kinds[name])
        if kinds[name] == "float":
            lists[name] = [float(value) for value in values]  # 1 and 1.0 are one setting
    if zipped:
        longest = max(map(len, lists.values()), default=1)
        for name, values in lists.items():
            if len(values) not in (1, longest):
                raise ValueError(f"--zip: {name} has {len(values)} values; expected {longest}, or one for all")
        lists = {name: values * longest if len(values) == 1 else values for name, values in lists.items()}
    if repeat and "seed" not in kinds:
        raise ValueError(f"{notebook.stem} has no parameter 'seed', so its repeats would all be the same")

    combine = (lambda *values: zip(*values, strict=True)) if zipped and lists else itertools.product
    points = [dict(zip(lists, values, strict=True)) for values in combine(*lists.values())]
    if "seed" in kinds and "seed" not in lists:
        default = default_seed(notebook)
        points = [point | {"seed": default} for point in points]
    runs = [_run(point, None) for point in points]
    if repeat:
        runs = [_run(point | {"seed": _spawn(point, k)}, k) for point in points for k in range(repeat)]
    if len({run.name for run in runs}) < len(runs):
        raise ValueError("the grid names a run twice; expected different values")
    return runs


def default_seed(notebook: Path) -> int:
    """The value that a notebook gives its parameter `seed`."""
    from papermill import inspect_notebook

    text = inspect_notebook(str(notebook))["seed"]["default"]
    if not text.isdecimal():
        raise ValueError(f"the notebook's seed is {text}; expected a whole number")
    return int(text)


def _spawn(point: dict, index: int) -> int:
    """The seed of a repeat: 53 bits, so that every table and file format holds it exactly."""
    import numpy as np

    sequence = np.random.SeedSequence(point["seed"], spawn_key=(int(_digest(point, 32), 16), index))
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(11))


def _run(parameters: dict, repeat: int | None) -> Run:
    """A run and its name: what of the parameters is readable, and a digest of them all."""
    said = "_".join(f"{name}={value}" for name, value in parameters.items() if name != "seed")
    said = "".join(letter if letter.isalnum() or letter in "=_.-" else "-" for letter in said)[:100]
    return Run(f"{said}_{_digest(parameters, 8)}", parameters, repeat)


def _digest(values, length: int) -> str:
    """A digest of plain values, in hexadecimal."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:length]


# One run


def versions() -> dict[str, str]:
    """What a run's result depends on beside its notebook; a change of profilecal's source shows in its version."""
    source = hashlib.sha256()
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


def execute(source: str, folder: str, run: Run, key: str, expected: dict, timeout: float | None) -> str:
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
    seconds, is tried once more. See `plan` for the grid.

    Raises ValueError for a grid that does not fit, OSError where something cannot be written or reached.
    """
    runs = plan(notebook, grid, zipped=zipped, repeat=repeat)
    source, present = without_outputs(notebook), versions()
    code = _code(source)
    keys = {run.name: _digest([code, run.parameters, present], 16) for run in runs}
    (output / "runs").mkdir(parents=True, exist_ok=True)

    with _alone(output) as scratch:
        missing = [run for run in runs if _state(output, run, keys) != "done"]
        if missing:
            with _cluster(scheduler, scratch) as client, _progress(len(missing)) as tell:
                jobs = {}
                for run in missing:
                    arguments = (source, str(notebook.resolve().parent), run, keys[run.name], present, timeout)
                    jobs[client.submit(execute, *arguments, key=f"{run.name}-{keys[run.name]}", pure=False)] = run
                for run, text in _finished(client, jobs):
                    text = text or _stamp(json.loads(source), keys[run.name], "its worker died each time", 0.0)
                    with _whole(output / "runs" / f"{run.name}.ipynb", scratch) as part:
                        part.write_text(text, encoding="utf-8")
                    tell(_state(output, run, keys), len(jobs), client)
        table, failed = gather(output, runs, present)
        path = output / f"table.{'parquet' if parquet else 'csv'}"
        with _whole(path, scratch) as part:
            table.to_parquet(part) if parquet else table.to_csv(part, index=False)
    others = {file.stem for file in (output / "runs").glob("*.ipynb")} - keys.keys()
    return Sweep(path, table, failed, len(others))


def gather(output: Path, runs: list[Run], present: dict[str, str]) -> "tuple[pd.DataFrame, dict[str, str]]":
    """The table of runs that have ended, in the order of the grid, and why some failed."""
    import pandas as pd

    rows, failed = [], {}
    for run in runs:
        notebook = _read(output / "runs" / f"{run.name}.ipynb")
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
    return _digest([(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(source)["cells"]], 64)


def _state(output: Path, run: Run, keys: dict[str, str]) -> str:
    """ "done", "failed", or "missing", which a run with another notebook or other versions is too."""
    about = (_read(output / "runs" / f"{run.name}.ipynb") or {}).get("metadata", {}).get("profilecal", {})
    if about.get("key") != keys[run.name]:
        return "missing"
    return "failed" if about["error"] else "done"


def _finished(client, jobs: dict):
    """Each run as it ends, with its notebook's text, None where workers died of it; in the end, calls off the rest."""
    from distributed import KilledWorker, as_completed

    try:
        for future in as_completed(list(jobs), loop=client.loop):
            try:
                text = future.result()
            except KilledWorker:
                text = None
            except ImportError as error:
                raise ValueError(f"a worker cannot load the library: {error}; install it there") from error
            yield jobs.pop(future), text
            del future
    finally:
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
    options = {"processes": False, "n_workers": 1, "threads_per_worker": notebooks.cores(), "memory_limit": None}
    address = {
        "protocol": "tcp",
        "host": "127.0.0.1",
        "dashboard_address": "127.0.0.1:0",
        "silence_logs": logging.CRITICAL,
    }
    with (
        LocalCluster(**options, **address, local_directory=str(scratch)) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        try:
            yield client
        finally:
            notebooks.stop_all()


@contextlib.contextmanager
def _progress(total: int):
    """A bar of the runs; what it gives is called with each one's state, how many remain, and the client."""
    from tqdm import tqdm

    form = "{l_bar}{bar}| {n}/{total} runs{postfix}, {elapsed} gone, {remaining} left"
    with tqdm(total=total, disable=None, bar_format=form) as bar:
        failed = 0

        def tell(state: str, remaining: int, client) -> None:
            nonlocal failed
            failed += state == "failed"
            if not bar.disable:
                running = min(remaining, sum(client.nthreads().values()))
                bar.set_postfix_str(f"{failed} failed, {running} running", refresh=False)
            bar.update()

        yield tell


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


@contextlib.contextmanager
def _whole(path: Path, scratch: Path):
    """A place to write a file that then appears at `path` whole, or not at all."""
    part = scratch / path.name
    yield part
    part.replace(path)
