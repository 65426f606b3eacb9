"""The scan folder: a user's measurements as plain files, read with every mistake named, and written.

data/README.md describes the format. Lengths are millimetres once read, whatever the folder's units.
"""

import csv
import json
import re
import stat
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pandas as pd

from profilecal.scan.scan import ScanError

LARGEST_FILE = 400_000_000  # bytes
LARGEST_HEADER = 1_000_000


def is_file(path: Path) -> bool:
    """Whether there is a file. Raises ScanError for what is no file, and OSError (a loop of links, no permission)."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    if not stat.S_ISREG(mode):
        raise ScanError(f"{path}: not a file")
    return True


def shown(value) -> str:
    """A value, for a sentence: short and on one line."""
    text = "a huge number" if isinstance(value, int) and value.bit_length() > 200 else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def listed(names) -> str:
    """Names of columns, for a sentence."""
    text = ", ".join(str(name) for name in names)
    return shown(text) if len(text) > 200 or not text.isprintable() else text


def is_number(value) -> bool:
    """Whether an entry of a TOML file is one."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def read_toml(path) -> dict:
    """The content of a TOML file. Raises ScanError."""
    path = Path(path)
    try:
        if is_file(path) and path.stat().st_size > LARGEST_HEADER:
            raise ScanError(f"{path}: {path.stat().st_size} bytes; expected at most {LARGEST_HEADER}")
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ScanError(f"{path}: {_not_utf8(path, error)}") from error
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror}") from error
    except ScanError:
        raise
    except RecursionError as error:
        raise ScanError(f"{path}: nested too deeply") from error
    except ValueError as error:  # of tomllib, and of numbers of thousands of digits
        raise ScanError(f"{path}: {error}") from error


def _not_utf8(path: Path, error: UnicodeDecodeError) -> str:
    """Where a file is no text."""
    content = path.read_bytes()
    try:
        content.decode()
    except UnicodeDecodeError as first:
        line = content.count(b"\n", 0, first.start) + 1
        return f"not UTF-8 text, {content[first.start : first.start + 1]!r} in line {line}; save it as UTF-8"
    return f"not UTF-8 text ({error.reason})"


def read_table(folder: Path, name: str, required) -> tuple[Path, pd.DataFrame]:
    """A table by its name, CSV or Parquet, without its empty rows; its index is the line in the file less two."""
    paths = [folder / f"{name}{end}" for end in (".csv", ".parquet") if is_file(folder / f"{name}{end}")]
    if len(paths) != 1:
        both = "both .csv and .parquet are there; keep one" if paths else "no such file"
        raise ScanError(f"{folder / name}.csv: {both}")
    path = paths[0]
    if path.stat().st_size > LARGEST_FILE:
        size = path.stat().st_size / 1e6
        raise ScanError(f"{path}: {size:.0f} MB; expected at most {LARGEST_FILE / 1e6:.0f} MB: thin the profiles out")
    try:
        table = read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
    except UnicodeDecodeError as error:
        raise ScanError(f"{path}: {_not_utf8(path, error)}") from error
    except (ScanError, PermissionError):
        raise
    except (ValueError, OSError, ImportError, csv.Error) as error:  # pandas and pyarrow name the line
        raise ScanError(f"{path}: cannot be read: {str(error).strip().splitlines()[-1][:200]}") from error
    table.columns = [str(column).strip().lower() for column in table.columns]
    for column in required:
        if column not in table:
            hint = " (columns are separated by commas)" if len(table.columns) == 1 else ""
            raise ScanError(f"{path}: no column {column!r}; there are {listed(table.columns)}{hint}")
    table = table.dropna(how="all")
    if table.empty:
        raise ScanError(f"{path}: no rows")
    return path, table


def read_csv(path: Path) -> pd.DataFrame:
    """A CSV file whose rows are as long as its header, or shorter, but for the last one: a file cut short."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        names = [name.strip().lower() for name in next(csv.reader([file.readline(100_000)]), [])]
    if not names:
        raise ScanError(f"{path}: the first line is empty; expected column names")
    for name in names:
        if name and names.count(name) > 1:
            raise ScanError(f"{path}: column {shown(name)} is there twice")
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            table = pd.read_csv(
                path,
                dtype={"pose": str, "group": str},
                index_col=False,
                skip_blank_lines=False,
                low_memory=False,
                encoding="utf-8-sig",
            )
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
    if len(table) and fields < len(names):
        line = table.dropna(how="all").index.max() + 2
        raise ScanError(f"{path} line {line}: {fields} of {len(names)} columns in the last row; is the file cut short?")
    return table


def _line(path: Path, table: pd.DataFrame, row: int) -> str:
    """Where a row is, as an editor counts lines."""
    return f"{path} line {table.index[row] + 2}"


def _labels(path: Path, table: pd.DataFrame) -> np.ndarray:
    blank = table["pose"].isna().to_numpy()
    if blank.any():
        raise ScanError(f"{_line(path, table, int(np.argmax(blank)))}: no pose label")
    return table["pose"].astype(str).str.strip().to_numpy()


def _numbers(path: Path, table: pd.DataFrame, columns, blank: bool = False, largest: float = np.inf) -> np.ndarray:
    """Columns as numbers (rows, columns), at most `largest`. Blank or NaN cells only where `blank`; never infinite."""
    numbers = np.empty((len(table), len(columns)))
    for k, column in enumerate(columns):
        cells = table[column]
        if not pd.api.types.is_numeric_dtype(cells) or pd.api.types.is_bool_dtype(cells):
            cells = cells.astype(str).where(cells.notna())  # no dates, lists, or True for numbers
        numbers[:, k] = pd.to_numeric(cells, errors="coerce")
        text = cells.notna().to_numpy() & np.isnan(numbers[:, k])
        bad = text | np.isinf(numbers[:, k]) | (np.isnan(numbers[:, k]) & (not blank))
        if bad.any():
            row = int(np.argmax(bad))
            value = table[column].iloc[row]
            found = "is empty or NaN" if pd.isna(cells.iloc[row]) else f"is {shown(str(value))}"
            raise ScanError(f"{_line(path, table, row)}: {column} {found}; expected a finite number")
        if (np.abs(numbers[:, k]) > largest).any():
            row = int(np.argmax(np.abs(numbers[:, k]) > largest))
            raise ScanError(
                f"{_line(path, table, row)}: {column} is {numbers[row, k]:.6g}; expected at most {largest:g}: "
                "are the units in scan.toml right? Missing points are left out or blank"
            )
    return numbers


def toml_text(entries: dict) -> str:
    """A dictionary of numbers, texts, nested lists of numbers, and one level of such dictionaries, as TOML."""

    def value(entry):
        if isinstance(entry, np.ndarray):
            entry = entry.tolist()
        if isinstance(entry, list | tuple):
            return "[" + ", ".join(map(value, entry)) + "]"
        return json.dumps(entry, ensure_ascii=False)

    tables = {key: entry for key, entry in entries.items() if isinstance(entry, dict)}
    lines = [f"{key} = {value(entry)}" for key, entry in entries.items() if key not in tables]
    for name, table in tables.items():
        if table:
            lines += ["", f"[{name}]", *(f"{key} = {value(entry)}" for key, entry in table.items())]
    return "\n".join(lines) + "\n"
