"""A scan from files that people have: a folder with one profile file for each pose, and the robot's poses in a table, a
FANUC listing, or a file each. What is not said is guessed, and every guess is told."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from profilecal.geometry.poses import carry, inverse, rotation_groups
from profilecal.scan.columns import Columns, read_columns
from profilecal.scan.conventions import Convention, RowError, find_convention, named, to_rotations
from profilecal.scan.fanuc import read_listing
from profilecal.scan.files import naming
from profilecal.scan.folder import FARTHEST_MM, SCALE, check_sizes
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import listed, shown
from profilecal.targets import TARGETS

OF_POSES = re.compile(r"pose|robot|flange|tcp|calib", re.I)  # in a file's name
ALIASES = {
    "q1": "qw",
    "q2": "qx",
    "q3": "qy",
    "q4": "qz",
    "tx": "x",
    "ty": "y",
    "tz": "z",
    "px": "x",
    "py": "y",
    "pz": "z",
}
LABELS = ("pose", "name", "label", "id", "index", "file", "n")
MATRIX = tuple(f"r{i}{j}" if j < 4 else "xyz"[i - 1] for i in (1, 2, 3) for j in (1, 2, 3, 4))
LONGEST_M = 20.0  # from the base to a flange: what is less than that in all poses is in metres


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
    tool: tuple[float, ...] | None = (
        None  # x, y, z, mm, and three angles of the frame that the poses are of, in the flange's
    )


@dataclass(frozen=True)
class Poses:
    """The robot's poses as a file has them."""

    labels: tuple[str, ...]  # none where the file gives none
    R: np.ndarray  # (P, 3, 3)
    T: np.ndarray  # (P, 3) in the file's own units
    convention: Convention
    told: str  # what they were taken for


def import_scan(folder, kind: str, sizes: dict, layout: Layout = Layout()) -> tuple[Scan, list[str]]:
    """The scan of a target in a folder of files, and what was guessed, a line each.

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
    poses = read_poses(of_poses, layout, {last_number(path.stem) for path in profiles})
    order, matched = match(folder, poses, profiles, of_poses)
    found = [read_columns(profiles[k], layout.entry).upright for k in order]
    values, taken = measured([x_and_z(one, layout.columns) for one in found], found, layout)
    scale, units = scale_of(np.linalg.norm(poses.T, axis=1).max(), LONGEST_M, layout.pose_units)
    R, T = poses.R, poses.T * scale
    if layout.tool:
        R, T = without_tool(R, T, layout.tool, poses.convention)
    single = all(len(rows) == 1 for rows in values)
    scan = Scan(
        kind=kind,
        labels=labels_of(poses, [profiles[k] for k in order]),
        R_base_flange=R,
        T_base_flange=T,
        measured="points" if single else "profiles",
        values=values,
        sizes=tuple(sizes[name] for name in target.lengths),
        side=np.zeros(len(R)),
        group=rotation_groups(R),
        title=folder.resolve().name,
        convention=poses.convention.name,
    )
    if scan.measured not in target.tables:
        raise ScanError(f"{folder}: a target of kind {kind!r} needs {' or '.join(target.tables)}, not {scan.measured}")
    guessed = [
        f"poses      {names_of(of_poses)}: {len(R)}, {poses.told}, {units}",
        f"of         {'the tool given, taken off' if layout.tool else 'the flange (--tool if they are of a tool)'}",
        f"profiles   {names_of([profiles[k] for k in order])}: {taken}",
        f"matched    {matched}",
        f"target     {scan.description}",
    ]
    return scan, guessed + ([f"left out   {listed(left)}"] if left else [])


def sort_files(folder: Path, layout: Layout) -> tuple[list[Path], list[Path], list[str]]:
    """The profiles, what holds the poses, and the names of other files. Files alike but for numbers belong together."""
    with naming(folder):
        there = sorted((p for p in folder.iterdir() if p.is_file() and p.name[0] != "."), key=natural)
        chosen = {
            name: sorted(folder.glob(getattr(layout, name)), key=natural)
            for name in ("profiles", "poses")
            if getattr(layout, name)
        }
    for name, paths in chosen.items():
        if not paths:
            raise ScanError(f"{folder}: no file {getattr(layout, name)} (--{name})")
    families = {}
    for path in there:
        if path not in chosen.get("profiles", []) + chosen.get("poses", []):
            families.setdefault(re.sub(r"\d+", "#", path.name), []).append(path)
    if "poses" not in chosen:
        likely = [f for f in families if f.lower().endswith(".ls")] or [f for f in families if OF_POSES.search(f)]
        if len(likely) != 1:
            found = f"{listed(likely)} may all be" if likely else "nothing is named like"
            raise ScanError(f"{folder}: {found} the robot's poses; say which: --poses FILE")
        chosen["poses"] = families.pop(likely[0])
    if "profiles" not in chosen:
        if not families:
            raise ScanError(f"{folder}: no profiles beside {names_of(chosen['poses'])}")
        chosen["profiles"] = families.pop(max(families, key=lambda f: len(families[f])))
    left = [path.name for family in families.values() for path in family]
    return chosen["profiles"], chosen["poses"], left


def natural(path: Path) -> list:
    """A key that puts p2 before p10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def names_of(paths) -> str:
    """Files in a few words."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} … {paths[-1].name}"


def read_poses(paths: list[Path], layout: Layout, numbers: set) -> Poses:
    """The poses of a FANUC listing, of a table, or of files of one pose each. `numbers`: in the profiles' names."""
    if paths[0].suffix.lower() == ".ls":
        listing = read_listing(paths[0])
        fanuc = named("FANUC angles")
        told = f"{fanuc.meaning}, user frame {listing.user_frame}, tool {listing.tool}"
        labels = tuple(f"P{n}" for n in listing.numbers)
        return Poses(labels, to_rotations(fanuc, listing.poses[:, 3:]), listing.poses[:, :3], fanuc, told)
    tables = [read_columns(path, layout.entry if len(paths) > 1 else "") for path in paths]
    if tables[0].values.shape in ((3, 4), (4, 4)):
        shape = {t.values.shape for t in tables}
        if len(shape) > 1:
            raise ScanError(f"{paths[0].parent}: poses of {len(shape)} shapes; expected all 3 x 4, or all 4 x 4")
        rows, names = np.array([t.values[:3].ravel() for t in tables]), MATRIX
    else:
        rows, names = one_table(tables, layout)
    where = names_of(paths)
    with naming(paths[0]):
        names = [ALIASES.get(name, name) for name in names]
        convention = find_convention(names)
        if missing := [name for name in "xyz" if name not in names]:
            raise ScanError(f"{paths[0]}: no column {missing[0]}; there are {listed(names)} (--pose-columns)")
        block = rows[:, [names.index(name) for name in convention.columns]]
        T = rows[:, [names.index(name) for name in "xyz"]]
        if not np.isfinite(rows[:, [names.index(name) for name in ("x", "y", "z", *convention.columns)]]).all():
            raise ScanError(f"{paths[0]}: a number is missing among the poses")
        try:
            R = to_rotations(convention, block)
        except RowError as error:
            raise ScanError(f"{where}, pose {error.row + 1}: {error}") from error
    labels = labels_in(tables[0], len(paths), {*"xyz", *convention.columns}, numbers)
    return Poses(labels, R, T, convention, f"{convention.meaning} ({convention.name})")


