"""A scan from files that people have: read, told what is what, paired, checked."""

import re
from dataclasses import replace
from glob import glob
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.geometry.log import GAP
from profilecal.geometry.progress import watched
from profilecal.scan.folder import NO_POSES, check_header, scan_of
from profilecal.scan.motion import checked_log
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError, listed, naming
from profilecal_tool.importing.blocks import Block, Part, counted
from profilecal_tool.importing.pair_profiles import pair_profiles
from profilecal_tool.importing.questions import Layout, Question, one_or_ask
from profilecal_tool.importing.read_file import is_known, tables_in_file
from profilecal_tool.importing.robot_poses import pose_entries, poses_in, robot_poses
from profilecal_tool.importing.scanner_profiles import (
    point_tables,
    read_profiles,
    with_a_point_a_row,
)
from profilecal_tool.importing.tool_frames import (
    entries_of_flange,
    of_one_tool,
    said_in_program,
)

NOTHING_SAID = Layout()


Files = dict[Path, list[Block]]  # files, and the tables in each


def import_scan(
    folder: str | Path, kind: str, sizes: dict, layout: Layout = NOTHING_SAID
) -> tuple[Scan, dict[str, str]]:
    """The scan of a target of these sizes, mm by name, in a folder of files; and what
    was taken for granted, by option. Raises ScanError; Question where it is uncertain.
    """
    folder, target = Path(folder), {"kind": kind} | sizes
    said = {"title": folder.resolve().name, "mount": layout.mount, "target": target}
    header, _ = check_header(folder, said)
    taken = {}
    poses, names, values, beside = read_folder(folder, layout, taken)
    poses, tool = of_one_tool(poses, beside, layout, taken)
    moves = (name for (name,) in said_in_program(poses, beside, "uses", ["name"]))
    rows, log, taken["matched"] = pair_profiles(poses, names, moves, layout)
    if not log:
        order = np.argsort(rows, kind="stable")
        order = order[rows[order] >= 0]
        rows, names = rows[order], [names[k] for k in order]
        values = [values[k] for k in order]
        check_one_profile_a_pose(folder, rows, names, layout)
    labels = counted(len(rows)) if log else names
    entries = pose_entries(poses.at(rows), labels, layout, taken)
    if tool is not None:
        entries = entries_of_flange(entries, poses, tool, layout)
    if log:
        entries = in_sweeps(folder, entries, *log)
    measured = "points" if max(map(len, values)) == 1 else "profiles"
    if measured == "profiles":  # one point is none
        values = [one if len(one) > 1 else one[:0] for one in values]
    entries = header | entries | {"measured": measured, "values": tuple(values)}
    return scan_of(folder, entries), taken


def read_folder(
    folder: Path, layout: Layout, taken: dict[str, str]
) -> tuple[Part, list[str], list[ndarray], list[Block]]:
    """The robot's poses; the names of the profiles, and their points; and what all
    files hold. Raises ScanError, Question.
    """
    families = families_in(folder, layout)
    poses_called, profiles_called = which_hold_what(folder, families, layout)
    of_poses, of_profiles = families[poses_called], families[profiles_called]
    every = {
        path: blocks for files in families.values() for path, blocks in files.items()
    }
    beside = [block for blocks in every.values() for block in blocks]
    columns = {"tool", "base", *(c.name for block in beside for c in block.others)}
    if layout.where and layout.where.lower().partition("=")[0] not in columns:
        sentence = f"no rows where {layout.where}; the columns are"
        raise ScanError(f"{folder}: {sentence} {listed(sorted(columns))}")
    used = {*of_poses, *of_profiles, *(block.path for block in beside if block.robot)}
    taken["left out"] = listed(p.name for p in every if p not in used) or "none"
    poses = robot_poses(of_poses, layout)
    rows = len(poses.block.table)
    in_one = of_poses is of_profiles and len(of_poses) == 1
    several = 0 if in_one else rows
    names, values = read_profiles(of_profiles, several, layout, taken)
    counts = [*map(len, values)]
    if in_one and sum(counts) == rows:  # of one table: the pose of the first row
        poses = poses.at(np.cumsum([0, *counts[:-1]]))
    return poses, names, values, beside


