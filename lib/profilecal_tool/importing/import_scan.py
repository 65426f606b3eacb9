"""From a folder of files to a scan, step by step."""

import re
from collections import ChainMap
from contextlib import nullcontext, suppress
from glob import escape, glob
from pathlib import Path

import numpy as np
from numpy import ndarray
from pandas import Series

from profilecal.geometry.log import GAP
from profilecal.geometry.progress import watched
from profilecal.scan.folder import NO_POSES, check_header, scan_of
from profilecal.scan.scan import Scan, checked_log
from profilecal.scan.tables import ScanError, listed, naming
from profilecal_tool.importing.blocks import Block, Files, Part, counted, label_of
from profilecal_tool.importing.pair_profiles import Times, pair_profiles
from profilecal_tool.importing.questions import Layout, Question, Taken, one_or_ask
from profilecal_tool.importing.read_file import blocks_in_file, is_readable
from profilecal_tool.importing.robot_poses import (
    Entries,
    pose_entries,
    poses_in,
    robot_poses,
)
from profilecal_tool.importing.scanner_profiles import (
    points_of_file,
    read_profiles,
    with_a_point_a_row,
)
from profilecal_tool.importing.tool_frames import (
    entries_of_flange,
    lines_of_program,
    of_one_tool,
    tools_in_data,
)

NOTHING_SAID = Layout()


def import_scan(
    folder: Path, kind: str, sizes: dict, layout: Layout = NOTHING_SAID
) -> tuple[Scan, Taken]:
    """The scan of a target of these sizes, mm by name, in a folder of files; and what
    was taken for granted, by what it is about.

    Raises ScanError; Question where it is uncertain.
    """
    target = {"kind": kind} | sizes
    said = {"title": folder.resolve().name, "mount": layout.mount, "target": target}
    header, _ = check_header(folder, said)
    taken = {}  # each step adds what it takes for granted
    poses, profiles, every = read_folder(folder, layout, taken)
    program = lines_of_program(every, poses.robot)
    program["tool"] += tools_in_data(every, poses)
    poses, tool = of_one_tool(poses, program, layout, taken)
    if poses.table.empty:
        raise ScanError(f"{poses.path}: no poses where {layout.where}")
    moves = [row.get("name") for row in program["uses"]]
    pairing = pair_profiles(poses, [*profiles.index], moves, layout)
    taken["matched"] = pairing.how
    if not all(profiles.index):
        profiles.index = counted(len(profiles))
    rows = Series(pairing.rows)  # its index says which profile
    if pairing.times:
        labels = counted(len(rows))  # a log's poses have no profiles
    else:
        rows = rows[rows >= 0].sort_values(kind="stable")
        profiles = profiles.iloc[rows.index]
        check_one_profile_a_pose(folder, rows.to_numpy(), profiles.index, layout)
        labels = [*profiles.index]
    entries = pose_entries(poses.rows_at(rows), labels, taken)
    if tool is not None:
        entries = entries_of_flange(entries, poses, tool, layout)
    if pairing.times:
        entries = in_sweeps(folder, entries, pairing.times)
    return scan_of(folder, header | entries | measured(profiles, taken)), taken


def measured(profiles: Series, taken: Taken) -> Entries:
    """Entries of a Scan: points; or profiles, which are empty if they have one point.

    What is empty is said of what is missing.
    """
    counts = profiles.map(len)
    if counts.max() == 1:
        return {"measured": "points", "values": tuple(profiles)}
    values = tuple(points if len(points) > 1 else points[:0] for points in profiles)
    if (counts < 2).any():
        taken["missing"] += f"; empty: {listed(profiles.index[counts < 2])}"
    return {"measured": "profiles", "values": values}


def read_folder(
    folder: Path, layout: Layout, taken: Taken
) -> tuple[Part, Series, list[Block]]:
    """The robot's poses, the profiles, and all that files hold. Raises ScanError."""
    families = families_in(folder, layout)
    of_poses, of_profiles = map(families.get, which_hold_what(folder, families, layout))
    files = ChainMap(*families.values())
    every = [block for blocks in files.values() for block in blocks]
    check_where(folder, every, layout)
    programs = {block.path for block in every if block.robot}
    unused = files.keys() - of_poses.keys() - of_profiles.keys() - programs
    taken["files left out"] = listed(sorted(path.name for path in unused)) or "none"
    poses = robot_poses(of_poses, layout)
    rows = len(poses.table)
    is_both = of_poses.keys() == of_profiles.keys()
    profiles = read_profiles(of_profiles, 0 if is_both else rows, layout, taken)
    counts = [*map(len, profiles)]
    if is_both and sum(counts) == rows:  # the pose of each profile's first row
        poses = poses.rows_at(np.cumsum([0, *counts[:-1]]))
    called = f"{poses.called} {profiles.name}".strip()
    if layout.entry.lower() not in called.lower():
        raise ScanError(f"{folder}: no entry {layout.entry}; those read are {called}")
    return poses, profiles, every


def families_in(folder: Path, layout: Layout) -> dict[str, Files]:
    """The files of a folder by what they are called but for numbers, as scan_*.csv, and
    by patterns that a user says; with their blocks, of the rows that are wanted, and
    with a point in each row. Where a user says both patterns, the other files may say
    what tool the poses have, and those that cannot be read are empty. Raises ScanError.
    """
    said = [pattern for pattern in (layout.poses, layout.profiles) if pattern]
    # a file of both patterns is of the one that has fewer
    said.sort(key=lambda name: -len(files_matching(folder, name)))
    paths = {path: name for name in said for path in files_matching(folder, name)}
    for path in sorted_files(folder, "**/*"):
        if path not in paths and is_readable(path):
            paths[path] = re.sub(r"\d+", "*", escape(str(path.relative_to(folder))))
    if not paths:
        raise ScanError(f"{folder}: no files; is the folder right?")
    families = {}
    for path, name in watched([*paths.items()], "reading"):
        blocks = families.setdefault(name, {})[path] = []
        is_beside = len(said) == 2 and name not in said  # and may be of any kind
        with suppress(ScanError) if is_beside else nullcontext():
            for block in blocks_in_file(path, layout.encoding):
                wanted = with_rows_wanted(block, layout)
                blocks.append(with_a_point_a_row(wanted, layout))
    for name in said:  # of the same files
        families.setdefault(name, families[said[-1]])
    return families


