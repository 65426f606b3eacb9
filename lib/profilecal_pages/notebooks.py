"""Notebooks as programs: which there are, what parameters they take, one run of one,
runs of many.
"""

import ast
import json
import logging
import os
import platform
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from importlib import metadata
from pathlib import Path

sys.modules.setdefault(
    "rfc3987_syntax", None
)  # a grammar that jsonschema compiles in a second, and does without

TYPES = {"int": int, "float": (int, float), "bool": bool, "str": str, "list": list}


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


def find(names) -> list[Path]:
    """The notebooks of the clone whose names, or beginnings of names, are given; when
    none is, all. Raises ValueError naming what is there when a name fits none.
    """
    there = sorted(folder().rglob("[!.]*.ipynb"))
    if not names:
        return there
    chosen = set()
    for name in names:
        fits = [path for path in there if path.stem.startswith(Path(name).stem)]
        if not fits:
            raise ValueError(
                f"no notebook named {name!r}; there are {', '.join(path.stem for path in there)}"
            )
        chosen.update(fits)
    return sorted(chosen)


def parameters_of(path: Path) -> dict[str, str]:
    """Name and type ("float", "str", …) of each parameter that a notebook declares."""
    from nbformat import ValidationError
    from papermill import inspect_notebook

    try:
        return {
            name: entry["inferred_type_name"]
            for name, entry in inspect_notebook(str(path)).items()
        }
    except ValidationError as error:
        raise ValueError(f"{path}: not a notebook: {error.message}") from error


def parse_value(text: str):
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
    names = list(dict.fromkeys(name for kinds in declared for name in kinds))
    for name, values in given.items():
        if name not in names:
            raise ValueError(
                f"no parameter named {name!r}; there are {', '.join(names) or 'none'}"
            )
        for kind in {kinds[name] for kinds in declared if name in kinds} & TYPES.keys():
            for value in values:
                if not isinstance(value, TYPES[kind]) or (
                    isinstance(value, bool) and kind != "bool"
                ):
                    raise ValueError(f"parameter {name} is {value!r}; expected {kind}")


def versions() -> dict[str, str]:
    """What a run's result depends on beside its notebook; a change of profilecal's
    source shows in its version.
    """
    sources = sorted(Path(__file__).parents[1].glob("profilecal*/**/*.py"))
    source = sha256(b"".join(path.read_bytes() for path in sources))
    found = {
        name: metadata.version(name)
        for name in ("profilecal", "numpy", "scipy", "pandas")
    }
    found["profilecal"] += f"+{source.hexdigest()[:8]}"
    return {"python": platform.python_version()} | found


def run(
    source: Path,
    output: Path,
    parameters: dict,
    cwd: Path,
    timeout: int | None = None,
    progress=False,
) -> None:
    """Execute `source` with papermill in the folder `cwd`; write the executed copy,
    even of a failure, to `output`. Raises NotebookError; NotebookLost where the kernel
    died or a cell took longer than `timeout` seconds; OSError.
    """
    import papermill
    from traitlets.config import Config

    quiet = ["--log-level=CRITICAL"]  # a kernel else says how it talks
    options = {
        "cwd": cwd,
        "execution_timeout": timeout,
        "progress_bar": progress,
        "extra_arguments": quiet,
    }
    try:
        with tempfile.TemporaryDirectory() as sockets:
            if (
                os.name == "posix"
            ):  # of two kernels that start at once, both may choose the same port
                options["config"] = Config(
                    KernelManager={"transport": "ipc", "ip": f"{sockets}/kernel"}
                )
            papermill.execute_notebook(source, output, parameters, **options)
    except papermill.PapermillExecutionError as error:
        raise NotebookError(
            f"error in cell {error.cell_index}: {error.ename}: {error.evalue}"
        ) from error
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
        begin, end = Path(scratch, "source.ipynb"), Path(scratch, "executed.ipynb")
        begin.write_text(source, encoding="utf-8")
        for _ in range(attempts):
            start, why = time.perf_counter(), ""
            try:
                run(
                    begin,
                    end,
                    parameters,
                    Path(cwd if Path(cwd).is_dir() else scratch),
                    timeout,
                )
            except NotebookError as error:
                why = str(error)
                if isinstance(error, NotebookLost):
                    continue
            break
        took = time.perf_counter() - start
        return (end if end.exists() else begin).read_text(encoding="utf-8"), why, took


