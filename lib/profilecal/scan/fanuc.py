"""The positions P[1] … P[n] of a FANUC teach-pendant listing (.ls)."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from profilecal.scan.files import text_of
from profilecal.scan.scan import ScanError

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
POSITION = re.compile(r"^\s*P\[(\d+)[^\]\n]*\][ \t]*\{(.*?)(^\s*\}|^\s*P\[|\Z)", re.MULTILINE | re.DOTALL)
COORDINATES = {"X": "mm", "Y": "mm", "Z": "mm", "W": "deg", "P": "deg", "R": "deg"}
CONSTANT = 1e-3  # mm or degrees by which a further axis may move between positions


@dataclass(frozen=True)
class Listing:
    """The positions of a teach-pendant listing, of the robot's user frame and tool that it names."""

    numbers: tuple[int, ...]  # (P,) N of P[N]
    poses: np.ndarray  # (P, 6) X, Y, Z mm; W, P, R degrees
    user_frame: int
    tool: int


def read_listing(path) -> Listing:
    """The /POS section of a FANUC listing (.ls). Raises ScanError.

    Only group 1 is the robot. Further groups, such as external axes, must not move: they would carry the scanner or
    the target along.
    """
    path = Path(path)
    text = text_of(path)
    section = re.search(r"^\s*/POS\s*$", text, re.MULTILINE)
    if not section:
        raise ScanError(f"{path}: no /POS section; expected a FANUC listing with positions P[1] …")
    numbers, poses, frames, further = [], [], [], {}
    for number, line, body in positions(path, text, section.end()):
        where = f"{path} line {line}: P[{number}]"
        if number in numbers:
            raise ScanError(f"{where} is there twice")
        groups = re.split(r"GP(\d+)\s*:", body)
        content = dict(zip(map(int, groups[1::2]), groups[2::2], strict=True))
        if 1 not in content:
            raise ScanError(f"{where} has no group GP1")
        numbers.append(number)
        poses.append([coordinate(where, content[1], *entry) for entry in COORDINATES.items()])
        frames.append(tuple(frame_number(where, content[1], name) for name in ("UF", "UT")))
        for group in content.keys() - {1}:
            axes = re.findall(rf"=\s*({NUMBER})", content[group])
            further.setdefault(group, []).append([float(value) for value in axes])
    if not numbers:
        raise ScanError(f"{path}: the /POS section holds no position P[1] …")
    refuse_moving(path, further, len(numbers))
    if len(set(frames)) > 1:
        raise ScanError(f"{path}: positions in {len(set(frames))} user frames or tools (UF, UT); expected one of each")
    return Listing(tuple(numbers), np.array(poses), *frames[0])


def positions(path, text: str, start: int):
    """(N, line, text) of each P[N]{…} from `start`; lines as an editor counts them."""
    for entry in POSITION.finditer(text, start):
        number, body, end = entry.groups()
        line = text.count("\n", 0, entry.start(1)) + 1
        if not end.endswith("}"):
            raise ScanError(f"{path} line {line}: P[{number}] is not closed by }};")
        yield int(number), line, body


def coordinate(where: str, text: str, name: str, unit: str) -> float:
    """One of X, Y, Z, W, P, R. An untaught position has asterisks instead."""
    entry = re.search(rf"(?<![A-Za-z]){name}\s*=\s*(\S+)\s*(\w*)", text)
    if not entry:
        raise ScanError(f"{where} has no {name}; expected X, Y, Z in mm and W, P, R in deg, not joint angles")
    if not re.fullmatch(NUMBER, entry[1]) or entry[2] != unit:
        raise ScanError(f"{where}: {name} is {' '.join(entry.groups()).strip()!r}; expected a number in {unit}")
    return float(entry[1])


def frame_number(where: str, text: str, name: str) -> int:
    """The user frame UF or the tool UT; F, the one in use, counts as 0."""
    entry = re.search(rf"{name}\s*:\s*(\w+)", text)
    if not entry or not re.fullmatch(r"\d+|F", entry[1]):
        raise ScanError(f"{where} has no {name}; expected the number of a frame")
    return 0 if entry[1] == "F" else int(entry[1])


def refuse_moving(path, further: dict, count: int) -> None:
    """Raise ScanError for groups of axes that are not at one place in all positions."""
    for group, values in further.items():
        same = len(values) == count and len({len(v) for v in values}) == 1
        if not same or np.ptp(np.array(values), axis=0).max(initial=0) > CONSTANT:
            raise ScanError(f"{path}: group GP{group} moves between positions; expected external axes to stand still")
