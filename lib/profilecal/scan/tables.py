"""The files of a scan folder one by one: tables in CSV or Parquet, with every mistake named."""

import csv
import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from profilecal.scan.files import is_file, naming
from profilecal.scan.scan import ScanError

LARGEST_FILE = 400_000_000  # bytes


def shown(value) -> str:
    """A value, for a sentence: short and on one line."""
    text = "a huge number" if isinstance(value, int) and value.bit_length() > 200 else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def listed(names) -> str:
    """Names of columns, for a sentence."""
    text = ", ".join(str(name) for name in names)
    return shown(text) if len(text) > 200 or not text.isprintable() else text


# Tables


@dataclass(frozen=True)
class Table:
    """A table and the file that it is from. The frame's index is the line in the file; or what its name says."""

    path: Path
    frame: pd.DataFrame

    def line(self, row: int) -> str:
        """Where a row is; lines as an editor counts them."""
        return f"{self.path} {self.frame.index.name or 'line'} {self.frame.index[row]}"

    def refuse(self, bad, sentence) -> None:
        """Raise ScanError for the first row that is bad (rows,): where it is, and `sentence` of its number."""
        if np.any(bad):
            row = int(np.argmax(bad))
            raise ScanError(f"{self.line(row)}: {sentence(row)}")

    def labels(self) -> np.ndarray:
        """The poses' labels (rows,)."""
        self.refuse(self.frame["pose"].isna(), lambda row: "no pose label")
        return self.frame["pose"].astype(str).str.strip().to_numpy()

    def numbers(self, columns, blank: bool = False, largest: float = np.inf) -> np.ndarray:
        """Columns as numbers (rows, columns), at most `largest`; cells may be blank or NaN only where `blank`."""
        return np.column_stack([self._column(name, blank, largest) for name in columns])

    def _column(self, name: str, blank: bool, largest: float) -> np.ndarray:
        cells = self.frame[name]
        if not pd.api.types.is_numeric_dtype(cells) or pd.api.types.is_bool_dtype(cells):
            cells = cells.astype(str).where(cells.notna())  # no dates, lists, or True for numbers
        numbers = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float, na_value=np.nan)

        def found(row):
            return "is empty or NaN" if pd.isna(cells.iloc[row]) else f"is {shown(str(self.frame[name].iloc[row]))}"

        missing = np.isnan(numbers) & (cells.notna() | (not blank))
        called = f"column {name}" if name.isdigit() else name
        self.refuse(missing | np.isinf(numbers), lambda row: f"{called} {found(row)}; expected a finite number")
        self.refuse(
            np.abs(numbers) > largest,
            lambda row: (
                f"{name} is {numbers[row]:.6g}; expected at most {largest:g}: are the units in scan.toml right? "
                "Missing points are left out or blank"
            ),
        )
        return numbers


def read_table(folder: Path, name: str, required) -> Table:
    """A table by its name, without its empty rows. Raises ScanError, also where a required column is missing."""
    paths = [path for end in (".csv", ".parquet") if is_file(path := folder / f"{name}{end}")]
    if len(paths) != 1:
        both = "both .csv and .parquet are there; keep one" if paths else "no such file"
        raise ScanError(f"{folder / name}.csv: {both}")
    (path,) = paths
    size = path.stat().st_size
    if size > LARGEST_FILE:
        megabytes = f"{size / 1e6:.0f} MB; expected at most {LARGEST_FILE / 1e6:.0f} MB"
        raise ScanError(f"{path}: {megabytes}: thin the profiles out")
    with naming(path):
        try:
            frame = read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
        except (ScanError, UnicodeDecodeError, PermissionError):
            raise
        except (ValueError, OSError, ImportError, csv.Error) as error:  # pandas and pyarrow name the line
            raise ScanError(f"{path}: cannot be read: {str(error).strip().splitlines()[-1][:200]}") from error
    frame.columns = [str(column).strip().lower() for column in frame.columns]
    frame.index = pd.RangeIndex(2, len(frame) + 2)
    for column in required:
        if column not in frame:
            hint = " (columns are separated by commas)" if len(frame.columns) == 1 else ""
            raise ScanError(f"{path}: no column {column!r}; there are {listed(frame.columns)}{hint}")
    frame = frame.dropna(how="all")
    if frame.empty:
        raise ScanError(f"{path}: no rows")
    return Table(path, frame)


def read_csv(path: Path) -> pd.DataFrame:
    """A CSV file whose rows are as long as its header, or shorter, but for the last one: a file cut short."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        names = [name.strip().lower() for name in next(csv.reader([file.readline(100_000)]), [])]
    if not names:
        raise ScanError(f"{path}: the first line is empty; expected column names")
    for name in names:
        if name and names.count(name) > 1:
            raise ScanError(f"{path}: column {shown(name)} is there twice")
    text = {"dtype": {"pose": str, "group": str}, "encoding": "utf-8-sig"}
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame = pd.read_csv(path, index_col=False, skip_blank_lines=False, low_memory=False, **text)
        except (pd.errors.ParserWarning, pd.errors.ParserError) as error:
            found = re.search(r"in line (\d+), saw (\d+)", str(error))
            if isinstance(error, pd.errors.ParserError) and not found:
                raise
            where, many = (f" line {found[1]}", found[2]) if found else ("", "more")
            raise ScanError(
                f"{path}{where}: {many} columns where the header has {len(names)}; expected one number in each "
                "(decimal commas?)"
            ) from error
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 10_000))
        last = file.read().decode(errors="replace").rstrip().splitlines()[-1:]
    fields = len(next(csv.reader(last), []))
    if len(frame) and fields < len(names):
        line = frame.dropna(how="all").index.max() + 2
        raise ScanError(f"{path} line {line}: {fields} of {len(names)} columns in the last row; is the file cut short?")
    return frame
