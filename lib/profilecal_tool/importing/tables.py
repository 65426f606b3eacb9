"""Text: its lines, tables in it with whatever parts their columns, titles and units."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

import numpy as np
from charset_normalizer import from_bytes
from numpy import ndarray

from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.tables import (
    Row,
    ScanError,
    Table,
    in_columns,
    listed,
    naming,
    number,
    shown,
    text_of,
)
from profilecal_tool.importing.makers import (
    ALIASES,
    AXIS,
    ENCODINGS,
    FOREIGN,
    HEADING,
    LENGTHS,
    POSE_FILES,
    TIMES,
    UNITS,
)

# or what FANUC prints for a position that was not taught
NUMBER = r"(?:[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|\*+)"
# before decimal commas, or as no separator of fields
THOUSANDS = re.compile(r"(?<=\d)(?:\.(?=\d{3}(?:\.\d{3})*,\d)|[\xa0\u202f’'](?=\d{3}))")
SPACES = re.compile(r"\s+(?![\[(])")  # a unit in brackets belongs to its title
RULE = re.compile(r"[\s|+:-]*[|+][\s|+:-]*")  # below titles
COMMAS = re.compile(r"\d,\d+\s+-?\d+,\d")  # decimal, between numbers
WORKBOOK = ".xlsx"
ROW = "row of the file"  # a column that tells profiles apart, one a row
REMARK = re.compile(r"\s*(?:#|%|//|!)[\s#%/]*")
# what is behind the name in a title: a unit in brackets and what follows it, or one
# behind a space, "_" or "/"
UNIT = re.compile(
    r"[\s_]*(?:[\[(]\s*([^\])]*?)\s*[\])].*|(?:[\s_/]|[.,]\s)\s*(mm|m|[uµ]m|inch|deg|rad|мм|град))?\Z"
)


def closed_text(path: Path, encoding: str, entry: str, of_poses: bool = False) -> str:
    """A file's text, in an encoding where it is not UTF-8; of a workbook, that of the
    sheet `entry`, or of the one that is named like poses, or is not.

    Raises ScanError where brackets are not closed.
    """
    if sheets := sheets_of(path):
        own = [name for name in sheets if bool(POSE_FILES.search(name)) == of_poses]
        return sheets[chosen(path, own if len(own) == 1 else sheets, entry)]
    text = text_of(path, encoding=encoding)
    for opening, closing in ("{}", "[]"):
        if text.count(opening) != text.count(closing):
            raise ScanError(
                f"{path}: not as many {closing} as {opening}; is the file cut short?"
            )
    return text


def chosen(path: Path, lists: Collection[str], entry: str) -> str:
    """The name of one of several lists. Raises ScanError where that is not clear."""
    name = entry or (next(iter(lists)) if len(lists) == 1 else "profile")
    if name not in lists:
        raise ScanError(
            f"{path}: no list {shown(name)}; "
            f"there are {listed(lists) or 'none'} (--entry)"
        )
    return name


def sheets_of(path: Path) -> dict[str, str]:
    """The sheets of a workbook, a row a line, by name; of other files none.

    Raises ScanError.
    """
    if path.suffix.lower() != WORKBOOK:
        return {}
    from openpyxl import load_workbook

    with naming(path), path.open("rb") as file:
        try:
            return {
                sheet.title: f"# {sheet.title}\n"
                + "\n".join(
                    "\t".join("" if cell is None else str(cell) for cell in row)
                    for row in sheet.values
                )
                for sheet in load_workbook(file, read_only=True, data_only=True)
            }
        # zip, zlib, XML and openpyxl have errors of their own
        except Exception as error:
            raise ScanError(f"{path}: not a workbook ({error})") from error


def encoding_of(paths: list[Path]) -> str:
    """The encoding of those files that are not UTF-8, "" if there are none.

    Titles are too short to tell languages apart by their letters. Of the encodings
    that are possible it is the one in which they say most of the words that we know;
    where they say none, cp1252 if most letters beyond ASCII stand alone, as accents do.
    """
    titles = {}
    for path in paths:
        with naming(path):
            content = path.read_bytes()
        if b"\0" not in content and not content.isascii():
            lines = re.findall(rb"(?m)^.*[\x80-\xff].*", content)
            titles |= dict.fromkeys(
                line for line in lines if line.decode(errors="ignore").encode() != line
            )
    sample = b"\n".join(titles)[:10_000]
    if not sample:
        return ""
    runs = re.findall(rb"[\x80-\xff]+", sample)
    are_accents = 2 * sum(len(run) == 1 for run in runs) > len(runs)
    matches = [] if are_accents else from_bytes(sample, cp_isolation=ENCODINGS)
    known = {}
    for encoding in (*(match.encoding for match in matches), *ENCODINGS):
        with suppress(UnicodeDecodeError):
            text = sample.decode(encoding).lower()
            known[encoding] = sum(map(text.count, FOREIGN))
    return max(known, key=known.__getitem__, default="")


def lines_of(text: str) -> Iterator[Row]:
    """The lines that are not blank, in fields.

    Remarks are left out, but for those that name x and z: titles.
    """
    for line_number, match in enumerate(re.finditer(r"(.*)\n?", text), 1):
        line = match[1]
        if not line.strip() or RULE.fullmatch(line):
            continue
        remark = REMARK.match(line)
        fields = fields_of(line[remark.end() :] if remark else line)
        if not remark or {"x", "z"} <= set().union(*map(words_in, fields)):
            yield line_number, fields


def fields_of(line: str) -> list[str]:
    """A line's fields; decimal commas where something else parts them."""
    mark = next((mark for mark in ";\t|," if mark in line), "")
    if mark == "," and COMMAS.search(line):
        mark = ""
    if mark != ",":
        line = THOUSANDS.sub("", line).replace(",", ".")
    line = line.strip(" \r|")
    fields = line.split(mark) if mark else SPACES.split(line)
    return [field.strip(" \r\"'") for field in fields]


