"""A scan from files that people have: profiles in a file each or all in one, and the
robot's poses in any text or array. What is not said is guessed, and every guess is
told.
"""

import re
from dataclasses import replace
from glob import glob
from pathlib import Path
from statistics import mode

import numpy as np
from numpy import ndarray

from profilecal.geometry.log import GAP
from profilecal.scan.folder import NO_POSES, check_header, scan_of
from profilecal.scan.motion import checked_log
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError, listed, naming
from profilecal_tool.importing.layout import NOTHING_SAID, Layout
from profilecal_tool.importing.makers import POSE_FILES, PROGRAM
from profilecal_tool.importing.pairing import driven, match, unit_s
from profilecal_tool.importing.poses import pose_table, taken_as
from profilecal_tool.importing.profiles import (
    check_one_scanner,
    profiles_of,
    read_profiles,
    seen_in_mm,
)
from profilecal_tool.importing.tables import encoding_of, names_of, rows_of, sheets_of


def import_scan(
    folder: str | Path, kind: str, sizes: dict, layout: Layout = NOTHING_SAID
) -> tuple[Scan, list[str]]:
    """The scan of a target of these sizes, mm by name, in a folder of files; and each
    guess. Raises ScanError.
    """
    folder = Path(folder)
    said = {
        "title": folder.resolve().name,
        "mount": layout.mount,
        "target": {"kind": kind} | sizes,
    }
    header, _ = check_header(folder, said)

    of_profiles, of_poses, left = sort_files(folder, layout)
    encoding = layout.encoding or encoding_of([*of_poses, *of_profiles])
    is_one_table = of_poses == of_profiles and len(sheets_of(of_poses[0])) < 2
    layout = replace(layout, encoding=encoding, in_one=is_one_table)
    poses, convention, guessed = pose_table(of_poses, layout, left)
    count = len(poses.lines)
    tables = [read_profiles(path, count, layout) for path in of_profiles]
    unit = unit_s(tables[0])
    of_one = count if len(tables) == 1 else 0
    names, *read = profiles_of(tables, of_one, layout, poses.columns)
    del tables
    values, taken_profiles = seen_in_mm(folder, *read, layout.missing)
    if layout.times:
        unit, names = 1.0, evenly(*layout.times, len(names))
    moving = driven(poses, names, convention.columns, unit)
    if moving:
        rows, t, times = moving
        labels = [*map(str, range(1, len(t) + 1))]
        poses = rows_of(poses, rows)
        poses.columns["pose"] = labels
        order = [*range(len(times))]
    elif layout.times:
        raise ScanError(
            f"{names_of(of_poses)}: no log of a robot in motion with the times of the "
            f"profiles, {names[0]} to {names[-1]} s (--times); expected a column t"
        )
    else:
        poses, order, matched = match(poses, names, convention.columns, left)
    entries, taken_poses, of, doubts = taken_as(poses, convention, layout)
    if moving:
        entries, matched = in_sweeps(folder, entries, t, times)

    measured = "points" if max(map(len, values)) == 1 else "profiles"
    if measured == "profiles":
        # one point is no profile
        values = [value if len(value) > 1 else value[:0] for value in values]
    by_pose = tuple(values[k] for k in order)
    if not moving and measured == "profiles":
        names = [str(names[k]) for k in order]
        check_one_scanner(folder, names, by_pose, entries["p_base_flange"])
    seen = {"measured": measured, "values": by_pose}
    scan = scan_of(folder, header | entries | seen)

    guesses = [
        f"poses      {names_of(of_poses)}: {taken_poses}",
        f"of         {of}",
        f"profiles   {names_of(of_profiles)}: {taken_profiles}",
        f"matched    {matched}",
        f"mount      {scan.mount} (--mount)",
        f"target     {scan.description}",
    ]
    if encoding:
        guesses.append(f"encoding   {encoding} (--encoding)")
    if left:
        guesses.append(f"left out   {listed(left)}")
    return scan, guesses + [f"note       {doubt}" for doubt in guessed + doubts]


def evenly(start: float, rate: float, count: int) -> list[str]:
    """The times of profiles, as a table would have them. Raises ScanError."""
    if not 0 <= start < np.inf or not 0 < rate < np.inf:
        raise ScanError(
            f"--times is {start:g} {rate:g}; expected the first profile's time, s by "
            "the scanner's clock, and profiles a second"
        )
    return [f"{start + k / rate:.6f}" for k in range(count)]


