"""Nested text: poses in JSON and YAML, in whatever they are nested; YAML with lists of
points.
"""

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from profilecal.scan.tables import Rows, ScanError, Table, in_columns, listed, number
from profilecal_tool.importing.key_value import Named
from profilecal_tool.importing.makers import (
    ALIASES,
    INVERSE,
    OF_ROBOT,
    POSITION,
    ROTATION,
    TOOL_FRAME,
    VECTORS,
    several,
)
from profilecal_tool.importing.programs import check_axes
from profilecal_tool.importing.tables import (
    ROW,
    chosen,
    in_numbers,
    names_and_units,
    words_in,
)

NAMED_LIST = re.compile(r"^ *(\w+) *:\s*\[([^\[\]]*)\]", re.MULTILINE)
# how JSON, XML and YAML begin
NESTED = re.compile(r"(?:\s*#.*\n)*\s*(?:[\[{<]|%YAML|---|-\s|[\w\"'-]+:\s)")
OPENCV = re.compile(r'<(\w+) type_id="opencv-matrix">[^"]*<data>([^<]*)</data>')
BLOCKS = {3, 4, 6, 7, 9, 12, 16}  # how many numbers in lists of lists are one thing
Words = tuple[str, ...]


def tree_of(text: str) -> Any:
    """What JSON, one document or several, or YAML says, with numbers as they are
    written; None where a text is neither.
    """
    if matrices := OPENCV.findall(text):
        return [{name: numbers.split() for name, numbers in matrices}]
    if text.lstrip()[:1] in ("{", "["):
        documents = re.sub(r"\}\s*\{", "},{", text)
        try:
            return json.loads(f"[{documents}]", parse_float=str, parse_int=str)
        except ValueError:
            return None
    if not NESTED.match(text):
        return None
    import yaml

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    without_version = re.sub(r"^%.*", "", text, flags=re.MULTILINE)
    try:
        return [*yaml.load_all(without_version, Loader=loader)]
    except yaml.YAMLError:
        return None


def poses_in(
    path: Path, tree: Any, entry: str, most: int | None = None
) -> tuple[list[Named], list[str]]:
    """The poses in what `tree_of` reads, with what else is there of each, and what was
    guessed; none in another text. It has `most` numbers.

    What has the same numbers in its path is of one pose: R_1 and t_1, or what is in one
    element of a list. `entry` names the poses where there are several of each.

    Raises ScanError.
    """
    records = {}
    guessed = set()
    # what YAML repeats by name may be endless
    for words, numbers, cells in islice(leaves(tree), most):
        where, columns = placed(words, cells)
        part = records.setdefault(numbers, {}).setdefault(".".join(where), {})
        part |= zip(columns, cells, strict=True)
        is_said = words and words[-1].endswith(("wxyz", "xyzw"))
        if len(cells) == 4 and "qw" in columns and not is_said:
            guessed.add(
                f"{words[-1]} is taken for {', '.join(columns)} (--pose-columns)"
            )
    parts = [(where, part) for one in records.values() for where, part in one.items()]
    counts = Counter(where for where, part in parts if is_pose(part))
    # there once, where others are of each profile
    once = [place for place in counts if counts[place] == 1 < max(counts.values())]
    tools = [place for place in counts if TOOL_FRAME.search(place)]
    places = [place for place in counts if place not in (*once, *tools)]
    if not places:
        check_axes(path, chain.from_iterable(part for _, part in parts))
        return [], []
    place = chosen_place(path, places, entry)
    if len(places) > 1:
        others = listed(other for other in places if other != place)
        guessed.add(f"{place} is taken for the robot's pose, not {others} (--entry)")
    poses = []
    for numbers, record in records.items():
        if not is_pose(record.get(place, {})):
            continue
        name = " ".join(word for word in numbers if isinstance(word, str))
        cells_of = dict(record[place])
        if INVERSE.search(place):
            cells_of["inverse"] = place
        for where, part in record.items():
            for column in part if where not in counts else ():
                if not column[-1:].isdigit():  # no part of a list
                    dotted = f"{where}.{column}" if column in cells_of else column
                    cells_of[dotted] = part[column]
        if "flange" in place:
            cells_of["tool"], tools = "flange", []
        for above in (numbers[:k] for k in range(len(numbers) + 1)):
            for where, part in records.get(above, {}).items():
                if where in tools:
                    cells_of |= {f"tool {name}": part[name] for name in part}
                    cells_of["tool"] = where
        poses.append(Named(cells_of, name, len(poses) + 1))
    return poses, sorted(guessed)


def leaves(
    node: Any, words: Words = (), numbers: tuple = ()
) -> Iterator[tuple[Words, tuple, list[str]]]:
    """All that is in a tree: words of its path, the numbers there, and its cells."""
    if isinstance(node, dict) and {"rows", "data"} <= node.keys():  # OpenCV's
        node = node["data"]
    if isinstance(node, dict):
        for key, value in node.items():
            word, digits = str(key).lower(), ""
            if isinstance(value, dict | list):
                word, digits = re.fullmatch(r"(?s)(.*?)[\W_]*(\d*)", word).groups()
            own = (digits,) if digits else ()
            yield from leaves(value, (*words, word), (*numbers, *own))
        return
    cells = [*islice(atoms(node), max(BLOCKS) + 1)]
    are_one = len(cells) in BLOCKS and np.isfinite([*map(number, cells)]).all()
    if are_one or not isinstance(node, list):
        yield words, numbers, cells
    else:
        for k, value in enumerate(node):
            yield from leaves(value, words, (*numbers, k))


