"""Notebooks as programs: which there are, what parameters they take, one run of one,
runs of many.
"""

import json
import logging
import os
import platform
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import Any

# A grammar that jsonschema compiles in a second, and does without
modules: dict = sys.modules
modules.setdefault("rfc3987_syntax", None)

ANSWERS_S = 10  # in which a scheduler is there
TYPES = {
    "int": (int,),
    "float": (int, float),
    "bool": (bool,),
    "str": (str,),
    "list": (list,),
}


class NotebookError(Exception):
    """A notebook stopped; the message says in which cell and why."""


class NotebookLost(NotebookError):
    """A kernel died, or a cell did not end in time: another attempt may succeed."""


def folder() -> Path:
    """The notebooks of the clone that this package was installed from. Raises
    ValueError where there is none.
    """
    place = Path(__file__).resolve().parents[2] / "notebooks"
    if not place.is_dir():
        hint = "this command works in a clone of the repository, installed from there"
        raise ValueError(f"no notebooks at {place}; {hint}")
    return place


def shipped(package: str, name: str) -> Path:
    """A file of the clone that a wheel has inside one of its packages."""
    packages = Path(__file__).parents[1]
    inside = packages / package / name
    return inside if inside.is_file() else packages.parent / name


def find(names: Sequence[str]) -> list[Path]:
    """The notebooks of the clone whose names, or beginnings of names, are given; when
    none is, all. Raises ValueError naming what is there when a name fits none.
    """
    paths = sorted(folder().rglob("[!.]*.ipynb"))
    if not names:
        return paths
    chosen = set()
    for name in names:
        matching = [path for path in paths if path.stem.startswith(Path(name).stem)]
        if not matching:
            known = ", ".join(path.stem for path in paths)
            raise ValueError(f"no notebook named {name!r}; there are {known}")
        chosen.update(matching)
    return sorted(chosen)


def parameters_of(path: Path) -> dict[str, str]:
    """Name and type ("float", "str", …) of each parameter that a notebook declares."""
    from nbformat import ValidationError
    from papermill import inspect_notebook

    try:
        parameters = inspect_notebook(str(path))
    except ValidationError as error:
        raise ValueError(f"{path}: not a notebook: {error.message}") from error
    return {name: entry["inferred_type_name"] for name, entry in parameters.items()}


def parse_value(text: str) -> Any:
    """A parameter typed at the command line: a number, true or false, a JSON list, else
    text as it stands.
    """
    if text in ("True", "False"):
        return text == "True"
    try:
        return json.loads(text)
    except ValueError:
        return text


def check_parameters(given: dict[str, list], declared: list[dict[str, str]]) -> None:
    """Raise ValueError for a name that no notebook declares (`parameters_of`), and for
    a value of another type than one of them does; `given` has the values of each name.
    """
    names = dict.fromkeys(name for kinds in declared for name in kinds)
    for name, values in given.items():
        if name not in names:
            known = ", ".join(names) or "none"
            raise ValueError(f"no parameter named {name!r}; there are {known}")
        kinds = {kinds[name] for kinds in declared if name in kinds}
        for kind, value in product(kinds & TYPES.keys(), values):
            if type(value) not in TYPES[kind]:
                raise ValueError(f"parameter {name} is {value!r}; expected {kind}")


def versions() -> dict[str, str]:
    """What a run's result depends on beside its notebook; a change of profilecal's
    source shows in its version.
    """
    sources = sorted(Path(__file__).parents[1].glob("profilecal*/**/*.py"))
    source = sha256(b"".join(path.read_bytes() for path in sources))
    names = "profilecal", "numpy", "scipy", "pandas"
    found = {name: metadata.version(name) for name in names}
    found["profilecal"] += f"+{source.hexdigest()[:8]}"
    return {"python": platform.python_version()} | found


