"""The numbers that the two papers print, read from data/published, with the digits they were printed in."""

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

FILES = {"disk": "disk_chen_2018.csv", "edge": "edge_xu_2021.csv"}


def folder() -> Path:
    """Where the tables are: inside an installed package, or at the top of a clone."""
    package = Path(__file__).parent
    places = (package / "data" / "published", package.parents[1] / "data" / "published")
    return next((place for place in places if place.is_dir()), places[0])


@cache
def table(paper: str) -> pd.DataFrame:
    """All published numbers of one paper ("disk" or "edge"), one a row.

    Columns: paper, item (table, equation, figure or section), quantity, row, component, printed (text), decimals
    (of the last digit that the quantity is printed to: the papers drop trailing zeros), unit, note, value, half_unit.
    """
    if paper not in FILES:
        raise ValueError(f"paper is {paper!r}; expected one of {', '.join(FILES)}")
    frame = pd.read_csv(folder() / FILES[paper], dtype=str, keep_default_na=False)
    frame["value"] = frame["printed"].astype(float)
    frame["half_unit"] = 0.5 * 10.0 ** -frame["decimals"].astype(int)
    return frame


def _entries(paper: str, item: str, quantity: str) -> pd.DataFrame:
    frame = table(paper)
    if item not in set(frame["item"]):
        raise ValueError(f"the {paper} paper has no {item!r}; there are {', '.join(frame['item'].unique())}")
    frame = frame[frame["item"] == item]
    if quantity not in set(frame["quantity"]):
        raise ValueError(f"{item} has no {quantity!r}; there are {', '.join(frame['quantity'].unique())}")
    return frame[frame["quantity"] == quantity]


def values(paper: str, item: str, quantity: str) -> np.ndarray:
    """The printed numbers of one quantity, (rows, components), without the axes of length one.

    values("disk", "Table I", "T_tcp") is (4, 3); values("disk", "Eq. 51", "accuracy") has no axis.
    Raises ValueError with the names there are.
    """
    entries = _entries(paper, item, quantity)
    rows = entries["row"].nunique()
    return np.squeeze(entries["value"].to_numpy().reshape(rows, -1))


def half_unit(paper: str, item: str, quantity: str) -> float:
    """Half of the last printed digit: how far the number behind a printed one can be from it."""
    return _entries(paper, item, quantity)["half_unit"].max()


def unrounded(paper: str, item: str, quantity: str, size: int, rng: np.random.Generator) -> np.ndarray:
    """`size` draws (size, rows, components) from the rounding box: numbers that would be printed as these are."""
    printed = values(paper, item, quantity)
    return printed + half_unit(paper, item, quantity) * rng.uniform(-1, 1, (size, *printed.shape))
