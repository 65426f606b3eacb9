"""A file of any kind as blocks."""

import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from profilecal.scan.tables import ScanError, naming, shown, text_of
from profilecal_tool.importing.array_files import binary_blocks, sheet_blocks
from profilecal_tool.importing.makers import FOREIGN, WORDS
from profilecal_tool.importing.nested_lists import nested_blocks
from profilecal_tool.importing.program_lines import program_blocks
from profilecal_tool.importing.text_tables import (
    BEGIN,
    Block,
    text_blocks,
    with_continuations,
)

SHEETS = {".xlsx", ".xlsm"}
BINARY = {".npy", ".npz", ".mat", ".ply"}
NESTED = {".json", ".yaml", ".yml", ".jsonl"}
LARGEST_PROGRAM = 2_000_000  # characters
TOOL = re.compile(
    rf"(?<![^\W\d_])(?:{'|'.join(WORDS['tool'])})(?:_?(?:no|nr|number|name))?(?![a-z])"
    r"[^\w\n]*(\w*)(?![\s,;.]+-?\d)"
)
ENCODINGS = ("cp1252", "gb18030", "shift_jis", "big5", "cp949", "cp1251")


def tables_in_file(path: Path, encoding: str) -> list[Block]:
    """The tables in a file. Raises ScanError."""
    suffix = path.suffix.lower()
    if suffix in SHEETS:
        return [*sheet_blocks(path)]
    if suffix in BINARY:
        return [*binary_blocks(path)]
    text = decoded_text(path, encoding)
    if suffix in NESTED:
        return [*nested_blocks(path, text)]
    programs = [*program_blocks(path, text)] if len(text) < LARGEST_PROGRAM else []
    if any(block.kind != "uses" for block in programs):
        return programs
    content = text.encode()
    del text
    with naming(path):
        return [*with_continuations(text_blocks(path, content)), *programs]


def decoded_text(path: Path, encoding: str) -> str:
    """A file's text; where it is not UTF-8, and no one says what, in the encoding in
    which most known words stand in it. Raises ScanError.
    """
    try:
        return text_of(path, encoding=encoding)
    except ScanError as error:
        if encoding or not isinstance(error.__cause__, UnicodeDecodeError):
            raise
        begin = path.read_bytes()[:BEGIN]
        texts = {begin.decode(name, errors="ignore"): name for name in ENCODINGS}
        with suppress(ScanError):
            return text_of(path, encoding=texts[max(texts, key=known_words)])
        raise


def where_a_tool_is_said(paths: Iterable[Path]) -> str:
    """Where texts first speak of a tool that is not the flange, or ""."""
    for path in paths:
        with path.open("rb") as file:
            begin = file.read(LARGEST_PROGRAM).replace(b"\0", b"")
        is_text = path.suffix.lower() not in BINARY | SHEETS
        lines = begin.decode(errors="ignore").splitlines() if is_text else []
        for number, line in enumerate(lines, start=1):
            words = TOOL.findall(line.lower())
            if {*words} - WORDS["no_frame"]:
                return f"{path.name} line {number} says {shown(line.strip())}"
    return ""


def names_of(paths: Sequence[Path]) -> list[str]:
    """What files are called; with their folders where these tell them apart."""
    names = [path.stem for path in paths]
    if len({*names}) == len(names):
        return names
    return [f"{path.parent.name}/{path.stem}" for path in paths]


def known_words(text: str) -> int:
    """How many words of titles and units in other scripts a text has."""
    words = re.findall(r"[^\W\d]+|°", text.lower())
    return sum(word in FOREIGN for word in words)


def is_known(path: Path) -> bool:
    """Whether a file can be read: it is no picture."""
    with path.open("rb") as file:
        begin = file.read(4096)
    is_text = begin[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) or b"\0" not in begin
    return is_text or path.suffix.lower() in BINARY | SHEETS
