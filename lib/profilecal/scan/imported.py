"""A scan from files that people have: a folder with one profile file for each pose, and the robot's poses in a table, a
FANUC listing, or a file each. What is not said is guessed, and every guess is told."""

import re
from dataclasses import dataclass
from glob import glob
from pathlib import Path

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from profilecal.geometry.poses import carry, inverse
from profilecal.scan.columns import ANGLES, LENGTHS, nameless, names_and_units, read_columns, unit_of, unnamed
from profilecal.scan.conventions import CONVENTIONS, find_convention, named, to_rotations
from profilecal.scan.folder import FARTHEST_MM, REACH_MM, check_header, check_poses, scan_of
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import Table, listed

OF_POSES = re.compile(r"pose|robot|flange|tcp|calib|\.ls$", re.I)  # in a file's name
LABELS = ("pose", "name", "label", "id", "index", "file", "n")  # columns that say which profile a pose has
OF_A_POSE = ["x", "y", "z", *(name for convention in CONVENTIONS for name in convention.columns)]
MATRIX = {k: "r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z" + ",_" * (k - 12) for k in (12, 16)}
UNITS = {"deg": ANGLES, "rad": ("rad",), "1": ("1", "-")}  # in titles, by a convention's unit
FRAMES = {"uf": "user frame", "ut": "tool"}
FIXED = r"^(uf|ut|e\d|gp\d.*)$"  # columns of frames and external axes
STANDSTILL = 0.01  # mm or degrees by which an axis that stands still may tremble


@dataclass(frozen=True)
class Layout:
    """What is said of the files; what is empty is guessed."""

    profiles: str = ""  # which files, as a shell pattern
    poses: str = ""  # which file or files
    columns: str = ""  # names or numbers, from 1, of x and z in a profile: "x,z"
    pose_columns: str = ""  # a pose table's columns in order, names with or without units, "_" for no meaning
    entry: str = ""  # the list in a YAML or NPZ file that is the profile
    units: str = ""  # of the profiles: mm, cm, m or um
    pose_units: str = ""  # of the poses' positions
    missing: float | None = None  # z where the scanner saw nothing
    tool: tuple[float, ...] | None = None  # x, y, z, mm, and three angles of the poses' frame, in the flange's


def import_scan(folder, kind: str, sizes: dict, layout: Layout = Layout()) -> tuple[Scan, list[str]]:
    """The scan of a target of some sizes, mm by name, in a folder of files; and what was guessed, a line each.

    Raises ScanError.
    """
    folder = Path(folder)
    header = check_header(folder, {"title": folder.resolve().name, "target": {"kind": kind} | sizes})
    profiles, of_poses, left = sort_files(folder, layout)
    poses, units = pose_table(of_poses, layout)
    poses, profiles, matched = match(poses, of_poses, profiles)
    entries, taken_poses, doubts = read_poses(folder / names_of(of_poses), poses, units, layout)
    measured, values, taken = read_profiles(profiles, layout)
    scan = scan_of(folder, header, entries, doubts, measured, values)
    guessed = [
        f"poses      {names_of(of_poses)}: {taken_poses}",
        f"of         {'the tool given, taken off' if layout.tool else 'the flange (--tool if they are of a tool)'}",
        f"profiles   {names_of(profiles)}: {taken}",
        f"matched    {matched}",
        f"target     {scan.description}",
        *([f"left out   {listed(left)}"] if left else []),
        *(f"note       {doubt}" for doubt in scan.warnings),
    ]
    return scan, guessed


def sort_files(folder: Path, layout: Layout) -> tuple[list[Path], list[Path], list[str]]:
    """The profiles, what holds the poses, and the names of other files. Files alike but for numbers belong together."""
    profiles, poses = files(folder, layout.profiles), files(folder, layout.poses)
    families = {}
    for path in files(folder, "*"):
        if path not in (*profiles, *poses):
            families.setdefault(re.sub(r"\d+", "#", path.name), []).append(path)
    if not poses:
        likely = [family for family in families if OF_POSES.search(family)]
        if len(likely) != 1:
            found = f"{listed(likely)} may all be" if likely else "no such folder, or nothing in it is named like"
            raise ScanError(f"{folder}: {found} the robot's poses; say which: --poses FILE")
        poses = families.pop(likely[0])
    if not profiles:
        if not families:
            raise ScanError(f"{folder}: no profiles beside {names_of(poses)}")
        profiles = families.pop(max(families, key=lambda family: len(families[family])))
    return profiles, poses, [path.name for family in families.values() for path in family]


def files(folder: Path, pattern: str) -> list[Path]:
    """The files of a shell pattern, p2 before p10. Raises ScanError if there are none of one that a user gave."""
    paths = [path for name in glob(pattern, root_dir=folder) if (path := folder / name).is_file()]
    if pattern.strip("*") and not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(paths, key=lambda path: re.sub(r"\d+", lambda number: number[0].zfill(20), path.name))


