"""The numbers that the two papers print, read from data/published, with the digits they were printed in."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import linprog

ROUNDS = 30  # steps of the search in a rounding box; four or five are usual
LEAST_GAIN = 1e-3  # of the largest mismatch: what is worth another step
FILES = {"disk": "disk_chen_2018.csv", "edge": "edge_xu_2021.csv"}


def folder() -> Path:
    """Where the tables are: inside an installed package, or at the top of a clone."""
    package = Path(__file__).parents[1]
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


@dataclass(frozen=True)
class RoundingBox:
    """All tables that would be printed as this one is: each number free within half a unit of its last digit."""

    paper: str
    item: str
    quantities: tuple[str, ...]

    @property
    def size(self) -> int:
        """How many numbers the table has."""
        return sum(values(self.paper, self.item, name).size for name in self.quantities)

    def at(self, place) -> dict[str, np.ndarray]:
        """The tables at places (..., size) of the box, -1 to 1 along each axis; 0 is the table as printed."""
        place, tables, start = np.asarray(place, dtype=float), {}, 0
        for name in self.quantities:
            printed = values(self.paper, self.item, name)
            offset = place[..., start : start + printed.size].reshape(*place.shape[:-1], *printed.shape)
            tables[name] = printed + half_unit(self.paper, self.item, name) * offset
            start += printed.size
        return tables

    def draw(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """`count` tables drawn uniformly from the box, each quantity (count, rows, components)."""
        return self.at(rng.uniform(-1, 1, (count, self.size)))

    def reach(self, compute, target, unit) -> tuple[np.ndarray, float]:
        """Look inside the box for a table from which `compute` gives `target`.

        `compute(tables)` maps tables with any leading axes to (..., k); target and unit are (k,). Returns the place
        (size,) at which the largest of |compute - target| / unit is smallest, and that value; the search ends once it
        is 1 or less. Each step solves the linearised problem over the whole box, a linear program: where `compute` is
        nearly linear there, as the calibrations are, nothing better is missed. Still, a search is no proof of absence.
        """

        def mismatch(place):
            return (compute(self.at(place)) - target) / unit

        place, widest = np.zeros(self.size), 1.0
        found, steps = mismatch(place), 1e-4 * np.eye(self.size)
        for _ in range(ROUNDS):
            worst = np.abs(found).max()
            if worst <= 1:
                break
            J = ((mismatch(place + steps) - mismatch(place - steps)) / 2e-4).T
            level = -np.ones((len(J), 1))  # the last unknown: what no mismatch may exceed
            bounds = np.column_stack([np.maximum(-1 - place, -widest), np.minimum(1 - place, widest)])
            program = linprog(
                np.append(np.zeros(self.size), 1.0),
                np.block([[J, level], [-J, level]]),
                np.concatenate([-found, found]),
                bounds=[*bounds, (0, None)],
            )
            if worst - program.fun < LEAST_GAIN * worst:
                break
            there = np.clip(place + program.x[:-1], -1, 1)
            moved = mismatch(there)
            if worst - np.abs(moved).max() > 0.1 * (worst - program.fun):
                place, found = there, moved
            else:
                widest /= 3
        return place, np.abs(found).max()
