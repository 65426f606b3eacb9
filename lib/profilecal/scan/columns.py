"""Tables from files of any common kind: text, OpenCV YAML, NumPy, ASCII PLY and PCD, FANUC listings."""

import re
from pathlib import Path
from statistics import mode
from zipfile import BadZipFile

import numpy as np
import pandas as pd

from profilecal.scan.files import naming, text_of
from profilecal.scan.folder import SCALE
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import listed, shown

LENGTHS = SCALE | {"cm": 10.0, "um": 0.001}  # in mm
ANGLES = ("deg", "rad")
SIGNS = str.maketrans({"µ": "u", "μ": "u", "°": "deg"})
TITLE = re.compile(rf"(.*?)[\s_]*(?:[\[(]\s*([^\])]*?)\s*(?:[\])].*)?|[\s_/]\s*({'|'.join([*LENGTHS, *ANGLES])}))?")
ALIASES = {"q1": "qw", "q2": "qx", "q3": "qy", "q4": "qz"} | {f"{t}{axis}": axis for t in "tp" for axis in "xyz"}
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.I)
NOTHING = ("", "nan", "-nan", ".nan", "inf", "-inf", ".inf", "-.inf", "null", "none", "na", "-", ".")
REMARK = re.compile(r"\s*(#|%|//)[\s#%/]*")
CLOUDS = {  # the header of a point cloud, and how it names a column
    ".ply": (r"ply\s.*?format ascii.*?element vertex (\d+)(.*?)(?:element.*?)?end_header", r"property \w+ (\w+)"),
    ".pcd": (r"(?:.*?\n)?FIELDS(?=.*?POINTS (\d+))(.*?)\n.*?DATA ascii", r"\w+"),
}
LIST = re.compile(r"^ *(\w+) *:(?:\s*!!opencv-matrix.*?cols:\s*(\d+).*?data:)?\s*\[([^\]]*)(\]?)", re.M | re.S)
POSITION = re.compile(r"^\s*P\[(\d+).*?\]\s*\{([^{}]*)(\}?)", re.M)  # of a FANUC listing
ENTRY = re.compile(r"(\w+)\s*[:=]\s*('[^']*'|[^\s,]*)[ \t]*(\w*)")  # name, value, unit

Rows = list[tuple[int, list[str]]]  # lines' numbers and fields


def read_columns(path: Path, entry: str = "") -> pd.DataFrame:
    """A file's table under its titles in lower case, or "1", "2", …; blank cells are NaN.

    `entry`: the list in a YAML file or the array in an .npz file, where there are several. Raises ScanError for a file
    that holds no numbers, or is cut short.
    """
    match path.suffix.lower():
        case ".npy" | ".npz":
            return unnamed(array(path, entry))
        case ".ls":
            return listing(path)
        case ".yml" | ".yaml":
            return from_rows(path, yaml_list(path, entry))
        case ".ply" | ".pcd":
            return from_rows(path, point_cloud(path))
    return from_rows(path, lines_of(text_of(path)))


def from_rows(path: Path, rows: Rows) -> pd.DataFrame:
    """The table in rows, from the first that holds numbers and is as long as most of these. Its titles are the row of
    that length above; or the one above that, if this one holds units."""
    numeric = [j for j, (_, fields) in enumerate(rows) if has_numbers(fields)]
    if not numeric:
        raise ScanError(f"{path}: no numbers in columns")
    k = mode(len(rows[j][1]) for j in numeric)
    first = next(j for j in numeric if len(rows[j][1]) == k)
    for line, fields in rows[first:]:
        if len(fields) != k:
            text = f"{len(fields)} fields; expected {k} for each point or pose; is the file cut short?"
            raise ScanError(f"{path} line {line}: {text}")
    table = unnamed([[*map(value, fields)] for _, fields in rows[first:]])
    table.index = [line for line, _ in rows[first:]]
    above = [fields for _, fields in rows[:first] if len(fields) == k] or [[*table]]
    units = [field.strip("[]()") for field in above[-1]]
    if len(above) > 1 and {*units} <= {"", "-", *LENGTHS, *ANGLES}:
        above.append([f"{title} [{unit}]" for title, unit in zip(above[-2], units, strict=True)])
    return table.set_axis([title.lower() for title in above[-1]], axis=1)


def value(field: str) -> float | str:
    """A number, NaN for nothing, or a word."""
    if NUMBER.fullmatch(field):
        return float(field)
    return np.nan if field.lower() in NOTHING else field


def has_numbers(fields: list[str]) -> bool:
    """Whether a row is of a table: not one of titles."""
    return any(map(NUMBER.fullmatch, fields)) or all(field.lower() in NOTHING for field in fields)


def names_and_units(titles) -> dict[str, str]:
    """The names in titles, or columns' numbers where a name is there twice; and the units that the titles say."""
    parts = [TITLE.fullmatch(title.strip().lower()).groups(default="") for title in titles]
    names = [ALIASES.get(name, name) for name, *_ in parts]
    alone = [names.count(name) == 1 and not name.isdigit() for name in names]
    return {names[j] if alone[j] else str(j + 1): "".join(units) for j, (_, *units) in enumerate(parts)}


