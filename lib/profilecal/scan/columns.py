"""Numbers in columns, from files of any common kind: text, OpenCV YAML, NumPy, ASCII PLY and PCD."""

import re
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from profilecal.scan.files import naming, text_of
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import listed, shown

NOTHING = ("", "nan", "-nan", ".nan", "null", "none", "na", "-", ".")
ENTRY = re.compile(
    r"^\s*(\w+)\s*:\s*(?:!!opencv-matrix\s+rows:\s*\d+\s+cols:\s*(\d+)\s+dt:\s*\S+\s+data:\s*)?\[([^\]]*)(\]?)", re.M
)
LIKE_ROWS = 3


@dataclass(frozen=True)
class Columns:
    """A table of numbers. Cells that are no numbers are NaN, their words kept."""

    path: Path
    values: np.ndarray  # (n, k)
    names: tuple[str, ...]  # (k,) lower case, without units; "1", "2", … where the file gives none
    words: tuple[str, ...] = ()  # (n,) of the first column, where it is no number

    @property
    def upright(self) -> "Columns":
        """With columns as columns, where a file without names has them side by side in at most three rows."""
        n, k = self.values.shape
        return table(self.path, self.values.T) if n <= LIKE_ROWS < k and self.names[0] == "1" else self


def read_columns(path: Path, entry: str = "") -> Columns:
    """A file's table. `entry`: the list in a YAML file or the array in an .npz file, where there are several.

    Raises ScanError for a file that holds none, or is cut short.
    """
    match path.suffix.lower():
        case ".yml" | ".yaml":
            return from_yaml(path, entry)
        case ".npy" | ".npz":
            return from_numpy(path, entry)
    lines = [line.strip() for line in text_of(path).splitlines()]
    if lines[:1] == ["ply"]:
        return from_cloud(path, lines, "end_header", r"property \w+ (\w+)", r"element vertex (\d+)", "format ascii")
    if any(line.startswith("DATA") for line in lines[:20]):
        return from_cloud(path, lines, "DATA", r"(\w+)", r"POINTS (\d+)", "DATA ascii", fields="FIELDS")
    return from_text(path, list(enumerate(lines, 1)))


def from_text(path: Path, lines) -> Columns:
    """Columns from numbered lines: words above the numbers are names if they are as many, else remarks."""
    lines = [(k, line) for k, line in lines if line and line[0] not in "#%" and not line.startswith("//")]
    begin = next((i for i, (_, line) in enumerate(lines) if is_data(fields_of(line))), None)
    if begin is None:
        raise ScanError(f"{path}: no numbers in columns")
    cells = [fields_of(line) for _, line in lines[begin:]]
    for (k, _), row in zip(lines[begin:], cells, strict=True):
        if len(row) != len(cells[0]):
            raise ScanError(
                f"{path} line {k}: {len(row)} columns where the first row has {len(cells[0])}; is it cut short?"
            )
    title = fields_of(lines[begin - 1][1]) if begin else []
    names = title if len(title) == len(cells[0]) else []
    words = () if all(number(row[0]) is not None for row in cells) else tuple(row[0] for row in cells)
    values = np.empty((len(cells), len(cells[0])))
    for i, row in enumerate(cells):
        for j, cell in enumerate(row):
            value = number(cell)
            if value is None and not (words and j == 0):
                raise ScanError(f"{path} line {lines[begin + i][0]}: {shown(cell)} where a number is expected")
            values[i, j] = np.nan if value is None else value
    return table(path, values, names, words)


def fields_of(line: str) -> list[str]:
    """A line's fields; decimal commas where something else parts them."""
    for separator in ";\t":
        if separator in line:
            return [field.strip().replace(",", ".") for field in line.split(separator)]
    return [field.strip() for field in line.split(",")] if "," in line else line.split()


def number(text: str) -> float | None:
    """NaN for nothing, None for a word."""
    if text.lower() in NOTHING:
        return np.nan
    try:
        return float(text.lower().replace(".inf", "inf"))
    except ValueError:
        return None


