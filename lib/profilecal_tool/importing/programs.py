"""Robots' programs and logs: lines that makers.toml shows, found in any text."""

import re
from collections.abc import Iterator
from pathlib import Path

from pandas import DataFrame

from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.makers import ROBOTS

WORDS = {"name", "tool", "base"}  # of a line; what else begins with $ is a number


def pattern(line: str) -> re.Pattern:
    """The expression for a line of makers.toml."""
    line = re.sub(r"\s*([^\w\s$…⋮])\s*", r"\1", line)
    parts = []
    for token in re.findall(r"\$\w+|\w+|\s+|.", line):
        if token[0] == "$" and len(token) > 1:
            of = r"[\w$.\[\]]+?" if token[1:] in WORDS else r"[^\s,;:()\[\]{}\"'=]+"
            parts.append(f"(?P<{token[1:]}>{of})")
        elif token == "…":
            parts.append(r"[^{};<>\n]*?")
        elif token == "⋮":
            parts.append(r"[^{};<>]*?")
        elif token == "^":
            parts.append(r"^[ \t\d]*")
        elif token.isspace():
            parts.append(r"[ \t]+")
        else:
            parts.append(token if token.isalnum() else rf"\s*{re.escape(token)}\s*")
    begin = r"(?<!\w)" if line[0].isalnum() else ""
    parts.append(r"(?!\w)" if token[0] == "$" else "")
    return re.compile(begin + "".join(parts), re.IGNORECASE | re.MULTILINE)


def found(lines: list[str], text: str) -> tuple[DataFrame, str]:
    """What stands in such lines, by the number of the line, and the text without."""
    rows = {}
    for line in lines:
        for match in pattern(line).finditer(text):
            rows[match.start()] = match.groupdict()
            blank = re.sub(r"[^\n]", " ", match[0])
            text = text[: match.start()] + blank + text[match.end() :]
    places = sorted(rows)
    numbers = [text.count("\n", 0, place) + 1 for place in places]
    return DataFrame([rows[place] for place in places], index=numbers), text


def plain(text: str, robot: dict) -> str:
    """A program without remarks."""
    remark = robot.get("remark")
    return re.sub(f"{re.escape(remark)}.*", "", text) if remark else text


def program_blocks(path: Path, text: str) -> Iterator[Block]:
    """The poses in a program of any robot."""
    for maker, robot in ROBOTS.items():
        if robot.get("has", "") not in text:
            continue
        _, rest = found(robot.get("tool", []), plain(text, robot))
        table, _ = found(robot["pose"], rest)
        if len(table):
            yield Block(path, table, [*table.columns], text, maker)
            return


def frames(robot: dict, text: str) -> tuple[DataFrame, dict[str, set[str]]]:
    """The tools' frames in programs, and the names in use by "tool" and "base"."""
    text = plain(text, robot)
    lines = robot["pose"] if robot.get("tools_are_poses") else robot.get("tool", [])
    tools, rest = found(lines, text)
    uses, _ = found(robot.get("uses", []), rest)
    uses = uses.reindex(columns=["tool", "base"])
    return tools, {which: {*uses[which].dropna()} for which in uses}
