"""One notebook over a grid of parameters, and one tidy table of what its runs record.

The runs are here or on a cluster. An executed notebook holds all there is to know about
its run. It appears under `runs/` in one move: a sweep that is killed leaves whole runs
or none, and goes on from there.
"""

import itertools
import json
import re
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from profilecal.scan.tables import written_whole
from profilecal.scan.toml import read_toml
from profilecal_pages import notebooks


def read_grid(path: Path | None, texts: Sequence[str] = ()) -> dict:
    """Read the grid of a TOML file, and then of texts NAME=A,B,…

    The file has a list of values, or one value, for each name. Raises ValueError where
    it is something else.
    """
    grid = read_toml(path) if path else {}
    given = {}
    for text in texts:
        name, equals, values = text.partition("=")
        if not equals or name in given:
            raise ValueError(
                f"-p {text}; expected name=value,value,…, and each name once"
            )
        given[name] = [notebooks.parse_value(value) for value in values.split(",")]
    return grid | given


def plan(notebook: Path, grid: dict, repeat: int | None = None) -> dict[str, dict]:
    """The parameters of each run of a grid, by the run's name.

    A run has each value of one parameter with each of the others. With `repeat`, each
    is run that often, with seeds that depend on the parameters and the count of the
    repeat: a grid that grows keeps the runs it has. Raises ValueError for a grid that
    does not fit the notebook's parameters.
    """
    kinds = notebooks.parameters_of(notebook)
    if not grid and not repeat:
        known = f"{notebook.stem} has the parameters {', '.join(kinds)}"
        raise ValueError(f"the grid is empty; {known}")
    if repeat and "seed" not in kinds:
        raise ValueError(
            f"{notebook.stem} has no parameter 'seed', "
            "so its repeats would all be the same"
        )
    lists = {k: v if isinstance(v, list) else [v] for k, v in grid.items()}
    notebooks.check_parameters(lists, [kinds])
    for name, values in lists.items():
        if not values:
            raise ValueError(f"the grid has no values for {name}")
        if kinds[name] == "float":  # 1 and 1.0 are one setting
            lists[name] = [*map(float, values)]
    product = itertools.product(*lists.values())
    points = [dict(zip(lists, values, strict=True)) for values in product]
    if repeat:
        numbered = itertools.product(points, range(repeat))
        points = [one | {"seed": int(_digest([one, k], 13), 16)} for one, k in numbered]
    runs = {_name(point): point for point in points}
    if len(runs) < len(points):
        raise ValueError("the grid names a run twice; expected different values")
    return runs


def _name(parameters: dict) -> str:
    """What of a run's parameters is readable, and a digest of them all."""
    said = [f"{name}={value}" for name, value in parameters.items() if name != "seed"]
    readable = re.sub(r"[^\w=.-]", "-", "_".join(said))
    return f"{readable[:100]}_{_digest(parameters, 8)}"


def _digest(values: object, length: int) -> str:
    """A digest of plain values, in hexadecimal."""
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:length]


def sweep(
    notebook: Path,
    grid: dict,
    output: Path,
    *,
    repeat: int | None = None,
    scheduler: str | None = None,
    timeout: int | None = None,
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Carry out the runs of a grid (`plan`) that are not there yet.

    Returns a table of all, and by name why some failed. `output` gets the executed
    notebooks under `runs/` and `table.csv`. A run is there when it did not fail and its
    notebook, parameters and versions are the present ones.

    The runs share this machine's cores, or go to the Dask scheduler at the address
    `scheduler`. A run whose kernel dies, or where a cell takes longer than `timeout`
    seconds, is tried once more. Raises ValueError for a grid that does not fit,
    OSError.
    """
    runs = plan(notebook, grid, repeat)
    source = notebook.read_text("utf-8")
    cells = json.loads(source)["cells"]
    code = [cell["source"] for cell in cells if cell["cell_type"] == "code"]
    versions = notebooks.versions()
    place = str(notebook.resolve().parent)
    folder = output / "runs"
    folder.mkdir(parents=True, exist_ok=True)
    jobs, keys = {}, {}
    for name, parameters in runs.items():
        keys[name] = _digest([code, parameters, versions], 16)
        about = _about(folder / f"{name}.ipynb")
        if about.get("key") != keys[name] or about["error"]:
            jobs[name] = source, parameters, place, timeout
    if jobs:
        with notebooks.workers(scheduler) as client:
            ended = notebooks.outcomes(client, jobs)
            bar = tqdm(ended, total=len(jobs), unit="run", disable=None)
            for name, text, why, seconds in bar:
                executed = json.loads(text)
                executed["metadata"]["profilecal"] = {
                    "key": keys[name],
                    "error": why,
                    "duration_s": seconds,
                }
                with written_whole(folder / f"{name}.ipynb") as part:
                    part.write_text(json.dumps(executed), "utf-8")
    table, failed = _gather(runs, folder, versions)
    with written_whole(output / "table.csv") as part:
        table.to_csv(part, index=False)
    return table, failed


def _about(path: Path) -> dict:
    """What an executed notebook says of its run; nothing where there is none."""
    try:
        executed = json.loads(path.read_text("utf-8"))
        return executed["metadata"]["profilecal"]
    except (FileNotFoundError, ValueError, KeyError):
        return {}


def _gather(
    runs: dict, folder: Path, versions: dict[str, str]
) -> tuple[pd.DataFrame, dict[str, str]]:
    """The table of runs that have ended, in the grid's order, and why some failed."""
    rows = []
    failed = {}
    for name, parameters in runs.items():
        executed = json.loads((folder / f"{name}.ipynb").read_text("utf-8"))
        about = executed["metadata"]["profilecal"]
        status, records = "done", notebooks.recorded(executed)
        if about["error"]:
            status, records = "failed", [{}]
            failed[name] = about["error"]
        seconds = about["duration_s"]
        end = {"status": status, "duration_s": seconds, **versions, "run": name}
        # a parameter is what it was set to, whatever is recorded
        rows += [parameters | record | parameters | end for record in records]
    table = pd.DataFrame(rows)
    return table[[*table.columns.drop([*end]), *end]], failed
