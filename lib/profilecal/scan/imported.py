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
from profilecal.scan.columns import numbered, read_columns, unnamed
from profilecal.scan.conventions import CONVENTIONS, named, to_rotations
from profilecal.scan.folder import FARTHEST_MM, REACH_MM, SCALE, check_poses, check_sizes, exchanged
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import Table, listed, shown
from profilecal.targets import TARGETS

OF_POSES = re.compile(r"pose|robot|flange|tcp|calib|\.ls$", re.I)  # in a file's name
ALIASES = {"q1": "qw", "q2": "qx", "q3": "qy", "q4": "qz"} | {f"{t}{axis}": axis for t in "tp" for axis in "xyz"}
LABELS = ("pose", "name", "label", "id", "index", "file", "n")  # columns that say which profile a pose has
OF_A_POSE = ["x", "y", "z", *(name for convention in CONVENTIONS for name in convention.columns)]
MATRIX = ("r11", "r12", "r13", "x", "r21", "r22", "r23", "y", "r31", "r32", "r33", "z", "_", "_", "_", "_")


@dataclass(frozen=True)
class Layout:
    """What is said of the files; what is empty is guessed."""

    profiles: str = ""  # which files, as a shell pattern
    poses: str = ""  # which file or files
    columns: str = ""  # names or numbers, from 1, of x and z in a profile: "x,z"
    pose_columns: str = ""  # names of a pose table's columns in order, "_" for those without meaning
    entry: str = ""  # the list in a YAML or NPZ file that is the profile
    units: str = ""  # of the profiles, "mm" or "m"
    pose_units: str = ""  # of the poses' positions
    missing: float | None = None  # z where the scanner saw nothing
    tool: tuple[float, ...] | None = None  # x, y, z, mm, and three angles of the poses' frame, in the flange's


def import_scan(folder, kind: str, sizes: dict, layout: Layout = Layout()) -> tuple[Scan, list[str]]:
    """The scan of a target of some sizes, mm by name, in a folder of files; and what was guessed, a line each.

    Raises ScanError.
    """
    folder = Path(folder)
    if kind not in TARGETS:
        raise ScanError(f"target is {shown(kind)}; expected one of {', '.join(TARGETS)}")
    target = TARGETS[kind]
    if missing := [name for name in target.lengths if name not in sizes]:
        raise ScanError(f"{folder}: the {kind}'s {missing[0]} is missing; expected --{missing[0]}, in mm")
    check_sizes(folder, {"kind": kind} | sizes, 1.0)
    profiles, of_poses, left = sort_files(folder, layout)
    poses, profiles, matched = match(pose_table(of_poses, layout), of_poses, profiles)
    entries, taken_poses, doubts = read_poses(folder / names_of(of_poses), poses, layout)
    values, taken = read_profiles(profiles, layout)
    single = [path for path, rows in zip(profiles, values, strict=True) if len(rows) == 1]
    measured = "points" if len(single) == len(profiles) else "profiles"
    if single and measured == "profiles":
        raise ScanError(f"{single[0]}: a single point, where other files hold profiles")
    if measured not in target.tables:
        raise ScanError(f"{folder}: a target of kind {kind!r} needs {' or '.join(target.tables)}, not {measured}")
    scan = Scan(
        **entries,
        kind=kind,
        measured=measured,
        values=values,
        sizes=tuple(sizes[name] for name in target.lengths),
        title=folder.resolve().name,
        warnings=(*doubts, *exchanged(values)),
    )
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
    if not (profiles or poses or families):
        raise ScanError(f"{folder}: no such folder, or no files in it")
    if not poses:
        likely = [family for family in families if OF_POSES.search(family)]
        if len(likely) != 1:
            found = f"{listed(likely)} may all be" if likely else "nothing is named like"
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


def last_number(name: str) -> int | str:
    """The last whole number in a name; the name if there is none."""
    found = re.findall(r"\d+", name)
    return int(found[-1]) if found else name


def pose_table(paths: list[Path], layout: Layout) -> pd.DataFrame:
    """The poses in a table or a listing, or in files of one each, with columns as conventions name them."""
    tables = [read_columns(path, layout.entry if len(paths) > 1 else "") for path in paths]
    if tables[0].shape in ((3, 4), (4, 4)):
        tables = [unnamed(table.to_numpy().reshape(1, -1)) for table in tables]
    poses = pd.concat(tables, ignore_index=True)
    k, where = poses.shape[1], paths[0].parent / names_of(paths)
    titles = [*poses]
    if layout.pose_columns:
        titles = [name.strip().lower() for name in layout.pose_columns.split(",")]
    if titles == numbered(k) and k in (12, 16):
        titles = MATRIX[:k]
    elif titles == numbered(k):
        examples = "--pose-columns x,y,z,a,b,c or x,y,z,qw,qx,qy,qz"
        raise ScanError(f"{where}: {k} numbers for each pose, without names; say what they are: {examples}")
    elif len(titles) != k:
        raise ScanError(f"{where}: {k} columns, and {len(titles)} names in --pose-columns")
    poses.columns = [title if ALIASES.get(title) in titles else ALIASES.get(title, title) for title in titles]
    if missing := [name for name in "xyz" if name not in poses]:
        raise ScanError(f"{where}: no column {missing[0]}; there are {listed(poses)} (--pose-columns)")
    if {"uf", "ut"} <= {*poses} and len(poses[["uf", "ut"]].drop_duplicates()) > 1:
        raise ScanError(f"{where}: poses in several user frames or tools (UF, UT); expected one of each")
    return poses.loc[:, ~poses.columns.duplicated()]


