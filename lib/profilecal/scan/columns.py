"""Tables from files of any common kind: text, OpenCV YAML, NumPy, ASCII PLY and PCD, FANUC listings."""

import re
from collections import Counter
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import pandas as pd

from profilecal.scan.fanuc import read_listing
from profilecal.scan.files import naming, text_of
from profilecal.scan.folder import SCALE
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import listed, shown

LENGTHS = SCALE | {"cm": 10.0, "um": 0.001}  # in mm
ANGLES = {"deg": 1.0, "rad": 180 / np.pi}  # in degrees
SIGNS = str.maketrans({"µ": "u", "μ": "u", "°": "deg"})
TITLE = re.compile(rf"(.*?)[\s_]*(?:[\[(]\s*([^\])]*?)\s*(?:[\])].*)?|[\s_/]\s*({'|'.join(LENGTHS | ANGLES)}))?")
ALIASES = {"q1": "qw", "q2": "qx", "q3": "qy", "q4": "qz"} | {f"{t}{axis}": axis for t in "tp" for axis in "xyz"}
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.I)
NOTHING = ("", "nan", "-nan", ".nan", "inf", "-inf", ".inf", "-.inf", "null", "none", "na", "-", ".")
REMARK = re.compile(r"\s*(#|%|//|$)")
CLOUDS = {  # the header of a point cloud, and how it names a column
    ".ply": (r"ply\s.*?format ascii.*?element vertex (\d+)(.*?)(?:element.*?)?end_header", r"property \w+ (\w+)"),
    ".pcd": (r"(?:.*?\n)?FIELDS(?=.*?POINTS (\d+))(.*?)\n.*?DATA ascii", r"\w+"),
}
LIST = re.compile(r"^ *(\w+) *:(?:\s*!!opencv-matrix.*?cols:\s*(\d+).*?data:)?\s*\[([^\]]*)(\]?)", re.M | re.S)


def read_columns(path: Path, entry: str = "") -> pd.DataFrame:
    """A file's table under its titles in lower case, or "1", "2", …; blank cells are NaN.

    `entry`: the list in a YAML file or the array in an .npz file, where there are several. Raises ScanError for a file
    that holds no numbers, or is cut short.
    """
    match path.suffix.lower():
        case ".npy" | ".npz":
            return from_numpy(path, entry)
        case ".ls":
            titles, rows = read_listing(path)
        case ".yml" | ".yaml":
            titles, rows = [], yaml_list(path, entry)
        case ".ply" | ".pcd":
            titles, rows = point_cloud(path)
        case _:
            titles, rows = lines_of(text_of(path))
    return from_rows(path, titles, rows)


def from_rows(path: Path, titles: list[str], rows: list[tuple[int, list[str]]]) -> pd.DataFrame:
    """The table in rows (line, fields), from the first that holds numbers and is as long as most of these. The titles
    are in the row above, if it is as long; else as given."""
    lengths = Counter(len(fields) for _, fields in rows if has_numbers(fields))
    if not lengths:
        raise ScanError(f"{path}: no numbers in columns")
    k = lengths.most_common(1)[0][0]
    first = next(i for i, (_, fields) in enumerate(rows) if len(fields) == k and has_numbers(fields))
    for line, fields in rows[first:]:
        if len(fields) != k:
            text = f"{len(fields)} fields; expected {k} for each point or pose; is the file cut short?"
            raise ScanError(f"{path} line {line}: {text}")
    above = [fields for _, fields in rows[:first] if len(fields) == k] or [titles]
    units = [field.strip("[]()") for field in above[-1]]
    if len(above) > 1 and {*units} <= {"", "-", *LENGTHS, *ANGLES}:
        above += [[f"{title} [{unit}]" for title, unit in zip(above[-2], units, strict=True)]]
    fields = pd.Series([field for _, fields in rows[first:] for field in fields])
    values = pd.to_numeric(fields, errors="coerce").to_numpy(dtype=float).reshape(-1, k)
    words = np.isnan(values) & ~fields.str.lower().isin(NOTHING).to_numpy().reshape(-1, k)
    table = unnamed(np.where(np.isfinite(values), values, np.nan))
    for j in np.flatnonzero(words.any(axis=0)):
        table[str(j + 1)] = fields[j::k].to_numpy()
    table.index = pd.Index([line - 1 for line, _ in rows[first:]], name="line")
    return table.set_axis([title.lower() for title in above[-1]], axis=1) if len(above[-1]) == k else table


def has_numbers(fields: list[str]) -> bool:
    """Whether a row is of a table: not one of titles."""
    return any(map(NUMBER.fullmatch, fields)) or all(field.lower() in NOTHING for field in fields)


