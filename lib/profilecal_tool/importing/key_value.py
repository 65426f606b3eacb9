"""Text in which each number stands behind its name: KUKA's {X 1,Y 2,…}, listings of
FANUC's positions, lines t … and r ….
"""

import re
from dataclasses import dataclass
from pathlib import Path

from profilecal.scan.tables import Table, in_columns
from profilecal_tool.importing.makers import ALIASES, SEVERAL
from profilecal_tool.importing.tables import NUMBER, line_of

# a brace and the name before it; a group of a FANUC robot's axes; a name and its
# numbers
TOKEN = re.compile(
    rf"(?:\b([a-z]\w*)(?:\[(\d+)[^\]]*\])?\s*=?\s*)?(\{{)|\bgp(\d+)\s*:|"
    rf"\b([a-z]\w*)\"?\s*[:=]?[ \t]*({NUMBER}(?:[ \t]+{NUMBER})*)",
    re.IGNORECASE,
)


@dataclass
class NamedCells:
    """The cells of one pose by their names."""

    cells: dict[str, str]
    line: int = 0  # where the first number stands; 0 before there is one


def behind_names(path: Path, text: str) -> Table | None:
    """Poses whose numbers have names; None where no names make a position.

    A column is there for each name that some pose has, blank for the others.
    """
    poses = [
        pose
        for pose in named_cells(text)
        if {"x", "y", "z"} <= pose.cells.keys() or "uf" in pose.cells
    ]
    if not poses:
        return None
    units = {name: "" for pose in poses for name in pose.cells}
    rows = [(pose.line, [pose.cells.get(name, "") for name in units]) for pose in poses]
    return in_columns(path, units, rows)


def named_cells(text: str) -> list[NamedCells]:
    """All that may be poses: another one begins at a brace, or where a name comes
    again.
    """
    poses = [NamedCells({})]
    prefix = ""  # of a group's names; those of the first group have none
    for token in TOKEN.finditer(text):
        label, index, brace, group, key, numbers = token.groups()
        if group:
            prefix = "" if group == "1" else f"gp{group} "
        elif brace:
            prefix = ""
            poses.append(NamedCells({"pose": f"{label}{index}"} if index else {}))
        else:
            name = prefix + key.lower()
            cells = numbers.split()
            names = SEVERAL.get((name, len(cells)), (ALIASES.get(name, name),))
            if poses[-1].cells.keys() & names:
                poses.append(NamedCells({}))
            if len(names) == len(cells):
                pose = poses[-1]
                pose.line = pose.line or line_of(text, token.start())
                pose.cells |= zip(names, cells, strict=True)
    return poses
