"""Robots' programs: positions as their languages write them, and the tool and the base
that these are of.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from profilecal.scan.tables import ScanError, listed, number
from profilecal_tool.importing.key_value import Named, named_cells, numbered_lines
from profilecal_tool.importing.makers import (
    CALL,
    CALLS,
    FRAME_SET,
    IS_FRAME,
    JOINTS,
    LISTS,
    MOVE,
    NUMBERED_TOOL,
    REMARKS,
    UNSAID,
    VARIABLES,
)
from profilecal_tool.importing.tables import NUMBER

SQUARE = r"\[(?:[^\[\]\n]|\[(?:[^\[\]\n]|\[[^\[\]\n]*\])*\])*\]"
ROUND = r"\(\s*[+-]?\.?\d[^()\n]*\)"
# a type or a function, a name and a call before brackets, and what is in these
LIST = re.compile(
    rf"(?<![\w$.=])(?:([a-z]\w*)([ \t]+|\())?(?:([a-z$][\w$]*(?:\[\d+\])?)\s*:?=\s*)?"
    rf"([a-z]\w*)?({SQUARE}|{ROUND})",
    re.IGNORECASE,
)
ANYWHERE = re.IGNORECASE | re.MULTILINE
# a line that says what follows, an element of that, or a name and its numbers
ROW = re.compile(
    rf"^[ \t]*(?:[./]+([a-z]+)|\[\*\w+\*\]\$(\w+).*|\[\d,(\d+)\] *=.*|"
    r"([a-z][\w.]*(?:\[\d+\])?)[= \t,]+"
    rf"({NUMBER}(?:[, \t]+{NUMBER}){{5,}}))[ \t\r]*$",
    ANYWHERE,
)


def positions_in(path: Path, text: str) -> list[Named]:
    """Positions in a program, with the names of their tools and bases, and with the
    frames of these where the program has them; lists of numbers where it has none.

    Raises ScanError.
    """
    text = with_brackets(without_remarks(text))
    for call, as_list in CALLS.items():
        text = re.sub(call, as_list, text)
    found = [*named_cells(text), *lists_in(path, text)]
    full = [one for one in found if one.has("xyz")]
    if all(map(is_frame, full)):
        check_axes(path, (column for one in found for column in one.cells))
        full += [one for one in found if one.has("123456")]
    for one in found:
        if len({*"xyz"} & one.cells.keys()) == 2 and len(one.cells) > 4:
            raise ScanError(
                f"{path} line {one.line}: {one.name or 'a position'} has "
                f"{listed(one.cells)}; expected x, y and z"
            )
    # a tool's number is no pose's
    frames = {bare(one.name): one for one in full if one.name.strip("0123456789")}
    poses = [one for one in full if not is_frame(one)]
    of_pose = names_said(text, found)
    alike = [*of_pose.values()]
    of_all = alike[0] if alike and alike.count(alike[0]) == len(alike) else {}
    for which, pattern in FRAME_SET.items():
        chosen = dict(
            chosen_frame(path, text[: match.start(1)].count("\n"), match[1])
            for match in re.finditer(pattern, text, ANYWHERE)
        )
        set_there = [frame or frames.get(name) for name, frame in chosen.items()]
        poses = [one for one in poses if one not in set_there]
        for one in poses:
            own = bare(one.name)
            keys = (own, own[1:], str(one.line), own.rstrip("0123456789"))
            # an array's have no names
            other = {} if own else of_all
            said = next((of_pose[key] for key in keys if key in of_pose), other)
            name = one.cells.get(which) or said.get(which) or " or ".join(chosen)
            frame = chosen.get(name) or frames.get(bare(name))
            put(one, which, name, frame or frames.get(f"{which}_data{name}"))
    tools = [
        one
        for one in full
        if is_frame(one, "tool") and any(number(one.cells.get(k, "0")) for k in "xyz")
    ]
    if tools and not any("tool" in one.cells for one in poses):
        names = " or ".join(one.name or one.kind for one in tools)
        for one in poses:
            put(one, UNSAID, names, tools[0] if len(tools) == 1 else None)
    return poses


def without_remarks(text: str) -> str:
    """A program in which nothing but the ends of lines is left of its remarks."""
    for language, remark in REMARKS.items():
        if re.search(language, text, ANYWHERE):
            lines = re.compile(remark, ANYWHERE)
            text = lines.sub(lambda found: "\n" * found[0].count("\n"), text)
    return text


def lists_in(path: Path, text: str) -> Iterator[Named]:
    """Lists of numbers, under columns where the language says what these are.

    Raises ScanError for one that is longer or shorter.
    """
    line_at = numbered_lines(text)
    for match in LIST.finditer(text):
        kind, between, name, call, brackets = match.groups(default="")
        if between == "(" and kind[:3].lower() != "mov":
            continue  # what a function takes is no position
        cells = re.split(r"[\s,;]+", re.sub(r"[\[\]()]", " ", brackets).strip())
        line = line_at(match.start())
        call, kind = call.lower(), kind.lower()
        calls = [call + brackets[0], call] if call else []
        words = [word for word in (*calls, kind) if word in LISTS]
        if not words and call.startswith("set"):
            continue
        if brackets[0] == "(" and name and not words:
            words = ["j(" if name[0] in "jJ" else "("]
        columns = LISTS[words[0] if words else "["].split(",")
        if brackets[0] == "(":  # without an arm's posture, without external axes
            cells = cells[: len(columns)]
        if len(cells) != len(columns):
            if words and len(cells) > 5:
                raise ScanError(
                    f"{path} line {line}: {name or words[0]} has {len(cells)} numbers; "
                    f"expected {len(columns)}"
                )
            columns = [str(k) for k in range(1, len(cells) + 1)]
        named = dict(zip(columns, cells, strict=True))
        named.pop("_", "")
        yield Named(named, name, line, kind or call)


def with_brackets(text: str) -> str:
    """A program in which rows of a name and numbers are lists, too, below a line that
    says what they are, and the elements of a listed variable have names.
    """
    above = ""

    def as_list(match: re.Match) -> str:
        nonlocal above
        header, variable, index, name, numbers = match.groups()
        if header or variable:
            above = (header or variable).lower()
        if index:
            return f"{VARIABLES.get(above, above)}{index} {{"
        return f"{name}={above}({numbers})" if name and above in LISTS else match[0]

    return ROW.sub(as_list, text)


def bare(name: str) -> str:
    """A name without brackets, in lower case."""
    return re.sub(r"[\[\]]", "", name.lower())


def is_frame(one: Named, which: str = "tool|tcp|base|wobj|null|frame") -> bool:
    """Whether a position is the frame of a tool or a base."""
    return any(
        re.fullmatch(IS_FRAME.format(which), word)
        for word in (one.kind, bare(one.name).removesuffix("frame"))
    )


def names_said(text: str, found: list[Named]) -> dict[str, dict[str, str]]:
    """The names of the tool and the base of positions, by the name, its end or the line
    of a position, as its moves or what stands beside it say.
    """
    line_at = numbered_lines(text)
    with_tool = (one for one in found if one.has(["tool"]))
    said = {bare(one.name)[1:] or str(one.line): one.cells for one in with_tool}
    for move in re.finditer(MOVE, text, ANYWHERE):
        targets, tool, base = move.groups(default="")
        line = str(line_at(move.start()))
        names = {"tool": tool, "base": base}
        said |= dict.fromkeys(
            [line, *re.findall(r"\b[a-z]\w*", targets.lower())], names
        )
    for move in re.finditer(NUMBERED_TOOL, text, ANYWHERE):
        said[str(line_at(move.start(1)))] = {"tool": move[1]}
    tools = {bare(one.name) for one in found if is_frame(one, "tool")}
    for target, tool in re.findall(CALL, text, ANYWHERE):
        first = f"{bare(tool)}0"  # an array's name stands for its first
        if first in tools:
            said[bare(target)] = {"tool": first}
    return said


def chosen_frame(path: Path, above: int, argument: str) -> tuple[str, Named | None]:
    """The name of the frame that a statement sets, below so many lines, or its numbers
    and the frame. Raises ScanError.
    """
    lists = lists_in(path, above * "\n" + f"frame={argument}")
    for one in (*lists, *named_cells(argument)):
        if len(one.cells) > 5:
            name = f"({', '.join(one.cells.values())})"
            return name, one if one.has("xyz") else None
    return bare(re.match(r"[^\s(),;\"']*", argument)[0]), None


def put(one: Named, which: str, name: str, frame: Named | None) -> None:
    """Note the name of a position's tool or base, and its frame."""
    if name:
        one.cells[which] = name
    if frame:
        one.cells |= {f"{which} {key}": cell for key, cell in frame.cells.items()}


def check_axes(path: Path, names: Iterable[str]) -> None:
    """Raise ScanError where names are those of joint angles."""
    axes = [name for name in dict.fromkeys(names) if JOINTS.fullmatch(name)]
    if {"5", "6"} <= {name[-1] for name in axes}:
        raise ScanError(
            f"{path}: joint angles or pulses, {listed(axes)}, and no poses; let the "
            "robot write x, y, z and its orientation, and say where: --poses FILE"
        )
