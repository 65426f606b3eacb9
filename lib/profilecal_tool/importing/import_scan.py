"""A scan from files that people have: read, told what is what, paired, checked."""

import re
from collections.abc import Iterator, Mapping
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
from profilecal.scan.tables import ScanError, listed, naming, text_of
from profilecal_tool.importing.answers import Layout, Question, only
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.files import encoding_of, is_known, is_text, read
from profilecal_tool.importing.pairing import paired
from profilecal_tool.importing.poses import Poses, entries_of, joined, poses_of
from profilecal_tool.importing.profiles import read_profiles, tables_in, to_mm

NOTHING_SAID = Layout()


@dataclass(frozen=True)
class Source:
    """Files that are called alike but for numbers."""

    paths: list[Path]
    first: list[Block]  # what the first of them holds
    encoding: str

    def files(self) -> Iterator[tuple[Path, list[Block]]]:
        """Each file and what it holds."""
        yield self.paths[0], self.first
        for path in watched(self.paths[1:], "reading"):
            yield path, read(path, self.encoding)


def import_scan(
    folder: str | Path, kind: str, sizes: dict, layout: Layout = NOTHING_SAID
) -> tuple[Scan, dict[str, str]]:
    """The scan of a target of these sizes, mm by name, in a folder of files; and what
    was taken for granted, by option. Raises ScanError; Question where it is uncertain.
    """
    folder = Path(folder)
    said = {"title": folder.resolve().name, "mount": layout.mount}
    header, _ = check_header(folder, said | {"target": {"kind": kind} | sizes})
    taken = {}
    sources = sources_in(folder, layout, taken)
    of_poses, of_profiles = sorted_out(folder, sources, layout)
    poses = joined([*sources[of_poses].files()], layout)
    files = sources[of_profiles]
    one_each = len(files.paths) > 1
    of_rows = None
    if of_poses == of_profiles:
        poses, of_rows = each_once(poses)
    count = len(poses.table)
    profiles = read_profiles(files.files(), one_each, layout, count, of_rows)
    others = sources.keys() - {of_poses, of_profiles}
    left = [path for name in sorted(others) for path in sources[name].paths]
    near = filter(is_text, [*sources[of_poses].paths, *left])
    programs = ""
    if poses.robot:
        programs = "\n".join(text_of(path, encoding=files.encoding) for path in near)
    if left:
        taken["left out"] = listed(path.name for path in left)
    taken["profiles"] = f"{files.paths[0].name}{' …' * one_each}: {len(profiles.names)}"
    to_mm(profiles, layout, taken)
    values = np.split(profiles.xz, np.cumsum(profiles.counts)[:-1])
    names = times_said(layout, profiles.names)
    pairing = paired(poses, names)
    taken["matched"] = pairing.how
    order = np.argsort(pairing.rows, kind="stable")
    order = order[pairing.rows[order] >= 0]
    rows = pairing.rows[order]
    if pairing.log:
        labels, rows = [*map(str, range(1, len(order) + 1))], pairing.rows
    else:
        check_once(rows, [names[k] for k in order], files.paths[0], layout)
        labels = labels_for(poses, rows, [names[k] for k in order])
        values = [values[k] for k in order]
    own = replace(poses, table=poses.table.iloc[rows].assign(pose=labels))
    entries = entries_of(own, layout, programs, taken)
    if pairing.log:
        entries = in_sweeps(folder, entries, *pairing.log)
    measured = "points" if max(map(len, values)) == 1 else "profiles"
    if measured == "profiles":  # one point is none
        values = [one if len(one) > 1 else one[:0] for one in values]
    seen = {"measured": measured, "values": tuple(values)}
    return scan_of(folder, header | entries | seen), taken


def sources_in(
    folder: Path, layout: Layout, taken: dict[str, str]
) -> dict[str, Source]:
    """The files of a folder, by pattern. Raises ScanError."""
    patterns = {pattern for pattern in (layout.poses, layout.profiles) if pattern}
    families = {pattern: files(folder, pattern) for pattern in patterns}
    said = {path for paths in families.values() for path in paths}
    for path in files(folder, "**/*") if len(patterns) < 2 else []:
        pattern = re.sub(r"\d+", "*", str(path.relative_to(folder)))
        if path not in said and is_known(path):
            families.setdefault(pattern, []).append(path)
    every = [path for paths in families.values() for path in paths]
    encoding = layout.encoding or encoding_of(every)
    if encoding:
        taken["encoding"] = encoding
    return {
        pattern: Source(paths, read(paths[0], encoding), encoding)
        for pattern, paths in families.items()
    }


