"""Notebooks as programs: which there are, what parameters they take, and one run of one in a process of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

_running: set[subprocess.Popen] = set()

TYPES = {"int": int, "float": (int, float), "bool": bool, "str": str, "list": list}


class NotebookError(Exception):
    """A notebook stopped; the message says in which cell and why."""


def folder() -> Path:
    """The notebooks of the clone that this package was installed from.

    Raises ValueError where there is no such clone.
    """
    place = Path(__file__).resolve().parents[2] / "notebooks"
    if not place.is_dir():
        raise ValueError(
            f"no notebooks at {place}; this command works in a clone of the repository, installed from there"
        )
    return place


def find(names) -> list[Path]:
    """The notebooks of the clone whose names, or beginnings of names, are given; all of them when none is.

    Raises ValueError naming what is there when a name fits none.
    """
    there = sorted(folder().glob("*.ipynb"))
    if not names:
        return there
    chosen = set()
    for name in names:
        fits = [path for path in there if path.stem.startswith(Path(name).stem)]
        if not fits:
            raise ValueError(f"no notebook named {name!r}; there are {', '.join(path.stem for path in there)}")
        chosen.update(fits)
    return sorted(chosen)


def parameters_of(path: Path) -> dict[str, str]:
    """Name and type ("float", "str", …) of each parameter that a notebook declares."""
    from papermill import inspect_notebook

    return {name: entry["inferred_type_name"] for name, entry in inspect_notebook(str(path)).items()}


def parse_value(text: str):
    """A parameter typed at the command line: a number, true or false, a JSON list, else text as it stands."""
    if text in ("True", "False"):
        return text == "True"
    try:
        return json.loads(text)
    except ValueError:
        return text


def check_parameters(paths: list[Path], given: dict) -> dict[Path, dict]:
    """For each notebook the given parameters that it declares.

    Raises ValueError for a name that none of them declares and for a value of the wrong type.
    """
    declared = {path: parameters_of(path) for path in paths}
    for name, value in given.items():
        kinds = {types[name] for types in declared.values() if name in types}
        if not kinds:
            names = sorted({name for types in declared.values() for name in types})
            raise ValueError(f"no parameter named {name!r}; there are {', '.join(names) or 'none'}")
        for kind in kinds:
            expected = TYPES.get(kind)
            if expected and (not isinstance(value, expected) or (isinstance(value, bool) and kind != "bool")):
                raise ValueError(f"parameter {name} is {value!r}; expected {kind}")
    return {path: {k: v for k, v in given.items() if k in types} for path, types in declared.items()}


def count_cells(path: Path) -> int:
    """The number of cells that papermill goes through."""
    return len(json.loads(path.read_text(encoding="utf-8"))["cells"])


def run(source: Path, output: Path, parameters: dict, on_cell=lambda: None) -> None:
    """Execute `source` with papermill in a process of its own and write the executed copy to `output`.

    The copy appears whole or not at all; a notebook that fails leaves it too, with its traceback.
    `on_cell` is called as each cell is done. Raises NotebookError.
    """
    partial = output.with_name(f".{output.name}")  # papermill writes after every cell
    environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **os.environ}  # notebooks share the cores
    command = [sys.executable, "-m", "profilecal.notebooks", str(source), str(partial), json.dumps(parameters)]
    reason = ""
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    ) as process:
        _running.add(process)
        for line in process.stdout:
            if line == "cell\n":
                on_cell()
            elif line.startswith("error ") or not reason.startswith("error "):
                reason = line.strip() or reason
    _running.discard(process)
    if partial.exists():
        partial.replace(output)
    if process.returncode:
        raise NotebookError(reason or f"its process ended with status {process.returncode}")


def stop_all() -> None:
    """End the runs that are under way; each then raises NotebookError."""
    for process in list(_running):
        process.terminate()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _main(source: str, output: str, parameters: str) -> int:
    """The process that `run` starts: one line "cell" for each cell done, then why it failed if it did."""
    import papermill
    from papermill.engines import NBClientEngine, papermill_engines

    class Reporting(NBClientEngine):
        @classmethod
        def execute_managed_notebook(cls, nb_man, kernel_name, **options):
            complete = nb_man.cell_complete

            def cell_complete(cell, cell_index=None, **rest):
                complete(cell, cell_index=cell_index, **rest)
                print("cell", flush=True)

            nb_man.cell_complete = cell_complete
            super().execute_managed_notebook(nb_man, kernel_name, **options)

    papermill_engines.register("reporting", Reporting)
    try:
        papermill.execute_notebook(
            source, output, json.loads(parameters), engine_name="reporting", progress_bar=False, cwd=Path(source).parent
        )
    except papermill.PapermillExecutionError as error:
        print(f"error in cell {error.cell_index}: {error.ename}: {error.evalue}".replace("\n", " "), flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(_main(*sys.argv[1:]))