def families_in(folder: Path, layout: Layout) -> dict[str, Files]:
    """The files of a folder by what they are called but for numbers, and by patterns
    that a user says. Raises ScanError.
    """
    said = [pattern for pattern in (layout.poses, layout.profiles) if pattern]
    paths = {path: name for name in said for path in files_matching(folder, name)}
    if len(said) < 2:
        for path in files_matching(folder, "**/*"):
            if path not in paths and is_known(path):
                paths[path] = re.sub(r"\d+", "*", str(path.relative_to(folder)))
    families = {}
    for path, name in watched([*paths.items()], "reading"):
        families.setdefault(name, {})[path] = blocks_in(path, layout)
    return families


def files_matching(folder: Path, pattern: str) -> list[Path]:
    """The files of a pattern, p2 before p10; or one elsewhere. Raises ScanError."""
    inside = [folder / name for name in glob(pattern, root_dir=folder, recursive=True)]
    paths = [path for path in inside or [Path(pattern)] if path.is_file()]
    if not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(paths, key=lambda p: re.sub(r"\d+", lambda d: d[0].zfill(20), str(p)))


def blocks_in(path: Path, layout: Layout) -> list[Block]:
    """The tables in a file, of one with the column that was said the rows wanted, and
    with a point in each row. Raises ScanError.
    """
    name, _, value = layout.where.lower().partition("=")
    blocks = tables_in_file(path, layout.encoding)
    for k, block in enumerate(blocks):
        for at in (column.at for column in block.others if column.name == name):
            is_wanted = block.table[at].astype(str).str.lower() == value
            if not is_wanted.any():
                raise ScanError(f"{path}: no rows where {layout.where}")
            blocks[k] = block = replace(block, table=block.table[is_wanted])
        blocks[k] = with_a_point_a_row(block, layout)
    return blocks


def which_hold_what(
    folder: Path, families: dict[str, Files], layout: Layout
) -> tuple[str, str]:
    """Which files hold the poses, and which the profiles. Raises Question."""
    first = {
        name: next(filter(None, files.values()), []) for name, files in families.items()
    }
    count = {name: len(families[name]) for name, blocks in first.items() if blocks}
    names = sorted(count, key=count.get, reverse=True)
    poses = [n for n in names if poses_in(first[n], layout.pose_columns)]
    poses = [n for n in poses if n != layout.profiles]
    others = [name for name in names if name not in poses]
    profiles = [name for name in others if point_tables(first[name], layout)]
    profiles = [n for n in profiles if 2 * count[n] > count[profiles[0]]]
    unclear = [name for name in others if name not in profiles]
    poses = [layout.poses] if layout.poses else poses or unclear[-1:]
    pose = one_or_ask(folder, poses, "holds the poses", "poses")
    profiles = profiles or [name for name in unclear if name != pose][:1]
    if not profiles and point_tables(first[pose], layout):
        profiles = [pose]
    profiles = [layout.profiles] if layout.profiles else profiles
    return pose, one_or_ask(folder, profiles, "are the profiles", "profiles")


def check_one_profile_a_pose(
    folder: Path, rows: ndarray, names: list[str], layout: Layout
) -> None:
    """Raise Question where several profiles are of one pose, and no one said which."""
    again = np.flatnonzero(rows[1:] == rows[:-1])
    if len(again) and not layout.profiles:
        one, other = names[again[0]], names[again[0] + 1]
        parts = [w for w in re.findall(r"[a-zA-Z]*\d+", one) if w not in other]
        sentence = f"{one} and {other} are of one pose; which of them? (all: '*')"
        raise Question(f"{folder}: {sentence}", profiles=f"*{[*parts, one][0]}*")


def in_sweeps(
    folder: Path, entries: dict[str, Any], t: ndarray, times: ndarray
) -> dict[str, Any]:
    """Entries of a Scan in motion, from those of the log's poses at times t (L,) and
    the profiles' times (P,), s. Raises ScanError.
    """
    with naming(folder):
        log = checked_log(t, entries["R_base_flange"], entries["p_base_flange"])
        begins = np.diff(times, prepend=times[0]) > GAP * np.median(np.diff(times))
        sweeps = [f"s{number}" for number in np.cumsum(begins) + 1]
    moved = {"log": log, "times": times, "sweeps": tuple(sweeps)}
    return moved | NO_POSES | {"side": 0, "convention": entries["convention"]}