def one_table(tables: list[Columns], layout: Layout) -> tuple[np.ndarray, list[str]]:
    """Rows of numbers (P, k) from a table, or from files of a row each, and the columns' names."""
    path, k = tables[0].path, tables[0].values.shape[1]
    if any(t.values.shape[1] != k for t in tables):
        raise ScanError(f"{path.parent}: files of poses with different numbers of columns")
    names = (
        [name.strip().lower() for name in layout.pose_columns.split(",")] if layout.pose_columns else tables[0].names
    )
    if layout.pose_columns and len(names) != k:
        raise ScanError(f"{path}: {k} columns, and {len(names)} names in --pose-columns")
    rows = np.concatenate([t.values for t in tables])
    if names[0] == "1" and k in (12, 16):
        return rows[:, :12], list(MATRIX)
    if names[0] == "1":
        example = "x,y,z,a,b,c" if k == 6 else "x,y,z,qw,qx,qy,qz"
        raise ScanError(
            f"{path}: {k} numbers for each pose, without names; say what they are: --pose-columns {example}"
        )
    return rows, list(names)


def labels_in(table: Columns, files: int, used: set, numbers: set) -> tuple[str, ...]:
    """The poses' labels in a table: a column of that name, or one with the numbers of the profiles' names that is of no
    other use. None where there is no such column."""
    if files > 1 or table.values.shape in ((3, 4), (4, 4)):
        return ()
    if table.words:
        return table.words
    columns = [
        column
        for name, column in zip(table.names, table.values.T, strict=True)
        if name in LABELS or (ALIASES.get(name, name) not in used and set(column) == numbers)
    ]
    return tuple(f"{value:g}" for value in columns[0]) if columns else ()


