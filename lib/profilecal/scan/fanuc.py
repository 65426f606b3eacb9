"""The positions P[1] … P[n] of a FANUC teach-pendant listing (.ls)."""

import re

import numpy as np
import pandas as pd

from profilecal.scan.files import text_of
from profilecal.scan.scan import ScanError

POSITION = re.compile(r"^\s*P\[(\d+)[^\]\n]*\][ \t]*\{(.*?)(^\s*\}|^\s*P\[|\Z)", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"(\w+)\s*[:=]\s*('[^']*'|[^\s,]*)[ \t]*(\w*)")  # name, value, unit
UNITS = {"X": "mm", "Y": "mm", "Z": "mm", "W": "deg", "P": "deg", "R": "deg", "UF": "", "UT": ""}
STANDSTILL = 1e-3  # mm or degrees by which a further axis may move between positions


def read_listing(path) -> pd.DataFrame:
    """The /POS section of a FANUC listing: pose ("P1", …), x, y, z in mm, w, p, r in degrees, and the numbers uf of the
    user frame and ut of the tool, a row for each position. Raises ScanError.

    Only group 1 is the robot. Further groups, such as external axes, must not move: they would carry the scanner or
    the target along.
    """
    text = text_of(path)
    section = re.search(r"^\s*/POS\s*$", text, re.MULTILINE)
    if not section:
        raise ScanError(f"{path}: no /POS section; expected a FANUC listing with positions P[1] …")
    positions = {}
    for found in POSITION.finditer(text, section.end()):
        number, body, end = found.groups()
        line = text.count("\n", 0, found.start(1)) + 1
        where = f"{path} line {line}: P[{number}]"
        if not end.endswith("}"):
            raise ScanError(f"{where} is not closed by }};")
        if f"P{number}" in positions:
            raise ScanError(f"{where} is there twice")
        positions[f"P{number}"] = coordinates(where, body)
    if not positions:
        raise ScanError(f"{path}: the /POS section holds no position P[1] …")
    table = pd.DataFrame.from_dict(positions, orient="index")
    for axis in table.columns[len(UNITS) :]:
        if table[axis].isna().any() or np.ptp(table[axis]) > STANDSTILL:
            group = axis.split()[0]
            raise ScanError(f"{path}: group {group} moves between positions; expected external axes to stand still")
    frames = len(table[["uf", "ut"]].drop_duplicates())
    if frames > 1:
        raise ScanError(f"{path}: positions in {frames} user frames or tools (UF, UT); expected one of each")
    return table.rename_axis("pose").reset_index()


def coordinates(where: str, body: str) -> dict[str, float]:
    """The numbers in a position: the robot's x, y, …, ut, then those of further groups, such as "GP2 J1"."""
    _, *parts = re.split(r"(GP\d+)\s*:", body)
    groups = {group: FIELD.findall(text) for group, text in zip(parts[::2], parts[1::2], strict=True)}
    robot = {name: (value, unit) for name, value, unit in groups.pop("GP1", [])}
    if not robot:
        raise ScanError(f"{where} has no group GP1")
    found = {}
    for name, unit in UNITS.items():
        if name not in robot:
            expected = "X, Y, Z in mm and W, P, R in deg, not joint angles, of numbered frames UF and UT"
            raise ScanError(f"{where} has no {name}; expected {expected}")
        value = 0.0 if robot[name] == ("F", "") else pd.to_numeric(robot[name][0], errors="coerce")  # F: in use
        if not np.isfinite(value) or robot[name][1] != unit:  # asterisks where a position is not taught
            expected = f"a number in {unit}" if unit else "the number of a frame"
            raise ScanError(f"{where}: {name} is {' '.join(robot[name]).strip()!r}; expected {expected}")
        found[name.lower()] = value
    further = {f"{group} {name}": value for group, fields in groups.items() for name, value, _ in fields}
    numbers = pd.to_numeric(pd.Series(further, dtype=object), errors="coerce")
    return found | numbers.dropna().to_dict()
