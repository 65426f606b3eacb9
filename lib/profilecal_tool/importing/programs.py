"""Robots' programs that write a pose in brackets: ABB's robtargets, UR's p[…]."""

import re

from profilecal.scan.tables import Rows
from profilecal_tool.importing.tables import line_of

ONE = r"[^\[\],]*"  # of the numbers in brackets
POSITION = rf"\[\s*\[({ONE},{ONE},{ONE})\]\s*,\s*"
# poses, and what a robot's language has in them
BRACKETS = {
    rf"{POSITION}\[({ONE},{ONE},{ONE},{ONE})\]\s*,\s*\[": "x y z qw qx qy qz",  # ABB
    r"\bp\[([^\[\]]*)\]": "x y z rx ry rz",  # Universal Robots
    rf"\[((?:{ONE},){{5,}}{ONE})\]": "",
}


def in_brackets(text: str) -> Rows:
    """Poses in brackets, under titles where a robot's language says what the numbers
    are.
    """
    for pattern, titles in BRACKETS.items():
        rows = []
        for match in re.finditer(pattern, text):
            cells = ",".join(match.groups()).strip()
            rows.append((line_of(text, match.start()), re.split(r"[\s,]+", cells)))
        if rows:
            return [(0, titles.split()), *rows]
    return []
