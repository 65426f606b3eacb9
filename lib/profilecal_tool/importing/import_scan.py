"""A scan from files that people have: read, told what is what, paired, checked."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
    folder, target = Path(folder), {"kind": kind} | sizes
    said = {"title": folder.resolve().name, "mount": layout.mount, "target": target}
    header, _ = check_header(folder, said)
    taken = {}
    sources = sources_in(folder, layout, taken)
    of_poses, of_profiles = sorted_out(folder, sources, layout)
    poses, of_rows = joined([*sources[of_poses].files()], layout), None
    if of_poses == of_profiles:
        poses, of_rows = each_once(poses)
    files = sources[of_profiles]
    one_each, count = len(files.paths) > 1, len(poses.table)
    profiles = read_profiles(files.files(), one_each, layout, count, of_rows)
    left = [own for name, own in sources.items() if name not in (of_poses, of_profiles)]
    taken["left out"] = (
        listed(path.name for own in left for path in own.paths) or "none"
    )
    programs = text_near([sources[of_poses], *left]) if poses.robot else ""
    to_mm(profiles, layout, taken)
    values = np.split(profiles.xz, np.cumsum(profiles.counts)[:-1])
    names = times_said(layout, profiles.names)
    pairing = paired(poses, names)
    taken["matched"] = pairing.how
    if pairing.log:
        labels = [*map(str, range(1, len(pairing.rows) + 1))]
        poses = with_labels(poses, pairing.rows, labels)
    else:
        of_each = pairing.rows[order := in_order(pairing.rows)]
        values, names = [values[k] for k in order], [names[k] for k in order]
        check_once(of_each, names, files.paths[0], layout)
        poses = with_labels(poses, of_each, names)
    entries = entries_of(poses, layout, programs, taken)
    if pairing.log:
        entries = in_sweeps(folder, entries, *pairing.log)
    return scan_of(folder, header | entries | measured_of(values)), taken


def measured_of(values: Sequence[ndarray]) -> dict[str, Any]:
    """Entries of a Scan: points, or profiles, of which one point is none."""
    if max(map(len, values)) == 1:
        return {"measured": "points", "values": tuple(values)}
    profiles = tuple(one if len(one) > 1 else one[:0] for one in values)
    return {"measured": "profiles", "values": profiles}


def text_near(sources: Iterable[Source]) -> str:
    """The text of files that may be a program's."""
    paths = [(path, own.encoding) for own in sources for path in own.paths]
    near = [(path, encoding) for path, encoding in paths if is_text(path)]
    return "\n".join(text_of(path, encoding=encoding) for path, encoding in near)


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


def in_order(rows: ndarray) -> list[int]:
    """The profiles that have a pose, by the rows of their poses."""
    order = np.argsort(rows, kind="stable")
    return order[rows[order] >= 0].tolist()


def with_labels(poses: Poses, rows: ndarray, names: list[str]) -> Poses:
    """Some of the poses under their labels, or under names where these are more."""
    table = poses.table.iloc[rows]
    own = table.get("label", table["x"]).astype(str).tolist()
    is_named = "label" in table and len({*own}) == len(own)
    return replace(poses, table=table.assign(pose=own if is_named else names))


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
