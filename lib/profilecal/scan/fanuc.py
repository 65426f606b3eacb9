"""The positions P[1] … P[n] of a FANUC teach-pendant listing (.ls)."""

import re

import numpy as np
import pandas as pd

from profilecal.scan.files import text_of
from profilecal.scan.scan import ScanError

POSITION = re.compile(r"^\s*P\[(\d+)[^\]\n]*\][ \t]*\{(.*?)(^\s*\}|^\s*P\[|\Z)", re.MULTILINE | re.DOTALL)
ENTRY = re.compile(r"(\w+)\s*[:=]\s*('[^']*'|[^\s,]*)[ \t]*(\w*)")  # name, value, unit
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
        number, position, end = found.groups()
        line = text.count("\n", 0, found.start(1)) + 1
        where = f"{path} line {line}: P[{number}]"
        if not end.endswith("}"):
            raise ScanError(f"{where} is not closed by }};")
        if f"P{number}" in positions:
            raise ScanError(f"{where} is there twice")
        positions[f"P{number}"] = numbers_in(where, position)
    if not positions:
        raise ScanError(f"{path}: the /POS section holds no position P[1] …")
    table = pd.DataFrame(positions).T
    further = table.drop(columns="GP1").dropna(axis=1, how="all")
    moving = further.columns[further.isna().any() | (further.max() - further.min() > STANDSTILL)]
    if len(moving):
        raise ScanError(f"{path}: group {moving[0][0]} moves between positions; expected external axes to stand still")
    robot = table["GP1"][[*UNITS]].rename(columns=str.lower)
    if (frames := len(robot[["uf", "ut"]].drop_duplicates())) > 1:
        raise ScanError(f"{path}: positions in {frames} user frames or tools (UF, UT); expected one of each")
    return robot.rename_axis("pose").reset_index()


def numbers_in(where: str, position: str) -> dict[tuple[str, str], float]:
    """The numbers in a position by group and name, NaN for other entries; those of the robot are all there."""
    _, *parts = re.split(r"(GP\d+)\s*:", position)
    if "GP1" not in parts[::2]:
        raise ScanError(f"{where} has no group GP1")
    groups = zip(parts[::2], parts[1::2], strict=True)
    entries = {(group, name): entry for group, text in groups for name, *entry in ENTRY.findall(text)}
    values = ["0" if value == "F" else value for value, _ in entries.values()]  # F: the frame in use
    numbers = dict(zip(entries, pd.to_numeric(np.array(values, dtype=object), errors="coerce"), strict=True))
    for name, unit in UNITS.items():
        if ("GP1", name) not in entries:
            expected = "X, Y, Z in mm and W, P, R in deg, not joint angles, of numbered frames UF and UT"
            raise ScanError(f"{where} has no {name}; expected {expected}")
        value, of = entries["GP1", name]
        if of != unit or not np.isfinite(numbers["GP1", name]):  # asterisks where a position is not taught
            expected = f"a number in {unit}" if unit else "the number of a frame"
            raise ScanError(f"{where}: {name} is {f'{value} {of}'.strip()!r}; expected {expected}")
    return numbers
