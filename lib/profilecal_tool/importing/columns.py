"""Tables in files of any common kind: numbers behind names, in brackets, in columns of
a text, in arrays.
"""

import json
import re
from pathlib import Path
from statistics import mode
from zipfile import BadZipFile

import numpy as np

from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import (
    Rows,
    Table,
    in_columns,
    listed,
    naming,
    number,
    shown,
    text_of,
)

TITLE = re.compile(
    r"(.*?)[\s_]*(?:[\[(]\s*([^\])]*?)\s*[\])].*|[\s_/]\s*(mm|m|deg|rad))?"
)
ALIASES = {"q1": "qw", "q2": "qx", "q3": "qy", "q4": "qz"} | {
    f"{t}{axis}": axis for t in "tp" for axis in "xyz"
}
# numbers behind one name
SEVERAL = {("t", 3): ("x", "y", "z"), ("r", 9): CONVENTIONS[-1].columns}
# or what FANUC prints for a position that was not taught
NUMBER = r"(?:[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|\*+)"
# a brace and the name before it; a group of a FANUC robot's axes; a name and its
# numbers
TOKEN = re.compile(
    rf"(?:\b([a-z]\w*)(?:\[(\d+)[^\]]*\])?\s*=?\s*)?(\{{)|\bgp(\d+)\s*:|"
    rf"\b([a-z]\w*)\"?\s*[:=]?[ \t]*({NUMBER}(?:[ \t]+{NUMBER})*)",
    re.IGNORECASE,
)
ONE = r"[^\[\],]*"  # of the numbers in brackets
POSITION = rf"\[\s*\[({ONE},{ONE},{ONE})\]\s*,\s*"
BRACKETS = {  # poses, and what a robot's language has in them
    rf"{POSITION}\[({ONE},{ONE},{ONE},{ONE})\]\s*,\s*\[": "x y z qw qx qy qz",  # ABB
    r"\bp\[([^\[\]]*)\]": "x y z rx ry rz",  # Universal Robots
    rf"\[((?:{ONE},){{5,}}{ONE})\]": "",
}
ARRAYS = (".npy", ".npz")
REMARK = re.compile(r"\s*(?:#|%|//|!)[\s#%/]*")


def read_profiles(path: Path, entry: str = "") -> list[Table]:
    """Points of a profile, or of several in one array, under the names in titles, or
    "1", "2", …; `entry` names the list or array where there are several. Raises
    ScanError.
    """
    if path.suffix.lower() in ARRAYS:
        values = array(path, entry)
        values = values[None] if values.ndim == 2 else values
        values = values.mT if values.shape[1] <= 3 < values.shape[2] else values
        return [from_array(path, profile) for profile in values]
    text = closed_text(path)
    lists = {
        found[1]: found
        for found in re.finditer(r"(?m)^ *(\w+) *:\s*\[([^\[\]]*)\]", text)
    }  # YAML
    if not lists:  # without a number there are titles at most
        return [
            from_rows(path, lines_of(text))
            if re.search(r"\b\d", text)
            else Table(path, {}, [])
        ]
    found = lists[chosen(path, lists, entry)]
    line, fields = line_of(text, found.start(1)), found[2].split(",")
    return [
        from_rows(path, [(line, fields[j : j + 3]) for j in range(0, len(fields), 3)])
    ]  # x, 0, z


def read_poses(path: Path) -> Table:
    """Poses, one a row, or one matrix: also KUKA's {X 1,Y 2,…}, FANUC listings, lines t
    … and r …, ABB's robtargets, UR's p[…], arrays of matrices. Raises ScanError.
    """
    if path.suffix.lower() in ARRAYS:
        values = array(path, "")
        table = from_array(path, values.reshape(len(values), -1))
    else:
        text = closed_text(path)
        rows = in_lists(text)
        table = None if rows else behind_names(path, text)
        table = table or from_rows(path, rows or in_brackets(text) or lines_of(text))
    if len(table.lines) in (3, 4) and table.units.keys() == {*"1234"}:
        return from_array(path, table.numbers(table.units).reshape(1, -1))
    return table


def closed_text(path: Path) -> str:
    """A file's text. Raises ScanError where brackets are not closed."""
    text = text_of(path)
    for opening, closing in ("{}", "[]"):
        if text.count(opening) != text.count(closing):
            raise ScanError(
                f"{path}: not as many {closing} as {opening}; is the file cut short?"
            )
    return text


def behind_names(path: Path, text: str) -> Table | None:
    """Poses whose numbers have names; another one begins at a brace, or where a name
    comes again.
    """
    poses, prefix = [{}], ""
    for found in TOKEN.finditer(text):
        label, index, brace, group, key, numbers = found.groups()
        if group:
            prefix = "" if group == "1" else f"gp{group} "
        elif brace:
            poses.append({"pose": f"{label}{index}"} if index else {})
            prefix = ""
        else:
            key, cells = prefix + key.lower(), numbers.split()
            names = SEVERAL.get((key, len(cells)), (ALIASES.get(key, key),))
            if poses[-1].keys() & names:
                poses.append({})
            if len(names) == len(cells):
                poses[-1].setdefault("", line_of(text, found.start()))
                poses[-1] |= zip(names, cells, strict=True)
    poses = [pose for pose in poses if {"x", "y", "z"} <= pose.keys() or "uf" in pose]
    units = {name: "" for pose in poses for name in pose if name}
    rows = [(pose[""], [pose.get(name, "") for name in units]) for pose in poses]
    return in_columns(path, units, rows) if rows else None


