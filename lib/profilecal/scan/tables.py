"""Files and the tables in them, with every mistake named. What is written is whole, or
leaves nothing.
"""

import csv
import shutil
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.progress import watched

LARGEST_MB = 400  # of a text file: more a usual computer does not hold
PART = 1000  # rows at a time: the text of all would fill the memory, and hear no Ctrl-C
Rows = list[tuple[int, list[str]]]  # each line's number and fields
# cells of points that were not seen
NOTHING = {"", ".", "na", "n/a", "#n/a", "null", "none"}
NOTHING |= {"nan", ".nan", "nan(ind)", "1.#qnan", "invalid", "n.a.", "#nv"}


class ScanError(ValueError):
    """A scan is wrong; one sentence says where, what it holds and what was expected."""


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """What goes wrong with a file or argument becomes a ScanError that names it."""
    try:
        yield
    except ScanError:
        raise
    except UnicodeDecodeError as error:
        raise ScanError(f"{path}: {not_text(error)}") from error
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror or error}") from error
    except RecursionError as error:
        raise ScanError(f"{path}: nested too deeply") from error
    except (LookupError, TypeError, ValueError) as error:
        raise ScanError(f"{path}: {error}") from error


def not_text(error: UnicodeDecodeError) -> str:
    """Why a file is no text, and what to do."""
    if b"\0" in error.object:
        return "binary data; save it as text"
    line = error.object.count(b"\n", 0, error.start) + 1
    byte = error.object[error.start : error.start + 1]
    name = error.encoding.upper()
    return f"not {name} text, {byte!r} in line {line}; save it as UTF-8"


def text_of(path: Path, megabytes: int = LARGEST_MB, encoding: str = "") -> str:
    """A file's text, of at most so many megabytes; in an encoding where it is not
    UTF-8, or UTF-16 and says so. Raises ScanError.
    """
    if not is_file(path):
        raise ScanError(f"{path}: no such file")
    with naming(path):
        size = path.stat().st_size / 1e6
        if size > megabytes:
            raise ScanError(
                f"{path}: {size:.7g} MB; expected at most {megabytes} MB; "
                "thin profiles out"
            )
        content = path.read_bytes()
        if content[:2] in (BOM_UTF16_LE, BOM_UTF16_BE):
            return content.decode("utf-16")
        try:
            return content.decode("utf-8-sig")
        except UnicodeDecodeError:
            if not encoding:
                raise
            return content.decode(encoding)


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


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A place beside `path` for a file or a folder, which then appears at `path` whole,
    or after an error not at all.
    """
    partial = partial_of(path)
    with naming(path):
        remove(partial)
    try:
        yield partial
        partial.replace(path)
    finally:
        remove(partial)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder to fill, which then appears at `path` whole.

    Raises ScanError where anything is there, or none can be.
    """
    with naming(path):
        if path.exists() and (path.samefile(".") or any(path.iterdir())):
            raise ScanError(f"{path}: already in use; name a new folder")
    with written_whole(path) as partial:
        with naming(path):
            partial.mkdir(parents=True)
        yield partial


def partial_of(path: Path) -> Path:
    """Where `written_whole` has a file while it is being written."""
    return path.parent / f".{path.name}.partial"


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def shown(value: Any) -> str:
    """A value, for a sentence: short and on one line."""
    if isinstance(value, int) and value.bit_length() > 200:
        return "a huge number"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def listed(names: Iterable[Any]) -> str:
    """Names of columns or poses, for a sentence; of many the first ones, and how many
    more.
    """
    texts, most = [str(name) for name in names], 20
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    text = ", ".join(texts[:most]) + more
    return shown(text) if len(text) > 500 or not text.isprintable() else text


def cell_number(cell: str) -> float:
    """What a cell says: NaN for nothing, infinity for a word."""
    try:
        return float(cell)
    except ValueError:
        word = cell.strip(" -").lower()
        return np.nan if word in NOTHING else np.inf


@dataclass(frozen=True)
class Table:
    """The columns of a file by their names, and where each row stands in it."""

    path: Path
    columns: dict[str, Sequence]  # text, or numbers
    lines: Sequence | ndarray  # numbers or names of the rows
    counted: str = "line"  # what `lines` counts; "row" where a file has no lines

    def refuse(
        self, bad: ArrayLike, sentence: str, *values: Sequence | ndarray
    ) -> None:
        """Raise ScanError for the first row that is `bad` (rows,): where it is, and the
        sentence filled in with that row's entry of each of `values` (rows,).
        """
        if not np.any(bad):
            return
        row = int(np.argmax(bad))
        entries = [of_rows[row] for of_rows in values]
        words = [shown(str(one)) if isinstance(one, str) else one for one in entries]
        place = f"{self.path} {self.counted} {self.lines[row]}"
        raise ScanError(f"{place}: {sentence.format(*words)}")

    def text(self, name: str) -> ndarray:
        """A column's cells (rows,), empty where there is none."""
        cells = self.columns.get(name, [""] * len(self.lines))
        return np.array([str(cell).strip() for cell in cells], dtype=object)

    def labels(self) -> ndarray:
        """The poses' labels (rows,)."""
        labels = self.text("pose")
        self.refuse(labels == "", "no pose label")
        return labels

    def numbers(
        self, names: Iterable[str], blank: bool = False, largest: float = np.inf
    ) -> ndarray:
        """Columns as numbers (rows, columns), at most `largest`.

        Cells may be blank or NaN, and columns left out, only where `blank` says so.
        Raises ScanError.
        """
        return np.column_stack([self.column(name, blank, largest) for name in names])

    def column(
        self, name: str, blank: bool = False, largest: float = np.inf
    ) -> ndarray:
        """One column (rows,) as numbers; as `numbers` says."""
        cells = self.columns.get(name, [np.nan] * len(self.lines))
        title = f"column {name}" if name.isdigit() else name
        try:
            values = np.array(cells, dtype=float)
        except ValueError:
            values = np.array([cell_number(cell) for cell in cells])
        if not blank:
            empty = np.isnan(values)
            self.refuse(empty, f"{title} is empty or NaN; expected a finite number")
        words = np.isinf(values)
        self.refuse(words, f"{title} is {{}}; expected a finite number", cells)
        self.refuse(
            np.abs(values) > largest,
            f"{title} is {{:.6g}}; expected at most {largest:g}: are the units in "
            "scan.toml right? Missing points are left out or blank",
            values,
        )
        return values


