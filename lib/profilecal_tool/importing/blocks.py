"""Tables under titles, whatever the file is; nothing here knows what a pose is."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas
from pandas import DataFrame

from profilecal.geometry.progress import watched
from profilecal.scan.tables import NOTHING, ScanError, number

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
    """The tables of delimited text: lines of as many fields that follow each other. A
    table with titles goes on below remarks and blank lines.

    Raises ScanError for a line of numbers within it that has other fields.
    """
    mark, decimal = dialect(content[:BEGIN].decode(errors="ignore"))
    between = mark.encode() if mark else None
    found, titled, odd = [], None, None
    read = 0
    for line, count, place in runs(path, content, between):
        rows = rows_of(content[place : place + BEGIN], between)[:count]
        first = first_row(rows, decimal)
        if first is None:
            continue
        stream = BytesIO(content)
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
        is_remark = content[place : place + 1] in (b"#", b"%")
        without = not first or (is_remark and titled and titles != titled[0])
        if titled and without and len(titles) == len(titled[0]):
            if odd:
                sentence = f"{odd[1]} fields; expected {len(titles)}, as above"
                raise ScanError(f"{path} line {odd[0]}: {sentence}")
            titled[2].append(table)
            continue
        found.append((titles, above, [table]))
        if first:
            titled, odd = found[-1], None
        else:
            odd = odd or (line, len(titles))
        read = place
    for titles, above, parts in found:
        table = pandas.concat(parts) if len(parts) > 1 else parts[0]
        yield Block(path, table, titles, above)


def runs(
    path: Path, content: bytes, between: bytes | None
) -> Iterator[tuple[int, int, int]]:
    """The first line, the count and the place of lines with as many fields."""
    lines = watched(BytesIO(content), f"reading {path.name}", content.count(b"\n"))
    first = place = at = fields = line = 0
    was_remark = False
    for line, text in enumerate(lines, 1):
        count = len(text.strip(MARKS).split(between)) if text.strip() else 0
        is_remark = text[:1] in (b"#", b"%")
        if count != fields or (is_remark and not was_remark):
            if fields:
                yield first, line - first, place
            first, place, fields = line, at, count
        was_remark = is_remark
        at += len(text)
    if fields:
        yield first, line + 1 - first, place


def rows_of(content: bytes, between: bytes | None) -> list[list[str]]:
    """The cells of the first lines."""
    lines = content.split(b"\n", HEAD)[:HEAD]
    rows = [line.strip(MARKS).split(between) for line in lines]
    return [[cell.decode(errors="ignore").strip(" \"'\r") for cell in r] for r in rows]


def first_row(rows: Sequence[Sequence[str]], decimal: str) -> int | None:
    """Where numbers begin: most of a row's cells are, and none stands below a word."""
    cells = DataFrame(rows)
    values = cells.map(lambda cell: number(cell.replace(decimal, ".")))
    words = values.abs() == float("inf")
    has_numbers = 2 * words.sum(axis=1) < (cells != "").sum(axis=1)
    is_title = (words > words.shift(-1, fill_value=True)).any(axis=1)
    data = np.flatnonzero(has_numbers & ~is_title)
    return int(data[0]) if len(data) else None