def files(folder: Path, pattern: str) -> list[Path]:
    """The files of a pattern, p2 before p10; or one elsewhere. Raises ScanError."""
    inside = [folder / name for name in glob(pattern, root_dir=folder, recursive=True)]
    paths = [path for path in inside or [Path(pattern)] if path.is_file()]
    if not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(paths, key=lambda p: re.sub(r"\d+", lambda d: d[0].zfill(20), str(p)))


def sorted_out(
    folder: Path, sources: Mapping[str, Source], layout: Layout
) -> tuple[str, str]:
    """Which files hold the poses, and which the profiles. Raises Question."""
    titles = layout.pose_columns
    of_poses = {name for name, own in sources.items() if poses_of(own.first, titles)}
    of_poses = {layout.poses} if layout.poses else of_poses - {layout.profiles}
    others = {n: own for n, own in sources.items() if n not in of_poses and own.first}
    found = {n: own for n, own in others.items() if tables_in(own.first, layout)}
    most = max((len(own.paths) for own in found.values()), default=0)
    found = [n for n, own in found.items() if 2 * len(own.paths) > most]
    of_profiles = [layout.profiles] if layout.profiles else found
    unclear = sorted(others.keys() - {*found}, key=lambda n: len(sources[n].paths))
    if not of_poses and not unclear:
        raise ScanError(f"{folder}: nothing in it is a table of poses: --poses FILE")
    of_poses = of_poses or {unclear.pop(0)}
    poses = only(folder, {n: n for n in sorted(of_poses)}, "holds the poses", "poses")
    rest = of_profiles or unclear[-1:]
    if not rest and not tables_in(sources[poses].first, layout):
        raise ScanError(f"{folder}: no profiles beside {poses}")
    rest = rest or [poses]
    return poses, only(folder, {n: n for n in rest}, "are the profiles", "profiles")


def each_once(poses: Poses) -> tuple[Poses, ndarray | None]:
    """The poses that stand beside points, each once; and which of them each row has,
    where they have neither labels nor times.
    """
    table = poses.table
    codes = table.groupby([*table], sort=False, dropna=False).ngroup()
    once = ~codes.duplicated()
    if once.all() or {"label", "time"} & {*table}:
        return replace(poses, table=table[once]), None
    table = table.assign(label=codes.astype(str))[once]
    return replace(poses, table=table), codes.to_numpy()


def times_said(layout: Layout, names: list[str]) -> list[str]:
    """The names of profiles, or when they were taken by --times."""
    if not layout.times:
        return names
    start, rate = layout.times
    if not 0 < rate < np.inf:
        raise ScanError(
            f"--times is {start:g} {rate:g}; expected s, and profiles a second"
        )
    return [f"{start + k / rate:.6f}" for k in range(len(names))]


def check_once(rows: ndarray, names: list[str], path: Path, layout: Layout) -> None:
    """Raise Question where several profiles are of one pose, and no one said which."""
    again = np.flatnonzero(rows[1:] == rows[:-1])
    if len(again) and not layout.profiles:
        one, other = names[again[0]], names[again[0] + 1]
        parts = [w for w in re.findall(r"[a-zA-Z]*\d+", one) if w not in other]
        raise Question(
            f"{path}: {one} and {other} are of one pose; which of them? (all: '*')",
            profiles=f"*{[*parts, one][0]}*{path.suffix}",
        )


def labels_for(poses: Poses, rows: ndarray, names: list[str]) -> list[str]:
    """The labels of poses; the names of profiles where these are more, or alone."""
    own = poses.table.get("label", poses.table.index).astype(str).to_numpy()[rows]
    is_named = "label" in poses.table and len({*own}) == len(own)
    return own.tolist() if is_named else names


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
