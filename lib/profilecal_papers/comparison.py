"""Ours beside what a paper prints: an item from its published numbers and from what we
found.
"""

from collections.abc import Iterable, Mapping
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
    within: Mapping | None = None,
    why: Mapping | None = None,
    labels: Mapping | None = None,
    **about: str,
) -> Item:
    """An item from what `published` has of it.

    `ours`, `low`, `high`: for each quantity an array shaped as `published.values` has
    it; or `within`: how far from ours the printed numbers may be. Neither: not at all,
    but for rounding. A quantity that can be read in two ways stands twice, as
    (quantity, reading). `why`: for each quantity, why it differs. `labels`: how the
    paper writes names of rows, columns and quantities. `about` goes to `Item`. Raises
    ValueError for a number that differs without a reason.
    """
    rows = []
    for key, values in ours.items():
        quantity, *reading = key if isinstance(key, tuple) else (key,)
        entries = published.entries(paper, item, quantity).itertuples()
        spread = (within or {}).get(key, 0.0)
        least = (low or {}).get(key, values - spread)
        most = (high or {}).get(key, values + spread)
        ranges = zip(*map(np.ravel, (values, least, most)), strict=True)
        for entry, numbers in zip(entries, ranges, strict=True):
            row = beside_printed(entry, numbers, labels or {}, "".join(reading))
            if not row.inside:
                row = replace(row, why=(why or {}).get(key, ""))
                check_reason(item, row)
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


def check_reason(item: str, row: Row) -> None:
    """Raise ValueError for a number that differs without a reason."""
    if not row.why:
        where = f"{item}, {row.row}, {row.column}, {row.quantity}"
        raise ValueError(f"{where}: {row.ours} differs from {row.printed}; say why")


def beside(
    item: str, what: str, quantity: str, ours: np.ndarray, alike: np.ndarray
) -> Item:
    """Ours beside a matrix, vector or number of the disk paper; `alike` (draws, ...):
    ours from tables that print so, of which 95 % span the range allowed.
    """
    low, high = np.quantile(alike, [0.025, 0.975], axis=0)
    return compare(
        "disk",
        item,
        what,
        {quantity: ours},
        {quantity: low},
        {quantity: high},
        why={quantity: "outside what rounding allows"},
        range_from="rounding",
        layout="matrix",
    )
