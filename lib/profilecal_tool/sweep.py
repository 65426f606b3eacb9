"""One notebook over a grid of parameters, here or on a cluster, and one tidy table of
what its runs record.

An executed notebook holds all there is to know about its run. It appears under `runs/`
in one move: a sweep that is killed leaves whole runs or none, and goes on from there.
"""

import itertools
import json
import os
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from profilecal.scan.tables import whole
from profilecal.scan.toml import read_toml
from profilecal_pages import notebooks
from profilecal_pages.notebooks import recorded


def read_grid(path: Path | None, texts=()) -> dict:
    """The grid of a TOML file (a list of values, or one value, for each name), then of
    texts NAME=A,B,… Raises ValueError where it is something else.
    """
    grid = read_toml(path) if path else {}
    given = [text.partition("=") for text in texts]
    for name, equals, values in given:
        if not equals or [first for first, *_ in given].count(name) > 1:
            raise ValueError(
                f"-p {name}{equals}{values}; expected name=value,value,…, and each name once"
            )
        grid[name] = [notebooks.parse_value(value) for value in values.split(",")]
    return grid


def plan(notebook: Path, grid: dict, repeat: int | None = None) -> dict[str, dict]:
    """By name the parameters of each run of a grid: each value of one with each of the
    others.

    With `repeat`, each is run that often, with seeds that depend on the parameters and
    the count of the repeat: a grid that grows keeps the runs it has. Raises ValueError
    for a grid that does not fit the notebook's parameters.
    """
    kinds = notebooks.parameters_of(notebook)
    if not grid and not repeat:
        raise ValueError(
            f"the grid is empty; {notebook.stem} has the parameters {', '.join(kinds) or '(none)'}"
        )
    if repeat and "seed" not in kinds:
        raise ValueError(
            f"{notebook.stem} has no parameter 'seed', so its repeats would all be the same"
        )
    lists = {
        name: values if isinstance(values, list) else [values]
        for name, values in grid.items()
    }
    notebooks.check_parameters(lists, [kinds])
    for name, values in lists.items():
        if not values:
            raise ValueError(f"the grid has no values for {name}")
        if kinds[name] == "float":
            # 1 and 1.0 are one setting
            lists[name] = [float(value) for value in values]
    points = [
        dict(zip(lists, values, strict=True))
        for values in itertools.product(*lists.values())
    ]
    if repeat:
        points = [
            point | {"seed": int(_digest([point, k], 13), 16)}
            for point in points
            for k in range(repeat)
        ]
    runs = {_name(point): point for point in points}
    if len(runs) < len(points):
        raise ValueError("the grid names a run twice; expected different values")
    return runs


def _name(parameters: dict) -> str:
    """What of a run's parameters is readable, and a digest of them all."""
    said = "_".join(
        f"{name}={value}" for name, value in parameters.items() if name != "seed"
    )
    said = "".join(
        letter if letter.isalnum() or letter in "=_.-" else "-" for letter in said
    )[:100]
    return f"{said}_{_digest(parameters, 8)}"


def _digest(values, length: int) -> str:
    """A digest of plain values, in hexadecimal."""
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:length]


def sweep(
    notebook: Path,
    grid: dict,
    output: Path,
    *,
    repeat=None,
    scheduler=None,
    timeout=None,
):
    """Carry out the runs of a grid (`plan`) that are not there yet; return a table of
    all, and by name why some failed.

    `output` gets the executed notebooks under `runs/` and `table.csv`. A run is there
    when it did not fail and its notebook, parameters and versions are the present ones.
    The runs share this machine's cores, or go to the Dask scheduler at the address
    `scheduler`. A run whose kernel dies, or where a cell takes longer than `timeout`
    seconds, is tried once more. Raises ValueError for a grid that does not fit,
    OSError.
    """
    runs = plan(notebook, grid, repeat)
    source, present = notebook.read_text(encoding="utf-8"), notebooks.versions()
    code = [(cell["cell_type"], cell["source"]) for cell in json.loads(source)["cells"]]
    keys = {
        name: _digest([code, parameters, present], 16)
        for name, parameters in runs.items()
    }
    files = {name: output / "runs" / f"{name}.ipynb" for name in runs}
    (output / "runs").mkdir(parents=True, exist_ok=True)
    with _alone(output):
        missing = [name for name in runs if not _is_done(files[name], keys[name])]
        if missing:
            jobs = {
                name: (source, runs[name], str(notebook.resolve().parent), timeout)
                for name in missing
            }
            with (
                notebooks.workers(scheduler) as client,
                tqdm(total=len(jobs), unit="run", disable=None) as bar,
            ):
                for name, text, why, took in notebooks.outcomes(client, jobs):
                    executed = json.loads(text)
                    clash = runs[name].keys() & {
                        column for row in recorded(executed) for column in row
                    }
                    if clash and not why:
                        why = f"it records {', '.join(sorted(clash))}, which is a parameter's name"
                    executed["metadata"]["profilecal"] = {
                        "key": keys[name],
                        "error": why,
                        "duration_s": round(took, 3),
                    }
                    with whole(files[name]) as part:
                        part.write_text(
                            json.dumps(executed, indent=1, ensure_ascii=False),
                            encoding="utf-8",
                        )
                    bar.update()
        table, failed = _gather(runs, files, present)
        with whole(output / "table.csv") as part:
            table.to_csv(part, index=False)
    return table, failed


def _is_done(path: Path, key: str) -> bool:
    """Whether there is an executed notebook that did not fail, of the same notebook,
    parameters and versions.
    """
    try:
        about = json.loads(path.read_text(encoding="utf-8"))["metadata"]["profilecal"]
    except (FileNotFoundError, ValueError, KeyError):
        return False
    return about["key"] == key and not about["error"]


def _gather(
    runs: dict, files: dict[str, Path], present: dict[str, str]
) -> tuple[pd.DataFrame, dict[str, str]]:
    """The table of runs that have ended, in the order of the grid, and why some failed."""
    rows, failed = [], {}
    for name, parameters in runs.items():
        notebook = json.loads(files[name].read_text(encoding="utf-8"))
        about = notebook["metadata"]["profilecal"]
        if about["error"]:
            failed[name] = about["error"]
        status = "failed" if about["error"] else "done"
        end = (
            {"status": status, "duration_s": about["duration_s"]}
            | present
            | {"run": name}
        )
        rows += [
            parameters | row | end
            for row in ([{}] if about["error"] else recorded(notebook))
        ]
    columns = [
        column for column in dict.fromkeys(itertools.chain(*rows)) if column not in end
    ]
    return pd.DataFrame(rows, columns=columns + list(end)), failed


@contextmanager
def _alone(output: Path):
    """Refuse to go on while another sweep writes to `output`."""
    if os.name != "posix":
        yield
        return
    import fcntl

    handle = os.open(output, os.O_RDONLY)
    try:
        try:
            fcntl.flock(
                handle, fcntl.LOCK_EX | fcntl.LOCK_NB
            )  # the system frees it, however we end
        except BlockingIOError:
            raise ValueError(
                f"another sweep is writing to {output}; wait for it or name another folder"
            ) from None
        yield
    finally:
        os.close(handle)
