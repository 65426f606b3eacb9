"""Files and the tables in them, with every mistake named. What is written is whole, or
leaves nothing.
"""

import csv
import shutil
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

import numpy as np

from profilecal.scan.scan import ScanError


@contextmanager
def naming(path: Path):
    """What goes wrong with a file becomes a ScanError that names it."""
    try:
        yield
    except ScanError:
        raise
    except UnicodeDecodeError as error:
        if b"\0" in error.object:
            raise ScanError(f"{path}: binary data; save it as text") from error
        line, byte = (
            error.object.count(b"\n", 0, error.start) + 1,
            error.object[error.start : error.start + 1],
        )
        raise ScanError(
            f"{path}: not UTF-8 text, {byte!r} in line {line}; save it as UTF-8"
        ) from error
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror or error}") from error
    except RecursionError as error:
        raise ScanError(f"{path}: nested too deeply") from error
    except ValueError as error:
        raise ScanError(f"{path}: {error}") from error


def text_of(path: Path, megabytes: int = 400) -> str:
    """A file's text, of at most so many megabytes: more than 400 a usual computer does
    not hold. Raises ScanError.
    """
    if not is_file(path):
        raise ScanError(f"{path}: no such file")
    with naming(path):
        if (size := path.stat().st_size / 1e6) > megabytes:
            raise ScanError(
                f"{path}: {size:.7g} MB; expected at most {megabytes} MB; thin profiles out"
            )
        return path.read_bytes().decode("utf-8-sig")


def is_file(path: Path) -> bool:
    """Whether there is a file. Raises ScanError for what is no file, or cannot be told
    (a loop of links, no right).
    """
    with naming(path):
        try:
            path.stat()
        except FileNotFoundError:
            return False
    if not path.is_file():
        raise ScanError(f"{path}: not a file")
    return True


@contextmanager
def whole(path: Path):
    """A place beside `path` for a file or a folder that then appears at `path` whole,
    or after an error not at all.
    """
    partial = partial_of(path)
    remove(partial)
    try:
        yield partial
        partial.replace(path)
    finally:
        remove(partial)


@contextmanager
def new_folder(path: Path):
    """A folder to fill that then appears at `path` whole. Raises ScanError where
    something is there, or cannot be.
    """
    if path.exists() and (any(path.iterdir()) or path.samefile(".")):
        raise ScanError(f"{path}: already in use; name a new folder")
    with whole(path) as partial:
        with naming(path):
            partial.mkdir(parents=True)
        yield partial


def partial_of(path: Path) -> Path:
    """Where `whole` has a file while it is being written."""
    return path.parent / f".{path.name}.partial"


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


Rows = list[tuple[int, list[str]]]  # lines' numbers and fields
# cells of points that were not seen
NOTHING = (
    "",
    "nan",
    "-nan",
    ".nan",
    "-nan(ind)",
    "1.#qnan",
    "na",
    "n/a",
    "#n/a",
    "null",
    "none",
    "-",
    "--",
    ".",
)


def shown(value) -> str:
    """A value, for a sentence: short and on one line."""
    text = (
        "a huge number"
        if isinstance(value, int) and value.bit_length() > 200
        else repr(value)
    )
    return text if len(text) <= 60 else f"{text[:60]}…"


def listed(names) -> str:
    """Names of columns, for a sentence."""
    text = ", ".join(str(name) for name in names)
    return shown(text) if len(text) > 200 or not text.isprintable() else text


def number(cell) -> float:
    """What a cell says: NaN for nothing, infinity for a word."""
    try:
        return float(cell)
    except ValueError:
        return np.nan if cell.strip().lower() in NOTHING else np.inf