def from_rows(path: Path, rows: Iterable[Row], among_words: bool = False) -> Table:
    """The table in rows that has most cells, from the first row of it that holds
    numbers, not words.

    Its titles are the row of that length above, or this row if it has x behind words.
    Lines of other words among its rows, or of any (`among_words`), and what other
    tables have below their titles, are left out. Text of many rows becomes numbers a
    thousand rows at a time, so that it never fills the memory. Raises ScanError.
    """
    most = 1000
    rows = iter(rows)
    head = [*islice(rows, most)]
    widths = Counter(len(fields) for _, fields in head if holds_numbers(fields))
    if not widths:
        raise ScanError(f"{path}: no numbers in columns")
    width = max(widths, key=lambda width: (widths[width] > 1, width * widths[width]))
    alike = [row for row in head if len(row[1]) == width and any(row[1])]
    first = next(k for k, (_, fields) in enumerate(alike) if holds_numbers(fields))
    titles = alike[first - 1][1] if first else width * ["1"]  # twice: a number
    x = [*map(number, alike[first][1])]
    if x[0] == np.inf and is_rising(np.array(x[x.count(np.inf) :])):
        titles = alike[first][1]
    body = body_of(chain(head[head.index(alike[first]) :], rows), titles)
    if among_words:
        body = (row for row in body if holds_numbers(row[1]))
    units = names_and_units(titles)
    batches = iter(lambda: [*islice(body, most)], [])
    parts = (in_columns(path, units, part) for part in batches)
    first_part = next(parts, None)
    if first_part is None:
        raise ScanError(f"{path}: no rows below the titles")
    numbers = [*map(in_numbers, parts)]
    return joined([in_numbers(first_part), *numbers]) if numbers else first_part


def body_of(rows: Iterable[Row], titles: list[str]) -> Iterator[Row]:
    """The rows of a table with titles, among others."""
    heading = 0  # the length of the titles of another one
    for line, fields in rows:
        if len(fields) < 3 and HEADING.fullmatch(" ".join(fields)):
            continue
        if len(fields) != len(titles) and np.isinf([*map(number, fields)]).all():
            heading = len(fields)
        elif fields != titles and len(fields) != heading:
            yield line, fields


