"""Text: its lines, tables in it with whatever parts their columns, titles and units."""

import re
from collections.abc import Collection
from pathlib import Path
from statistics import mode

import numpy as np

from profilecal.scan.folder import SCALE
from profilecal.scan.tables import (
    Rows,
    ScanError,
    Table,
    in_columns,
    listed,
    number,
    text_of,
)
from profilecal_tool.importing.makers import ALIASES

# or what FANUC prints for a position that was not taught
NUMBER = r"(?:[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|\*+)"
REMARK = re.compile(r"\s*(?:#|%|//|!)[\s#%/]*")
# what is behind the name in a title: a unit in brackets and what follows it, or one
# behind a space, "_" or "/"
UNIT = re.compile(r"[\s_]*(?:[\[(]\s*([^\])]*?)\s*[\])].*|[\s_/]\s*(mm|m|deg|rad))?\Z")


def closed_text(path: Path) -> str:
    """A file's text. Raises ScanError where brackets are not closed."""
    text = text_of(path)
    for opening, closing in ("{}", "[]"):
        if text.count(opening) != text.count(closing):
            raise ScanError(
                f"{path}: not as many {closing} as {opening}; is the file cut short?"
            )
    return text


def line_of(text: str, place: int) -> int:
    """The number of the line at a place in a text."""
    return text.count("\n", 0, place) + 1


def lines_of(text: str) -> Rows:
    """The lines that are not blank, in fields.

    Remarks are left out, but for those that name x and z: titles.
    """
    rows = []
    for line_number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        remark = REMARK.match(line)
        fields = fields_of(line[remark.end() :] if remark else line)
        if not remark or {"x", "z"} <= names_and_units(fields).keys():
            rows.append((line_number, fields))
    return rows


def fields_of(line: str) -> list[str]:
    """A line's fields; decimal commas where something else parts them."""
    # a unit in brackets belongs to its title
    spaces = r"\s+(?![\[(])"
    separator = next((mark for mark in ";\t," if mark in line), spaces)
    if separator in ";\t":
        line = line.replace(",", ".")
    return [field.strip(" \r\"'") for field in re.split(separator, line.strip(" \r"))]


def from_rows(path: Path, rows: Rows) -> Table:
    """The table in rows, from the first that holds numbers, not words, and is as long
    as most of these.

    Its titles are the row of that length above. Raises ScanError.
    """
    widths = [len(fields) for _, fields in rows]
    numeric = [at for at, (_, fields) in enumerate(rows) if holds_numbers(fields)]
    if not numeric:
        raise ScanError(f"{path}: no numbers in columns")
    width = mode(widths[at] for at in numeric)
    first = next(at for at in numeric if widths[at] == width)
    titles = width * ["1"]  # what is there twice gets numbers for names
    for _, fields in rows[:first]:
        if len(fields) == width:
            titles = fields
    return in_columns(path, names_and_units(titles), rows[first:])


def holds_numbers(fields: list[str]) -> bool:
    """Whether fewer than half of a row's fields are words."""
    words = np.isinf([*map(number, fields)])
    return words.sum() < len(fields) / 2


def names_and_units(titles: Collection[str]) -> dict[str, str]:
    """What titles say: "X [mm]" is x, in mm.

    Where a name is there twice, columns' numbers take its place.
    """
    parts = [UNIT.split(title.strip().lower(), maxsplit=1) for title in titles]
    names = [ALIASES.get(name, name) for name, *_ in parts]
    units = [in_brackets or behind or "" for _, in_brackets, behind, _ in parts]
    return {
        name if names.count(name) == 1 else str(k): unit.replace("°", "deg")
        for k, (name, unit) in enumerate(zip(names, units, strict=True), 1)
    }


def unit_of(path: Path, units: dict[str, str], known: Collection) -> str:
    """The one unit that the titles of some columns say, "" if they say none.

    Raises ScanError for several, or one that is not known.
    """
    said = {*units.values()}
    if len(said) > 1 or not said <= {"", *known}:
        columns = listed(f"{name} [{unit}]" for name, unit in units.items())
        raise ScanError(
            f"{path}: the columns are {columns}; "
            f"expected one unit for all of them, {' or '.join(known)}"
        )
    return said.pop()


def to_mm(
    path: Path, units: dict[str, str], lengths: np.ndarray, below: float
) -> tuple[float, str]:
    """From a file's units to mm, and in words.

    Where no title says a unit, lengths that are all less than `below` are metres.
    """
    largest = np.nanmax(np.abs(lengths), initial=0)
    said = unit_of(path, units, SCALE)
    unit = said or ("m" if largest < below else "mm")
    as_said = "as said, " if said else ""
    return SCALE[unit], f"in {unit} ({as_said}the largest is {largest:.10g})"


def check_alike(tables: list[Table]) -> None:
    """Raise ScanError where tables do not have the same columns."""
    first = tables[0]
    for table in tables:
        if table.units != first.units:
            raise ScanError(
                f"{table.path}: columns {listed(table.units)}, "
                f"where {first.path.name} has {listed(first.units)}; "
                "say which files belong together: --poses, --profiles"
            )


def names_of(paths: list[Path]) -> str:
    """Files in a few words."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} … {paths[-1].name}"
