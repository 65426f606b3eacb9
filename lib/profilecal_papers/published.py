"""The numbers that the two papers print, read from data/published, with the digits they
were printed in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.optimize import minimize

from profilecal.geometry.poses import nearest_rotation
from profilecal_pages.notebooks import shipped


def least_change(
    compute: Callable,
    low: ndarray,
    high: ndarray,
    size: int,
) -> tuple[ndarray, float]:
    """The x (size,) with the smallest max |x| at which all values of `compute`, (...,
    size) to (..., k), lie between `low` and `high` (k,); and that max |x|, infinity if
    an interval is missed.

    With values v(x) that are -1 at `low` and 1 at `high`, and a bound s of all |xᵢ|,

        minimise s, where s - x ≥ 0, s + x ≥ 0, 0.99 - v(x) ≥ 0 and 0.99 + v(x) ≥ 0.

    It is a problem in y = (x, s). The derivatives of the four constraints are

        by x: -I, I, -J, J,  by s: 1, 1, 0, 0,  with J = ∂v/∂x

    from central differences. Sequential quadratic programming (Kraft 1988) solves it
    from near x = 0.
    """
    step = 1e-4  # of the differences that stand for derivatives
    # of the way from the middle of an interval to its ends: room for what is not linear
    inside = 0.99
    middle, half = (low + high) / 2, (high - low) / 2
    one = np.eye(size)

    def v(x: ndarray) -> ndarray:
        return (compute(x) - middle) / half

    def room(y: ndarray) -> Any:
        x, s = y[:-1], y[-1]
        return np.concatenate([s - x, s + x, inside - v(x), inside + v(x)])

    def slopes_of_room(y: ndarray) -> Any:
        forth, back = np.split(v(y[:-1] + step * np.vstack([one, -one])), 2)
        J = (forth - back).T / (2 * step)
        by_x = np.vstack([-one, one, -J, J])
        by_s = np.repeat([1, 0], [2 * size, 2 * len(J)])
        return np.column_stack([by_x, by_s])

    # at 0 several values may tie, and have no slope
    start = np.append(np.linspace(-0.01, 0.01, size), 0)
    y = minimize(
        lambda y: y[-1],
        start,
        method="SLSQP",
        constraints={"type": "ineq", "fun": room, "jac": slopes_of_room},
    ).x
    x = y[:-1]
    return x, np.abs(x).max() if np.abs(v(x)).max() <= 1 else np.inf


FILES = {"disk": "disk_chen_2018.csv", "edge": "edge_xu_2021.csv"}


@cache
def table(paper: str) -> pd.DataFrame:
    """All published numbers of one paper ("disk" or "edge"), one a row.

    Columns: paper, item (table, equation, figure or section), quantity, row, component,
    printed (text), decimals (to which the quantity is printed; none for a number that
    is zero by definition), unit, note, value, half_unit.
    """
    file = shipped("profilecal_papers", f"data/published/{FILES[paper]}")
    frame = pd.read_csv(file, dtype=str, keep_default_na=False)
    frame["value"] = frame["printed"].astype(float)
    frame["half_unit"] = (0.5 * 10.0 ** -pd.to_numeric(frame["decimals"])).fillna(0.0)
    return frame


@cache
def entries(paper: str, item: str, quantity: str) -> pd.DataFrame:
    """The rows of `table` that one quantity of an item has. Raises ValueError with the
    names there are.
    """
    frame = _chosen(table(paper), "item", item, f"the {paper} paper")
    return _chosen(frame, "quantity", quantity, item)


def _chosen(frame: pd.DataFrame, column: str, name: str, where: str) -> pd.DataFrame:
    """The rows that have a name in a column."""
    chosen = frame[frame[column] == name]
    if chosen.empty:
        names = ", ".join(frame[column].unique())
        raise ValueError(f"{where} has no {name!r}; there are {names}")
    return chosen


def values(paper: str, item: str, quantity: str) -> ndarray:
    """The printed numbers of one quantity, (rows, components), without axes of length
    one: ("disk", "Table I", "T_tcp") is (4, 3), ("disk", "Eq. 51", "accuracy") has no
    axis. Raises ValueError with the names there are.
    """
    found = entries(paper, item, quantity)
    matrix = found["value"].to_numpy().reshape(found["row"].nunique(), -1)
    return np.squeeze(matrix)


def half_unit(paper: str, item: str, quantity: str) -> float:
    """Half of the last printed digit: how far the number behind a printed one can be
    from it.
    """
    return entries(paper, item, quantity)["half_unit"].max()


def vectors(paper: str, item: str, quantity: str) -> list[str]:
    """The rows of one quantity as the paper prints them, such as "(5.947, 0, 5.97)"."""
    rows = entries(paper, item, quantity).groupby("row", sort=False)["printed"]
    return [f"({', '.join(row)})".replace("-", "−") for _, row in rows]


def sensor_pose(item: str, quantity: str) -> tuple[ndarray, ndarray]:
    """R_sensor (3, 3), projected to a rotation, and T_sensor (3,), mm, of a matrix that
    the disk paper prints.
    """
    matrix = values("disk", item, quantity).reshape(-1, 4)[:3]
    return nearest_rotation(matrix[:, :3]), matrix[:, 3]


@dataclass(frozen=True)
class RoundingBox:
    """All tables that would be printed as this one is: each number is free within half
    a unit of its last digit, but for those that are zero by definition.
    """

    paper: str
    item: str
    quantities: tuple[str, ...]

    @cached_property
    def _printed(self) -> dict[str, tuple[ndarray, ndarray]]:
        """Of each quantity: the printed numbers, and half of their last digit."""
        found = {}
        for name in self.quantities:
            printed = values(self.paper, self.item, name)
            half = entries(self.paper, self.item, name)["half_unit"].to_numpy()
            found[name] = printed, half.reshape(printed.shape)
        return found

    @property
    def size(self) -> int:
        """How many numbers the table has."""
        return sum(printed.size for printed, _ in self._printed.values())

    def at(self, place: ndarray) -> dict[str, ndarray]:
        """The tables at places (..., size) of the box, -1 to 1 along each axis; 0 is
        the table as printed.
        """
        tables = {}
        first = 0
        for name, (printed, half) in self._printed.items():
            last = first + printed.size
            part = place[..., first:last].reshape(*place.shape[:-1], *printed.shape)
            tables[name] = printed + half * part
            first = last
        return tables

    def draw(self, count: int, rng: np.random.Generator) -> dict[str, ndarray]:
        """`count` tables drawn uniformly from the box, each quantity (count, rows,
        components).
        """
        return self.at(rng.uniform(-1, 1, (count, self.size)))

    def reach(
        self,
        compute: Callable,
        target: ndarray,
        unit: ndarray,
        largest_of: int = 1,
    ) -> tuple[ndarray, float]:
        """Look for the least change of the printed numbers with which `compute` gives
        `target`.

        `compute(tables)` maps tables with any leading axes to (..., k); each value is
        to come within its `unit` (k,) of its target (k,). Of the last `largest_of`
        values, which are not negative, the largest is to meet the last target: in
        falling order, the first of them lies in the last interval, and the others
        between 0 and its upper end.

        Returns the place (size,) found and the largest change there, in half units of
        the last printed digit: up to 1 the table prints alike; infinity if nothing was
        found. The search follows derivatives from the table as printed: a large value
        is no proof of absence.
        """
        low, high = target - unit, target + unit
        others = largest_of - 1
        low = np.append(low, np.zeros(others))
        high = np.append(high, np.full(others, high[-1]))

        def falling(place: ndarray) -> ndarray:
            """The values, the last of them in falling order."""
            found = np.array(compute(self.at(place)))
            found[..., -largest_of:] = -np.sort(-found[..., -largest_of:], axis=-1)
            return found

        return least_change(falling, low, high, self.size)
