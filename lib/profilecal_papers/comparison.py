"""Ours beside what a paper prints: an item from its published numbers and from what we
found.
"""

from dataclasses import replace

import numpy as np

from profilecal_pages.items import DIGITS, Item, Row
from profilecal_papers import published


def compare(
    paper,
    item,
    what,
    ours,
    low=None,
    high=None,
    *,
    within=None,
    why=None,
    labels=None,
    **about,
) -> Item:
    """An item from what `published` has of it.

    `ours`, `low`, `high`: for each quantity an array shaped as `published.values` has
    it; or `within`: how far from ours the printed numbers may be. Neither: not at all,
    but for rounding. A quantity that can be read in two ways stands twice, as
    (quantity, reading). `why`: for each quantity, why it differs. `labels`: how the
    paper writes names of rows, columns and quantities. `about` goes to `Item`. Raises
    ValueError for a number that differs without a reason.
    """
    frame, labels, rows = published.table(paper), labels or {}, []
    for key, values in ours.items():
        quantity, *reading = key if isinstance(key, tuple) else (key,)
        entries = frame[(frame["item"] == item) & (frame["quantity"] == quantity)]
        spread = (within or {}).get(key, 0.0)
        ends = [
            (low or {}).get(key, values - spread),
            (high or {}).get(key, values + spread),
        ]
        numbers = zip(*(np.ravel(array) for array in (values, *ends)), strict=True)
        for entry, found in zip(entries.itertuples(), numbers, strict=True):
            decimals = int(entry.decimals)
            names = [
                labels.get(name, name)
                for name in (entry.row, entry.component, quantity)
            ]
            ours_low_high = [round(float(value), decimals + DIGITS) for value in found]
            row = Row(
                *names,
                entry.printed,
                decimals,
                entry.unit,
                *ours_low_high,
                reading="".join(reading),
            )
            if not row.inside:
                row = replace(row, why=(why or {}).get(key, ""))
                if not row.why:
                    raise ValueError(
                        f"{item}, {', '.join(names)}: {row.ours} differs from {row.printed}; say why"
                    )
            rows.append(row)
    return Item(paper, item, what, tuple(rows), **about)


def beside(item: str, what: str, quantity: str, ours, alike) -> Item:
    """Ours beside a matrix, vector or number of the disk paper; `alike` (draws, ...):
    ours from tables that print so, of which 95 % span the range allowed.
    """
    low, high = np.quantile(alike, [0.025, 0.975], axis=0)
    about = {
        "range_from": "rounding",
        "layout": "matrix",
        "why": {quantity: "outside what rounding allows"},
    }
    return compare(
        "disk", item, what, {quantity: ours}, {quantity: low}, {quantity: high}, **about
    )
