"""Files and the tables in them, with every mistake named; files and folders that are
there whole or not at all.
"""

import csv
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from itertools import islice
from pathlib import Path
from shutil import rmtree
from textwrap import shorten
from typing import Any

import numpy as np
from numpy import ndarray

LARGEST_MB = 400  # of a table
PART = 1000  # rows of a long one that are looked at together
MOST = 20  # names that a sentence lists
# what programs write where there is no number
NOTHING = {"", ".", "n/a", "na", "n.a.", "#n/a", "#nv", "none", "null", "invalid"}
NOTHING |= {"nan", ".nan", "nan(ind)", "1.#qnan"}
Columns = dict[str, Any]  # each (rows,), by name


class ScanError(ValueError):
    """A scan is wrong; one sentence says where, what it holds and what was expected."""


@contextmanager
def naming(path: Any) -> Iterator[None]:
    """What goes wrong with a file or argument becomes a ScanError that names it."""
    try:
        yield
    except ScanError:
        raise
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ScanError(
            f"{path}: not {error.encoding.upper()} text, "
            f"{error.object[error.start : error.start + 1]!r} in line {line}; "
            "save it as UTF-8"
        ) from error
    except RecursionError as error:
        raise ScanError(f"{path}: nested too deeply") from error
    except (ValueError, TypeError) as error:
        raise ScanError(f"{path}: {error}") from error


def is_file(path: Path) -> bool:
    """Whether there is a file.

    Raises ScanError for what is no file, or cannot be told (a loop of links, no right).
    """
    with naming(path):
        try:
            path.stat()
        except FileNotFoundError:
            return False
        if not path.is_file():
            raise ScanError(f"{path}: not a file")
        return True


def text_of(path: Path, megabytes: int = LARGEST_MB, encoding: str = "") -> str:
    """A file's text, of at most so many megabytes; in an encoding where it is not
    UTF-8, or UTF-16 and says so. Raises ScanError.
    """
    if not is_file(path):
        raise ScanError(f"{path}: no such file")
    size = path.stat().st_size / 1e6
    if size > megabytes:
        raise ScanError(
            f"{path}: {size:g} MB; expected at most {megabytes} MB; thin profiles out"
        )
    with naming(path):
        content = path.read_bytes()
        is_16 = content.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
        try:
            return content.decode(encoding or ("utf-16" if is_16 else "utf-8-sig"))
        except LookupError:
            raise ScanError(f"{path}: no encoding is called {encoding}") from None


def partial_of(path: Path) -> Path:
    """Where `written_whole` has a file while it is being written."""
    return path.parent / f".{path.name}.partial"


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir():
        rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A place beside `path` for a file or a folder, which then appears at `path` whole,
    or after an error not at all. What an earlier program left there is removed.

    Raises ScanError where it cannot be.
    """
    partial = partial_of(path)
    with naming(path):
        remove(partial)
    try:
        yield partial
        with naming(path):
            partial.replace(path)
    finally:
        remove(partial)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder to fill, which then appears at `path` whole; after an error only the
    folders above it may have been made.

    Raises ScanError where anything is there, or none can be.
    """
    with naming(path):
        if path.exists() and (path.samefile(".") or any(path.iterdir())):
            raise ScanError(f"{path}: already in use; name a new folder")
    with written_whole(path) as partial:
        with naming(path):
            partial.mkdir(parents=True)
        yield partial


def shown(value: Any) -> str:
    """A value, for a sentence: short and on one line."""
    if value is None:
        return "missing"
    words = f"{value:.6g}" if isinstance(value, float) else repr(value)
    words = " ".join(words.split())
    return words if len(words) <= 60 else f"{words[:60]}…"


def listed(names: Iterable[Any]) -> str:
    """Names of columns or poses, for a sentence; of many the first ones, and how many
    more.
    """
    words = [*map(str, names)]
    more = f" and {len(words) - MOST} more" if len(words) > MOST else ""
    text = shorten(", ".join(words[:MOST]), 400, placeholder=" …") + more
    return text if text.isprintable() else repr(text)


def cell_number(cell: str) -> float:
    """What a cell says: NaN for nothing, infinity for a word."""
    if cell.strip().lower().removeprefix("-") in NOTHING:
        return np.nan
    try:
        return float(cell.replace("_", "?"))  # Python reads 4_00 as 400
    except ValueError:
        return np.inf