def in_lists(text: str) -> Rows:
    """Poses in JSON whose numbers are in lists of their own: a matrix, a position
    beside a quaternion.
    """
    try:
        poses = json.loads(text, object_hook=lambda named: [*named.values()])
        while isinstance(poses, list) and len(poses) == 1:
            (poses,) = poses
        apart = all(isinstance(part, list) for pose in poses for part in pose)
    except (
        ValueError,
        TypeError,
        RecursionError,
    ):  # another language, or numbers beside each other
        return []
    return [
        (k, re.findall(NUMBER, json.dumps(pose)))
        for k, pose in enumerate(poses, 1)
        if apart
    ]


def in_brackets(text: str) -> Rows:
    """Poses in brackets, under titles where a robot's language says what the numbers
    are.
    """
    for pattern, titles in BRACKETS.items():
        found = [
            (line_of(text, one.start()), ",".join(one.groups()))
            for one in re.finditer(pattern, text)
        ]
        if found:
            return [
                (0, titles.split()),
                *((line, re.split(r"[\s,]+", cells.strip())) for line, cells in found),
            ]
    return []


def line_of(text: str, place: int) -> int:
    """The number of the line at a place in a text."""
    return text.count("\n", 0, place) + 1


def lines_of(text: str) -> Rows:
    """The lines that are not blank. Remarks are left out, but for those that name x and
    z: titles.
    """
    rows = []
    for line_number, line in enumerate(text.split("\n"), 1):
        remark = REMARK.match(line)
        fields = fields_of(line[remark.end() :] if remark else line)
        if line.strip() and (
            not remark or {"x", "z"} <= names_and_units(fields).keys()
        ):
            rows.append((line_number, fields))
    return rows


def fields_of(line: str) -> list[str]:
    """A line's fields; decimal commas where something else parts them."""
    separator = next(
        (mark for mark in ";\t," if mark in line), r"\s+(?![\[(])"
    )  # a unit belongs to its title
    if separator in ";\t":
        line = line.replace(",", ".")
    return [field.strip(" \r\"'") for field in re.split(separator, line.strip(" \r"))]


def from_rows(path: Path, rows: Rows) -> Table:
    """The table in rows, from the first that holds numbers, not words, and is as long
    as most of these. Its titles are the row of that length above.
    """
    numeric = [
        j
        for j, (_, fields) in enumerate(rows)
        if np.isinf([*map(number, fields)]).sum() < len(fields) / 2
    ]
    if not numeric:
        raise ScanError(f"{path}: no numbers in columns")
    k = mode(len(rows[j][1]) for j in numeric)
    first = next(j for j in numeric if len(rows[j][1]) == k)
    titles = next(
        (fields for _, fields in rows[:first][::-1] if len(fields) == k), k * ["1"]
    )
    return in_columns(path, names_and_units(titles), rows[first:])


def names_and_units(titles) -> dict[str, str]:
    """What titles say: "X [mm]" is x, in mm. Where a name is there twice, columns'
    numbers take its place.
    """
    said = [
        TITLE.fullmatch(title.strip().lower()).groups(default="") for title in titles
    ]
    names = [ALIASES.get(name, name) for name, *_ in said]
    names = [
        name if names.count(name) == 1 else str(j) for j, name in enumerate(names, 1)
    ]
    return {
        name: "".join(unit).replace("°", "deg")
        for name, (_, *unit) in zip(names, said, strict=True)
    }


def unit_of(path: Path, units: dict[str, str], known) -> str:
    """The one unit that the titles of some columns say, "" if they say none. Raises
    ScanError for one not known.
    """
    said = {*units.values()}
    if len(said) > 1 or not said <= {"", *known}:
        there = listed(f"{name} [{unit}]" for name, unit in units.items())
        raise ScanError(
            f"{path}: the columns are {there}; expected one unit for all of them, {' or '.join(known)}"
        )
    return said.pop()


def array(path: Path, entry: str) -> np.ndarray:
    """The numbers of an array of two or three axes, or of one in an archive. Raises
    ScanError.
    """
    with naming(path), path.open("rb") as file:
        try:
            found = np.load(file, allow_pickle=False)
            values = np.asarray(
                found
                if isinstance(found, np.ndarray)
                else found[chosen(path, found, entry)],
                float,
            )
        except (EOFError, BadZipFile, KeyError, TypeError) as error:
            raise ScanError(f"{path}: not an array of numbers ({error})") from error
    if values.ndim not in (2, 3) or not values.size:
        raise ScanError(
            f"{path}: an array of shape {values.shape}; expected a row for each point or pose"
        )
    return values


def from_array(path: Path, values: np.ndarray) -> Table:
    """The table in an array (n, k)."""
    columns = {str(j + 1): column for j, column in enumerate(values.T)}
    return Table(
        path, columns, range(1, len(values) + 1), "row", dict.fromkeys(columns, "")
    )


def chosen(path: Path, lists, entry: str) -> str:
    """The name of one of several lists. Raises ScanError where that is not clear."""
    best = entry or (next(iter(lists)) if len(lists) == 1 else "profile")
    if best not in lists:
        raise ScanError(
            f"{path}: no list {shown(best)}; there are {listed(lists) or 'none'} (--entry)"
        )
    return best
