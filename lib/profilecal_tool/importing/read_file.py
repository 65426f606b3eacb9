"""A file of any kind as blocks: text and sheets here, and what other modules read."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from pandas import DataFrame, read_excel

from profilecal.scan.tables import ScanError, naming, text_of
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.folder_files import BINARY, SHEETS
from profilecal_tool.importing.lists_and_arrays import binary_blocks, nested_blocks
from profilecal_tool.importing.makers import ENCODINGS, FOREIGN, WORDS
from profilecal_tool.importing.program_lines import OF_MOVES, program_blocks
from profilecal_tool.importing.text_tables import BEGIN, text_blocks

TOOL = rf"\b(?:{'|'.join(WORDS['tool'])})(?:\b|_)"
NOT_0 = r"(?<!\w)(?!(?<=\[)\d+\])[\d.-]*[1-9]"  # a number, which is no [index]
# a line that does not begin with a number and is not on a speed
TOOL_LINE = re.compile(rf"(?im)^(?![+-]?[\d.]+[\s,;]|.*speed).*{TOOL}.*{NOT_0}")
NESTED = {".json", ".jsonl", ".ndjson", ".yaml", ".yml"}


def blocks_in_file(path: Path, encoding: str) -> Iterable[Block]:
    """The blocks in a file. Raises ScanError."""
    suffix = path.suffix.lower()
    if suffix in SHEETS:
        return sheet_blocks(path)
    if suffix in BINARY:
        return binary_blocks(path)
    text = decoded_text(path, encoding)
    if suffix in NESTED:
        return nested_blocks(path, text)
    programs = [*program_blocks(path, text)]
    # poses, tools or bases in lines are a program's; moves alone may be beside a table
    if any(block.kind not in OF_MOVES for block in programs):
        return programs
    return [*tables_and_tool(path, text), *programs]


def tables_and_tool(path: Path, text: str, sheet: str = "") -> Iterator[Block]:
    """The blocks of a text, or of a sheet that was one; and an empty one, of a tool,
    where a line is on one. Raises ScanError.
    """
    with naming(path):
        for block in text_blocks(path, text):
            yield replace(block, sheet=sheet)
    if has_tool(text[:BEGIN]):
        yield Block(path, DataFrame(), [], kind="tool")


def has_tool(text: str) -> bool:
    """Whether a line says that there is a tool.

    >>> [has_tool(line) for line in ("# Tool: X 25.0, Y 0.0", "TCP,1")]
    [True, True]
    >>> [has_tool(line) for line in ("- TCP: Z 95.5", "2025-03-12 10:14 tcp_offset [9")]
    [True, True]
    >>> [has_tool(line) for line in ("# Tool: none", "Tool,0", "F_T_EE[1]", "1,tool,2")]
    [False, False, False, False]
    >>> has_tool("TCP speed: 100 mm/s")
    False
    """
    return bool(TOOL_LINE.search(text))


def decoded_text(path: Path, encoding: str) -> str:
    """A file's text; where it is not UTF-8, and no one says what, in the encoding in
    which most words are known. Raises ScanError.
    """
    try:
        return text_of(path, encoding=encoding)
    except ScanError:
        if encoding:
            raise
        begin = path.read_bytes()[:BEGIN]
        likely = max(ENCODINGS, key=lambda name: words_known(begin, name))
        return text_of(path, encoding=likely)


def words_known(begin: bytes, encoding: str) -> int:
    """How many words of other scripts a text has, in this encoding, that are titles or
    units.
    """
    words = re.findall(r"[^\W\d]+|°", begin.decode(encoding, "ignore").lower())
    return sum(word in FOREIGN for word in words)


def sheet_blocks(path: Path) -> Iterator[Block]:
    """The blocks of a workbook. Blank rows part the tables of a single sheet; in one of
    several they stay, as points that were not seen.

    Raises ScanError.
    """
    try:
        sheets = read_excel(path, sheet_name=None, header=None)
    except Exception as error:  # of the archive, of its XML, of pandas
        raise ScanError(f"{path}: no workbook: is it damaged?") from error
    for name, cells in sheets.items():
        text = cells.to_csv(sep=";", header=False, index=False)
        if len(sheets) == 1:
            text, name = re.sub("(?m)^;+$", "", text), ""
        yield from tables_and_tool(path, text, name)
