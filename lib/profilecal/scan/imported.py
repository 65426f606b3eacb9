"""A scan from files that people have: profiles in a file each or all in one, and the robot's poses in any text or
array. What is not said is guessed, and every guess is told."""

import re
from dataclasses import dataclass, replace
from glob import glob
from pathlib import Path
from statistics import mode

import numpy as np

from profilecal.scan.columns import names_and_units, read_poses, read_profiles, unit_of
from profilecal.scan.conventions import CONVENTIONS, Convention
from profilecal.scan.folder import FARTHEST_MM, MOUNTS, REACH_MM, SCALE, check_header, check_poses, scan_of
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import Table, listed

OF_POSES = re.compile(r"pose|(\b|_)rob|flange|tcp|\.(ls|dat|mod|script|rob)$", re.IGNORECASE)  # in a file's name
LABELS = ("pose", "name", "label", "id", "index", "file", "n")  # columns that tell profiles apart
MATRIX = "r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z"
USUAL = {8: "timestamp,x,y,z,qx,qy,qz,qw", 12: MATRIX, 16: f"{MATRIX},_,_,_,_"}  # by columns without names; TUM first


@dataclass(frozen=True)
class Layout:
    """What is said of the files; what is empty is guessed."""

    profiles: str = ""  # which files, as a shell pattern
    poses: str = ""  # which file
    columns: str = ""  # names or numbers, from 1, of x and z in a profile: "x,z" or "1 [mm],3 [mm]"
    pose_columns: str = ""  # what a pose's numbers are, in their order: "x [m],y [m],z [m],a,b,c"; "_" for no meaning
    entry: str = ""  # the list in a YAML or NPZ file that is the profile
    missing: float | None = None  # z where the scanner saw nothing
    mount: str = MOUNTS[0]


def import_scan(folder, kind: str, sizes: dict, layout: Layout = Layout()) -> tuple[Scan, list[str]]:
    """The scan of a target of some sizes, mm by name, in a folder of files; and what was guessed, a line each.

    Raises ScanError.
    """
    folder = Path(folder)
    target = {"kind": kind} | sizes
    header = check_header(folder, {"title": folder.resolve().name, "mount": layout.mount, "target": target})
    of_profiles, of_poses, left = sort_files(folder, layout)
    poses, convention = pose_table(of_poses, layout.pose_columns)
    names, profiles, of_axes = profiles_of(of_profiles, layout)
    values, taken = seen_in_mm(folder, profiles, of_axes, layout.missing)
    poses.columns["pose"], order, matched = match(poses, names)
    entries, taken_poses = taken_as(poses, convention)
    measured = "points" if max(map(len, values)) == 1 else "profiles"
    scan = scan_of(folder, header, entries, measured, tuple(values[k] for k in order))
    guessed = [
        f"poses      {of_poses.name}: {taken_poses}",
        f"of         {frame_of(poses)} (the sensor pose will be in the frame, flange or tool, that the poses are of)",
        f"profiles   {names_of(of_profiles)}: {taken}",
        f"matched    {matched}",
        f"target     {scan.description}",
        *([f"left out   {listed(left)}"] if left else []),
    ]
    return scan, guessed


def sort_files(folder: Path, layout: Layout) -> tuple[list[Path], Path, list[str]]:
    """The profiles, what holds the poses, and the names of other files."""
    profiles, every = files(folder, layout.profiles), files(folder, "*")
    named = [path for path in every if OF_POSES.search(path.name) and path not in profiles]
    poses = files(folder, layout.poses) or named
    if len(poses) != 1:
        found = f"{names_of(poses)} may all be" if poses else "no such folder, or nothing in it is named like"
        raise ScanError(f"{folder}: {found} the robot's poses; expected one file, a row for each: --poses FILE")
    others = [path for path in every if path not in poses]
    if not profiles and not others:
        raise ScanError(f"{folder}: no profiles beside {names_of(poses)}")
    families = [re.sub(r"\d+", "#", path.name) for path in others]  # files alike but for numbers belong together
    profiles = profiles or [path for path, family in zip(others, families, strict=True) if family == mode(families)]
    return profiles, poses[0], [path.name for path in others if path not in profiles]


