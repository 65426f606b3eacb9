"""Tables under titles, whatever the file is; nothing here knows what a pose is."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import islice
from pathlib import Path

import numpy as np
import pandas
from numpy import ndarray
from pandas import DataFrame

from profilecal.geometry.progress import watched
from profilecal.scan.tables import NOTHING, ScanError, Table, cell_number

MARKS = b"#% "  # before titles
BEGIN = 100_000  # characters that tell what a table is like
HEAD = 50  # lines within which numbers begin


@dataclass(frozen=True)
class Block:
    """A table in a file."""

    path: Path
    table: DataFrame  # numbers and text; the index is where a row stands in the file
    titles: list[str]  # of its columns; 1, 2, … where there are none
    above: str = ""  # the words above it
    name: str = ""  # what the file calls it
    robot: str = ""  # the maker whose program it is of
    kind: str = "pose"  # of a program; or "tool", or "uses"
    left: int = 0  # lines of a program with as many numbers that fit no pattern

    @property
    def is_bare(self) -> bool:
        """Whether its columns have no titles."""
        return self.titles == counted(len(self.titles))


File = tuple[Path, list[Block]]  # and what it holds


def numbers_of(path: Path, table: DataFrame, blank: bool = False) -> ndarray:
    """A table as numbers (rows, columns), blanks as NaN if there may be some.

    Raises ScanError.
    """
    columns = {name: cells.to_numpy() for name, cells in table.items()}
    return Table(path, columns, table.index).numbers([*table], blank)


def counted(count: int) -> list[str]:
    """Titles for columns that have none."""
    return [str(k + 1) for k in range(count)]


def dialect(text: str) -> tuple[str | None, str]:
    """What stands between columns (None: spaces), and the decimal mark."""
    rows = [line for line in text.splitlines() if re.search(r"\d", line)]
    marks = [m for m in ";\t|," if sum(m in row for row in rows) > len(rows) / 2]
    mark = marks[0] if marks else None
    if mark == "," and re.search(r"\d,\d+[ ]+[-+]?\d+,\d", text):
        mark = None
    has_commas = mark != "," and re.search(r"\d,\d", text)
    return mark, "," if has_commas else "."


def text_blocks(path: Path, content: bytes) -> Iterator[Block]:
    """The tables of delimited text: lines of as many fields that follow each other."""
    mark, decimal = dialect(content[:BEGIN].decode(errors="ignore"))
    between = mark.encode() if mark else None
    read = 0
    for line, count, place in runs_of_equal_fields(path, content, between):
        stream = BytesIO(content)
        stream.seek(place)
        rows = first_cells(islice(stream, min(count, HEAD)), between)
        first = row_where_numbers_begin(rows, decimal)
        if first is None:
            continue
        stream.seek(place)
        table = pandas.read_csv(
            stream,
            sep=mark or r"\s+",
            header=None,
            names=range(len(rows[0])),
            nrows=count - first,
            skiprows=first,
            decimal=decimal,
            na_values=[*NOTHING, "Invalid", "INVALID", ".Nan", "-"],
            skipinitialspace=True,
            index_col=False,
        )
        table.index += line + first
        above = content[max(read, place - BEGIN) : place].decode(errors="ignore")
        above += "\n".join(map(" ".join, rows[:first]))
        titles = rows[first - 1] if first else counted(len(rows[0]))
        yield Block(path, table, titles, above)
        read = place


def with_continuations(blocks: Iterable[Block]) -> Iterator[Block]:
    """Tables with titles, and what goes on below remarks and blank lines without.

    Raises ScanError for numbers between, of another number of columns.
    """
    groups, titled = [], None
    for block in blocks:
        count = len(block.titles)
        if not titled or not block.is_bare or count != len(titled[0].titles):
            groups.append([block])
            titled = titled if block.is_bare else groups[-1]
            continue
        odd = groups[-1][0]
        if odd.is_bare:
            found = f"{len(odd.titles)} fields; expected {count}, as above"
            raise ScanError(f"{odd.path} line {odd.table.index[0]}: {found}")
        titled.append(block)
    for first, *more in groups:
        tables = [block.table for block in (first, *more)]
        yield replace(first, table=pandas.concat(tables)) if more else first


def runs_of_equal_fields(
    path: Path, content: bytes, between: bytes | None
) -> Iterator[tuple[int, int, int]]:
    """The first line, the count and the place of lines with as many fields."""
    lines = watched(BytesIO(content), f"reading {path.name}", content.count(b"\n"))
    first = place = at = fields = line = 0
    began = False  # a table; what is remarked below is no title
    for line, text in enumerate(lines, 1):
        began |= fields > 0 and line - first > 1
        is_blank = not text.strip() or (began and text[:1] in MARKS[:2])
        count = 0 if is_blank else len(text.strip(MARKS).split(between))
        if count != fields:
            if fields:
                yield first, line - first, place
            first, place, fields = line, at, count
        at += len(text)
    if fields:
        yield first, line + 1 - first, place


def first_cells(lines: Iterable[bytes], between: bytes | None) -> list[list[str]]:
    """The cells of lines."""
    rows = [line.strip(MARKS).split(between) for line in lines]
    outer = " \"'\r\n"
    return [[cell.decode(errors="ignore").strip(outer) for cell in r] for r in rows]


def row_where_numbers_begin(rows: Sequence[Sequence[str]], decimal: str) -> int | None:
    """Where numbers begin: half of a row's cells are, and none stands below a word."""
    cells = DataFrame(rows)
    values = cells.map(lambda cell: cell_number(cell.replace(decimal, ".")))
    words = values.abs() == float("inf")
    filled = (cells != "").sum(axis=1)
    has_numbers = 2 * words.sum(axis=1) < filled + (filled > 3)
    is_title = (words > words.shift(-1, fill_value=True)).any(axis=1)
    data = np.flatnonzero(has_numbers & ~is_title)
    return int(data[0]) if len(data) else None