def run(
    source: Path,
    output: Path,
    parameters: dict,
    cwd: Path,
    timeout: int | None = None,
    progress: bool = False,
) -> None:
    """Execute `source` with papermill in the folder `cwd`; write the executed copy,
    even of a failure, to `output`. Raises NotebookError; NotebookLost where the kernel
    died or a cell took longer than `timeout` seconds; OSError.
    """
    import papermill
    from traitlets.config import Config

    config = Config()
    try:
        with tempfile.TemporaryDirectory() as sockets:
            # of two kernels that start at once, both may choose the same port
            if os.name == "posix":
                config.KernelManager = Config(transport="ipc", ip=f"{sockets}/kernel")
            papermill.execute_notebook(
                source,
                output,
                parameters,
                cwd=cwd,
                execution_timeout=timeout,
                progress_bar=progress,
                # a kernel else says how it talks
                extra_arguments=["--log-level=CRITICAL"],
                config=config,
            )
    except papermill.PapermillExecutionError as error:
        why = f"error in cell {error.cell_index}: {error.ename}: {error.evalue}"
        raise NotebookError(why) from error
    except TimeoutError as error:
        raise NotebookLost(f"a cell took longer than {timeout} s") from error
    except OSError:
        raise
    except RuntimeError as error:  # nbclient's for a kernel that dies or does not start
        raise NotebookLost(str(error)) from error
    except Exception as error:
        raise NotebookError(f"{type(error).__name__}: {error}") from error


def execute(
    expected: dict, source: str, parameters: dict, cwd: str, timeout: int | None
) -> tuple[str, str, float]:
    """Carry out one run in a Dask worker: the executed notebook's text, why it failed,
    how many seconds it took. Raises ValueError where other versions than the expected
    ones are installed.
    """
    from distributed import get_worker

    attempts = 2  # at a run whose kernel dies or hangs
    if versions() != expected:
        raise ValueError(
            f"a worker has {versions()}; expected {expected}, as where this was started"
        )
    with tempfile.TemporaryDirectory(dir=get_worker().local_directory) as scratch:
        place = Path(cwd if Path(cwd).is_dir() else scratch)
        begin = Path(scratch, "source.ipynb")
        end = Path(scratch, "executed.ipynb")
        begin.write_text(source, "utf-8")
        for _ in range(attempts):
            why = ""
            start = time.perf_counter()
            try:
                run(begin, end, parameters, place, timeout)
            except NotebookLost as error:
                why = str(error)
                continue
            except NotebookError as error:
                why = str(error)
            break
        took = time.perf_counter() - start
        executed = end if end.exists() else begin
        return executed.read_text("utf-8"), why, took


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits, and does not reach the processes that start meanwhile, where the
    system knows how.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing.resource_tracker import ensure_running

    ensure_running()  # which would let it through again
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])