def files(folder: Path, pattern: str) -> list[Path]:
    """The files of a shell pattern, p2 before p10. Raises ScanError if there are none of one that a user gave."""
    paths = [path for name in glob(pattern, root_dir=folder) if (path := folder / name).is_file()]
    if pattern.strip("*") and not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(paths, key=lambda path: re.sub(r"\d+", lambda digits: digits[0].zfill(20), path.name))


def names_of(paths: list[Path]) -> str:
    """Files in a few words."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} … {paths[-1].name}"


def pose_table(path: Path, said: str) -> tuple[Table, Convention]:
    """The poses in a file, with columns as conventions name them: as said, or as titles or usual numbers have them."""
    table = read_poses(path)
    units = table.units
    said = said or (USUAL.get(len(units), "") if all(map(str.isdigit, units)) else "")
    if said:
        titles = names_and_units(said.split(","))
        units = {name: unit or old for (name, unit), old in zip(titles.items(), units.values(), strict=False)}
    blocks = [convention for convention in CONVENTIONS if {*"xyz", *convention.columns} <= units.keys()]
    if len(blocks) != 1 or len(units) != len(table.columns):
        known = "; ".join(",".join(convention.columns) for convention in CONVENTIONS)
        text = f"say what they are, in their order: --pose-columns x,y,z and one of {known} (_ for others)"
        raise ScanError(f"{path}: {len(table.columns)} columns, {listed(table.columns)}; {text}")
    return replace(table, columns=dict(zip(units, table.columns.values(), strict=True)), units=units), blocks[0]


def match(poses: Table, names: list) -> tuple[list[str], list[int], str]:
    """The poses' labels, which profile each has, and how it was found: by its name or its last number, or by order."""
    of_poses = next((name for name in LABELS if name in poses.columns), None)
    if not of_poses or not isinstance(names[0], str):
        if len(names) != len(poses.lines):
            raise ScanError(f"{poses.path}: {len(names)} profiles for {len(poses.lines)} poses")
        return [str(name) for name in names], [*range(len(names))], "in order, the first pose with the first profile"
    known = {key: k for k, name in enumerate(names) for key in (last_number(name), name)}
    labels = [str(cell) for cell in poses.columns[of_poses]]
    found = [known.get(label, known.get(last_number(label))) for label in labels]
    if None in found:
        there = f"there are {names[0]} … {names[-1]}; expected the same numbers or names"
        raise ScanError(f"{poses.path}: no profile for pose {labels[found.index(None)]}; {there}")
    if spare := {*range(len(names))} - {*found}:
        raise ScanError(f"{poses.path}: no pose for profile {names[min(spare)]}")
    return labels, found, "by their names"


def last_number(name: str) -> int | str:
    """The last whole number in a name; the name if there is none."""
    found = re.findall(r"\d+", name)
    return int(found[-1]) if found else name


def taken_as(poses: Table, convention: Convention) -> tuple[dict, str]:
    """Entries of a Scan, and what the poses were taken for."""
    said = {name: poses.units[name] for name in convention.columns}
    angle = unit_of(poses.path, said, ("deg", "rad") if convention.sequence else ("1", "rad"))
    if angle == "rad" and convention.sequence:
        poses.columns.update(zip(said, np.degrees(poses.numbers(said)).T, strict=True))
    along = {axis: poses.units[axis] for axis in "xyz"}
    scale, lengths = to_mm(poses.path, along, poses.numbers("xyz"), REACH_MM[1] / 1000)
    meaning = f"{convention.meaning} ({', '.join(said)}{angle and f' in {angle}, as said'})"
    return check_poses(poses, scale), f"{len(poses.lines)}, {meaning}, {lengths}"


