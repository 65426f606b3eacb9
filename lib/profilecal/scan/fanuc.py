"""The positions P[1] … P[n] of a FANUC teach-pendant listing (.ls)."""

import re

from profilecal.scan.files import text_of
from profilecal.scan.scan import ScanError

POSITION = re.compile(r"^\s*P\[(\d+)[^\]\n]*\][ \t]*\{(.*?)(^\s*\}|^\s*P\[|\Z)", re.MULTILINE | re.DOTALL)
GROUPS = re.compile(r"\s*GP1\s*:(.*?)(GP\d.*)?", re.DOTALL)
ENTRY = re.compile(r"(\w+)\s*[:=]\s*('[^']*'|[^\s,]*)[ \t]*(\w*)")  # name, value, unit
NUMBER = re.compile(r"[+-]?\d*\.\d+|\d+")
UNITS = {"X": "mm", "Y": "mm", "Z": "mm", "W": "deg", "P": "deg", "R": "deg", "UF": "", "UT": ""}


def read_listing(path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Titles and rows (line, fields) of the /POS section: pose ("P1", …), x, y, z, w, p, r with their units, the user
    frame uf, the tool ut, and all `other` numbers, such as where external axes are. Raises ScanError.

    Only group 1 is the robot.
    """
    text = text_of(path)
    section = re.search(r"^\s*/POS\s*$", text, re.MULTILINE)
    if not section:
        raise ScanError(f"{path}: no /POS section; expected a FANUC listing with positions P[1] …")
    rows = []
    for found in POSITION.finditer(text, section.end()):
        number, position, end = found.groups()
        line = text.count("\n", 0, found.start(1)) + 1
        where = f"{path} line {line}: P[{number}]"
        groups = GROUPS.fullmatch(position)
        if not end.endswith("}"):
            raise ScanError(f"{where} is not closed by }};")
        if not groups:
            raise ScanError(f"{where} has no group GP1")
        entries = {name: entry for name, *entry in ENTRY.findall(groups[1]) if name != "CONFIG"}
        for name, unit in UNITS.items():
            if name not in entries or entries[name][1] != unit:
                found = f"{name} is {' '.join(entries[name])}" if name in entries else f"no {name}"
                expected = "X, Y, Z in mm and W, P, R in deg, not joint angles, and the frames UF and UT"
                raise ScanError(f"{where}: {found}; expected {expected}")
        fields = [entries.pop(name)[0] for name in UNITS]
        rows.append((line, [f"P{number}", *fields, " ".join(NUMBER.findall(f"{entries}{groups[2]}")) or "0"]))
    if not rows:
        raise ScanError(f"{path}: the /POS section holds no position P[1] …")
    return ["pose", *(f"{name} [{unit}]" if unit else name for name, unit in UNITS.items()), "other"], rows
