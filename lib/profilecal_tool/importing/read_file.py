"""A file of any kind as blocks."""

import re
from collections.abc import Collection, Iterable
from pathlib import Path

from profilecal.scan.tables import ScanError, naming, text_of
from profilecal_tool.importing.array_files import binary_blocks, sheet_blocks
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.makers import ENCODINGS, FOREIGN
from profilecal_tool.importing.nested_lists import nested_blocks
from profilecal_tool.importing.program_lines import program_blocks
from profilecal_tool.importing.text_tables import BEGIN, text_blocks

SHEETS = {".xlsx", ".xlsm"}
BINARY = {".npy", ".npz", ".mat", ".ply"}
NESTED = {".json", ".yaml", ".yml"}
LARGEST_PROGRAM = 2_000_000  # characters


def tables_in_file(path: Path, encoding: str) -> Iterable[Block]:
    """The tables in a file. Raises ScanError."""
    suffix = path.suffix.lower()
    if suffix in SHEETS:
        return sheet_blocks(path)
    if suffix in BINARY:
        return binary_blocks(path)
    text = decoded_text(path, encoding)
    if suffix in NESTED:
        return nested_blocks(path, text)
    programs = [*program_blocks(path, text)] if len(text) < LARGEST_PROGRAM else []
    if any(block.kind != "uses" for block in programs):
        return programs
    with naming(path):
        return [*text_blocks(path, text.encode()), *programs]


def decoded_text(path: Path, encoding: str) -> str:
    """A file's text; where it is not UTF-8, and no one says what, in the encoding in
    which most words of other scripts are known titles or units. Raises ScanError.
    """
    try:
        return text_of(path, encoding=encoding)
    except ScanError as error:
        if encoding or not isinstance(error.__cause__, UnicodeDecodeError):
            raise
        begin = path.read_bytes()[:BEGIN]

    def words_known(name: str) -> int:
        """How many words are known, in this encoding."""
        words = re.findall(r"[^\W\d]+|°", begin.decode(name, "ignore").lower())
        return sum(word in FOREIGN for word in words)

    return text_of(path, encoding=max(ENCODINGS, key=words_known))


def names_of(paths: Collection[Path]) -> list[str]:
    """What files are called; with their folders where these tell them apart."""
    names = [path.stem for path in paths]
    if len({*names}) == len(names):
        return names
    return [f"{path.parent.name}/{path.stem}" for path in paths]


def is_known(path: Path) -> bool:
    """Whether a file can be read: it is no picture."""
    with path.open("rb") as file:
        begin = file.read(4096)
    is_text = begin[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" not in begin  # UTF-16
    return is_text or path.suffix.lower() in BINARY | SHEETS