@dataclass(frozen=True)
class Table:
    """The columns of a file by their names, and where each row stands in it."""

    path: Path
    columns: dict[str, Sequence]  # text, or numbers
    lines: Sequence[int]
    counted: str = "line"  # what `lines` counts; "row" where a file has no lines
    # that titles say, "" where they say none
    units: dict[str, str] = field(default_factory=dict)

    def refuse(self, bad, sentence: str, *values) -> None:
        """Raise ScanError for the first row that is bad (rows,): where it is, and
        `sentence` filled in with `values` (rows,) of that row.
        """
        if np.any(bad):
            row = int(np.argmax(bad))
            there = [
                shown(some[row]) if isinstance(some[row], str) else some[row]
                for some in values
            ]
            raise ScanError(
                f"{self.path} {self.counted} {self.lines[row]}: {sentence.format(*there)}"
            )

    def labels(self) -> np.ndarray:
        """The poses' labels (rows,)."""
        labels = np.array(
            [str(cell).strip() for cell in self.columns["pose"]], dtype=object
        )
        self.refuse(labels == "", "no pose label")
        return labels

    def numbers(
        self, names, blank: bool = False, largest: float = np.inf
    ) -> np.ndarray:
        """Columns as numbers (rows, columns), at most `largest`; cells may be blank or
        NaN only where `blank`.
        """
        columns, hint = (
            [],
            "are the units in scan.toml right? Missing points are left out or blank",
        )
        for name in names:
            cells, called = (
                self.columns[name],
                f"column {name}" if name.isdigit() else name,
            )
            try:
                found = np.array(cells, dtype=float)
            except ValueError:
                found = np.array([number(cell) for cell in cells])
            self.refuse(
                np.isnan(found) & (not blank),
                f"{called} is empty or NaN; expected a finite number",
            )
            self.refuse(
                np.isinf(found), f"{called} is {{}}; expected a finite number", cells
            )
            self.refuse(
                np.abs(found) > largest,
                f"{called} is {{:.6g}}; expected at most {largest:g}: {hint}",
                found,
            )
            columns.append(found)
        return np.column_stack(columns)


def read_table(path: Path, required) -> Table:
    """A CSV file without its empty rows, under its names in lower case. Raises
    ScanError, also where one is missing.
    """
    reader = csv.reader(StringIO(text_of(path), newline=""), strict=True)
    try:
        rows = [(reader.line_num, row) for row in reader if any(row)]
    except csv.Error as error:
        raise ScanError(
            f"{path} line {reader.line_num}: cannot be read: {error}"
        ) from error
    if len(rows) < 2:
        raise ScanError(
            f"{path}: no rows; expected names of columns, and a row for each pose or point"
        )
    names = [
        name.strip().lower() or f"without a name, {k}"
        for k, name in enumerate(rows[0][1])
    ]  # as spreadsheets add
    for name in (*required, *names):
        if names.count(name) != 1:
            found = f"{names.count(name) or 'no'} columns {shown(name)}; expected one"
            raise ScanError(
                f"{path}: {found}; there are {listed(names)} (separated by commas)"
            )
    return in_columns(path, dict.fromkeys(names, ""), rows[1:])


def in_columns(path: Path, units: dict[str, str], rows: Rows) -> Table:
    """The table of rows under names with units. Raises ScanError for a row that is
    shorter or longer.
    """
    for line, fields in rows:
        if len(fields) != len(units):
            hint = f"expected {len(units)}: is the file cut short? Are there decimal commas, or rows of a matrix?"
            raise ScanError(f"{path} line {line}: {len(fields)} fields; {hint}")
    lines, fields = zip(*rows, strict=True)
    return Table(
        path,
        dict(zip(units, zip(*fields, strict=True), strict=True)),
        lines,
        units=units,
    )


def write_table(path: Path, columns: dict[str, Sequence]) -> None:
    """Write a CSV file; numbers to twelve digits, NaN as an empty cell."""
    from pandas import DataFrame  # slow to load, and only what writes needs it

    DataFrame(columns).to_csv(
        path, index=False, float_format="%.12g", lineterminator="\n"
    )