def match(folder: Path, poses: Poses, profiles: list[Path], of_poses: list[Path]) -> tuple[list[int], str]:
    """Which profile belongs to each pose (P,): the one whose name, or last number, is the pose's; else by order."""
    source = names_of(of_poses)
    numbers = [last_number(path.stem) for path in profiles]
    named_by = poses.labels or tuple(path.stem for path in of_poses if len(of_poses) == len(poses.R) > 1)
    if named_by:
        stems = {path.stem: k for k, path in enumerate(profiles)} | {path.name: k for k, path in enumerate(profiles)}
        by_number = dict(zip(numbers, range(len(profiles)), strict=True)) if len({*numbers}) == len(numbers) else {}
        order = [stems.get(label, by_number.get(last_number(label))) for label in named_by]
        if None in order:
            raise ScanError(f"{folder}: no profile for pose {named_by[order.index(None)]} of {source}")
        if len({*order}) < len(order):
            raise ScanError(f"{source}: poses {listed(named_by)} name a profile twice")
        if spare := {*range(len(profiles))} - {*order}:
            raise ScanError(f"{profiles[min(spare)]}: no such pose in {source}")
        return order, "by their names"
    if len(profiles) != len(poses.R):
        raise ScanError(
            f"{folder}: {len(profiles)} profiles ({names_of(profiles)}) and {len(poses.R)} poses ({source})"
        )
    return list(range(len(profiles))), "in order, the first pose with the first profile"


def labels_of(poses: Poses, profiles: list[Path]) -> tuple[str, ...]:
    """What the poses are called: as their table calls them, or else as the profiles, without the word in front."""
    if poses.labels and {*poses.labels} != {path.name for path in profiles}:
        return poses.labels
    stems = [path.stem for path in profiles]
    shared = re.match(r"\D*", stems[0])[0]
    return tuple(stem.removeprefix(shared) or stem for stem in stems)


def last_number(text: str) -> int | None:
    """The last whole number in a name."""
    found = re.findall(r"\d+", text)
    return int(found[-1]) if found else None


def x_and_z(found: Columns, columns: str) -> tuple[int, int]:
    """Which two columns of a profile are x and z."""
    names = [*found.names]
    if columns:
        chosen = [name.strip().lower() for name in columns.split(",")]
        unnamed = [name for name in chosen if name not in names]
        if len(chosen) != 2 or unnamed:
            raise ScanError(f"{found.path}: no columns {columns}; expected two of {listed(names)}")
        return names.index(chosen[0]), names.index(chosen[1])
    if len(names) == 2:
        return 0, 1
    if "x" in names and "z" in names and "y" not in names:
        return names.index("x"), names.index("z")
    flat = [j for j, column in enumerate(found.values.T) if len({*column[np.isfinite(column)]}) < 2]
    flat = flat if len(found.values) > 1 else [1]
    if len(names) == 3 and len(flat) == 1:
        first, second = (j for j in range(3) if j != flat[0])
        return first, second
    raise ScanError(f"{found.path}: columns {listed(names)}; say which are x and z: --columns x,z")


def measured(chosen, found: list[Columns], layout: Layout) -> tuple[tuple[np.ndarray, ...], str]:
    """The profiles in mm, NaN where nothing was seen, and what they were taken for."""
    pairs = {tuple(one.names[j] for j in columns) for columns, one in zip(chosen, found, strict=True)}
    if len(pairs) > 1:
        raise ScanError(
            f"{found[0].path.parent}: profiles with different columns; say which are x and z: --columns x,z"
        )
    values = [np.array(one.values[:, list(columns)]) for columns, one in zip(chosen, found, strict=True)]
    z = np.concatenate([rows[:, 1] for rows in values])
    z = z[np.isfinite(z)]
    if not z.size:
        raise ScanError(f"{found[0].path.parent}: the profiles hold no point")
    missing = layout.missing
    if missing is None and (rest := z[z != 0]).size and rest.size < z.size and not rest.min() < 0 < rest.max():
        missing = 0.0
    near = np.abs(np.concatenate(values)[np.isfinite(np.concatenate(values)).all(axis=1)])
    scale, units = scale_of(near[near < FARTHEST_MM].max(initial=0), 1.0, layout.units)
    for rows in values:
        rows[(rows[:, 1] == missing) | (np.abs(rows) * scale > FARTHEST_MM).any(axis=1)] = np.nan
    (names,), points = pairs, sum(map(len, values))
    nothing = sum(int(np.isnan(rows).any(axis=1).sum()) for rows in values)
    where = "" if missing is None else f", where z is {missing:g}"
    seen = f"nothing seen in {nothing} of them{where}" if nothing else "all seen"
    said = f"{points} points, x and z in columns {' and '.join(names)}, {units}, {seen}"
    return tuple(rows * scale for rows in values), said


def scale_of(largest: float, below: float, stated: str) -> tuple[float, str]:
    """From a file's units to mm, and in words; metres where nothing is stated and all is less than `below`."""
    units = stated or ("m" if largest < below else "mm")
    return SCALE[units], f"in {units}" if stated else f"in {units} (the largest is {largest:.3g})"


def without_tool(R, T, tool, convention: Convention) -> tuple[np.ndarray, np.ndarray]:
    """Poses of the flange from those of a tool: x, y, z, mm, and angles as the poses have them, else as FANUC's."""
    angles = convention if convention.sequence else named("FANUC angles")
    R_inverse, T_inverse = inverse(to_rotations(angles, [tool[3:]])[0], np.asarray(tool[:3], dtype=float))
    return R @ R_inverse, carry(R, T, T_inverse)
