"""Tables under titles, whatever the file is; nothing here knows what a pose is."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import pandas
from pandas import DataFrame

from profilecal.geometry.progress import watched
from profilecal.scan.tables import NOTHING, number
from profilecal_tool.importing.makers import UNITS, WORDS

MARKS = b"#% "  # before titles


@dataclass(frozen=True)
class Block:
    """A table in a file."""

    path: Path
    table: DataFrame  # numbers and text; the index is where a row stands in the file
    titles: list[str]  # of its columns; 1, 2, … where there are none
    above: str = ""  # the words above it
    robot: str = ""  # whose program it is of
    name: str = ""  # what the file calls it

    @property
    def is_bare(self) -> bool:
        """Whether its columns have no titles."""
        return self.titles == [*map(str, range(1, len(self.titles) + 1))]


def encodings_of(contents: list[bytes]) -> list[str]:
    """The encodings in which most known words stand in some files' text."""
    found = {}
    for encoding in ("cp1252", "gb18030", "shift_jis", "big5", "cp949", "cp1251"):
        try:
            texts = {content.decode(encoding) for content in contents}
        except UnicodeDecodeError:
            continue
        words = re.findall(r"[^\W\d]+|°", " ".join(texts).lower())
        found[encoding] = sum(word in WORDS for word in words)
    most = max(found.values(), default=0)
    return [encoding for encoding, count in found.items() if count == most]


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
    mark, decimal = dialect(content[:50_000].decode(errors="ignore"))
    between = mark.encode() if mark else None
    read = 0
    for first, count, place in runs(path, content, between):
        head = rows_of(content[place : place + 100_000], between, min(count, 50))
        data = [k for k, row in enumerate(head) if is_data(row, decimal)]
        if not data:
            continue
        begin = data[0]
        titles = [*map(str, range(1, len(head[0]) + 1))]
        if is_title(head[begin : begin + 2], decimal):
            begin += 1
        if begin:
            over = [[c.strip(" \"'\r\n") for c in row] for row in head[:begin]]
            titles = over[-1]
            if begin > 1 and {*titles} <= UNITS.keys():
                pairs = zip(over[-2], titles, strict=True)
                titles = [f"{title} [{unit}]" for title, unit in pairs]
        stream = BytesIO(content)
        stream.seek(place)
        table = pandas.read_csv(
            stream,
            sep=mark or r"\s+",
            header=None,
            names=range(len(titles)),
            nrows=count - begin,
            skiprows=begin,
            decimal=decimal,
            na_values=[*NOTHING, "Invalid", "INVALID", ".Nan", "-"],
            skipinitialspace=True,
            index_col=False,
        )
        table.index = range(first + begin, first + begin + len(table))
        above = content[max(read, place - 5000) : place].decode(errors="ignore")
        above += "\n".join(map(" ".join, head[: max(begin - 1, 0)]))
        yield Block(path, table, titles, above)
        read = place


def runs(
    path: Path, content: bytes, between: bytes | None
) -> Iterator[tuple[int, int, int]]:
    """The first line, the count and the place of lines with as many fields."""
    lines = watched(BytesIO(content), f"reading {path.name}", content.count(b"\n"))
    first = place = at = fields = 0
    number = 0
    for number, line in enumerate(lines, 1):
        found = len(line.strip(MARKS).split(between)) if line.strip() else 0
        if found != fields:
            if fields:
                yield first, number - first, place
            first, place, fields = number, at, found
        at += len(line)
    if fields:
        yield first, number + 1 - first, place


def rows_of(content: bytes, between: bytes | None, count: int) -> list[list[str]]:
    """The cells of the first lines."""
    lines = content.split(b"\n", count)[:count]
    rows = [line.strip(MARKS).split(between) for line in lines]
    return [[cell.decode(errors="ignore").strip() for cell in row] for row in rows]


def value(cell: str, decimal: str) -> float:
    """A cell's number; infinity for a word."""
    return number(cell.replace(decimal, "."))


def is_word(cell: str, decimal: str) -> bool:
    """Whether a cell is no number, and not blank."""
    return abs(value(cell, decimal)) == float("inf")


def is_data(row: list[str], decimal: str) -> bool:
    """Whether most cells of a row are numbers."""
    filled = [is_word(cell, decimal) for cell in row if cell.strip()]
    return 2 * sum(filled) < len(filled)


def is_title(rows: list[list[str]], decimal: str) -> bool:
    """Whether words of the first of two rows stand above numbers."""
    if len(rows) < 2:
        return False
    over = zip(*rows, strict=True)
    return any(
        is_word(cell, decimal) and not is_word(below, decimal) for cell, below in over
    )