def is_data(fields) -> bool:
    """Whether a line's fields are numbers, but perhaps for a label in front."""
    found = [number(field) for field in fields[1:] or fields]
    return any(value is not None and np.isfinite(value) for value in found) and None not in found


def table(path: Path, values, names=(), words=()) -> Columns:
    """The columns, with their names as they are compared."""
    names = [re.sub(r"[\s_]*[\[(].*|_(mm|m|deg|rad)$", "", name.strip().strip("\"'").lower()) for name in names]
    return Columns(path, values, tuple(names) or tuple(str(j + 1) for j in range(values.shape[1])), words)


def from_cloud(path: Path, lines, end: str, name: str, count: str, ascii_: str, fields: str = "property") -> Columns:
    """An ASCII point cloud: a header that names and counts, then rows."""
    last = next((i for i, line in enumerate(lines) if line.startswith(end)), None)
    header = lines[: (last or 0) + 1]
    number_of = re.search(count, "\n".join(header))
    if last is None or not number_of or not any(line.startswith(ascii_) for line in header):
        raise ScanError(f"{path}: expected a header with {ascii_!r} and a number of points")
    titles = [line for line in header if line.startswith(fields)]
    names = [found for line in titles for found in re.findall(name, line.removeprefix("FIELDS"))]
    rows = [(k, line) for k, line in enumerate(lines[last + 1 :], last + 2) if line][: int(number_of[1])]
    if len(rows) < int(number_of[1]):
        raise ScanError(f"{path}: {len(rows)} points where the header says {number_of[1]}; is it cut short?")
    found = from_text(path, rows)
    if len(names) != len(found.names):
        raise ScanError(f"{path}: rows of {len(found.names)} numbers; expected {listed(names)}")
    return table(path, found.values, names)


def from_yaml(path: Path, entry: str) -> Columns:
    """A list x, 0, z, … of triplets, or a matrix, as OpenCV writes them."""
    text = text_of(path)
    found = {m[1]: (m, text.count("\n", 0, m.start()) + 1) for m in ENTRY.finditer(text)}
    match, line = found.get(chosen(path, found, entry), (None, 0))
    if not match[4]:
        raise ScanError(f"{path} line {line}: the list {match[1]} is not closed; is the file cut short?")
    words = [word.strip() for word in match[3].split(",")] if match[3].strip() else []
    values = [number(word) for word in words]
    if None in values:
        raise ScanError(f"{path} line {line}: {match[1]} holds {shown(words[values.index(None)])}; expected numbers")
    width = int(match[2] or 3)
    if not width or len(values) % width:
        raise ScanError(f"{path} line {line}: {match[1]} has {len(values)} numbers; expected {width} for each point")
    return table(path, np.reshape(np.array(values, dtype=float), (-1, width)))


def from_numpy(path: Path, entry: str) -> Columns:
    """An array (n, k) or (k, n)."""
    with naming(path), path.open("rb") as file:
        try:
            found = np.load(file, allow_pickle=False)
            if path.suffix.lower() == ".npz":
                found = found[chosen(path, found, entry)]
        except (EOFError, BadZipFile, KeyError) as error:
            raise ScanError(f"{path}: not a NumPy file ({error})") from error
        values = np.asarray(found, dtype=float)
    if values.ndim == 3:  # a matrix for each pose
        values = values.reshape(len(values), -1)
    if values.ndim != 2 or not values.size:
        raise ScanError(f"{path}: an array of shape {values.shape}; expected a row for each point")
    return table(path, values)


def chosen(path: Path, found, entry: str) -> str:
    """The name of one of several lists. Raises ScanError where that is not clear."""
    names = [*found]
    best = entry or ("profile" if "profile" in names else names[0] if len(names) == 1 else "")
    if best not in names:
        raise ScanError(f"{path}: no list {shown(entry or 'profile')}; there are {listed(names) or 'none'} (--entry)")
    return best
