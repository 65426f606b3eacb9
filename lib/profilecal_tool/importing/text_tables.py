"""Tables of delimited text: lines of as many fields that follow each other."""

import re
from collections.abc import Iterable, Iterator
from io import BytesIO
from itertools import groupby, islice
from pathlib import Path

import numpy as np
from pandas import DataFrame, read_csv

from profilecal.geometry.progress import watched
from profilecal.scan.tables import NOTHING, ScanError, cell_number
from profilecal_tool.importing.blocks import (
    Block,
    column_titled,
    columns_titled,
    counted,
)
from profilecal_tool.importing.makers import UNITS

MARKS = b"#% \r\n"  # around titles
BEGIN = 100_000  # characters that tell what a table is like
HEAD = 50  # lines within which numbers begin
EDGES = " \"'"  # of cells
Rows = list[list[str]]  # the cells of lines


def text_blocks(path: Path, text: str) -> Iterator[Block]:
    """The blocks of a text: runs of lines of as many fields, from where numbers begin,
    with titles of an earlier run if they have none. Raises ScanError for a lost field.
    """
    mark, has_decimal_commas = dialect(text[:BEGIN])
    if has_decimal_commas:
        for digit in "0123456789":  # 10 times faster than an expression
            text = text.replace(f",{digit}", f".{digit}")
    between = mark and mark.encode()
    content = text.encode()
    stream = BytesIO(content)
    above, end_above = [], 0  # titles above, and the end of the table that has them
    for begin, offset, rows in runs_of_lines(path, content, between):
        stream.seek(offset)
        head = cells_of(islice(stream, min(rows, HEAD)), between)
        first = row_where_numbers_begin(head)
        if first == len(head):
            continue
        count, titles = len(head[0]), titles_in(head[:first])
        if not titles and count == len(above):
            titles = above
        if titles:
            above, end_above = titles, begin + rows
        # a field is lost in these rows: they go on above them, or have one field less
        elif above and (begin == end_above or count == len(above) - 1):
            raise ScanError(
                f"{path} line {begin + 1}: {count} fields; expected {len(above)}, "
                "as above (--poses and --profiles say which files to read)"
            )
        titles = titles or counted(count)
        stream.seek(offset)
        table = table_in(stream, titles, mark, first, rows - first)
        table.index += begin + first + 1  # its lines in the file
        yield Block(path, table, columns_titled(table, titles))


def table_in(
    stream: BytesIO, titles: list[str], mark: str | None, first: int, rows: int
) -> DataFrame:
    """A table of so many rows, from the first one in a text."""
    labels = [k for k, t in enumerate(titles) if column_titled(k, t).role == "label"]
    return read_csv(
        stream,
        header=None,
        names=range(len(titles)),
        index_col=False,
        dtype=dict.fromkeys(labels, str),  # text, for 1.10 is not 1.1
        sep=mark or r"\s+",
        skipinitialspace=True,
        skiprows=first,
        nrows=rows,
        na_values=[*NOTHING, "Invalid", "INVALID", ".Nan", "-"],
    )


def dialect(text: str) -> tuple[str | None, bool]:
    """What stands between columns (None: spaces), and whether commas are decimal ones.

    >>> dialect("1,2")
    (',', False)
    >>> dialect("1;2,5")
    (';', True)
    >>> dialect("1,433;2.5;")  # with a point, they are no decimal ones
    (';', False)
    >>> dialect("1,5 2,5")  # one before a space, and one behind it
    (None, True)
    >>> dialect("x|z" + 2 * "\\n1|2")  # in most rows of numbers
    ('|', True)
    """
    rows = [line for line in text.splitlines() if re.search(r"\d", line)]
    most = len(rows) / 2
    mark = next((m for m in ";\t|," if sum(m in row for row in rows) > most), None)
    if mark == "," and re.search(r"\d,\d+[ ]+[-+]?\d+,\d", text):
        mark = None
    has_points = re.search(r"\d,\d+[;\t ]+[-+]?\d+\.\d+[;\s]", text)
    return mark, mark != "," and not has_points


def runs_of_lines(
    path: Path, content: bytes, between: bytes | None
) -> Iterator[tuple[int, int, int]]:
    """Lines of a text that have equally many fields: the first one, from 0, and where
    it begins, bytes; and how many they are. Blank lines end a run, and so do remarks
    below numbers.
    """
    at_top = True

    def count_fields(line: bytes) -> int:
        nonlocal at_top
        cells = line.strip(MARKS)
        if line[0] not in b"#%":
            at_top = at_top and not re.search(rb"\d", cells)
        elif not at_top:
            return 0
        if not cells:
            return 0
        return cells.count(between) + 1 if between else len(cells.split())

    begin = offset = 0
    lines = watched(BytesIO(content), f"reading {path.name}", content.count(b"\n"))
    for fields, run in groupby(lines, count_fields):
        sizes = [*map(len, run)]
        if fields:
            yield begin, offset, len(sizes)
        begin += len(sizes)
        offset += sum(sizes)


def cells_of(lines: Iterable[bytes], between: bytes | None) -> Rows:
    """The text of each cell of lines."""
    rows = [line.strip(MARKS).split(between) for line in lines]
    return [[c.decode().strip(EDGES) for c in row] for row in rows]


def row_where_numbers_begin(rows: Rows) -> int:
    """The first row of numbers; their end if there is none. It has two numbers, or one
    and no word; and no word of it stands above a number, if it is not below titles,
    where it is a label. Rows of nothing, blanks or NaN, just above belong to it.

    >>> row_where_numbers_begin([["n", "x", "z"], ["p1", "1", "2"], ["p2", "1", "3"]])
    1
    >>> row_where_numbers_begin([["x", "z"], ["", ""], ["nan", "nan"], ["1", "2"]])
    1
    >>> row_where_numbers_begin([["FOV", "9", "9"], ["7", "8", "9"]])  # a head
    1
    >>> row_where_numbers_begin([["pitch", "2"], ["x", "z"], ["1", "2"]])
    2
    >>> rows = [["n", "x", "z"], ["", "mm", "mm"], ["home", "5", "6"], ["1", "7", "8"]]
    >>> row_where_numbers_begin(rows)
    2
    >>> row_where_numbers_begin([["x", "z"], ["mm", "mm"]])
    2
    """
    # NaN for nothing, infinity for a word
    values = [[*map(cell_number, row)] for row in rows]
    first = 0  # behind the last row that is none of numbers
    for k, row in enumerate(values):
        words, numbers = np.isinf(row), np.isfinite(row)
        is_title = k + 1 < len(values) and (words & np.isfinite(values[k + 1])).any()
        above = values[max(k - 1, 0)]
        is_below_titles = np.isinf(above).any() and not np.isfinite(above).any()
        least = 2 if words.any() else 1
        if (is_below_titles or not is_title) and numbers.sum() >= least:
            return first
        if words.any():
            first = k + 1
    return first


def titles_in(rows: Rows) -> list[str]:
    """The last row of words, or the one above it with the units that it says."""
    if not rows:
        return []
    units = [cell.strip("[]()").lower() for cell in rows[-1]]
    if len(rows) < 2 or sum(unit in UNITS for unit in units) < 2:
        return rows[-1]
    cells = zip(rows[-2], units, strict=True)
    return [f"{title} [{unit}]" if unit in UNITS else title for title, unit in cells]
