"""Ours beside what a paper prints: an item from its published numbers and from what we
found.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from profilecal_pages.items import DIGITS, Item, Row
from profilecal_papers import published


def compare(
    paper: str,
    item: str,
    what: str,
    found: Mapping,
    *,
    why: str = "",
    labels: Mapping | None = None,
    otherwise: Mapping[str, Mapping] | None = None,
    **about: Any,
) -> Item:
    """An item from what `published` has of it and what we found.

    `found`: of each quantity ours, low and high, shaped as `published.values` has it. A
    quantity that can be read in several ways stands once for each, as (quantity,
    reading).

    `otherwise`: by name, what we would have found had the paper been otherwise: with a
    wrong sign, another formula, another set-up; of some of the quantities. A row counts
    only if one of them puts the printed number outside. `why`: a number differs.
    `labels`: how the paper writes names of rows, columns and quantities. `about` goes
    to `Item`.
    """
    rows = []
    for key, three in found.items():
        quantity, reading = key if isinstance(key, tuple) else (key, "")
        of_paper = published.entries(paper, item, quantity)
        decimals = int(of_paper["decimals"].iloc[0])
        numbers = in_rows(three, decimals)
        others = {
            name: in_rows(part[key], decimals)
            for name, part in (otherwise or {}).items()
            if key in part
        }
        for k, entry in enumerate(of_paper.itertuples()):
            names = entry.row, entry.component, entry.quantity
            row = Row(
                *((labels or {}).get(name, name) for name in names),
                entry.printed,
                decimals,
                entry.unit,
                *numbers[k],
                reading=reading,
                otherwise={name: of[k] for name, of in others.items()},
            )
            rows.append(row if row.inside else replace(row, why=why))
    return Item(paper, item, what, tuple(rows), **about)


def in_rows(three: Sequence, decimals: int) -> list[list[float]]:
    """Ours, low and high of each number, rounded to what the data hold."""
    columns = np.broadcast_arrays(*map(np.ravel, three))
    return np.round(np.column_stack(columns), decimals + DIGITS).tolist()


def beside(
    item: str,
    what: str,
    quantity: str,
    pick: Callable,
    solved: Sequence,
    wrongly: Mapping[str, Sequence],
    **about: Any,
) -> Item:
    """Ours beside a matrix, vector or number of the disk paper: what `pick` takes of
    `solved`, the solutions of the table as printed and (draws, ...) of tables that
    print so. Of the latter 95 % span the range allowed. `wrongly`: by name the same
    two, had the paper computed otherwise.
    """

    def spanned(two: Sequence) -> dict:
        ours, alike = map(pick, two)
        return {quantity: [ours, *np.quantile(alike, [0.025, 0.975], axis=0)]}

    return compare(
        "disk",
        item,
        what,
        spanned(solved),
        why="outside what rounding allows",
        otherwise={name: spanned(two) for name, two in wrongly.items()},
        range_from="rounding",
        **about,
    )
