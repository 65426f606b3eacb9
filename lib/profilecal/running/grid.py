"""A grid of parameters and the runs that it means: which there are, what each is called, its seed."""

import hashlib
import itertools
import json
from dataclasses import dataclass
from pathlib import Path

from profilecal.running import notebooks


@dataclass(frozen=True)
class Run:
    """One execution: a file name that says what it is, every parameter given, and which of the repeats it is."""

    name: str
    parameters: dict
    repeat: int | None

    @property
    def file(self) -> str:
        """The name of its executed notebook."""
        return f"{self.name}.ipynb"


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
    if repeat and "seed" not in kinds:
        raise ValueError(f"{notebook.stem} has no parameter 'seed', so its repeats would all be the same")
    lists = {name: _checked(name, values, kinds) for name, values in grid.items()}
    points = _zipped(lists) if zipped else _product(lists)
    if "seed" in kinds and "seed" not in lists:
        default = default_seed(notebook)
        points = [point | {"seed": default} for point in points]
    if repeat:
        runs = [_run(point | {"seed": _spawn(point, k)}, k) for point in points for k in range(repeat)]
    else:
        runs = [_run(point, None) for point in points]
    if len({run.name for run in runs}) < len(runs):
        raise ValueError("the grid names a run twice; expected different values")
    return runs


def _checked(name: str, values, kinds: dict[str, str]) -> list:
    """The values of one parameter as a list. Raises ValueError where they do not fit the notebook's parameters."""
    values = values if isinstance(values, list) else [values]
    if not values:
        raise ValueError(f"the grid has no values for {name}")
    if name not in kinds:
        raise ValueError(f"no parameter named {name!r}; there are {', '.join(kinds) or 'none'}")
    for value in values:
        notebooks.check_value(name, value, kinds[name])
    return [float(value) for value in values] if kinds[name] == "float" else values  # 1 and 1.0 are one setting


def _product(lists: dict[str, list]) -> list[dict]:
    """Every value of each list with every value of the others."""
    return [dict(zip(lists, values, strict=True)) for values in itertools.product(*lists.values())]


def _zipped(lists: dict[str, list]) -> list[dict]:
    """The first values of all lists, the second ones and so on; a list of one value has it everywhere."""
    longest = max(map(len, lists.values()), default=1)
    for name, values in lists.items():
        if len(values) not in (1, longest):
            raise ValueError(f"--zip: {name} has {len(values)} values; expected {longest}, or one for all")
    return [{name: values[k % len(values)] for name, values in lists.items()} for k in range(longest)]


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

    sequence = np.random.SeedSequence(point["seed"], spawn_key=(int(digest(point, 32), 16), index))
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(11))


def _run(parameters: dict, repeat: int | None) -> Run:
    """A run and its name: what of the parameters is readable, and a digest of them all."""
    said = "_".join(f"{name}={value}" for name, value in parameters.items() if name != "seed")
    said = "".join(letter if letter.isalnum() or letter in "=_.-" else "-" for letter in said)[:100]
    return Run(f"{said}_{digest(parameters, 8)}", parameters, repeat)


def digest(values, length: int) -> str:
    """A digest of plain values, in hexadecimal."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:length]
