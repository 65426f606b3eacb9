"""A file of any kind as blocks."""

from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Sequence
from pathlib import Path

from profilecal.scan.tables import ScanError, naming, text_of
from profilecal_tool.importing.answers import Question
from profilecal_tool.importing.arrays import binary_blocks, sheets
from profilecal_tool.importing.blocks import Block, encodings_of, text_blocks
from profilecal_tool.importing.nested import nested_blocks
from profilecal_tool.importing.programs import program_blocks

BINARY = {".npy", ".npz", ".mat", ".ply", ".xlsx", ".xlsm"}
NESTED = {".json", ".yaml", ".yml", ".jsonl"}
LARGEST_PROGRAM = 2_000_000  # characters


def read(path: Path, encoding: str) -> list[Block]:
    """The tables in a file. Raises ScanError."""
    suffix = path.suffix.lower()
    if suffix in BINARY:
        return [*(sheets if "xls" in suffix else binary_blocks)(path)]
    text = text_of(path, encoding=encoding)
    is_program = suffix not in NESTED and len(text) < LARGEST_PROGRAM
    programs = [*program_blocks(path, text)] if is_program else []
    if not programs and (suffix in NESTED or text.lstrip()[:1] in ("{", "[")):
        return [*nested_blocks(path, text)]
    content = text.encode()
    del text
    with naming(path):
        return programs or [*text_blocks(path, content)]


def is_text(path: Path) -> bool:
    """Whether a file is text, and no picture."""
    with path.open("rb") as file:
        begin = file.read(4096)
    return begin[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) or b"\0" not in begin


def is_known(path: Path) -> bool:
    """Whether a file can be read."""
    return path.suffix.lower() in BINARY or is_text(path)


def encoding_of(paths: Sequence[Path]) -> str:
    """The encoding of texts that are not UTF-8; "" where all are. Raises Question."""
    foreign = []
    for path in paths:
        if path.suffix.lower() in BINARY:
            continue
        try:
            text_of(path)
        except ScanError as error:
            if not isinstance(error.__cause__, UnicodeDecodeError):
                raise
            foreign.append(path.read_bytes())
    found = encodings_of(foreign)
    if foreign and len(found) != 1:
        known = " or ".join(found) or "in no encoding that is known"
        raise Question(
            f"{paths[0].parent}: text is not UTF-8 but {known}",
            encoding=[*found, "cp1252"][0],
        )
    return found[0] if foreign else ""