def match(poses: pd.DataFrame, of_poses: list[Path], profiles: list[Path]) -> tuple[pd.DataFrame, list[Path], str]:
    """The poses with labels, the profile of each, and how it was found: by its name or its last number, or by order."""
    folder, source = profiles[0].parent, names_of(of_poses)
    by_number = {last_number(path.stem): path for path in profiles}
    by_name = by_number | {name: path for path in profiles for name in (path.name, path.stem)}
    labels = None
    for name, column in poses.drop(columns=OF_A_POSE, errors="ignore").items():
        if name in LABELS or not is_numeric_dtype(column) or {*column} == by_number.keys():
            labels = [str(cell).removesuffix(".0") for cell in column]
            break
    names = labels or ([path.stem for path in of_poses] if len(of_poses) == len(poses) > 1 else None)
    found = [by_name.get(name, by_name.get(last_number(name))) for name in names] if names else profiles
    if None in found:
        raise ScanError(f"{folder}: no profile for pose {names[found.index(None)]} of {source}")
    if spare := [path for path in profiles if path not in found]:
        raise ScanError(f"{spare[0]}: no such pose in {source}")
    if len(profiles) != len(poses):
        raise ScanError(f"{folder}: {len(profiles)} profiles ({names_of(profiles)}) and {len(poses)} poses ({source})")
    stems = [path.stem for path in found]
    shared = re.match(r"\D*", stems[0])[0]
    poses = poses.assign(pose=labels or [stem.removeprefix(shared) or stem for stem in stems])
    return poses, found, "by their names" if names else "in order, the first pose with the first profile"


def read_poses(path: Path, poses: pd.DataFrame, layout: Layout) -> tuple[dict, str, list[str]]:
    """Entries of a Scan, what the poses were taken for, and doubts about them."""
    table = Table(path, poses.filter(items=["pose", *OF_A_POSE]), "row", 1)
    scale, units = scale_of(np.abs(table.numbers("xyz")).max(), REACH_MM[1] / 1000, layout.pose_units)
    entries, doubts = check_poses(table, scale)
    convention = named(entries["convention"])
    frames = f", user frame {poses['uf'][0]:g}, tool {poses['ut'][0]:g}" if {"uf", "ut"} <= {*poses} else ""
    if layout.tool:
        angles = convention if convention.sequence else named("FANUC angles")
        back = inverse(to_rotations(angles, [layout.tool[3:]])[0], np.array(layout.tool[:3]))
        R, T = entries["R_base_flange"], entries["T_base_flange"]
        entries |= {"R_base_flange": R @ back[0], "T_base_flange": carry(R, T, back[1]), "orientation": None}
    return entries, f"{len(poses)}, {convention.meaning} ({convention.name}){frames}, {units}", doubts


def read_profiles(paths: list[Path], layout: Layout) -> tuple[tuple[np.ndarray, ...], str]:
    """The profiles in mm, NaN where nothing was seen, and what they were taken for."""
    tables = upright({path: read_columns(path, layout.entry) for path in paths})
    tables = {path: table.select_dtypes("number") for path, table in tables.items()}
    names = x_and_z(tables, layout.columns)
    points = np.concatenate([table[names] for table in tables.values()])
    seen = (np.abs(points) <= FARTHEST_MM / SCALE[layout.units or "mm"]).all(axis=1)
    missing, z = layout.missing, points[seen, 1]
    rest = z[z != 0]
    if missing is None and 0 < len(rest) < len(z) and not rest.min() < 0 < rest.max():
        missing = 0.0
    if missing is not None:
        seen &= points[:, 1] != missing
    if not seen.any():
        raise ScanError(f"{paths[0].parent}: the profiles hold no point")
    scale, units = scale_of(np.abs(points[seen]).max(), 1.0, layout.units)
    points[~seen] = np.nan
    where = "" if missing is None else f", where z is {missing:g}"
    told = "all seen" if seen.all() else f"nothing seen in {(~seen).sum()} of them{where}"
    values = np.split(points * scale, np.cumsum([len(table) for table in tables.values()])[:-1])
    return tuple(values), f"{len(points)} points, x and z in columns {' and '.join(names)}, {units}, {told}"


def upright(tables: dict[Path, pd.DataFrame]) -> dict[Path, pd.DataFrame]:
    """With columns as columns, where the files, without names, have them side by side in at most three rows."""
    lying = all(len(t) <= 3 < t.shape[1] and [*t] == numbered(t.shape[1]) for t in tables.values())
    return {path: unnamed(t.to_numpy().T) for path, t in tables.items()} if lying else tables


def x_and_z(tables: dict[Path, pd.DataFrame], columns: str) -> list[str]:
    """The columns of x and z: those given, those of these names, or the two that are not the same everywhere."""
    points = pd.concat(tables.values())
    names = [*points]
    if columns:
        names = [name.strip().lower() for name in columns.split(",")]
    elif "x" in names and "z" in names and "y" not in names:
        names = ["x", "z"]
    elif len(names) > 2:
        names = [name for name in names if points[name].nunique() > 1]
        names = ["x", "z"] if {*names} == {"x", "z"} else names
    for path, table in sorted(tables.items(), key=lambda entry: -entry[1].shape[1]):
        if not len(names) == len({*names} & {*table}) == 2:
            found = f"no columns {columns}; there are {listed(table)}" if columns else f"columns {listed(table)}"
            raise ScanError(f"{path}: {found}; say which are x and z: --columns x,z")
    return names


def scale_of(largest: float, below: float, stated: str) -> tuple[float, str]:
    """From a file's units to mm, and in words; metres where nothing is stated and all is less than `below`."""
    units = stated or ("m" if largest < below else "mm")
    return SCALE[units], f"in {units}" if stated else f"in {units} (the largest is {largest:.3g})"
