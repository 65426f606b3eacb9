"""Robots' programs and logs: lines that makers.toml shows, found in any text."""

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from pandas import DataFrame

from profilecal_tool.importing.blocks import Block, columns_titled
from profilecal_tool.importing.makers import ROBOTS

LARGEST_PROGRAM = 2_000_000  # characters; what is longer is a table
# kinds of lines; poses come last, or else a line of a tool would be one of a pose
KINDS = "base", "tool", "uses", "beside", "pose"
OF_MOVES = {"uses", "beside"}  # which may have a pose in them too
WORD = r"[\w$][\w$.\[\]-]*?"
CELLS = {"name": WORD, "tool": WORD, "base": WORD, "words": "[^'\n]*"}  # at $name, …
CELL = r"[^\s,;:()\[\]{}\"'=]+"  # at others: a number, or ******** in place of one
SIGNS = {"…": r"[^{};<>\n]*?", "⋮": r"[^{};<>]*?", "^": r"^[ \t]*(?:\d+[ \t]+)??"}
NONE = DataFrame()  # one for all: to make each takes longer than to look for lines


def expression_of(form: str) -> re.Pattern:
    """The expression for a form of makers.toml, of "P$name=($x," one that finds
    "P1 = ( 400.5, ", with a group name that is 1 and a group x that is 400.5.
    """
    form = re.sub(r"\s*([^\w\s$…⋮])\s*", r"\1", form)
    parts = [r"(?<!\w)" if form[0].isalnum() else ""]
    tokens = re.findall(r"\$[a-z]\w*|\w+(?:\|\w+)*|\s+|.", form)
    for token, after in pairwise([*tokens, ""]):
        name = token[1:]
        if token[0] == "$" and name:
            parts.append(f"(?P<{name}>{CELLS.get(name, CELL)})")
        elif token.isspace():
            parts.append(r"[ \t]+")
        elif token[0].isalnum():
            end = "" if after.startswith("$") else r"(?!\w)"  # MoveL is not in MoveLDO
            parts.append(f"(?:{token}){end}")
        else:
            parts.append(SIGNS.get(token) or rf"\s*{re.escape(token)}\s*")
    if tokens[-1][0] == "$":  # what it finds is a whole word
        parts.append(r"(?![\w-])")
    # without blank lines above, which would give another line number, and without
    # the next line's blanks, from which a ^ would not find its beginning
    expression = "".join(parts).removeprefix(r"\s*").removesuffix(r"\s*")
    return re.compile(f"(?im){expression}")


def blanked(expression: str | re.Pattern, text: str) -> str:
    """A text with blanks where an expression stands, in as many lines."""
    return re.sub(expression, lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def rows_by_forms(forms: list[str], text: str) -> tuple[DataFrame, str]:
    """What stands in lines of these forms, by the number of the line, and the text
    without them.
    """
    rows = {}
    lowered = text.lower()
    for form in forms:
        words = re.findall(r"(?<![$\w|])[\w|]+", form.lower())
        # 30 times faster than the expression alone: 0.3 s for a program of 1.8 MB
        if not all(any(w in lowered for w in word.split("|")) for word in words):
            continue
        expression = expression_of(form)
        for match in expression.finditer(text):
            rows[match.start()] = match.groupdict()
        text = blanked(expression, text)
    if not rows:
        return NONE, text
    offsets = sorted(rows)
    numbers = [text.count("\n", 0, offset) + 1 for offset in offsets]
    return DataFrame([rows[offset] for offset in offsets], index=numbers), text


def program_blocks(path: Path, text: str) -> Iterator[Block]:
    """The tools, poses and moves in a program but for its remarks, of each maker that
    writes such lines. None of a long text.
    """
    if len(text) > LARGEST_PROGRAM:
        return
    for maker, robot in ROBOTS.items():
        rest = text
        for remark in robot.remarks:
            begin, end = map(re.escape, remark)
            # what ends it may be of a line that counts
            rest = blanked(rf"(?s){begin}.*?(?={end}|\Z)", rest)
        for kind in KINDS:
            # a listing of tools is no program: it has no text that programs have
            if robot.has not in text and kind != "tool":
                continue
            forms = [form for form, _ in getattr(robot, kind)]
            table, without = rows_by_forms(forms, rest)
            # a move may have a pose in it, which comes later; an offset is none
            if kind not in OF_MOVES or "x" in table:
                rest = without
            if len(table):
                titles = [*table.columns]
                table = table.set_axis(range(len(titles)), axis=1)
                columns = columns_titled(table, titles)
                yield Block(path, table, columns, maker, kind)
