"""Which files a folder has, by the patterns of their names."""

import re
from collections.abc import Iterable
from glob import escape, glob
from pathlib import Path

from profilecal.scan.tables import ScanError

BINARY = {".npy", ".npz", ".mat", ".ply", ".pcd"}
SHEETS = {".xlsx", ".xlsm"}


def patterns_of(folder: Path, given: list[str]) -> dict[Path, str]:
    """The pattern of each file: the last of those given that takes it; or else its name
    with * for numbers, as scan_*.csv. Raises ScanError where there are no files.
    """
    patterns = {}
    for pattern in given:
        patterns |= dict.fromkeys(files_matching(folder, pattern), pattern)
    for path in sorted_files(folder, "**/*"):
        if path not in patterns and is_readable(path):
            patterns[path] = re.sub(r"\d+", "*", escape(str(path.relative_to(folder))))
    if not patterns:
        raise ScanError(f"{folder}: no files; is the folder right?")
    return patterns


def files_matching(folder: Path, pattern: str) -> list[Path]:
    """The files of a pattern in a folder; or one elsewhere. Raises ScanError."""
    paths = sorted_files(folder, pattern) or [Path(pattern)]
    if not paths[0].is_file():
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return paths


def sorted_files(folder: Path, pattern: str) -> list[Path]:
    """The files of a pattern in a folder, p2 before p10."""
    inside = glob(pattern, root_dir=folder, recursive=True)
    paths = filter(Path.is_file, map(folder.joinpath, inside))
    return sorted(paths, key=lambda p: re.sub(r"\d+", lambda d: d[0].zfill(20), str(p)))


def names_of(paths: Iterable[Path]) -> list[str]:
    """What files are called; with their folders where these tell them apart."""
    names = [path.stem for path in paths]
    if len({*names}) == len(names):
        return names
    return [f"{path.parent.name}/{path.stem}" for path in paths]


def is_readable(path: Path) -> bool:
    """Whether a file can be read: it is no picture."""
    with path.open("rb") as file:
        begin = file.read(4096)
    is_text = begin[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" not in begin  # UTF-16
    return is_text or path.suffix.lower() in BINARY | SHEETS