def floats(cells: Sequence) -> ndarray:
    """Cells as numbers (n,): NaN for nothing, infinity for a word."""
    with suppress(ValueError):
        return np.asarray(cells, float)
    return np.array([*map(number, map(str, cells))])


def in_numbers(table: Table) -> Table:
    """The table with arrays for columns, of numbers where none is a word."""
    columns = {}
    for name, cells in table.columns.items():
        numbers = floats(cells)
        columns[name] = np.array(cells) if np.isinf(numbers).any() else numbers
    return replace(table, columns=columns, lines=np.array(table.lines))


def joined(parts: list[Table]) -> Table:
    """The parts of a table, with arrays for columns, as one."""
    columns = {
        name: np.concatenate([part.columns.pop(name) for part in parts])
        for name in [*parts[0].columns]
    }
    lines = np.concatenate([part.lines for part in parts])
    return replace(parts[0], columns=columns, lines=lines)


def is_rising(x: ndarray) -> bool:
    """Whether more than three numbers rise, or fall, all along."""
    rises, falls = x[1:] > x[:-1], x[1:] < x[:-1]
    return len(x) > 3 and bool(rises.all() or falls.all())


def holds_numbers(fields: list[str]) -> bool:
    """Whether a row has numbers, and fewer words."""
    values = np.array([*map(number, fields)])
    return bool(np.isfinite(values).sum() > np.isinf(values).sum())


def names_and_units(titles: Collection[str]) -> dict[str, str]:
    """What titles say: "X [mm]" is x, in mm.

    Where a name is there twice, columns' numbers take its place; but a title that says
    it goes before another that means it.
    """
    parts = [UNIT.split(title.strip().lower(), maxsplit=1) for title in titles]
    written = [name for name, *_ in parts]
    names = [
        name if ALIASES.get(name) in written else ALIASES.get(name, name)
        for name in written
    ]
    units = [in_brackets or behind or "" for _, in_brackets, behind, _ in parts]
    count = Counter(names)
    return {
        name if count[name] == 1 else str(k): UNITS.get(unit, unit)
        for k, (name, unit) in enumerate(zip(names, units, strict=True), 1)
    }


def words_in(name: str) -> set[str]:
    """The words of a name as we call them: "tcp_x" and "x坐标" say x."""
    parts = re.split(
        r"[\W_]+|(?<=[a-z])(?=[⺀-鿿])|(?<=[⺀-鿿])(?=[a-z])", name.lower()
    )
    parts = [AXIS.sub(r"\1", part) for part in parts]
    return {ALIASES.get(part, part) for part in parts}


def unit_of(path: Path, units: dict[str, str], known: Collection) -> str:
    """The one unit that the titles of some columns say, "" if they say none.

    Raises ScanError for several, or one that is not known.
    """
    said = {*units.values()}
    if len(said) > 1 or not said <= {"", *known}:
        columns = listed(f"{name} [{unit}]" for name, unit in units.items())
        raise ScanError(
            f"{path}: the columns are {columns}; "
            f"expected one unit for all of them, {' or '.join(sorted({*known} - {''}))}"
        )
    return said.pop()


def to_mm(
    path: Path, units: dict[str, str], lengths: np.ndarray, below: float
) -> tuple[float, str]:
    """From a file's units to mm, and in words.

    Where no title says a unit, lengths that are all less than `below` are metres.
    """
    largest = np.nanmax(np.abs(lengths), initial=0)
    said = unit_of(path, units, {*LENGTHS, *filter(mm_of, units.values())})
    unit = said or ("m" if largest < below else "mm")
    as_said = "as said, " if said else ""
    return mm_of(unit), f"in {unit} ({as_said}the largest is {largest:.10g})"


