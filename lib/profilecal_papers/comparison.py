"""Ours beside what a paper prints: an item from its published numbers and from what we
found.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from profilecal_pages.items import DIGITS, Item, Row
from profilecal_papers import published


def compare(
    paper: str,
    item: str,
    what: str,
    ours: Mapping,
    low: Mapping | None = None,
    high: Mapping | None = None,
    *,
    why: Mapping | None = None,
    labels: Mapping | None = None,
    otherwise: Mapping[str, Sequence[Mapping]] | None = None,
    **about: Any,
) -> Item:
    """An item from what `published` has of it.

    `ours`, `low`, `high`: for each quantity an array shaped as `published.values` has
    it; without them no range, but for rounding. A quantity that can be read in two ways
    stands twice, as (quantity, reading). `why`: for each quantity, why it differs.
    `labels`: how the paper writes names of rows, columns and quantities. `about` goes
    to `Item`.

    `otherwise`: by name, what we would have found had the paper been otherwise: with a
    wrong sign, another formula, another set-up. Of each ours, low and high, as above,
    of some of the quantities. A row counts only if one of them puts the printed number
    outside.

        otherwise={"own arcs": ({"e": e}, {"e": low}, {"e": high})}

    Raises ValueError for a number that differs without a reason.
    """
    rows = []
    for key, values in ours.items():
        quantity, *reading = key if isinstance(key, tuple) else (key,)
        entries = published.entries(paper, item, quantity).itertuples()
        least = (low or {}).get(key, values)
        most = (high or {}).get(key, values)
        ranges = zip(*map(np.ravel, (values, least, most)), strict=True)
        others = {
            name: np.stack([np.ravel(part[key]) for part in parts], axis=-1)
            for name, parts in (otherwise or {}).items()
            if key in parts[0]
        }
        for k, (entry, three) in enumerate(zip(entries, ranges, strict=True)):
            row = beside_printed(entry, three, labels or {}, "".join(reading))
            digits = row.decimals + DIGITS
            for name, each in others.items():
                row.otherwise[name] = [round(float(v), digits) for v in each[k]]
            if not row.inside:
                row = replace(row, why=(why or {}).get(key, ""))
                if not row.why:
                    where = f"{item}, {row.row}, {row.column}, {row.quantity}"
                    raise ValueError(
                        f"{where}: {row.ours} differs from {row.printed}; say why"
                    )
            rows.append(row)
    return Item(paper, item, what, tuple(rows), **about)


def beside_printed(entry: Any, numbers: Iterable, labels: Mapping, reading: str) -> Row:
    """A row of an item, from a row of `published.entries` and from ours, low and
    high, rounded to what the data hold.
    """
    decimals = int(entry.decimals)
    ours, low, high = (round(float(value), decimals + DIGITS) for value in numbers)
    return Row(
        row=labels.get(entry.row, entry.row),
        column=labels.get(entry.component, entry.component),
        quantity=labels.get(entry.quantity, entry.quantity),
        printed=entry.printed,
        decimals=decimals,
        unit=entry.unit,
        ours=ours,
        low=low,
        high=high,
        reading=reading,
    )


def beside(
    item: str,
    what: str,
    quantity: str,
    ours: np.ndarray,
    alike: np.ndarray,
    otherwise: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None,
    apart: str = "",
) -> Item:
    """Ours beside a matrix, vector or number of the disk paper; `alike` (draws, ...):
    ours from tables that print so, of which 95 % span the range allowed. `otherwise`:
    by name the same two, had the paper computed otherwise. `apart`: see `Item`.
    """

    def with_range(ours: np.ndarray, alike: np.ndarray) -> tuple[dict, ...]:
        low, high = np.quantile(alike, [0.025, 0.975], axis=0)
        return tuple({quantity: numbers} for numbers in (ours, low, high))

    return compare(
        "disk",
        item,
        what,
        *with_range(ours, alike),
        why={quantity: "outside what rounding allows"},
        otherwise={name: with_range(*two) for name, two in (otherwise or {}).items()},
        range_from="rounding",
        layout="matrix",
        apart=apart,
    )