@contextmanager
def workers(scheduler: str | None = None):
    """A Dask client of the scheduler at an address, else of new processes here, one for
    each core.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.comm import get_address_host_port

    with ExitStack() as stack:
        if scheduler:
            get_address_host_port(
                scheduler
            )  # refuses what is none: a Client would later complain of it again
        else:
            # Dask has memory given back at once, which makes NumPy's large arrays slow
            stack.enter_context(
                dask.config.set(
                    {"distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None}
                )
            )
            options = {
                "threads_per_worker": 1,
                "memory_limit": None,
                "dashboard_address": "127.0.0.1:0",
            }
            options["preload"] = [
                "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
            ]  # Ctrl-C is for us
            scheduler = stack.enter_context(
                LocalCluster(**options, silence_logs=logging.CRITICAL)
            )
        yield stack.enter_context(Client(scheduler, timeout=10, set_as_default=False))


def outcomes(client, jobs: dict[str, tuple]):
    """Carry out runs on Dask's workers; yields, as each ends, its name and what
    `execute` returns. `jobs` has for each name what `execute` takes after the versions.
    """
    from distributed import KilledWorker, as_completed

    here = versions()
    futures = {
        client.submit(execute, here, *job, pure=False): name
        for name, job in jobs.items()
    }
    for future in as_completed(list(futures), loop=client.loop):
        name = futures.pop(future)
        try:
            text, why, took = future.result()
        except (KilledWorker, ImportError) as error:
            text, why, took = jobs[name][0], f"its worker failed: {error}", 0.0
        del future  # or the workers keep its text
        yield name, text, why, took


def reproduce(paths: list[Path], given: dict, output: Path):
    """Execute notebooks into `output`; return the items of the papers that they compare
    and, by name, why some failed.

    A notebook that declares `executed_dir` reads the others' results and runs after
    them. Nothing of an earlier run stays in `output`. Raises ValueError for parameters
    that do not fit, and for what no earlier run wrote there.
    """
    from tqdm import tqdm

    from profilecal.scan.tables import remove
    from profilecal_pages import items

    output = output.resolve()
    declared = {path: parameters_of(path) for path in paths}
    check_parameters(
        {name: [value] for name, value in given.items()}, list(declared.values())
    )
    marker = output / "run.json"
    for name in ("notebooks", "figures", "tables", "scorecard.csv"):
        if (output / name).exists() and not marker.exists():
            raise ValueError(
                f"{output / name} was not written by this command; name a new or empty folder"
            )
        remove(output / name)
    (output / "notebooks").mkdir(parents=True)
    marker.write_text(
        json.dumps({"notebooks": [path.stem for path in paths], "parameters": given})
    )

    failed, values = (
        {},
        {"results_dir": str(output), "executed_dir": str(output / "notebooks")} | given,
    )
    with (
        workers() as client,
        tqdm(total=len(paths), unit="notebook", disable=None) as bar,
    ):
        for reading in (False, True):
            jobs = {}
            for path in paths:
                if ("executed_dir" in declared[path]) == reading:
                    parameters = {
                        name: value
                        for name, value in values.items()
                        if name in declared[path]
                    }
                    jobs[path.stem] = (
                        path.read_text(encoding="utf-8"),
                        parameters,
                        str(path.parent),
                        None,
                    )
            for name, text, why, took in outcomes(client, jobs):
                (output / "notebooks" / f"{name}.ipynb").write_text(
                    text, encoding="utf-8"
                )
                if why:
                    failed[name] = why
                bar.write(f"  {name}: {'FAILED' if why else f'{took:.1f} s'}")
                bar.update()
    gathered = items.gather(output / "notebooks")
    items.scorecard(gathered).to_csv(output / "scorecard.csv", index=False)
    return gathered, failed


MIME = "application/vnd.profilecal.record"


def record(table=None, /, **values) -> None:
    """Hand out values of the notebook that calls this, or a pandas table: they become
    columns of the sweep's table, with a row for each of the table's. Raises TypeError
    for a value that no table can hold.
    """
    from IPython.display import display

    rows = [
        values | row for row in ([] if table is None else table.to_dict("records"))
    ] or [values]
    display(
        {
            "text/plain": f"recorded: {', '.join(rows[0])}",
            MIME: json.dumps(rows, default=_plain),
        },
        raw=True,
    )


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
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    (source,) = (
        cell["source"]
        for cell in cells
        if "parameters" in cell["metadata"].get("tags", [])
    )
    entries = [
        entry
        for entry in ast.parse("".join(source)).body
        if isinstance(entry, ast.AnnAssign)
    ]
    defaults = {
        entry.target.id: ast.literal_eval(entry.value)
        for entry in entries
        if entry.target.id != "results_dir"
    }
    return all(names[name] == value for name, value in defaults.items())


def _plain(value):
    """NumPy's numbers as Python's."""
    if hasattr(value, "dtype") and value.ndim == 0:
        return value.item()
    raise TypeError(
        f"recorded value {value!r} is a {type(value).__name__}; expected a number, text, true or false"
    )


def recorded(notebook: dict) -> list[dict]:
    """The rows that an executed notebook recorded; one without columns where it
    recorded nothing.
    """
    outputs = [
        output.get("data", {})
        for cell in notebook["cells"]
        for output in cell.get("outputs", [])
    ]
    return [
        row for data in outputs for row in json.loads("".join(data.get(MIME, "[]")))
    ] or [{}]
