"""What a user says of files, what is asked, and import.toml, which keeps it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copy
from typing import Annotated, Any

import numpy as np

from profilecal.scan.folder import read_header, write_scan
from profilecal.scan.scan import Scan, described
from profilecal.scan.tables import ScanError, new_folder, remove
from profilecal.scan.toml import (
    TEXT,
    check_entries,
    entries_of,
    number,
    numbers,
    read_toml,
    toml_text,
)
from profilecal.targets import TARGETS

FILE = "import.toml"
SIZES = {name for target in TARGETS.values() for name in target.size_names}

# what was taken for granted, by what it is about: poses, pose_columns, tool, matched,
# columns, unit, missing, files left out
Taken = dict[str, str]


class Question(ScanError):
    """What is not certain, and an answer: options by their names."""

    def __init__(self, sentence: str, **answer: Any) -> None:
        super().__init__(sentence)
        self.answer = answer


TwoNumbers = Annotated[Sequence[float] | None, numbers(2)]
SixNumbers = Annotated[Sequence[float] | None, numbers(6)]


@dataclass(frozen=True)
class Layout:
    """What is said of files; the names are those of options, and of import.toml."""

    poses: str = ""  # which files hold the robot's poses
    pose_columns: str = ""  # what its columns are: "x [m],y [m],z [m],w,p,r,_"
    entry: str = ""  # whose pose, or which list, if a file has several
    tool: SixNumbers = None  # that poses are of: mm; angles as the poses', or W, P, R
    profiles: str = ""  # which files are profiles, a pattern
    columns: str = ""  # of x and z: names, or numbers from 1, with units
    where: str = ""  # which rows: "sensor=0"
    x: TwoNumbers = None  # of z alone: start and pitch
    times: TwoNumbers = None  # of profiles in motion: start, rate
    unit: str = ""  # of profiles
    missing: Annotated[float | None, number(-1e10, 1e10)] = (
        None  # z where nothing was seen
    )
    encoding: str = ""  # of text
    mount: str = Scan.mount

    @property
    def wanted(self) -> tuple[str, str]:
        """The column of the rows that are wanted, and its value, in small letters."""
        name, _, value = self.where.lower().partition("=")
        return name, value


def ranges(axes: str, points: np.ndarray) -> str:
    """Where points (n, axes) are, mm: X 1.0 to 2.0, Z 3.0 to 4.0 mm."""
    pairs = zip(axes, points.T, strict=True)
    ends = [f"{axis} {np.nanmin(x):.1f} to {np.nanmax(x):.1f}" for axis, x in pairs]
    return f"{', '.join(ends)} mm"


def one_or_ask(place: Any, names: Sequence[str], what: str, option: str) -> str:
    """The one of some names. Raises ScanError for none, Question for several."""
    if not names:
        raise ScanError(
            f"{place}: no file {what} (text, Excel, JSON, YAML, NumPy, MATLAB, PLY or "
            f"PCD); --{option} FILES says which"
        )
    if len(names) > 1:
        answer = {option: names[0]}
        raise Question(f"{place}: which {what}: {' or '.join(names)}?", **answer)
    return names[0]


def read_answers(folder: Path) -> dict[str, Any]:
    """What import.toml in a scan folder says, by option. Raises ScanError."""
    path = folder / FILE
    if not path.is_file():
        return {}
    entries = read_toml(path)
    sizes = dict.fromkeys(SIZES, number())
    check_entries(path, entries, entries_of(Layout) | {"target": TEXT} | sizes)
    return entries


def write_imported(
    scan: Scan, folder: Path, said: Mapping[str, Any], taken: Taken
) -> None:
    """Write a scan as a folder with import.toml: what was said, and as remarks what was
    taken for granted. Over one that was imported before, whose scan.toml stays.

    Raises ScanError.
    """
    head = "# How these files were read. Edit, then: profilecal import DIR SCAN"
    remarks = "".join(f"# {name}: {words}\n" for name, words in taken.items())
    again = (folder / FILE).is_file()
    place = folder.with_name(f"{folder.name}.new") if again else folder
    with new_folder(place) as partial:
        write_scan(scan, partial)
        (partial / FILE).write_text(f"{head}\n{toml_text(said)}{remarks}", "utf-8")
        if again:
            keep_header(folder, partial)
    if again:
        remove(folder)
        place.replace(folder)


def keep_header(folder: Path, partial: Path) -> None:
    """Keep a folder's scan.toml, with what a user knows. Raises ScanError where it says
    another target.
    """
    former, new = (read_header(place / "scan.toml")[0] for place in (folder, partial))
    before, now = (
        f"{described(header['kind'], header['sizes'].values())}, {header['mount']}"
        for header in (former, new)
    )
    if before != now:
        raise ScanError(
            f"{folder / 'scan.toml'}: {before}, where {now} is said now; name a new "
            "folder"
        )
    copy(folder / "scan.toml", partial)


def options(answers: Mapping[str, Any]) -> list[str]:
    """The words that give these answers on the command line."""
    words = []
    for name, value in answers.items():
        words += [f"--{name.replace('_', '-')}", *map(str, np.atleast_1d(value))]
    return words
