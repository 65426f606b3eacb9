"""The numbers that the two papers print, read from data/published, with the digits they
were printed in.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from profilecal.geometry.poses import nearest_rotation


def least_change(compute, low, high, size: int) -> tuple[np.ndarray, float]:
    """The x (size,) with the smallest max |x| at which all values of `compute`, (...,
    size) to (..., k), lie between `low` and `high` (k,); and that max |x|, infinity if
    an interval is missed. By sequential quadratic programming (Kraft 1988) in x and a
    bound s of all |x|, from near 0.
    """
    step = 1e-4  # of the differences that stand for derivatives
    # of the way from the middle of an interval to its ends: room for what is not linear
    inside = 0.99
    middle, half = (low + high) / 2, (high - low) / 2
    one, of_s = np.eye(size), np.eye(size + 1)[-1]

    def values(x):
        return (compute(x) - middle) / half

    def room(y):
        x, s = y[:-1], y[-1]
        return np.concatenate([s - x, s + x, inside - values(x), inside + values(x)])

    def room_by(y):
        moved = values(y[:-1] + step * np.vstack([one, -one]))
        J = (moved[:size] - moved[size:]).T / (2 * step)
        return np.column_stack(
            [np.vstack([-one, one, -J, J]), np.repeat([1, 0], [2 * size, 2 * len(J)])]
        )

    limits = {"type": "ineq", "fun": room, "jac": room_by}
    # at 0 several values may tie, and have no slope
    start = np.append(np.linspace(-0.01, 0.01, size), 0)
    x = minimize(
        lambda y: y[-1], start, jac=lambda _: of_s, method="SLSQP", constraints=limits
    ).x[:-1]
    return x, np.abs(x).max() if np.abs(values(x)).max() <= 1 else np.inf


FILES = {"disk": "disk_chen_2018.csv", "edge": "edge_xu_2021.csv"}


def folder() -> Path:
    """Where the tables are: inside an installed package, or at the top of a clone."""
    package = Path(__file__).parent
    places = (package / "data" / "published", package.parents[1] / "data" / "published")
    return next((place for place in places if place.is_dir()), places[0])


@cache
def table(paper: str) -> pd.DataFrame:
    """All published numbers of one paper ("disk" or "edge"), one a row.

    Columns: paper, item (table, equation, figure or section), quantity, row, component,
    printed (text), decimals (to which the quantity is printed; none for a number that
    is zero by definition), unit, note, value, half_unit.
    """
    if paper not in FILES:
        raise ValueError(f"paper is {paper!r}; expected one of {', '.join(FILES)}")
    frame = pd.read_csv(folder() / FILES[paper], dtype=str, keep_default_na=False)
    frame["value"] = frame["printed"].astype(float)
    frame["half_unit"] = (0.5 * 10.0 ** -pd.to_numeric(frame["decimals"])).fillna(0.0)
    return frame


@cache
def _entries(paper: str, item: str, quantity: str) -> pd.DataFrame:
    frame = table(paper)
    if item not in set(frame["item"]):
        raise ValueError(
            f"the {paper} paper has no {item!r}; there are {', '.join(frame['item'].unique())}"
        )
    frame = frame[frame["item"] == item]
    if quantity not in set(frame["quantity"]):
        raise ValueError(
            f"{item} has no {quantity!r}; there are {', '.join(frame['quantity'].unique())}"
        )
    return frame[frame["quantity"] == quantity]


def values(paper: str, item: str, quantity: str) -> np.ndarray:
    """The printed numbers of one quantity, (rows, components), without axes of length
    one: ("disk", "Table I", "T_tcp") is (4, 3), ("disk", "Eq. 51", "accuracy") has no
    axis. Raises ValueError with the names there are.
    """
    entries = _entries(paper, item, quantity)
    return np.squeeze(entries["value"].to_numpy().reshape(entries["row"].nunique(), -1))


def half_unit(paper: str, item: str, quantity: str) -> float:
    """Half of the last printed digit: how far the number behind a printed one can be
    from it.
    """
    return _entries(paper, item, quantity)["half_unit"].max()


def vectors(paper: str, item: str, quantity: str) -> list[str]:
    """The rows of one quantity as the paper prints them, such as "(5.947, 0, 5.97)"."""
    rows = _entries(paper, item, quantity).groupby("row", sort=False)["printed"]
    return [f"({', '.join(row)})".replace("-", "−") for _, row in rows]


def sensor_pose(item: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
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
    def _printed(self) -> dict:
        """Of each quantity: the printed numbers, and half of their last digit."""
        found = {}
        for name in self.quantities:
            printed = values(self.paper, self.item, name)
            half = (
                _entries(self.paper, self.item, name)["half_unit"]
                .to_numpy()
                .reshape(printed.shape)
            )
            found[name] = printed, half
        return found

    @property
    def size(self) -> int:
        """How many numbers the table has."""
        return sum(printed.size for printed, _ in self._printed.values())

    def at(self, place) -> dict[str, np.ndarray]:
        """The tables at places (..., size) of the box, -1 to 1 along each axis; 0 is
        the table as printed.
        """
        ends = np.cumsum([printed.size for printed, _ in self._printed.values()])
        tables = {}
        for (name, (printed, half)), part in zip(
            self._printed.items(), np.split(place, ends[:-1], -1), strict=True
        ):
            tables[name] = printed + half * part.reshape(
                *part.shape[:-1], *printed.shape
            )
        return tables

    def draw(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """`count` tables drawn uniformly from the box, each quantity (count, rows,
        components).
        """
        return self.at(rng.uniform(-1, 1, (count, self.size)))

    def reach(
        self, compute, target, unit, largest_of: int = 1
    ) -> tuple[np.ndarray, float]:
        """Look for the least change of the printed numbers with which `compute` gives
        `target`.

        `compute(tables)` maps tables with any leading axes to (..., k); each value is
        to come within its `unit` (k,) of its target (k,). Of the last `largest_of`
        values, the largest is to meet the last target.

        Returns the place (size,) found and the largest change there, in half units of
        the last printed digit: up to 1 the table prints alike; infinity if nothing was
        found. The search follows derivatives from the table as printed: a large value
        is no proof of absence.
        """
        target, unit = np.asarray(target, dtype=float), np.asarray(unit, dtype=float)
        others = np.ones(largest_of - 1)
        low = np.append(target - unit, 0 * others)
        high = np.append(target + unit, (target + unit)[-1] * others)

        def values(place):
            found = np.array(compute(self.at(place)))
            # the largest first
            found[..., -largest_of:] = -np.sort(-found[..., -largest_of:], axis=-1)
            return found

        return least_change(values, low, high, self.size)
