"""Notebooks as programs: which there are, what parameters they take, and one run of one in a process of its own."""

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

REAL_DATA = "PROFILECAL_REAL_DATA"
TYPES = {"int": int, "float": (int, float), "bool": bool, "str": str, "list": list}
_running: set[subprocess.Popen] = set()
_idle: list[subprocess.Popen] = []


class NotebookError(Exception):
    """A notebook stopped; the message says in which cell and why."""


class NotebookLost(NotebookError):
    """A kernel or the process that runs it died, or did not finish in time: another attempt may succeed."""


def folder() -> Path:
    """The notebooks of the clone that this package was installed from.

    Raises ValueError where there is no such clone.
    """
    place = Path(__file__).resolve().parents[3] / "notebooks"
    if not place.is_dir():
        raise ValueError(
            f"no notebooks at {place}; this command works in a clone of the repository, installed from there"
        )
    return place


def find(names) -> list[Path]:
    """The notebooks of the clone whose names, or beginnings of names, are given; when none is, all that can run here.

    Raises ValueError naming what is there when a name fits none.
    """
    there = sorted(folder().glob("*.ipynb"))
    if not names:
        missing = without_data()
        return [path for path in there if path not in missing]
    chosen = set()
    for name in names:
        fits = [path for path in there if path.stem.startswith(Path(name).stem)]
        if not fits:
            raise ValueError(f"no notebook named {name!r}; there are {', '.join(path.stem for path in there)}")
        chosen.update(fits)
    return sorted(chosen)


def without_data() -> list[Path]:
    """The notebooks that cannot run here: they have a parameter `real_data`, for measurements that the repository does
    not hold, and the environment does not say where these are (data/README.md)."""
    if os.environ.get(REAL_DATA):
        return []
    return [path for path in sorted(folder().glob("*.ipynb")) if "real_data" in parameters_of(path)]


def parameters_of(path: Path) -> dict[str, str]:
    """Name and type ("float", "str", …) of each parameter that a notebook declares."""
    declared = _papermill().inspect_notebook(str(path))
    return {name: entry["inferred_type_name"] for name, entry in declared.items()}


def _papermill():
    """The module papermill, imported without what takes time and is of no use here: a grammar of web addresses, which
    jsonschema compiles, and pyarrow. Both jsonschema and papermill do without where these are missing."""
    dear = ("rfc3987_syntax", "pyarrow")
    for name in dear:
        sys.modules.setdefault(name, None)
    import papermill

    for name in dear:
        if sys.modules[name] is None:
            del sys.modules[name]
    return papermill


def parse_value(text: str):
    """A parameter typed at the command line: a number, true or false, a JSON list, else text as it stands."""
    if text in ("True", "False"):
        return text == "True"
    try:
        return json.loads(text)
    except ValueError:
        return text


def check_value(name: str, value, kind: str) -> None:
    """Raise ValueError unless a parameter's value is of the type that the notebook declares."""
    expected = TYPES.get(kind)
    if expected and (not isinstance(value, expected) or (isinstance(value, bool) and kind != "bool")):
        raise ValueError(f"parameter {name} is {value!r}; expected {kind}")


def check_parameters(declared: dict[Path, dict[str, str]], given: dict) -> None:
    """Raise ValueError for a name that no notebook declares (`parameters_of`), and for a value of the wrong type."""
    for name, value in given.items():
        kinds = {types[name] for types in declared.values() if name in types}
        if not kinds:
            names = sorted({name for types in declared.values() for name in types})
            raise ValueError(f"no parameter named {name!r}; there are {', '.join(names) or 'none'}")
        for kind in kinds:
            check_value(name, value, kind)


def count_cells(path: Path) -> int:
    """The number of cells that papermill goes through."""
    return len(json.loads(path.read_text(encoding="utf-8"))["cells"])


def run(
    source: Path,
    output: Path,
    parameters: dict,
    on_cell=lambda: None,
    *,
    folder: Path | None = None,
    timeout: float | None = None,
    keep: bool = False,
) -> None:
    """Execute `source` with papermill in a process of its own and write the executed copy to `output`.

    The copy appears whole or not at all; a notebook that fails leaves it too, with its traceback. `on_cell` is
    called as each cell is done. The notebook runs in `folder`, by default its own. With `keep` the process stays
    for the next run, which then need not import papermill. Raises NotebookError; NotebookLost where the kernel or
    the process died or took longer than `timeout` seconds; OSError where the copy could not be written. An
    interruption ends the process too.
    """
    partial = output.with_name(f".{output.name}")  # papermill writes after every cell
    job = {"source": str(source), "output": str(partial), "parameters": parameters, "cwd": str(folder or source.parent)}
    process, late = _take(), threading.Event()
    clock = threading.Timer(timeout or 0, lambda: (late.set(), _end(process)))
    _running.add(process)
    if timeout:
        clock.start()
    try:
        kind, text = _converse(process, job, on_cell)
    except BaseException:
        _end(process)
        raise
    finally:
        clock.cancel()
        stopped = process not in _running
        _running.discard(process)
    if late.is_set():
        kind, text = "lost", f"not done after {timeout:g} s"
    if keep and kind in ("done", "failed") and process.poll() is None:
        _idle.append(process)
    else:
        _end(process)
        process.stdout.close()
    if partial.exists():
        partial.replace(output)
    if kind == "done":
        return
    if kind == "system":
        code, _, text = text.partition(" ")
        raise OSError(int(code), text)
    raise (NotebookLost if kind == "lost" and not stopped else NotebookError)(text)


