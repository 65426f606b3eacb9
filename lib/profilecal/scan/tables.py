"""Tables in files, with every mistake named: the file, the line, the value, what was expected."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from profilecal.scan.files import is_file, naming
from profilecal.scan.scan import ScanError

NOTHING = ("", "nan", "-nan", ".nan", "na", "n/a", "null", "none", "-", ".")  # cells of points that were not seen


def shown(value) -> str:
    """A value, for a sentence: short and on one line."""
    text = "a huge number" if isinstance(value, int) and value.bit_length() > 200 else repr(value)
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
    unit: str = "line"  # of `lines`; "row" where a file has no lines

    def refuse(self, bad, sentence) -> None:
        """Raise ScanError for the first row that is bad (rows,): where it is, and `sentence` of its number."""
        if np.any(bad):
            row = int(np.argmax(bad))
            raise ScanError(f"{self.path} {self.unit} {self.lines[row]}: {sentence(row)}")

    def labels(self) -> np.ndarray:
        """The poses' labels (rows,)."""
        labels = np.array([str(cell).strip() for cell in self.columns["pose"]], dtype=object)
        self.refuse(labels == "", lambda row: "no pose label")
        return labels

    def numbers(self, names, blank: bool = False, largest: float = np.inf) -> np.ndarray:
        """Columns as numbers (rows, columns), at most `largest`; cells may be blank or NaN only where `blank`."""
        return np.column_stack([self._numbers(name, blank, largest) for name in names])

    def _numbers(self, name: str, blank: bool, largest: float) -> np.ndarray:
        cells = self.columns[name]
        try:
            found = np.array(cells, dtype=float)
        except ValueError:
            found = np.array([number(cell) for cell in cells])
        called = f"column {name}" if name.isdigit() else name

        def bad_cell(row):
            what = "empty or NaN" if np.isnan(found[row]) else shown(str(cells[row]))
            return f"{called} is {what}; expected a finite number"

        hint = "are the units in scan.toml right? Missing points are left out or blank"
        self.refuse(np.isinf(found) | (np.isnan(found) & (not blank)), bad_cell)
        self.refuse(
            np.abs(found) > largest,
            lambda row: f"{called} is {found[row]:.6g}; expected at most {largest:g}: {hint}",
        )
        return found


def read_table(path: Path, required) -> Table:
    """A CSV file without its empty rows. Raises ScanError, also where a required column is missing."""
    if not is_file(path):
        raise ScanError(f"{path}: no such file")
    if (megabytes := path.stat().st_size // 1_000_000) > 400:  # more than the memory of a usual computer takes
        raise ScanError(f"{path}: {megabytes} MB; expected at most 400 MB: thin the profiles out")
    lines = []
    with naming(path), path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, strict=True)
        try:
            names = check_names(path, next(reader, []), required)
            columns = [[] for _ in names]
            for row in filter(any, reader):
                if len(row) != len(names):
                    hint = f"expected {len(names)} as the header: is the file cut short, or are there decimal commas?"
                    raise ScanError(f"{path} line {reader.line_num}: {len(row)} columns; {hint}")
                lines.append(reader.line_num)
                for cells, cell in zip(columns, row, strict=True):
                    cells.append(cell)
        except csv.Error as error:
            raise ScanError(f"{path} line {reader.line_num}: cannot be read: {error}") from error
    if not lines:
        raise ScanError(f"{path}: no rows")
    return Table(path, dict(zip(names, columns, strict=True)), lines)


def check_names(path: Path, header: list[str], required) -> list[str]:
    """The names of columns, in lower case. Raises ScanError."""
    names = [name.strip().lower() for name in header]
    if not names:
        raise ScanError(f"{path}: the first line is empty; expected column names")
    for name in names:
        if name and names.count(name) > 1:
            raise ScanError(f"{path}: column {shown(name)} is there twice")
    for name in required:
        if name not in names:
            hint = " (columns are separated by commas)" if len(names) == 1 else ""
            raise ScanError(f"{path}: no column {name!r}; there are {listed(names)}{hint}")
    return names


def write_table(path: Path, columns: dict[str, Sequence]) -> None:
    """Write a CSV file; numbers to twelve digits, NaN as an empty cell."""

    def cell(value):
        if not isinstance(value, float):
            return value
        return "" if np.isnan(value) else f"{value:.12g}"

    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*([cell(value) for value in values] for values in columns.values()), strict=True))