def atoms(node: Any) -> Iterator[str]:
    """What is in lists of lists, as text."""
    if isinstance(node, list):
        for one in node:
            yield from atoms(one)
    else:
        yield node if isinstance(node, str) else ""


def placed(words: Words, cells: list[str]) -> tuple[Sequence[str], Sequence[str]]:
    """What some cells are a part of, and their columns there."""
    *above, last = words or ("",)
    if len(cells) == 1:
        parent = above[-1] if above else ""
        if re.fullmatch(VECTORS, parent):
            return above[:-1], [f"r{last}"]
        is_turn = re.fullmatch(ROTATION, parent)
        if is_turn or re.fullmatch(POSITION, parent):
            above = above[:-1]
        is_of_quaternion = is_turn and last in [*"wxyz"]
        return above, [f"q{last}" if is_of_quaternion else ALIASES.get(last, last)]
    (head, _, rest), (front, _, tail) = last.partition("_"), last.rpartition("_")
    for name, own in ((last, []), (head, [rest]), (tail, [front])):
        if columns := several(name, len(cells)):
            return [*above, *own], columns
    numbers = [str(k) for k in range(1, len(cells) + 1)]
    if len(cells) < 6:  # a part of a pose
        return above, [f"{last} {k}" for k in numbers]
    return words, numbers


def is_pose(part: dict[str, str]) -> bool:
    """Whether columns are those of a pose, or may be."""
    return {*"123456"} <= part.keys() or (len(part) > 5 and {*"xyz"} <= part.keys())


def chosen_place(path: Path, places: list[str], entry: str) -> str:
    """Which of several poses is the robot's, as said or as it is called.

    Raises ScanError where that is not clear.
    """
    said = [place for place in places if entry and entry.lower() in place]
    exact = [place for place in said if place == entry.lower()]
    called = [place for place in places if OF_ROBOT.search(place)]
    of_flange = [place for place in called if "flange" in place]
    alone = [one for one in (places, called, of_flange) if len(one) == 1]
    fitting = exact or said or next(iter(alone), called)
    if len(fitting) != 1:
        raise ScanError(
            f"{path}: several poses at a time, {listed(places)}; "
            f"say which is the robot's: --entry {(called or places)[0]}"
        )
    return fitting[0]


def points_in_list(path: Path, text: str, entry: str) -> Rows:
    """The points x, 0, z of a profile in YAML, where they are one list of numbers.

    Of several lists, `entry` names the profile. Raises ScanError.
    """
    lists = {match[1]: match for match in NAMED_LIST.finditer(text)}
    if not lists:
        return []
    profile = lists[chosen(path, lists, entry)]
    line = text.count("\n", 0, profile.start()) + 1
    fields = profile[2].split(",")
    return [(line, fields[first : first + 3]) for first in range(0, len(fields), 3)]


def points_in(path: Path, text: str, entry: str) -> Table | None:
    """The points of all profiles in JSON; None in another text.

    Of several lists in a profile, `entry` names the one. Raises ScanError.
    """
    if text.lstrip()[:1] not in ("{", "["):
        return None
    found = {}
    titles = {}
    for k, (name, columns, points) in enumerate(lists_of(tree_of(text)), 1):
        titles[name] = columns
        rows = found.setdefault(name, [])
        rows += [(k, [str(k), *point]) for point in points]
    if not found:
        return None
    name = chosen(path, found, entry)
    units = names_and_units([ROW, *titles[name]])
    return in_numbers(in_columns(path, units, found[name]))


def lists_of(node: Any, name: str = "") -> Iterator[tuple[str, list[str], Sequence]]:
    """The lists of points in a tree: their name there, what a point's numbers are, and
    the points. They are lists of x and of z, or one of points.
    """
    if isinstance(node, dict):
        lists = {key: value for key, value in node.items() if is_long(value)}
        axes = [key for key in lists if words_in(key) & {*"xz"}]
        if len(axes) > 1 and len({len(lists[key]) for key in axes}) == 1:
            cells = (map(str, lists[key]) for key in axes)
            yield name, axes, [*zip(*cells, strict=True)]
            return
        for key, value in node.items():
            yield from lists_of(value, key)
    elif (
        is_long(node) and isinstance(node[0], list) and not isinstance(node[0][0], list)
    ):
        points = [[*map(str, point)] for point in node]
        yield name, [str(k) for k in range(1, len(points[0]) + 1)], points
    elif isinstance(node, list):
        for value in node:
            yield from lists_of(value, name)


def is_long(node: Any) -> bool:
    """Whether a list has more than a matrix has rows."""
    return isinstance(node, list) and len(node) > 4 and node[0] not in ([], {})