def files_matching(folder: Path, pattern: str) -> list[Path]:
    """The files of a pattern in a folder; or one elsewhere. Raises ScanError."""
    paths = sorted_files(folder, pattern) or [Path(pattern)]
    if not paths[0].is_file():
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return paths


def sorted_files(folder: Path, pattern: str) -> list[Path]:
    """The files of a pattern in a folder, p2 before p10."""
    inside = [folder / name for name in glob(pattern, root_dir=folder, recursive=True)]
    paths = filter(Path.is_file, inside)
    return sorted(paths, key=lambda p: re.sub(r"\d+", lambda d: d[0].zfill(20), str(p)))


def with_rows_wanted(block: Block, layout: Layout) -> Block:
    """A block with the rows that are wanted, if it has the column."""
    if block.kind != "pose":
        return block  # what moves use says which poses are not wanted
    name, value = layout.wanted
    for column in block.others:
        if name in (column.name, column.role) and value not in ("", "*"):
            cells = block.table[column.at]
            # 0 and 0.0 are both 0.0
            is_wanted = [value in (str(c).lower(), label_of(c).lower()) for c in cells]
            block = block.rows_at(is_wanted)
    return block


def check_where(folder: Path, blocks: list[Block], layout: Layout) -> None:
    """Raise ScanError where rows are wanted by a column that no block has."""
    names = {n for block in blocks for c in block.others for n in (c.name, c.role)}
    if layout.wanted[0] not in {*names, "", "tool", "base"}:
        known = f"the columns are {listed(sorted(names - {''}))}"
        raise ScanError(f"{folder}: no rows where {layout.where}; {known}")


def which_hold_what(
    folder: Path, families: dict[str, Files], layout: Layout
) -> tuple[str, str]:
    """Which files hold the poses, and which the profiles: as a user says, or else by
    the blocks in the first that has some::

        robot.csv (x, y, z, a, b, c), scan_*.csv (x, z)    robot.csv, scan_*.csv
        log.csv (tcp_x, …, tcp_c, laser_x, laser_z)        log.csv, log.csv
        poses.txt (1, …, 6), scan_*.csv (x, z)             poses.txt, scan_*.csv: the
                                                           former is asked about
                                                           later, by robot_poses

    Raises ScanError; Question where several may.
    """
    first = {n: next(filter(None, f.values()), []) for n, f in families.items()}
    # what no one has said, most files first
    free = [n for n in first if first[n] and n not in (layout.poses, layout.profiles)]
    free.sort(key=lambda name: -len(families[name]))
    of_poses = [n for n in free if poses_in(first[n], layout.pose_columns)]
    others = [n for n in free if n not in of_poses]
    # those of half as many files are something else, such as a reference
    most = [n for n in others if 2 * len(families[n]) > len(families[others[0]])]
    of_points = [n for n in most if points_of_file(first[n], layout)]
    # without titles: either, but poses are in the fewest files, which are asked about
    # first; and profiles are in those that are left
    unclear = [n for n in others if n not in of_points]
    of_poses = of_poses or [*reversed(unclear)]
    pose = layout.poses or one_or_ask(folder, of_poses, "holds the poses", "poses")
    of_points = of_points or [n for n in unclear if n != pose]
    # or all are in one file
    if not of_points and points_of_file(first[pose], layout):
        of_points = [pose]
    what = "holds the profiles (a pattern takes several)"
    profile = layout.profiles or one_or_ask(folder, of_points, what, "profiles")
    return pose, profile


def check_one_profile_a_pose(
    folder: Path, rows: ndarray, names: list[str], layout: Layout
) -> None:
    """Raise Question where several profiles are of one pose, and no one said which;
    ScanError where their names are labels in one file, of which no pattern tells some.
    """
    again = np.flatnonzero(rows[1:] == rows[:-1])
    if len(again) and not layout.profiles:
        one, other, *_ = names[again[0] :]
        words = re.findall(r"[a-zA-Z]+\d*|\d+", one)
        part = next((word for word in words if word not in other), one)
        sentence = f"{folder}: {one} and {other} are of one pose"
        if not sorted_files(folder, f"*{part}*"):
            raise ScanError(f"{sentence}; leave one out")
        every = re.sub(r"\d+", "*", f"{one}.*")
        raise Question(f"{sentence}; which? (all: '{every}')", profiles=f"*{part}*")


def in_sweeps(folder: Path, entries: Entries, both: Times) -> Entries:
    """Entries of a Scan in motion, from those of the log's poses. Raises ScanError."""
    times = both.profiles
    with naming(folder):  # a log's faults are said of arrays
        log = checked_log(both.log, entries["R_base_flange"], entries["p_base_flange"])
        begins = np.diff(times, prepend=times[0]) > GAP * np.median(np.diff(times))
        sweeps = [f"s{number}" for number in np.cumsum(begins) + 1]
    moved = {"log": log, "times": times, "sweeps": tuple(sweeps)}
    # no file says from which side a sweep was: all are of one
    return moved | NO_POSES | {"side": 0, "convention": entries["convention"]}