def _take() -> subprocess.Popen:
    """A process that executes notebooks: one that is idle, else a new one."""
    with contextlib.suppress(IndexError):
        return _idle.pop()
    environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **os.environ}  # notebooks share the cores
    command = [sys.executable, "-m", "profilecal.running.notebooks"]
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, **streams, env=environment, start_new_session=True)  # Ctrl-C is for us alone


def _converse(process: subprocess.Popen, job: dict, on_cell) -> tuple[str, str]:
    """Give a process its job; what it answers at the end: "done", "failed", "lost" or "system", and why."""
    reason = ""
    with contextlib.suppress(BrokenPipeError):
        print(json.dumps(job), file=process.stdin, flush=True)
    for line in process.stdout:
        kind, _, text = line.strip().partition(" ")
        if kind == "cell":
            on_cell()
        elif kind in ("done", "failed", "lost", "system"):
            return kind, text
        else:
            reason = line.strip() or reason
    status = process.wait()
    return ("lost" if status < 0 else "failed"), reason or f"its process ended with status {status}"


def _end(process: subprocess.Popen) -> None:
    """End a process, and the kernel under it."""
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()  # which it takes as the wish to end
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def stop_all() -> None:
    """End the runs that are under way, each of which then raises NotebookError, and the processes kept for more."""
    running = list(_running)
    _running.clear()
    for process in running:
        process.terminate()
    for process in running:
        _end(process)
    stop_idle()


def stop_idle() -> None:
    """End the processes kept for more runs."""
    while _idle:
        process = _idle.pop()
        _end(process)
        process.stdout.close()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _main() -> None:
    """The process that `run` starts: executes the jobs it reads, a line each, until there are no more.

    It answers "cell" for each cell done, then a line for the job. When its input ends during a job, whoever started
    it is gone or has had enough, and it takes its kernel with it.
    """
    papermill = _papermill()
    from papermill.engines import NBClientEngine, papermill_engines

    answers = os.fdopen(os.dup(1), "w", buffering=1)  # not inherited by kernels, so that it ends with this process
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)

    class Reporting(NBClientEngine):
        @classmethod
        def execute_managed_notebook(cls, nb_man, kernel_name, **options):
            complete = nb_man.cell_complete

            def cell_complete(cell, cell_index=None, **rest):
                complete(cell, cell_index=cell_index, **rest)
                print("cell", file=answers)

            nb_man.cell_complete = cell_complete
            super().execute_managed_notebook(nb_man, kernel_name, **options)

    def execute(source, output, parameters, cwd) -> str:
        options = {"engine_name": "reporting", "progress_bar": False, "cwd": cwd}
        try:
            papermill.execute_notebook(source, output, parameters, **options)
        except papermill.PapermillExecutionError as error:
            return f"failed error in cell {error.cell_index}: {error.ename}: {error.evalue}"
        except OSError as error:
            return f"system {error.errno or 5} {error.strerror or error}"
        except RuntimeError as error:  # nbclient's for a kernel that dies or does not start
            return f"lost {error}"
        except Exception as error:
            return f"failed {type(error).__name__}: {error}"
        return "done"

    papermill_engines.register("reporting", Reporting)
    jobs, busy = queue.SimpleQueue(), threading.Event()
    threading.Thread(target=_read_jobs, args=(jobs, busy), daemon=True).start()
    for job in iter(jobs.get, None):
        answer = execute(**job).replace("\n", " ")
        busy.clear()
        print(answer, file=answers)


def _read_jobs(jobs: queue.SimpleQueue, busy: threading.Event) -> None:
    """Hand on the jobs read; at the end of input stop the one that is under way."""
    for line in sys.stdin:
        busy.set()
        jobs.put(json.loads(line))
    jobs.put(None)
    if busy.is_set():
        os.kill(os.getpid(), signal.SIGTERM)  # nbclient asks its kernel to end, and kills it after five seconds
        time.sleep(8)
        os._exit(1)


if __name__ == "__main__":
    _main()