def mm_of(unit: str) -> float:
    """A unit in mm, also one such as 0.01 um; 0 if we do not know it."""
    match = re.fullmatch(r"(\d*\.?\d+(?:e[+-]?\d+)?)?\W*(.*)", unit.strip().lower())
    return float(match[1] or 1) * LENGTHS.get(match[2], 0.0)


def rows_of(table: Table, rows: ndarray) -> Table:
    """The table of some of its rows."""

    def some(cells: Sequence) -> Sequence:
        is_array = isinstance(cells, ndarray)
        return cells[rows] if is_array else [cells[row] for row in rows]

    columns = {name: some(cells) for name, cells in table.columns.items()}
    return replace(table, columns=columns, lines=some(table.lines))


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


def labels_of_files(paths: list[Path]) -> list[str]:
    """What files are called; where they are called alike, what their folders are."""
    stems = [path.stem for path in paths]
    return (
        stems if len({*stems}) == len(paths) else [path.parent.name for path in paths]
    )


def names_of(paths: list[Path]) -> str:
    """Files in a few words."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} … {paths[-1].name}"


def changed(cells: Sequence) -> ndarray:
    """Whether each cell (n,) differs from the one before; the first does."""
    values = np.asarray(cells)
    return np.append(True, values[1:] != values[:-1])


def blocks(cells: Sequence) -> int:
    """How many values follow each other in cells (n,), 0 if one of them comes again."""
    count = changed(cells).sum()
    return count if count == len({*cells}) else 0


def stem(name: str) -> str:
    """A name without its numbers."""
    return re.sub(r"\d+", "", name)


def apart(table: Table) -> tuple[Table, Table]:
    """Poses, one a row, and the points measured there, of a table that has both.

    Points have columns of numbered names, many of each; or those that change in most
    rows, while a pose's change together. Where these do too, each row has a pose and a
    point.

    Raises ScanError where it has no poses.
    """
    names, begins = [*table.columns], np.full(len(table.lines), True)
    points = numbered(names, "xz")
    if not points:
        changes = {name: changed(cells) for name, cells in table.columns.items()}
        points = [name for name in names if changes[name].mean() > 0.25]
        seldom = [changes[name] for name in names if name not in points]
        begins = np.sum([*seldom, 0 * begins], axis=0) > 1
    pose = [name for name in names if name not in points]
    of_pose = pose_columns(names)
    if {*of_pose} & {*points}:
        begins[:] = True
        points = [name for name in names if name not in of_pose]
        pose = [name for name in names if name in of_pose or TIMES.search(name)]
    if not pose:
        raise ScanError(
            f"{table.path}: columns {listed(names)}, and no poses; say what holds "
            "the robot's poses: --poses FILE"
        )
    of_points = with_columns(table, points)
    of_points.columns[ROW] = np.cumsum(begins)
    return rows_of(with_columns(table, pose), np.flatnonzero(begins)), of_points


def pose_columns(names: Sequence[str]) -> list[str]:
    """The columns of a position, x, y, z or tcp_x, tcp_y, tcp_z, and of an orientation
    among some; none where one of both is missing. Of two positions, the longer names.
    """
    words = {name: words_in(name) for name in names}
    positions = [
        [name.replace("x", axis) for axis in "xyz"]
        for name in names
        if "x" in words[name]
    ]
    positions = [three for three in positions if {*three} <= {*names}]
    for convention in CONVENTIONS:
        turn = [name for name in names if words[name] & {*convention.columns}]
        if positions and len(turn) == len(convention.columns):
            return max(positions, key=lambda three: len(three[0])) + turn
    return []


def numbered(names: Sequence[str], axes: str) -> list[str]:
    """The names that are one of many but for their numbers, and mean one of `axes`."""
    many = Counter(map(stem, names))
    stems = [one for one in many if many[one] > 4 and words_in(one) & {*axes}]
    return [name for name in names if stem(name) in stems]


def with_columns(table: Table, names: list[str]) -> Table:
    """The table of some of its columns."""
    columns = {name: table.columns[name] for name in names}
    units = {name: table.units.get(name, "") for name in names}
    return replace(table, columns=columns, units=units)
