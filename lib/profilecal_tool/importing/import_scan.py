"""A scan from files that people have: read, told what is what, paired, checked."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
from profilecal_tool.importing.pair_profiles import pair_profiles
from profilecal_tool.importing.questions import Layout, Question, of_entry, one_or_ask
from profilecal_tool.importing.read_file import is_known, tables_in_file
from profilecal_tool.importing.robot_poses import (
    Poses,
    labelled_by_pose,
    pose_entries,
    poses_of,
    robot_poses,
)
from profilecal_tool.importing.scanner_profiles import (
    Profiles,
    convert_to_mm,
    point_tables,
    read_profiles,
)
from profilecal_tool.importing.text_tables import Block, File, counted
from profilecal_tool.importing.tool_frames import entries_of_flange

NOTHING_SAID = Layout()


@dataclass(frozen=True)
class Source:
    """Files that are called alike but for numbers."""

    paths: list[Path]
    first: list[Block]  # what the first of them holds

    def each(self, encoding: str) -> Iterator[File]:
        """Each file and what it holds."""
        yield self.paths[0], self.first
        for path in watched(self.paths[1:], "reading"):
            yield path, tables_in_file(path, encoding)


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
    sources = sources_in(folder, layout)
    poses, profiles, others = tables_in(folder, sources, layout, taken)
    convert_to_mm(profiles, layout, taken)
    values = np.split(profiles.xz, np.cumsum(profiles.counts)[:-1])
    names = times_said(layout, profiles.names)
    pairing = pair_profiles(poses, names)
    taken["matched"] = pairing.how
    rows = pairing.rows
    if pairing.log:
        names = counted(len(rows))
    else:
        order = np.argsort(rows, kind="stable")
        order = order[rows[order] >= 0]
        rows = rows[order]
        values, names = ([those[k] for k in order] for those in (values, names))
        check_one_profile_a_pose(rows, names, profiles.path, layout)
    poses = replace(poses, table=poses.table.iloc[rows].assign(pose=names))
    entries = pose_entries(poses, taken)
    entries = entries_of_flange(entries, poses, layout, others, taken)
    if pairing.log:
        entries = in_sweeps(folder, entries, *pairing.log)
    return scan_of(folder, header | entries | measured_entries(values)), taken


def tables_in(
    folder: Path, sources: dict[str, Source], layout: Layout, taken: dict[str, str]
) -> tuple[Poses, Profiles, list[Path]]:
    """The robot's poses, the profiles, and other files, with the first of the profiles.

    Raises ScanError.
    """
    names = files_of_poses_and_profiles(folder, sources, layout)
    of_poses, of_profiles = (sources[name] for name in names)
    one_each = len(of_profiles.paths) > 1
    if of_poses is of_profiles and not one_each:
        blocks = [labelled_by_pose(block) for block in of_poses.first]
        of_poses = of_profiles = replace(of_poses, first=blocks)
    check_entry(layout, of_poses.first, of_profiles.first)
    beside = [block for source in sources.values() for block in source.first]
    poses = robot_poses([*of_poses.each(layout.encoding)], layout, beside)
    if of_poses is of_profiles:
        poses = poses.without_repeats()
    count = len(poses.table)
    files = of_profiles.each(layout.encoding)
    profiles = read_profiles(files, one_each, layout, count)
    used = {*of_poses.paths, *of_profiles.paths}
    every = (path for path in sorted(folder.rglob("*")) if path.is_file())
    left = [path for path in every if path not in used]
    programs = [b for b in beside if b.robot and b.robot == poses.block.robot]
    read = {block.path for block in programs if block.kind != "pose"}
    taken["left out"] = listed(p.name for p in left if p not in read) or "none"
    return poses, profiles, [*left, *of_poses.paths[1:], of_profiles.paths[0]]


def check_entry(
    layout: Layout, of_poses: list[Block], of_profiles: list[Block]
) -> None:
    """Raise ScanError where neither a pose nor a list is called as the entry said."""
    names = [*poses_of(of_poses, layout.pose_columns)]
    names += [table.name for table in point_tables(of_profiles, layout)]
    if names and not of_entry(names, layout.entry):
        raise ScanError(f"--entry is {layout.entry}; there are {listed(names)}")


def measured_entries(values: Sequence[ndarray]) -> dict[str, Any]:
    """Entries of a Scan: points, or profiles, of which one point is none."""
    if max(map(len, values)) == 1:
        return {"measured": "points", "values": tuple(values)}
    profiles = tuple(one if len(one) > 1 else one[:0] for one in values)
    return {"measured": "profiles", "values": profiles}


def sources_in(folder: Path, layout: Layout) -> dict[str, Source]:
    """The files of a folder, by pattern. Raises ScanError."""
    said = [pattern for pattern in (layout.poses, layout.profiles) if pattern]
    families = {pattern: files_matching(folder, pattern) for pattern in said}
    known = {path for paths in families.values() for path in paths}
    for path in files_matching(folder, "**/*") if len(said) < 2 else []:
        if path not in known and is_known(path):
            pattern = re.sub(r"\d+", "*", str(path.relative_to(folder)))
            families.setdefault(pattern, []).append(path)
    return {
        pattern: Source(paths, tables_in_file(paths[0], layout.encoding))
        for pattern, paths in families.items()
    }


def files_matching(folder: Path, pattern: str) -> list[Path]:
    """The files of a pattern, p2 before p10; or one elsewhere. Raises ScanError."""
    inside = [folder / name for name in glob(pattern, root_dir=folder, recursive=True)]
    paths = [path for path in inside or [Path(pattern)] if path.is_file()]
    if not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(paths, key=lambda p: re.sub(r"\d+", lambda d: d[0].zfill(20), str(p)))


def files_of_poses_and_profiles(
    folder: Path, sources: Mapping[str, Source], layout: Layout
) -> tuple[str, str]:
    """Which files hold the poses, and which the profiles. Raises Question."""
    first = {name: source.first for name, source in sources.items()}
    counts = {name: len(source.paths) for name, source in sources.items()}
    rows = {name: counts[name] * poses_in(first[name], layout) for name in first}
    with_poses = [n for n in first if rows[n] and n != layout.profiles]
    with_poses.sort(key=rows.get, reverse=True)
    if layout.poses:
        with_poses = [layout.poses]
    others = [n for n in sorted(counts, key=counts.get) if n not in with_poses]
    with_points = [n for n in others if point_tables(first[n], layout)]
    usual = [n for n in with_points if 2 * counts[n] > counts[with_points[-1]]]
    unclear = [n for n in others if n not in usual and first[n]]
    poses = one_or_ask(folder, with_poses or unclear[:1], "holds the poses", "poses")
    if layout.profiles:
        return poses, layout.profiles
    profiles = usual or [n for n in unclear if n != poses][-1:]
    beside = [poses] if point_tables(first[poses], layout) else []
    return poses, one_or_ask(folder, profiles or beside, "are the profiles", "profiles")


def poses_in(blocks: list[Block], layout: Layout) -> int:
    """How many poses the blocks of a file hold, of whatever has them."""
    by_name = poses_of(blocks, layout.pose_columns)
    return sum(len(one.table) for several in by_name.values() for one in several)


def times_said(layout: Layout, names: list[str]) -> list[str]:
    """The names of profiles, or when they were taken by --times."""
    if not layout.times:
        return names
    start, rate = layout.times
    if not 0 < rate < np.inf:
        expected = "expected s, and profiles a second"
        raise ScanError(f"--times is {start:g} {rate:g}; {expected}")
    return [f"{start + k / rate:.6f}" for k in range(len(names))]


def check_one_profile_a_pose(
    rows: ndarray, names: list[str], path: Path, layout: Layout
) -> None:
    """Raise Question where several profiles are of one pose, and no one said which."""
    again = np.flatnonzero(rows[1:] == rows[:-1])
    if len(again) and not layout.profiles:
        one, other = names[again[0]], names[again[0] + 1]
        parts = [w for w in re.findall(r"[a-zA-Z]*\d+", one) if w not in other]
        sentence = f"{one} and {other} are of one pose; which of them? (all: '*')"
        pattern = f"*{[*parts, one][0]}*{path.suffix}"
        raise Question(f"{path.parent}: {sentence}", profiles=pattern)


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