@contextmanager
def workers(scheduler: str | None = None) -> Iterator:
    """A Dask client of the scheduler at an address, else of new processes here, one for
    each core.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.comm import get_address_host_port

    with ExitStack() as stack:
        if scheduler:
            # refuses what is none: a Client would later complain of it again
            get_address_host_port(scheduler)
        else:
            # Dask has memory given back at once, which makes NumPy's large arrays slow
            trimming = "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_"
            stack.enter_context(dask.config.set({trimming: None}))
            with uninterrupted():
                cluster = LocalCluster(
                    threads_per_worker=1,
                    memory_limit=None,
                    dashboard_address="127.0.0.1:0",
                    # Ctrl-C is for us, and the last words of a kernel for nobody
                    preload=[
                        "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)",
                        "import os; os.dup2(os.open(os.devnull, os.O_WRONLY), 2)",
                    ],
                    silence_logs=logging.CRITICAL,
                )
            scheduler = stack.enter_context(cluster)
        client = Client(scheduler, timeout=ANSWERS_S, set_as_default=False)
        yield stack.enter_context(client)


def outcomes(
    client: Any, jobs: dict[str, tuple]
) -> Iterator[tuple[str, str, str, float]]:
    """Carry out runs on Dask's workers; yields, as each ends, its name and what
    `execute` returns. `jobs` has for each name what `execute` takes after the versions.
    """
    from distributed import KilledWorker, as_completed

    here = versions()
    futures = {}
    for name, job in jobs.items():
        futures[client.submit(execute, here, *job, pure=False)] = name
    for future in as_completed(list(futures), loop=client.loop):
        name = futures.pop(future)
        try:
            text, why, took = future.result()
        except (KilledWorker, ImportError) as error:
            text, why, took = jobs[name][0], f"its worker failed: {error}", 0.0
        del future  # or the workers keep its text
        yield name, text, why, took


def reproduce(
    paths: list[Path], given: dict, output: Path
) -> tuple[list[tuple], dict[str, str]]:
    """Execute notebooks into `output`; return the items of the papers that they compare
    and, by name, why some failed.

    A notebook that declares `executed_dir` reads the others' results and runs after
    them. Nothing of an earlier run stays in `output`. Raises ValueError for parameters
    that do not fit, and for what no earlier run wrote there.
    """
    from tqdm import tqdm

    from profilecal_pages import items

    output = output.resolve()
    executed = output / "notebooks"
    declared = {path: parameters_of(path) for path in paths}
    values = {name: [value] for name, value in given.items()}
    check_parameters(values, list(declared.values()))
    clear(output)
    executed.mkdir(parents=True)
    (output / MARKER).write_text(json.dumps({"parameters": given}))

    places = {"results_dir": str(output), "executed_dir": str(executed)}
    jobs: dict[bool, dict] = {False: {}, True: {}}  # by whether it reads the others
    for path, kinds in declared.items():
        source = path.read_text("utf-8")
        parameters = {k: v for k, v in (places | given).items() if k in kinds}
        job = source, parameters, str(path.parent), None
        jobs["executed_dir" in kinds][path.stem] = job
    failed = {}
    bar = tqdm(total=len(paths), unit="notebook", disable=None)
    with workers() as client, bar:
        for part in jobs.values():
            for name, text, why, took in outcomes(client, part):
                (executed / f"{name}.ipynb").write_text(text, "utf-8")
                if why:
                    failed[name] = why
                bar.write(f"  {name}: {'FAILED' if why else f'{took:.1f} s'}")
                bar.update()
    gathered = items.gather(executed)
    items.scorecard(gathered).to_csv(output / "scorecard.csv", index=False)
    return gathered, failed


MARKER = "run.json"  # says that `reproduce` wrote what lies beside it


def clear(output: Path) -> None:
    """Remove what an earlier run of `reproduce` wrote. Raises ValueError for what no
    run did.
    """
    from profilecal.scan.tables import remove

    for name in ("notebooks", "figures", "tables", "scorecard.csv"):
        place = output / name
        if place.exists() and not (output / MARKER).exists():
            hint = "name a new or empty folder"
            raise ValueError(f"{place} was not written by this command; {hint}")
        remove(place)


MIME = "application/vnd.profilecal.record"


def record(table: Any = None, /, **values: object) -> None:
    """Hand out values of the notebook that calls this, or a pandas table: they become
    columns of the sweep's table, with a row for each of the table's. Raises TypeError
    for a value that no table can hold.
    """
    from IPython.display import display

    of_table = [] if table is None else table.to_dict("records")
    rows = [values | row for row in of_table] or [values]
    text = f"recorded: {', '.join(rows[0])}"
    data = json.dumps(rows, default=_plain)
    display({"text/plain": text, MIME: data}, raw=True)


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's."""
    if hasattr(value, "dtype") and value.ndim == 0:
        return value.item()
    kind = type(value).__name__
    expected = "a number, text, true or false"
    raise TypeError(f"recorded value {value!r} is a {kind}; expected {expected}")


def recorded(notebook: dict) -> list[dict]:
    """The rows that an executed notebook recorded; one without columns where it
    recorded nothing.
    """
    from profilecal_pages.items import handed_out

    texts = ["".join(text) for text in handed_out(notebook, MIME)]
    return [row for text in texts for row in json.loads(text)] or [{}]


def at_defaults() -> bool:
    """Whether a notebook's parameters are those that its findings are asserted for, of
    the cell tagged `parameters` in its file: in the working folder, called as its
    `results` say. No file, no findings.
    """
    from IPython import get_ipython

    names = get_ipython().user_ns
    file = Path(f"{names['results'].notebook}.ipynb")
    if not file.exists():
        return False
    cells = json.loads(file.read_text("utf-8"))["cells"]
    tagged = (c for c in cells if "parameters" in c["metadata"].get("tags", []))
    own: dict = {}
    exec("".join(next(tagged)["source"]), own)
    declared = [name for name in own if not name.startswith("__")]
    return all(names[name] == own[name] for name in declared if name != "results_dir")
