"""Text in which each number stands behind its name: KUKA's {X 1,Y 2,…}, attributes in
XML, listings of FANUC's positions, lines t … and r ….
"""

import re
from bisect import bisect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from profilecal.scan.tables import ScanError, Table, in_columns
from profilecal_tool.importing.makers import ALIASES, DIALECTS, several
from profilecal_tool.importing.tables import NUMBER, names_and_units

NUMBERS = rf"{NUMBER}(?:[ \t]+{NUMBER})*"
IN_BRACKETS = rf"\[\s*{NUMBER}(?:\s*,\s*{NUMBER})*\s*\]"
# a brace and the name before it, or a tag; a group of a FANUC robot's axes; a name and
# its numbers; a name and a word
TOKEN = re.compile(
    rf"(?<![$\w])(?:([$\w]+)(?:\[(\d+)[^\]\n]*\])?\s*=?\s*)?(\{{|<\w+)|\bgp(\d+)\s*:|"
    r"\b([a-z]\w*)[\"']?\s*[:=]?[ \t]*(?:\([a-z]+\)[ \t]*)?\"?"
    rf"({NUMBERS}|{IN_BRACKETS})|"
    r"\b([a-z]\w*)=\"([^\"\n]*)\"",
    re.IGNORECASE,
)


@dataclass
class Named:
    """What a text says under one name."""

    cells: dict[str, str] = field(default_factory=dict)
    name: str = ""
    line: int = 0  # where the first number stands; 0 before there is one
    kind: str = ""  # what its language calls it

    def has(self, columns: Iterable[str]) -> bool:
        """Whether there are cells of these columns."""
        return {*columns} <= self.cells.keys()


def in_table(path: Path, poses: list[Named]) -> Table:
    """Poses under the columns that some have, blank for the others, and under their
    names where most have one of their own. Raises ScanError where there are none.
    """
    if not poses:
        raise ScanError(f"{path}: no positions in these programs")
    names = {pose.name for pose in poses}
    if "" not in names and len(names) > len(poses) / 2:
        for pose in poses:
            pose.cells = {"pose": pose.name} | pose.cells
    titles = dict.fromkeys(column for pose in poses for column in pose.cells)
    units = names_and_units(titles)
    rows = [(one.line, [one.cells.get(name, "") for name in titles]) for one in poses]
    return in_columns(path, units, rows)


def numbered_lines(text: str) -> Callable[[int], int]:
    """What says the number of the line at a place in a text."""
    ends = [end.start() for end in re.finditer("\n", text)]
    return lambda place: bisect(ends, place) + 1


def named_cells(text: str) -> list[Named]:
    """All that stands under names: another begins at a brace, a tag, or where a name
    comes again.
    """
    line_at = numbered_lines(text)
    aliases = dict(ALIASES)
    for word, names in DIALECTS.items():
        aliases |= names if word in text else {}
    found = [Named()]
    prefix = kind = title = ""  # a group's; those of the first group have none
    for token in TOKEN.finditer(text):
        label, index, opening, group, key, numbers, attribute, words = token.groups()
        if group:
            prefix = "" if group == "1" else f"gp{group} "
            continue
        if opening:
            prefix = ""
            tag = opening[1:].lower()
            found.append(Named(name=f"{label or ''}{index or ''}", kind=kind or tag))
            continue
        name = prefix + (key or attribute).lower()
        if name == "type":
            kind = words
        elif name == "name":
            title = words
        cells = re.split(r"[\s,]+", numbers.strip("[] \t")) if numbers else [words]
        columns = several(name, len(cells)) or (aliases.get(name, name),)
        if found[-1].cells.keys() & columns:
            found.append(Named(kind=found[-1].kind))
        one = found[-1]
        if name == "key":
            one.name = f"{title}{numbers}"
        elif len(columns) == len(cells):
            one.line = one.line or line_at(token.start())
            one.cells |= zip(columns, cells, strict=True)
    return found
