"""A scan from files that people have: profiles in a file each or all in one, and the
robot's poses in any text or array. What is not said is guessed, and every guess is
told.
"""

import re
from glob import glob
from pathlib import Path
from statistics import mode

from profilecal.scan.folder import check_header, scan_of
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError, listed
from profilecal_tool.importing.layout import NOTHING_SAID, Layout
from profilecal_tool.importing.makers import POSE_FILES
from profilecal_tool.importing.poses import frames_of, pose_table, taken_as
from profilecal_tool.importing.profiles import match, profiles_of, seen_in_mm
from profilecal_tool.importing.tables import names_of


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
    header = check_header(folder, said)

    of_profiles, of_poses, left = sort_files(folder, layout)
    poses, convention = pose_table(of_poses, layout)
    names, profiles, axes = profiles_of(of_profiles, len(poses.lines), layout)
    values, taken_profiles = seen_in_mm(folder, profiles, axes, layout.missing)
    poses.columns["pose"], order, matched = match(poses, names, left)
    entries, taken_poses = taken_as(poses, convention, layout.tool)

    measured = "points" if max(map(len, values)) == 1 else "profiles"
    if measured == "profiles":
        # one point is no profile
        values = [value if len(value) > 1 else value[:0] for value in values]
    by_pose = tuple(values[k] for k in order)
    scan = scan_of(folder, header, entries, measured, by_pose)

    of = "the flange (--tool if they are of a tool)"
    if layout.tool:
        of = "the tool given, taken off"
    guesses = [
        f"poses      {names_of(of_poses)}: {taken_poses}",
        f"of         {of}",
        f"profiles   {names_of(of_profiles)}: {taken_profiles}",
        f"matched    {matched}",
        f"mount      {scan.mount} (--mount)",
        f"target     {scan.description}",
    ]
    if left:
        guesses.append(f"left out   {listed(left)}")
    return scan, guesses + [
        f"note       {doubt}" for doubt in frames_of(poses, layout.mount, layout.tool)
    ]


def sort_files(
    folder: Path, layout: Layout
) -> tuple[list[Path], list[Path], list[str]]:
    """The profiles, what holds the poses, and the names of other files.

    Raises ScanError where there are no profiles or no poses.
    """
    profiles = files(folder, layout.profiles)
    every = files(folder, "*")
    poses = files(folder, layout.poses) or [
        path for path in every if POSE_FILES.search(path.name) and path not in profiles
    ]
    if not poses:
        raise ScanError(
            f"{folder}: no such folder, or nothing in it is named like the robot's "
            "poses; say what holds them: --poses FILE"
        )
    others = [path for path in every if path not in poses]
    if not profiles and not others:
        raise ScanError(f"{folder}: no profiles beside {names_of(poses)}")
    if not profiles:
        # files alike but for numbers belong together
        families = [re.sub(r"\d+", "#", path.name) for path in others]
        largest = mode(families)
        profiles = [
            path
            for path, family in zip(others, families, strict=True)
            if family == largest
        ]
    return profiles, poses, [path.name for path in others if path not in profiles]


def files(folder: Path, pattern: str) -> list[Path]:
    """The files of a shell pattern, p2 before p10.

    Raises ScanError if there are none of one that a user gave.
    """
    places = [folder / name for name in glob(pattern, root_dir=folder)]
    paths = [path for path in places if path.is_file()]
    if pattern.strip("*") and not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(paths, key=in_order_of_numbers)


def in_order_of_numbers(path: Path) -> str:
    """What sorts files so that p2 comes before p10."""
    return re.sub(r"\d+", lambda digits: digits[0].zfill(20), path.name)