def names_of(paths: list[Path]) -> str:
    """Files in a few words."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} … {paths[-1].name}"


def read_alike(paths: list[Path], turned, entry: str = "") -> tuple[list[pd.DataFrame], dict[str, str]]:
    """The tables in files, `turned` as they should lie, whose columns must be the same; and the columns' units."""
    tables = [turned(read_columns(path, entry)) for path in paths]
    for path, table in zip(paths, tables, strict=True):
        if [*table] != [*tables[0]]:
            raise ScanError(f"{path}: columns {listed(table)}, where {paths[0].name} has {listed(tables[0])}")
    units = names_and_units(tables[0])
    return [table.set_axis([*units], axis=1) for table in tables], units


def in_a_row(table: pd.DataFrame) -> pd.DataFrame:
    """A matrix as one row."""
    return unnamed(table.to_numpy().reshape(1, -1)) if table.shape in ((3, 4), (4, 4)) else table


def in_columns(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of x and z as columns."""
    return unnamed(table.to_numpy().T) if len(table) <= 3 < table.shape[1] and nameless(table) else table


def pose_table(paths: list[Path], layout: Layout) -> tuple[pd.DataFrame, dict[str, str]]:
    """The poses in a table or a listing, or in files of one each, with columns as conventions name them; and units."""
    tables, units = read_alike(paths, in_a_row)
    poses = pd.concat(tables)
    if len(tables) > 1:
        poses.index = pd.RangeIndex(1, len(poses) + 1, name="row")
    where, k = paths[0].parent / names_of(paths), poses.shape[1]
    if layout.pose_columns or nameless(poses):
        titles = re.findall("[^,]+", layout.pose_columns or MATRIX.get(k, ""))
        if len(titles) != k:
            examples = "--pose-columns x,y,z,a,b,c or x,y,z,qw,qx,qy,qz"
            raise ScanError(f"{where}: {k} columns and {len(titles)} names for them; say what they are: {examples}")
        said = names_and_units(titles)
        units = {name: unit or units[old] for (name, unit), old in zip(said.items(), poses, strict=True)}
        poses = poses.set_axis([*units], axis=1).loc[:, [title.strip() != "_" for title in titles]]
    if missing := [name for name in "xyz" if name not in poses]:
        raise ScanError(f"{where}: no column {missing[0]}; there are {listed(poses)} (--pose-columns)")
    return poses, units


def match(poses: pd.DataFrame, of_poses: list[Path], profiles: list[Path]) -> tuple[pd.DataFrame, list[Path], str]:
    """The poses with labels, the profile of each, and how it was found: by its name or its last number, or by order."""
    folder, source = profiles[0].parent, names_of(of_poses)
    by_number = {last_number(path.stem): path for path in profiles}
    by_name = by_number | {name: path for path in profiles for name in (path.name, path.stem)}
    labels = [path.stem for path in of_poses] if len(of_poses) == len(poses) > 1 else None
    for name, column in poses.drop(columns=OF_A_POSE, errors="ignore").items():
        if name in LABELS or not is_numeric_dtype(column) or {*column} == by_number.keys():
            labels = [str(cell).removesuffix(".0") for cell in column]
            break
    found = [by_name.get(name, by_name.get(last_number(name))) for name in labels] if labels else profiles
    if None in found:
        all_in_one = f"; if {profiles[0].name} holds them all, write a scan folder (data/README.md) instead"
        missing = f"{folder}: no profile for pose {labels[found.index(None)]} of {source}"
        raise ScanError(missing + all_in_one * (len(profiles) == 1))
    if spare := [path for path in profiles if path not in found]:
        raise ScanError(f"{spare[0]}: no such pose in {source}")
    if len({*found}) != len(poses):
        raise ScanError(f"{folder}: {len(profiles)} profiles ({names_of(profiles)}) and {len(poses)} poses ({source})")
    how = "by their names" if labels else "in order, the first pose with the first profile"
    return poses.assign(pose=labels or [path.stem for path in found]), found, how


def last_number(name: str) -> int | str:
    """The last whole number in a name; the name if there is none."""
    found = re.findall(r"\d+", name)
    return int(found[-1]) if found else name


def read_poses(path: Path, poses: pd.DataFrame, units: dict, layout: Layout) -> tuple[dict, str, list[str]]:
    """Entries of a Scan, what the poses were taken for, and doubts about them."""
    try:
        convention = find_convention(poses)
    except ValueError as error:
        raise ScanError(f"{path}: {error}; say what the columns are: --pose-columns") from error
    table = from_frame(path, poses.filter(items=["pose", *OF_A_POSE]))
    angle = unit_of(path, units, convention.columns, UNITS[convention.unit])
    if angle == "rad" and convention.unit != "rad":
        degrees = np.degrees(table.numbers(convention.columns)).T
        table.columns.update(zip(convention.columns, degrees, strict=True))
    largest = np.abs(table.numbers("xyz")).max()
    scale, lengths = to_mm(path, units, "xyz", layout.pose_units, largest, REACH_MM[1] / 1000)
    entries, doubts = check_poses(table, scale)
    called = convention.name if convention.sequence else ", ".join(name for name in poses if name in convention.columns)
    if angle in ANGLES:
        called, doubts = f"{called} in {angle}, as the file says", []
    if layout.tool:
        of_tool = convention if convention.sequence else named("FANUC angles")
        back = inverse(to_rotations(of_tool, [layout.tool[3:]])[0], np.array(layout.tool[:3]))
        R, T = entries["R_base_flange"], entries["T_base_flange"]
        entries |= {"R_base_flange": R @ back[0], "T_base_flange": carry(R, T, back[1]), "orientation": None}
    return entries, f"{len(poses)}, {convention.meaning} ({called}){frames(path, poses)}, {lengths}", doubts


def from_frame(path: Path, frame: pd.DataFrame) -> Table:
    """The table in a frame whose index says where a row is in a file."""
    return Table(path, {name: frame[name].tolist() for name in frame}, [*frame.index], frame.index.name or "line")


def frames(path: Path, poses: pd.DataFrame) -> str:
    """The robot's frames and external axes, in words. Raises ScanError where one of them differs between poses."""
    told = ""
    for name, cells in poses.filter(regex=FIXED).items():
        what = FRAMES.get(name, f"external axis {name}")
        still = is_numeric_dtype(cells) and np.ptp(cells) <= STANDSTILL
        if not still and cells.nunique(dropna=False) > 1:
            raise ScanError(f"{path}: the {what} differs between poses; expected one for all")
        told += f", {what} {poses.round(1)[name].iloc[0]}".removesuffix(".0")
    return told


def read_profiles(paths: list[Path], layout: Layout) -> tuple[str, tuple[np.ndarray, ...], str]:
    """Whether files hold profiles or points, what they hold in mm, NaN where nothing was seen, and what it was taken
    for."""
    tables, units = read_alike(paths, in_columns, layout.entry)
    names = x_and_z(paths[0], pd.concat(tables), layout.columns)
    counts = [len(table) for table in tables]
    measured = "points" if max(counts) == 1 else "profiles"
    if measured == "profiles" and 1 in counts:
        raise ScanError(f"{paths[counts.index(1)]}: a single point, where other files hold profiles")
    points = np.concatenate([from_frame(*of).numbers(names, blank=True) for of in zip(paths, tables, strict=True)])
    seen, z, missing = ~np.isnan(points).any(axis=1), points[:, 1], layout.missing
    if missing is None and {*np.sign(z[seen])} in ({0, 1}, {0, -1}):
        missing = 0.0
    seen &= z != missing
    points[~seen] = np.nan
    largest = np.nanmax(np.abs(points), initial=0)
    scale, lengths = to_mm(paths[0], units, names, layout.units, largest, 1.0)
    points *= scale
    if not 1 <= largest * scale <= FARTHEST_MM:
        farthest = max((points[seen] / scale).flat, key=abs, default=0.0)
        hint = f"expected 1 to {FARTHEST_MM:g} mm: is it the unit (--units), or where nothing was seen (--missing)?"
        raise ScanError(f"{paths[0].parent}: the profiles, {lengths}, reach {farthest:.10g}; {hint}")
    where = "" if missing is None else f", where z is {missing:g}"
    told = "all seen" if seen.all() else f"nothing seen in {(~seen).sum()} of them{where}"
    ends = zip("xz", names, points[seen].min(axis=0), points[seen].max(axis=0), strict=True)
    ranges = ", ".join(f"{axis} (column {name}) from {low:.4g} to {high:.4g} mm" for axis, name, low, high in ends)
    values = tuple(np.split(points, np.cumsum(counts)[:-1]))
    return measured, values, f"{len(points)} points, {lengths}, {ranges}, {told}"


def x_and_z(path: Path, points: pd.DataFrame, columns: str) -> list[str]:
    """The columns of x and z: those given, those of these names, or where columns have no names the two that vary."""
    varying = [name for name in points if points[name].nunique() > 1]
    names = varying if nameless(points) else ["x", "z"]
    if columns:
        names = [name.strip().lower() for name in columns.split(",")]
    if not len(names) == len({*names} & {*points}) == 2 or (not columns and "y" in varying):
        raise ScanError(f"{path}: columns {listed(points)}; say which are x and z: --columns x,z")
    return names


def to_mm(path: Path, units: dict, names, option: str, largest: float, below: float) -> tuple[float, str]:
    """From a file's units to mm, and in words; metres if all is less than `below` and neither option nor title says."""
    if option:
        others = ", ".join({units[name] for name in names} - {"", option})
        return LENGTHS[option], f"in {option}, as you say" + (f", where the file says {others}" if others else "")
    if unit := unit_of(path, units, names, LENGTHS):
        return LENGTHS[unit], f"in {unit}, as the file says"
    unit = "m" if largest < below else "mm"
    return LENGTHS[unit], f"in {unit} (the largest is {largest:.3g})"
