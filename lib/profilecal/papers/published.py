"""The numbers that the two papers print, read from data/published, with the digits they were printed in."""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import linprog

from profilecal.geometry.fitting import ROUNDS
from profilecal.geometry.poses import nearest_rotation

SMALL = 1e-4  # the step of the differences that stand for derivatives, and the change at which the search ends
INSIDE = 0.99  # of the way from the middle of an interval to its ends: room for what is not linear
DEAR = 10.0  # cost of missing an interval by its own half width, where a change of 1 costs 1


def least_change(compute, low, high, size: int) -> tuple[np.ndarray, float]:
    """The x (size,) with the smallest max |x| at which all values of `compute` lie between `low` and `high` (k,).

    `compute` maps (..., size) to (..., k). Each round puts derivatives at the last x in its place and solves what is
    left, a linear program, no farther than `trust` away, a distance that grows or shrinks with how well that went
    (sequential linear programming with an exact penalty). Where the values curve, the program is solved once more with
    what the values at its solution really are (Fletcher 1982). Returns x and max |x|; infinity if an interval is
    missed.
    """
    middle, half = (low + high) / 2, (high - low) / 2

    def look(y):
        found = (compute(y) - middle) / half
        return found, _cost(y, found)

    x, trust, J = np.zeros(size), 1.0, None
    values, cost = look(x)
    for _ in range(ROUNDS):
        if J is None:  # of a new x
            moved = (compute(x + SMALL * np.vstack([np.eye(size), -np.eye(size)])) - middle) / half
            J = (moved[:size] - moved[size:]).T / (2 * SMALL)
        constant = values - J @ x
        tried = _linear_least_change(J, constant, x, trust)
        promised = cost - _cost(tried, J @ tried + constant)
        if promised < SMALL or trust < SMALL:
            break
        found, after = look(tried)
        if cost - after < 0.75 * promised:  # the second-order correction
            again = _linear_least_change(J, found - J @ tried, x, trust)
            seen, less = look(again)
            if less < after:
                tried, found, after = again, seen, less
        if cost - after > 0.75 * promised:
            trust = max(trust, 2 * np.abs(tried - x).max())
        elif cost - after < 0.25 * promised:
            trust = trust / 4
        if after < cost:
            x, values, cost, J = tried, found, after, None
    return x, np.abs(x).max() if np.abs(values).max() <= 1 else np.inf


def _cost(x, values) -> float:
    return np.abs(x).max() + DEAR * max(np.abs(values).max() - INSIDE, 0)


def _linear_least_change(J, constant, x, trust: float) -> np.ndarray:
    """The y within `trust` of x that costs least, if the values are J y + constant: a linear program in (y, s, t)."""
    k, size = J.shape
    one, rows = np.ones((size, 1)), np.ones((k, 1))
    A = np.block(
        [
            [J, 0 * rows, -rows],  # |J y + constant| ≤ INSIDE + t
            [-J, 0 * rows, -rows],
            [np.eye(size), -one, 0 * one],  # |y| ≤ s
            [-np.eye(size), -one, 0 * one],
        ]
    )
    b = np.concatenate([INSIDE - constant, INSIDE + constant, np.zeros(2 * size)])
    bounds = [*zip(x - trust, x + trust, strict=True), (0, None), (0, None)]
    return linprog(np.r_[np.zeros(size), 1, DEAR], A, b, bounds=bounds).x[:size]


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
    (of the last digit that the quantity is printed to: the papers drop trailing zeros; none for a number that is zero
    by definition), unit, note, value, half_unit.
    """
    if paper not in FILES:
        raise ValueError(f"paper is {paper!r}; expected one of {', '.join(FILES)}")
    frame = pd.read_csv(folder() / FILES[paper], dtype=str, keep_default_na=False)
    frame["value"] = frame["printed"].astype(float)
    frame["half_unit"] = (0.5 * 10.0 ** -pd.to_numeric(frame["decimals"])).fillna(0.0)
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


def vectors(paper: str, item: str, quantity: str) -> list[str]:
    """The rows of one quantity as the paper prints them, such as "(5.947, 0, 5.97)"."""
    rows = _entries(paper, item, quantity).groupby("row", sort=False)["printed"]
    return [f"({', '.join(row)})".replace("-", "−") for _, row in rows]


def sensor_pose(item: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """R_sensor (3, 3), projected to a rotation, and T_sensor (3,), mm, of a matrix that the disk paper prints."""
    matrix = values("disk", item, quantity).reshape(-1, 4)[:3]
    return nearest_rotation(matrix[:, :3]), matrix[:, 3]


@dataclass(frozen=True)
class RoundingBox:
    """All tables that would be printed as this one is: each number free within half a unit of its last digit.

    Numbers that are zero by definition stay.
    """

    paper: str
    item: str
    quantities: tuple[str, ...]

    @cached_property
    def _printed(self) -> dict:
        """Of each quantity: the printed numbers, and half of their last digit."""
        found = {}
        for name in self.quantities:
            printed = values(self.paper, self.item, name)
            half = _entries(self.paper, self.item, name)["half_unit"].to_numpy().reshape(printed.shape)
            found[name] = printed, half
        return found

    @property
    def size(self) -> int:
        """How many numbers the table has."""
        return sum(printed.size for printed, _ in self._printed.values())

    def at(self, place) -> dict[str, np.ndarray]:
        """The tables at places (..., size) of the box, -1 to 1 along each axis; 0 is the table as printed."""
        place, tables, start = np.asarray(place, dtype=float), {}, 0
        for name, (printed, half) in self._printed.items():
            offset = place[..., start : start + printed.size].reshape(*place.shape[:-1], *printed.shape)
            tables[name] = printed + half * offset
            start += printed.size
        return tables

    def draw(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """`count` tables drawn uniformly from the box, each quantity (count, rows, components)."""
        return self.at(rng.uniform(-1, 1, (count, self.size)))

    def reach(self, compute, target, unit, largest_of: int = 1) -> tuple[np.ndarray, float]:
        """Look for the least change of the printed numbers with which `compute` gives `target`.

        `compute(tables)` maps tables with any leading axes to (..., k), and each value is to come within its `unit`
        (k,) of its target (k,). With `largest_of`, so many values at the end have one target and unit, the last: the
        largest of them has to meet it.

        Returns the place (size,) found and the largest change there, in half units of the last printed digit: up to 1
        the table prints alike; infinity if nothing was found at all. The search follows derivatives from the table as
        printed: a large value is no proof of absence.
        """
        target, unit = np.asarray(target, dtype=float), np.asarray(unit, dtype=float)
        others = np.ones(largest_of - 1)
        low = np.append(target - unit, 0 * others)
        high = np.append(target + unit, (target + unit)[-1] * others)

        def values(place):
            found = np.array(compute(self.at(place)))
            found[..., -largest_of:] = -np.sort(-found[..., -largest_of:], axis=-1)  # the largest first
            return found

        return least_change(values, low, high, self.size)