@dataclass(frozen=True)
class Table:
    """The columns of a file by their names, and where each row stands in it."""

    path: Path
    columns: Columns
    lines: Sequence | ndarray  # (rows,)
    counted: str = "line"  # what `lines` count

    def refuse(self, bad: ndarray, *words: str | Sequence | ndarray) -> None:
        """Raise ScanError for the first row that is `bad` (rows,): where it is, and a
        sentence of these words, of which a sequence (rows,) gives the row's entry.
        """
        for row in np.flatnonzero(bad)[:1]:
            parts = [
                part if isinstance(part, str) else shown(np.asarray(part, object)[row])
                for part in words
            ]
            raise ScanError(
                f"{self.path} {self.counted} {self.lines[row]}: {''.join(parts)}"
            )

    def text(self, name: str) -> ndarray:
        """A column's cells (rows,), empty where there is none."""
        cells = self.columns.get(name, [""] * len(self.lines))
        return np.char.strip(np.asarray(cells, str))

    def labels(self) -> ndarray:
        """The poses' labels (rows,)."""
        labels = self.text("pose")
        self.refuse(labels == "", "no pose label")
        return labels

    def column(self, name: str, blank: bool = False) -> ndarray:
        """A column (rows,) as numbers; cells may be blank or NaN, and the column left
        out, only where `blank` says so. Raises ScanError.
        """
        cells = self.columns.get(name, [np.nan] * len(self.lines))
        try:
            are_text = isinstance(next(iter(cells), 0), str)
            if are_text and "_" in "".join(cells):  # 4_00 is no 400
                raise ValueError
            numbers = np.asarray(cells, float)
        except (ValueError, TypeError):
            numbers = np.array([cell_number(str(cell)) for cell in cells])
        title = f"column {name}" if name.isdecimal() else name
        expected = "; expected a finite number"
        self.refuse(np.isinf(numbers), f"{title} is ", cells, expected)
        if not blank:
            self.refuse(np.isnan(numbers), f"{title} is empty or NaN{expected}")
        return numbers

    def numbers(self, names: Iterable[str], blank: bool = False) -> ndarray:
        """Several such columns (rows, columns)."""
        return np.stack([self.column(name, blank) for name in names], axis=1)


def read_table(path: Path, required: Collection[str]) -> Table:
    """A CSV file without its empty rows, under its names in lower case.

    Raises ScanError, also where one of the required names is missing.
    """
    return next(read_parts(path, required, None))


def read_parts(
    path: Path, required: Collection[str], most: int | None = PART
) -> Iterator[Table]:
    """A table of any length, at most so many rows at a time: a CSV file, or the same
    columns as arrays in an .npz file.

    Raises ScanError, as `read_table` does.
    """
    if path.suffix == ".npz":
        yield from parts_of_arrays(path, required)
        return
    rows = rows_of_text(path)
    _, titles = next(rows, (0, []))
    names = [title.strip().lower() for title in titles]
    part = [*islice(rows, most)]
    check_columns(path, required, names, len(part))
    while part:
        for line, cells in part:
            if len(cells) != len(names):
                raise ScanError(
                    f"{path} line {line}: {len(cells)} fields; expected {len(names)}: "
                    "is the file cut short? Are there decimal commas, or rows of a "
                    "matrix?"
                )
        lines, cells_of_rows = zip(*part, strict=True)
        columns = zip(*cells_of_rows, strict=True)
        yield Table(path, dict(zip(names, columns, strict=True)), lines)
        part = [*islice(rows, most)]


def rows_of_text(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows of a CSV file that are not blank, each with its line in the file."""
    content = BytesIO(text_of(path).encode())  # StringIO takes four bytes a letter
    rows = csv.reader(TextIOWrapper(content, "utf-8", newline=""), strict=True)
    try:
        for row in rows:
            if "".join(row).strip():
                yield rows.line_num, row
    except csv.Error as error:
        raise ScanError(
            f"{path} line {rows.line_num}: cannot be read: {error}"
        ) from error


def parts_of_arrays(path: Path, required: Collection[str]) -> Iterator[Table]:
    """The required arrays of an .npz file as tables of some rows."""
    try:
        with path.open("rb") as stream, np.load(stream) as file:
            names = {own: own.strip().lower() for own in file.files}
            arrays = {
                name: file[own] for own, name in names.items() if name in required
            }
    except Exception as error:  # of numpy, of the archive, of what is packed in it
        raise ScanError(
            f"{path}: no arrays; expected what numpy.savez writes of numbers and text "
            "(dtype str): is it cut short?"
        ) from error
    rows = min((array.size for array in arrays.values()), default=0)
    check_columns(path, required, [*names.values()], rows)
    for name, array in arrays.items():
        if array.shape != (rows,) or array.dtype.kind not in "iufU":
            raise ScanError(
                f"{path}: {name} is {array.dtype} of shape {array.shape}; "
                f"expected numbers or text, ({rows},)"
            )
    for begin in range(0, rows, PART):
        some = slice(begin, begin + PART)
        columns = {name: array[some] for name, array in arrays.items()}
        yield Table(path, columns, range(1, rows + 1)[some], "row")


def check_columns(
    path: Path, required: Collection[str], names: Sequence[str], rows: int
) -> None:
    """Refuse a table without rows, without required columns, or with two of a name."""
    if not rows:
        raise ScanError(
            f"{path}: no rows; expected names of columns, and a row for each pose or "
            "point"
        )
    for name in (*required, *filter(None, names)):
        count = names.count(name)
        if count != 1:
            raise ScanError(
                f"{path}: {count or 'no'} columns {name!r}; expected one; there are "
                f"{listed(names)} (separated by commas)"
            )


def write_table(path: Path, columns: Columns) -> None:
    """Write a CSV file; numbers to twelve digits, times `t`, which may count from 1970,
    to all; NaN as an empty cell.
    """
    cells = [
        cells_of(np.asarray(values), "" if name == "t" else ".12g")
        for name, values in columns.items()
    ]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*cells, strict=True))


def cells_of(values: ndarray, form: str) -> Iterator[str]:
    """A column as it is written, numbers in a form."""
    if values.dtype.kind not in "iuf":
        # as Python's own: while numpy's scalars were written, Ctrl-C was lost at times
        return iter(values.tolist())
    return ("" if n != n else format(n, form) for n in values.tolist())