def read_table(path: Path, required: Collection[str]) -> Table:
    """A CSV file without its empty rows, under its names in lower case.

    Raises ScanError, also where one of the required names is missing.
    """
    (table,) = parts_of_text(path, required, None)
    return table


def read_parts(path: Path, required: Collection[str]) -> Iterator[Table]:
    """A table of any length, some rows at a time: a CSV file, or the same columns as
    arrays in an .npz file.

    Raises ScanError, as `read_table` does.
    """
    if path.suffix == ".npz":
        return parts_of_arrays(path, required)
    return parts_of_text(path, required, PART)


def parts_of_text(
    path: Path, required: Collection[str], most: int | None
) -> Iterator[Table]:
    """A CSV file as tables of at most so many rows; None: as one."""
    content = text_of(path).encode()
    # StringIO would take four bytes for each character
    text = TextIOWrapper(BytesIO(content), "utf-8", newline="")
    reader = csv.reader(text, strict=True)
    # spreadsheets leave rows and columns without content
    rows = ((reader.line_num, row) for row in reader if any(map(str.strip, row)))
    try:
        _, titles = next(rows, (1, []))
        names = [
            title.strip().lower() or f"without a name, {k}"
            for k, title in enumerate(titles)
        ]
        first = [*islice(rows, most)]
        check_columns(path, required, names, len(first))
        others = iter(lambda: [*islice(rows, most)], [])  # until one is empty
        # about how many parts
        count = content.count(b"\n") // (most or len(content)) + 1
        for part in watched(chain([first], others), f"reading {path.name}", count):
            yield in_columns(path, names, part)
    except csv.Error as error:
        place = f"{path} line {reader.line_num}"
        raise ScanError(f"{place}: cannot be read: {error}") from error


def parts_of_arrays(path: Path, required: Collection[str]) -> Iterator[Table]:
    """The required columns of an .npz file, some rows at a time."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            names = [*map(str.lower, file.files)]
            pairs = zip(names, file.files, strict=True)
            columns = {name: file[own] for name, own in pairs if name in required}
    except Exception as error:  # zip, zlib and numpy have errors of their own
        raise ScanError(
            f"{path}: no arrays; expected what numpy.savez writes of numbers and text "
            "(dtype str): is it cut short?"
        ) from error
    rows = min((column.size for column in columns.values()), default=0)
    check_columns(path, required, names, rows)
    for name, column in columns.items():
        if column.shape != (rows,) or column.dtype.kind not in "Ufiu":
            raise ScanError(
                f"{path}: {name} is {column.dtype} of shape {column.shape}; "
                f"expected numbers or text, ({rows},)"
            )
    for first in watched(range(0, rows, PART), f"reading {path.name}"):
        chosen = slice(first, first + PART)
        part = {name: column[chosen] for name, column in columns.items()}
        yield Table(path, part, range(1, rows + 1)[chosen], "row")


def check_columns(
    path: Path, required: Collection[str], names: Sequence[str], rows: int
) -> None:
    """Refuse a table without rows, without required columns, or with two of a name."""
    if not rows:
        raise ScanError(
            f"{path}: no rows; expected names of columns, and a row for each pose or "
            "point"
        )
    for name in (*required, *names):
        count = names.count(name)
        if count != 1:
            raise ScanError(
                f"{path}: {count or 'no'} columns {shown(name)}; expected one; "
                f"there are {listed(names)} (separated by commas)"
            )


def in_columns(path: Path, names: Sequence[str], rows: Rows) -> Table:
    """The table of rows under names.

    Raises ScanError for a row that is shorter or longer.
    """
    lines, fields_by_row = zip(*rows, strict=True)
    counts = np.array([*map(len, fields_by_row)])
    table = Table(path, {}, lines)
    table.refuse(
        counts != len(names),
        f"{{}} fields; expected {len(names)}: is the file cut short? "
        "Are there decimal commas, or rows of a matrix?",
        counts,
    )
    cells = zip(*fields_by_row, strict=True)
    table.columns.update(zip(names, cells, strict=True))
    return table


def write_table(path: Path, columns: Mapping[str, Sequence]) -> None:
    """Write a CSV file; numbers to twelve digits, times `t`, which may count from 1970,
    to all; NaN as an empty cell.
    """
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    rows = max(map(len, arrays.values()))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for first in range(0, rows, PART):
            part = slice(first, first + PART)
            cells = [cells_of(arrays[name][part], name == "t") for name in arrays]
            writer.writerows(zip(*cells, strict=True))


def cells_of(values: ndarray, exact: bool) -> list:
    """A column as `write_table` writes it."""
    if values.dtype.kind != "f":
        return values.tolist()
    written = repr if exact else "{:.12g}".format
    return ["" if np.isnan(value) else written(value) for value in values.tolist()]