def in_sweeps(
    folder: Path, entries: dict, t: ndarray, times: ndarray
) -> tuple[dict, str]:
    """Entries of a Scan in motion, from those of the log's poses at times t (L,) and
    the profiles' times (P,), s; and what was taken for a sweep. Raises ScanError.
    """
    with naming(folder):
        log = checked_log(t, entries["R_base_flange"], entries["p_base_flange"])
        begins = np.diff(times, prepend=times[0]) > GAP * np.median(np.diff(times))
        sweeps = [f"s{number}" for number in np.cumsum(begins) + 1]
    moved = {"log": log, "times": times, "sweeps": tuple(sweeps)}
    moved |= NO_POSES | {"side": 0, "convention": entries["convention"]}
    how = (
        f"by time, in motion: {len(times)} profiles in {len({*sweeps})} sweeps, parted "
        f"where {GAP:g} profiles are missing; the delay of the clocks is to be found"
    )
    return moved, how


def sort_files(
    folder: Path, layout: Layout
) -> tuple[list[Path], list[Path], list[str]]:
    """The profiles, what holds the poses, and the names of other files.

    Files alike but for numbers belong together, and most are profiles; of two kinds
    with as many files each, the larger. A file alone holds both, and so may files in
    JSON.

    Raises ScanError where there are no profiles or no poses.
    """
    every = files(folder, "*")
    if len(every) < 2 or all(map(is_named, every)):
        every += files(folder, "*/*")
    may_hold_both = len(every) == 1 or {path.suffix for path in every} == {".json"}
    profiles, poses = files(folder, layout.profiles), files(folder, layout.poses)
    if not poses:
        rest = [path for path in every if path not in profiles]
        usual = mode(map(family, every)) if every else ""
        unlike = [path for path in rest if family(path) != usual]
        named = [*filter(is_named, rest)]
        alone = unlike if len(unlike) == 1 else rest if may_hold_both else []
        if 2 * len(unlike) == len(rest) and len({*map(family, rest)}) == 2:
            halves = unlike, [path for path in rest if path not in unlike]
            alone = min(halves, key=lambda paths: sum(p.stat().st_size for p in paths))
        poses = [path for path in named if path in unlike] or named or alone
    if not poses:
        raise ScanError(
            f"{folder}: no such folder, or nothing in it is named like the robot's "
            "poses; say what holds them: --poses FILE"
        )
    others = [path for path in every if path not in poses]
    if not profiles and not others and not may_hold_both:
        raise ScanError(f"{folder}: no profiles beside {names_of(poses)}")
    if not profiles:
        profiles = alike(folder, others) or poses
    return profiles, poses, [path.name for path in others if path not in profiles]


def alike(folder: Path, paths: list[Path]) -> list[Path]:
    """The most files in a folder that are called alike but for numbers; in all folders,
    if these are many; but for all but their ending, where no two are.

    Raises ScanError where as many are called otherwise.
    """
    for of in (
        lambda path: (path.parent, family(path)),
        family,
        lambda path: path.suffix,
    ):
        kinds = {}
        for path in paths:
            kinds.setdefault(of(path), []).append(path)
        most = max(map(len, kinds.values()), default=0)
        usual = [kind for kind in kinds.values() if len(kind) == most]
        if most > 1 and len(usual) < 5:
            break
    if len(usual) > 1 and len({kind[0].suffix for kind in usual}) == 1:
        firsts = [kind[0].relative_to(folder) for kind in usual]
        pattern = firsts[0].with_name(re.sub(r"\d+", "*", firsts[0].name))
        raise ScanError(
            f"{folder}: {' … or '.join(map(str, firsts))} …, as many files each, may "
            f"be the profiles; say which: --profiles '{pattern}'"
        )
    return usual[0] if usual else []


def is_named(path: Path) -> bool:
    """Whether a file is called like poses or a program."""
    return any(words.search(path.name) for words in (POSE_FILES, PROGRAM))


def family(path: Path) -> str:
    """What the names of files that belong together have in common."""
    return re.sub(r"\d+", "#", path.name)


def files(folder: Path, pattern: str) -> list[Path]:
    """The files of a shell pattern, p2 before p10; a file that is elsewhere, by its
    path.

    Raises ScanError if there are none of one that a user gave.
    """
    inside = [folder / name for name in glob(pattern, root_dir=folder)]
    places = inside or [Path(pattern)]
    paths = [path for path in places if path.is_file()]
    if pattern.strip("*/") and not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(
        paths,
        key=lambda path: re.sub(r"\d+", lambda digits: digits[0].zfill(20), str(path)),
    )