def unit_of(path: Path, units: dict[str, str], names, known) -> str:
    """The one unit that the titles of some columns say, "" if they say none. Raises ScanError for one not known."""
    for name in names:
        if units[name] not in ("", *known) or units[name] != units[names[0]]:
            found = f"the unit {shown(units[name])}" if units[name] else "no unit"
            text = f"expected {' or '.join(known)}, the same for {', '.join(names)}"
            raise ScanError(f"{path}: the title of column {name} says {found}; {text}")
    return units[names[0]]


def unnamed(rows) -> pd.DataFrame:
    """The table in rows of equal length. Rows and columns have numbers for names."""
    return pd.DataFrame(rows, pd.RangeIndex(1, len(rows) + 1, name="row"), [str(j + 1) for j in range(len(rows[0]))])


def nameless(table: pd.DataFrame) -> bool:
    """Whether columns have no names."""
    return all(map(str.isdigit, table))


def lines_of(text: str) -> Rows:
    """The lines that are not blank. Remarks are left out, but for those that name x and z: titles."""
    rows = []
    for number, line in enumerate(text.translate(SIGNS).split("\n"), 1):
        remark = REMARK.match(line)
        fields = fields_of(line[remark.end() :] if remark else line)
        if line.strip() and (not remark or {"x", "z"} <= names_and_units(fields).keys()):
            rows.append((number, fields))
    return rows


def fields_of(line: str) -> list[str]:
    """A line's fields; decimal commas where something else parts them."""
    separator = next((mark for mark in ";\t," if mark in line), r"\s+(?![\[(])")  # a unit belongs to its title
    if separator in ";\t":
        line = line.replace(",", ".")
    return [field.strip(" \r\"'") for field in re.split(separator, line.strip(" \r"))]


def point_cloud(path: Path) -> Rows:
    """Titles and points of a PLY or PCD file."""
    text = text_of(path)
    header, name = CLOUDS[path.suffix.lower()]
    found = re.match(header, text, re.DOTALL)
    if not found:
        raise ScanError(f"{path}: expected a header with 'format ascii' or 'DATA ascii' and a number of points")
    rows = [row for row in lines_of(text) if row[0] > found[0].count("\n") + 1][: int(found[1])]
    if len(rows) < int(found[1]):
        raise ScanError(f"{path}: {len(rows)} points where the header says {found[1]}; is it cut short?")
    return [(1, re.findall(name, found[2])), *rows]


def listing(path: Path) -> pd.DataFrame:
    """The positions P[1] … P[n] of a FANUC listing: pose ("P1", …) and all that it says of group 1, the robot; what it
    says of other groups is titled "gp2 j1 [deg]" and so on."""
    text, lines, poses = text_of(path), [], []
    for found in POSITION.finditer(text):
        number, content, end = found.groups()
        lines.append(text.count("\n", 0, found.start(1)) + 1)
        if not end:
            raise ScanError(f"{path} line {lines[-1]}: P[{number}] is not closed by }};")
        poses.append({"pose": f"P{number}"})
        for group, entries in re.findall(r"GP(\d+)\s*:(.*?)(?=GP\d|\Z)", content, re.DOTALL):
            whose = "" if group == "1" else f"gp{group} "
            poses[-1] |= {f"{whose}{name} [{unit}]".lower(): value(text) for name, text, unit in ENTRY.findall(entries)}
    if not poses:
        raise ScanError(f"{path}: holds no position P[1]{{…}}; expected a FANUC listing with a section /POS")
    return pd.DataFrame(poses, lines)


def yaml_list(path: Path, entry: str) -> Rows:
    """Triplets of a list x, 0, z, …, or rows of a matrix, as OpenCV writes them."""
    text = text_of(path)
    lists = {found[1]: found for found in LIST.finditer(text)}
    name, columns, content, end = lists[chosen(path, lists, entry)].groups()
    line = text.count("\n", 0, lists[name].start(1)) + 1
    if not end:
        raise ScanError(f"{path} line {line}: the list {name} is not closed; is the file cut short?")
    fields, k = [field.strip() for field in content.split(",")], int(columns or 3)
    return [(line, fields[j : j + k]) for j in range(0, len(fields), k)]


def array(path: Path, entry: str) -> np.ndarray:
    """The array (n, k) in a NumPy file, or one of matrices (n, 3, 4) or (n, 4, 4) as rows."""
    with naming(path), path.open("rb") as file:
        try:
            found = np.load(file, allow_pickle=False)
            values = np.asarray(found if isinstance(found, np.ndarray) else found[chosen(path, found, entry)], float)
        except (EOFError, BadZipFile, KeyError, TypeError) as error:
            raise ScanError(f"{path}: not an array of numbers ({error})") from error
    if values.ndim not in (2, 3) or not values.size:
        raise ScanError(f"{path}: an array of shape {values.shape}; expected a row for each point or pose")
    return values.reshape(len(values), -1)


def chosen(path: Path, lists, entry: str) -> str:
    """The name of one of several lists. Raises ScanError where that is not clear."""
    best = entry or (next(iter(lists)) if len(lists) == 1 else "profile")
    if best not in lists:
        raise ScanError(f"{path}: no list {shown(best)}; there are {listed(lists) or 'none'} (--entry)")
    return best