def names_and_units(titles) -> tuple[list[str], dict[str, str]]:
    """The names in titles, or the columns' numbers where a name is there twice; and what units the titles say."""
    parts = [TITLE.fullmatch(title.strip().lower()).groups(default="") for title in titles]
    names = [ALIASES.get(name, name) for name, *_ in parts]
    names = [name if names.count(name) == 1 else str(j + 1) for j, name in enumerate(names)]
    return names, {name: "".join(units) for name, (_, *units) in zip(names, parts, strict=True)}


def unit_of(path: Path, units: dict[str, str], names, known) -> str:
    """The one unit that the titles of some columns say, "" if they say none. Raises ScanError for one not known."""
    for name in names:
        if units[name] not in ("", *known) or units[name] != units[names[0]]:
            found = f"the unit {shown(units[name])}" if units[name] else "no unit"
            text = f"expected {' or '.join(known)}, the same for {', '.join(names)}"
            raise ScanError(f"{path}: the title of column {name} says {found}; {text}")
    return units[names[0]]


def numbered(k: int) -> list[str]:
    """Names of columns that have none."""
    return [str(j + 1) for j in range(k)]


def unnamed(values: np.ndarray) -> pd.DataFrame:
    """The table in an array (n, k)."""
    return pd.DataFrame(values, columns=numbered(values.shape[1]))


def lines_of(text: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Titles in the last remark above all rows, if there are any; and the rows."""
    lines = [*enumerate(text.translate(SIGNS).split("\n"), 1)]
    rows = [(k, fields_of(line)) for k, line in lines if not REMARK.match(line)]
    remarks = [fields_of(line.strip(" \t\r#%/")) for _, line in lines[: rows[0][0] - 1 if rows else 0] if line.strip()]
    titled = remarks and {"x", "z"} <= {*names_and_units(remarks[-1])[0]}
    return remarks[-1] if titled else [], rows


def point_cloud(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Titles and rows of a PLY or PCD file."""
    text = text_of(path)
    header, name = CLOUDS[path.suffix.lower()]
    found = re.match(header, text, re.DOTALL)
    if not found:
        raise ScanError(f"{path}: expected a header with 'format ascii' or 'DATA ascii' and a number of points")
    rows = [row for row in lines_of(text)[1] if row[0] > found[0].count("\n") + 1][: int(found[1])]
    if len(rows) < int(found[1]):
        raise ScanError(f"{path}: {len(rows)} points where the header says {found[1]}; is it cut short?")
    return re.findall(name, found[2]), rows


def fields_of(line: str) -> list[str]:
    """A line's fields; decimal commas where something else parts them."""
    separator = next((mark for mark in ";\t," if mark in line), None)
    if separator in (";", "\t"):
        line = line.replace(",", ".")
    if separator is None:
        line = re.sub(r"\s+([\[(])", r"\1", line)  # a unit belongs to its title
    return [field.strip(" \r\"'") for field in line.split(separator)]


def yaml_list(path: Path, entry: str) -> list[tuple[int, list[str]]]:
    """Rows of a list x, 0, z, … of triplets, or of a matrix, as OpenCV writes them."""
    text = text_of(path)
    lists = {found[1]: found for found in LIST.finditer(text)}
    name, cols, content, end = lists[chosen(path, lists, entry)].groups()
    line = text.count("\n", 0, lists[name].start(1)) + 1
    if not end:
        raise ScanError(f"{path} line {line}: the list {name} is not closed; is the file cut short?")
    fields = [field.strip() for field in content.split(",")] if content.strip() else []
    width = min(int(cols or 3), len(fields)) or 3
    return [(line, fields[i : i + width]) for i in range(0, len(fields), width)]


def from_numpy(path: Path, entry: str) -> pd.DataFrame:
    """The table in an array (n, k), or of matrices (n, 3, 4) or (n, 4, 4)."""
    with naming(path), path.open("rb") as file:
        try:
            found = np.load(file, allow_pickle=False)
            array = found if isinstance(found, np.ndarray) else found[chosen(path, found, entry)]
            values = np.asarray(array, dtype=float)
        except (EOFError, BadZipFile, KeyError, TypeError) as error:
            raise ScanError(f"{path}: not an array of numbers ({error})") from error
    if values.ndim not in (2, 3) or not values.size:
        raise ScanError(f"{path}: an array of shape {values.shape}; expected a row for each point or pose")
    return unnamed(values.reshape(len(values), -1))


def chosen(path: Path, lists, entry: str) -> str:
    """The name of one of several lists. Raises ScanError where that is not clear."""
    best = entry or ("profile" if "profile" in lists or len(lists) != 1 else next(iter(lists)))
    if best not in lists:
        raise ScanError(f"{path}: no list {shown(best)}; there are {listed(lists) or 'none'} (--entry)")
    return best
