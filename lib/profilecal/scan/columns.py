"""Tables of numbers from files of any common kind: text, OpenCV YAML, NumPy, ASCII PLY and PCD, FANUC listings."""

import re
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import pandas as pd

from profilecal.scan.fanuc import read_listing
from profilecal.scan.files import naming, text_of
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import listed, shown

NOTHING = ("", "nan", "-nan", ".nan", ".inf", "-.inf", "null", "none", "na", "-", ".")
REMARK = re.compile(r"\s*(#|%|//|$)")
UNIT = re.compile(r"[\s_]*[\[(].*|_(mm|m|deg|rad)$")
CLOUDS = {  # the header of a point cloud, and how it names a column
    ".ply": (r"ply\s.*?format ascii.*?element vertex (\d+)(.*?)(?:element.*?)?end_header", r"property \w+ (\w+)"),
    ".pcd": (r"(?:.*?\n)?FIELDS(?=.*?POINTS (\d+))(.*?)\n.*?DATA ascii", r"\w+"),
}
LIST = re.compile(r"^ *(\w+) *:(?:\s*!!opencv-matrix.*?cols:\s*(\d+).*?data:)?\s*\[([^\]]*)(\]?)", re.M | re.S)


def read_columns(path: Path, entry: str = "") -> pd.DataFrame:
    """A file's table of numbers, whose first column may be words.

    Names are lower case, without units; "1", "2", … where the file gives none. `entry`: the list in a YAML file or the
    array in an .npz file, where there are several. Raises ScanError for a file that holds none, or is cut short.
    """
    match path.suffix.lower():
        case ".ls":
            return read_listing(path)
        case ".npy" | ".npz":
            return from_numpy(path, entry)
        case ".yml" | ".yaml":
            return from_fields(path, *yaml_list(path, entry), labelled=False)
    return from_fields(path, *lines_of(path))


def from_fields(path: Path, names: list[str], rows: list, labelled: bool = True) -> pd.DataFrame:
    """The table in rows (line, fields), whose first column may be words where they are `labelled`; a name that is there
    twice gives way to the column's number."""
    names = [UNIT.sub("", name.strip("\"'").lower()) for name in names]
    names = [name if names.count(name) == 1 else str(j + 1) for j, name in enumerate(names)]
    k = len(names)
    values = [[number(field) for field in fields] for _, fields in rows]
    words = labelled and {row[0] for row in values} == {None}
    for (line, fields), row in zip(rows, values, strict=True):
        where = f"{path} line {line}"
        if len(row) != k:
            raise ScanError(f"{where}: {len(row)} fields; expected {k} for each point or pose; is the file cut short?")
        if None in row[words:]:
            raise ScanError(f"{where}: {shown(fields[row.index(None, words)])} where a number is expected")
    table = pd.DataFrame(np.array(values, dtype=float).reshape(len(rows), k), columns=names)
    if words:
        table[names[0]] = [fields[0] for _, fields in rows]
    return table


def number(field: str) -> float | None:
    """NaN for nothing, None for a word."""
    try:
        return np.nan if field.lower() in NOTHING else float(field)
    except ValueError:
        return None


def numbered(k: int) -> list[str]:
    """Names of columns that have none."""
    return [str(j + 1) for j in range(k)]


def unnamed(values: np.ndarray) -> pd.DataFrame:
    """The table in an array (n, k)."""
    return pd.DataFrame(values, columns=numbered(values.shape[1]))


def lines_of(path: Path) -> tuple[list[str], list]:
    """Names and rows of text: a point cloud's header says them; else what is above the numbers are names if they are as
    many, or remarks."""
    text = text_of(path)
    rows = [(k, fields_of(line)) for k, line in enumerate(text.split("\n"), 1) if not REMARK.match(line)]
    if path.suffix.lower() in CLOUDS:
        header, name = CLOUDS[path.suffix.lower()]
        found = re.match(header, text, re.DOTALL)
        if not found:
            raise ScanError(f"{path}: expected a header with 'format ascii' or 'DATA ascii' and a number of points")
        rows = [row for row in rows if row[0] > found[0].count("\n") + 1][: int(found[1])]
        if len(rows) < int(found[1]):
            raise ScanError(f"{path}: {len(rows)} points where the header says {found[1]}; is it cut short?")
        return re.findall(name, found[2]), rows
    above = []
    for i, (_, fields) in enumerate(rows):
        unlabelled = fields[1:] or fields
        if (any(unlabelled) or number(fields[0]) is not None) and None not in map(number, unlabelled):
            return above if len(above) == len(fields) else numbered(len(fields)), rows[i:]
        above = fields
    raise ScanError(f"{path}: no numbers in columns")


def fields_of(line: str) -> list[str]:
    """A line's fields; decimal commas where something else parts them."""
    for separator in ";\t":
        if separator in line:
            return [field.strip().replace(",", ".") for field in line.split(separator)]
    return [field.strip() for field in line.split(",")] if "," in line else line.split()


def yaml_list(path: Path, entry: str) -> tuple[list[str], list]:
    """Names and rows of a list x, 0, z, … of triplets, or of a matrix, as OpenCV writes them."""
    text = text_of(path)
    lists = {found[1]: found for found in LIST.finditer(text)}
    name, cols, content, end = lists[chosen(path, lists, entry)].groups()
    line = text.count("\n", 0, lists[name].start(1)) + 1
    if not end:
        raise ScanError(f"{path} line {line}: the list {name} is not closed; is the file cut short?")
    fields = [field.strip() for field in content.split(",")] if content.strip() else []
    width = min(int(cols or 3), len(fields)) or 3
    return numbered(width), [(line, fields[i : i + width]) for i in range(0, len(fields), width)]


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