def frame_of(poses: Table) -> str:
    """What a FANUC robot's poses are of, or the flange. Raises ScanError where that differs between poses."""
    numbers = zip(poses.columns.get("ut", ()), poses.columns.get("uf", ()), strict=False)
    said = sorted({f"tool {tool} in user frame {frame}" for tool, frame in numbers})
    if len(said) > 1:
        raise ScanError(f"{poses.path}: poses of {' and of '.join(said)}; expected one for all")
    return said[0] if said else "the flange in the robot's base frame"


def profiles_of(paths: list[Path], layout: Layout) -> tuple[list, list[np.ndarray], dict[str, str]]:
    """The names of profiles, or numbers, their points (n, 2), and the columns of x and z with their units.

    In one table of all are rows that share a label.
    """
    tables = [table for path in paths for table in read_profiles(path, layout.entry)]
    first = tables[0]
    for table in tables:
        if table.units != first.units:
            there = f"columns {listed(table.units)}, where {first.path.name} has {listed(first.units)}"
            raise ScanError(f"{table.path}: {there}; say which files belong together: --profiles FILES")
    names, which = [path.stem for path in paths], None
    label = next((name for name in LABELS if name in first.columns), None)
    if len(tables) == 1 and label:
        names, which = np.unique(first.columns.pop(label), return_inverse=True)
    axes = x_and_z(tables, layout.columns)
    points = [table.numbers(axes, blank=True) for table in tables]
    if which is not None:
        points = [points[0][which == k] for k in range(len(names))]
    return list(names if len(names) == len(points) else range(len(points))), points, axes


def x_and_z(tables: list[Table], said: str) -> dict[str, str]:
    """The columns of x and z and their units: as said, of these names, or where there are no names, the two that vary.

    Raises ScanError.
    """
    first = tables[0]
    varying = [name for name in first.columns if len({cell for table in tables for cell in table.columns[name]}) > 1]
    axes = dict.fromkeys(varying if all(map(str.isdigit, varying)) else "xz", "")
    if said:
        axes = names_and_units(said.split(","))
    if not len(axes) == len(axes.keys() & first.columns) == 2 or (not said and "y" in varying):
        hint = "say which are x and z of a point: --columns x,z"
        raise ScanError(f"{first.path}: columns {listed(first.columns)}; {hint}")
    return {name: unit or first.units[name] for name, unit in axes.items()}


def seen_in_mm(folder: Path, profiles: list[np.ndarray], axes: dict, missing: float | None) -> tuple[list, str]:
    """The points (n, 2) of profiles, mm, NaN where nothing was seen, and what they were taken for."""
    points = np.concatenate(profiles)
    seen, z = ~np.isnan(points).any(axis=1), points[:, 1]
    if missing is None and {*np.sign(z[seen])} in ({0, 1}, {0, -1}):
        missing = 0.0
    seen &= z != missing
    points[~seen] = np.nan
    scale, lengths = to_mm(folder, axes, points, 1.0)
    points *= scale
    if not 1 <= np.nanmax(np.abs(points), initial=0) <= FARTHEST_MM:
        hint = f"expected 1 to {FARTHEST_MM:g} mm: is it the unit, or where nothing was seen (--missing)?"
        raise ScanError(f"{folder}: the profiles are {lengths}; {hint}")
    ranges = ", ".join(
        f"{axis} (column {name}) from {np.nanmin(values):.4g} to {np.nanmax(values):.4g} mm"
        for axis, name, values in zip("xz", axes, points.T, strict=True)
    )
    unseen = f"nothing seen in {(~seen).sum()} of them{'' if missing is None else f', where z is {missing:g}'}"
    values = np.split(points, np.cumsum([len(profile) for profile in profiles])[:-1])
    return values, f"{len(points)} points, {lengths}, {ranges}, {unseen}"


def to_mm(path: Path, units: dict, values, below: float) -> tuple[float, str]:
    """From a file's units to mm, and in words; metres if all is less than `below` and no title says."""
    largest = np.nanmax(np.abs(values), initial=0)
    said = unit_of(path, units, SCALE)
    unit = said or ("m" if largest < below else "mm")
    return SCALE[unit], f"in {unit} ({'as said, ' if said else ''}the largest is {largest:.10g})"
