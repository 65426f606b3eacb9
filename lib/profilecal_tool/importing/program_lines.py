"""Robots' programs and logs: lines that makers.toml shows, found in any text."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from pandas import DataFrame

from profilecal_tool.importing.makers import ROBOTS, Robot
from profilecal_tool.importing.text_tables import Block

NAMES = {"name", "tool", "base"}  # of a line; what else begins with $ is a number
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*")
OF_POSE = 6  # numbers
SIGNS = {
    "…": r"[^{};<>\n]*?",
    "⋮": r"[^{};<>]*?",
    "^": r"^[ \t]*(?:\d+[ \t]+)?",
}


def expression_of_line(line: str) -> re.Pattern:
    """The expression for a line of makers.toml."""
    line = re.sub(r"\s*([^\w\s$…⋮])\s*", r"\1", line)
    parts = [r"(?<!\w)" if line[0].isalnum() else ""]
    for token in re.findall(r"\$\w+|\w+|\s+|.", line):
        if token[0] == "$" and len(token) > 1:
            parts.append(expression_of_name(token[1:]))
        elif token.isspace():
            parts.append(r"[ \t]+")
        elif token.isalnum():
            parts.append(token)
        else:
            parts.append(SIGNS.get(token) or rf"\s*{re.escape(token)}\s*")
    if token[0] == "$":
        parts.append(r"(?!\w)")
    expression = "".join(parts).removeprefix(r"\s*")  # it may begin no line earlier
    return re.compile(expression, re.IGNORECASE | re.MULTILINE)


def expression_of_name(name: str) -> str:
    """The expression for what stands where $name does."""
    cell = r"[\w$.\[\]]+?" if name in NAMES else r"[^\s,;:()\[\]{}\"'=]+"
    return f"(?P<{name}>{cell})"


def as_blanks(match: re.Match) -> str:
    """As many blanks, in as many lines."""
    return re.sub(r"[^\n]", " ", match[0])


def matches_of(lines: Sequence[str], text: str) -> tuple[DataFrame, str]:
    """What stands in such lines, by the number of the line, and the text without."""
    rows = {}
    lowered = text.lower()
    for line in lines:
        words = re.findall(r"(?<![$\w])\w+", line.lower())
        if not all(word in lowered for word in words):  # much faster
            continue
        expression = expression_of_line(line)
        for match in expression.finditer(text):
            rows[match.start()] = match.groupdict()
        text = expression.sub(as_blanks, text)
    places = sorted(rows)
    numbers = [text.count("\n", 0, place) + 1 for place in places]
    return DataFrame([rows[place] for place in places], index=numbers), text


def without_remarks(text: str, robot: Robot) -> str:
    """A program without remarks, in as many lines."""
    if not robot.remark:
        return text
    begin, *end = map(re.escape, robot.remark.split())
    remark = f"{begin}.*?{end[0]}" if end else f"{begin}[^\n]*"
    return re.sub(remark, as_blanks, text, flags=re.DOTALL)


def program_blocks(path: Path, text: str) -> Iterator[Block]:
    """The tools, poses and uses in a program, of each maker that writes such lines."""
    for maker, robot in ROBOTS.items():
        tables, rest = {}, without_remarks(text, robot)
        kinds = ("tool", "pose", "uses") if robot.has in text else ("tool",)
        for kind in kinds:
            tables[kind], rest = matches_of(getattr(robot, kind), rest)
        if robot.tools_are_poses and "pose" in tables:
            tables["tool"] = tables["pose"]
        if not any(map(len, tables.values())):
            continue
        read = {number for table in tables.values() for number in table.index}
        left = sum(
            number not in read and len(NUMBER.findall(line)) >= OF_POSE
            for number, line in enumerate(rest.splitlines(), start=1)
        )
        for kind, table in tables.items():
            if len(table):
                titles = [*table.columns]
                yield Block(path, table, titles, "", maker, maker, kind, left)
