"""A scan from files that people have: profiles in a file each or all in one, and the
robot's poses in any text or array. What is not said is guessed, and every guess is
told.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from glob import glob
from pathlib import Path
from statistics import mode

import numpy as np

from profilecal.geometry.poses import carry, inverse
from profilecal.scan.conventions import CONVENTIONS, Convention, named, to_rotations
from profilecal.scan.folder import (
    FARTHEST_MM,
    MOUNTS,
    REACH_MM,
    SCALE,
    check_header,
    check_poses,
    scan_of,
)
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.tables import Table, listed
from profilecal_tool.importing.columns import (
    from_array,
    names_and_units,
    read_poses,
    read_profiles,
    unit_of,
)

OF_POSES = re.compile(
    r"pose|(\b|_)rob|flange|tcp|\.(ls|dat|mod|script|rob)$", re.IGNORECASE
)  # in a file's name
# columns that tell profiles apart
LABELS = "pose", "name", "label", "id", "index", "file", "n"
MATRIX = "r11,r12,r13,x,r21,r22,r23,y,r31,r32,r33,z"
# by columns without names; TUM first
USUAL = {8: "timestamp,x,y,z,qx,qy,qz,qw", 12: MATRIX, 16: f"{MATRIX},_,_,_,_"}
FRAMES = {"uf": "user frame", "ut": "tool"}


@dataclass(frozen=True)
class Layout:
    """What is said of the files; what is empty is guessed."""

    profiles: str = ""  # which files, as a shell pattern
    poses: str = ""  # which file or files
    # names or numbers, from 1, of x and z in a profile: "x,z" or "1 [mm],3 [mm]"
    columns: str = ""
    # what a pose's numbers are, in their order: "x [m],y [m],z [m],a,b,c"; "_" for no
    # meaning
    pose_columns: str = ""
    entry: str = ""  # the list in a YAML or NPZ file that is the profile
    missing: float | None = None  # z where the scanner saw nothing
    # x, y, z, mm, and three angles of the poses' frame, in the flange's
    tool: tuple[float, ...] | None = None
    mount: str = MOUNTS[0]


def import_scan(
    folder, kind: str, sizes: dict, layout: Layout = Layout()
) -> tuple[Scan, list[str]]:
    """The scan of a target of these sizes, mm by name, in a folder of files; and each
    guess. Raises ScanError.
    """
    folder = Path(folder)
    target = {"kind": kind} | sizes
    header = check_header(
        folder,
        {"title": folder.resolve().name, "mount": layout.mount, "target": target},
    )
    of_profiles, of_poses, left = sort_files(folder, layout)
    poses, convention = pose_table(of_poses, layout.pose_columns)
    names, profiles, of_axes = profiles_of(of_profiles, len(poses.lines), layout)
    values, taken = seen_in_mm(folder, profiles, of_axes, layout.missing)
    poses.columns["pose"], order, matched = match(poses, names, left)
    entries, taken_poses = taken_as(poses, convention, layout.tool)
    measured = "points" if max(map(len, values)) == 1 else "profiles"
    # one point is no profile
    values = [v if len(v) > 1 or measured == "points" else v[:0] for v in values]
    scan = scan_of(folder, header, entries, measured, tuple(values[k] for k in order))
    guessed = [
        f"poses      {names_of(of_poses)}: {taken_poses}",
        f"of         {'the tool given, taken off' if layout.tool else 'the flange (--tool if they are of a tool)'}",
        f"profiles   {names_of(of_profiles)}: {taken}",
        f"matched    {matched}",
        f"mount      {scan.mount} (--mount)",
        f"target     {scan.description}",
        *([f"left out   {listed(left)}"] if left else []),
        *(f"note       {doubt}" for doubt in frames_of(poses, layout)),
    ]
    return scan, guessed


def sort_files(
    folder: Path, layout: Layout
) -> tuple[list[Path], list[Path], list[str]]:
    """The profiles, what holds the poses, and the names of other files."""
    profiles, every = files(folder, layout.profiles), files(folder, "*")
    named = [
        path for path in every if OF_POSES.search(path.name) and path not in profiles
    ]
    poses = files(folder, layout.poses) or named
    if not poses:
        there = "no such folder, or nothing in it is named like the robot's poses"
        raise ScanError(f"{folder}: {there}; say what holds them: --poses FILE")
    others = [path for path in every if path not in poses]
    if not profiles and not others:
        raise ScanError(f"{folder}: no profiles beside {names_of(poses)}")
    # files alike but for numbers belong together
    families = [re.sub(r"\d+", "#", path.name) for path in others]
    profiles = profiles or [
        path
        for path, family in zip(others, families, strict=True)
        if family == mode(families)
    ]
    return profiles, poses, [path.name for path in others if path not in profiles]


def files(folder: Path, pattern: str) -> list[Path]:
    """The files of a shell pattern, p2 before p10. Raises ScanError if there are none
    of one that a user gave.
    """
    paths = [
        path
        for name in glob(pattern, root_dir=folder)
        if (path := folder / name).is_file()
    ]
    if pattern.strip("*") and not paths:
        raise ScanError(f"{folder}: no file matches {pattern!r}; is the folder right?")
    return sorted(
        paths,
        key=lambda path: re.sub(r"\d+", lambda digits: digits[0].zfill(20), path.name),
    )


def names_of(paths: list[Path]) -> str:
    """Files in a few words."""
    return paths[0].name if len(paths) == 1 else f"{paths[0].name} … {paths[-1].name}"


def check_alike(tables: list[Table]) -> None:
    """Raise ScanError where tables do not have the same columns."""
    for table in tables:
        if table.units != tables[0].units:
            there = f"columns {listed(table.units)}, where {tables[0].path.name} has {listed(tables[0].units)}"
            raise ScanError(
                f"{table.path}: {there}; say which files belong together: --poses, --profiles"
            )


def pose_table(paths: list[Path], said: str) -> tuple[Table, Convention]:
    """The poses in a file, or in files of one each, with columns as conventions name
    them: as said, or as titles or usual numbers have them.
    """
    tables = [read_poses(path) for path in paths]
    check_alike(tables)
    table, units = tables[0], tables[0].units
    if len(tables) > 1:
        if max(len(one.lines) for one in tables) > 1:
            text = "may all be the robot's poses; expected one file, or one for each pose: --poses FILE"
            raise ScanError(f"{paths[0].parent}: {names_of(paths)} {text}")
        columns = {name: [one.columns[name][0] for one in tables] for name in units}
        table = Table(paths[0].parent, columns, [path.stem for path in paths], "pose")
    said = said or (USUAL.get(len(units), "") if all(map(str.isdigit, units)) else "")
    if said:
        titles = names_and_units(said.split(","))
        units = {
            name: unit or old
            for (name, unit), old in zip(titles.items(), units.values(), strict=False)
        }
    blocks = [
        convention
        for convention in CONVENTIONS
        if {*"xyz", *convention.columns} <= units.keys()
    ]
    if len(blocks) != 1 or len(units) != len(table.columns):
        known = "; ".join(",".join(convention.columns) for convention in CONVENTIONS)
        text = f"say what they are, in their order: --pose-columns x,y,z and one of {known} (_ for others)"
        raise ScanError(
            f"{table.path}: {len(table.columns)} columns, {listed(table.columns)}; {text}"
        )
    columns = dict(zip(units, table.columns.values(), strict=True))
    if len(tables) > 1:
        columns.setdefault("pose", table.lines)
    return replace(table, columns=columns, units=units), blocks[0]


def match(
    poses: Table, names: Sequence, left: Sequence[str]
) -> tuple[list[str], list[int], str]:
    """The poses' labels, which profile each has, and how it was found: by its name or
    its last number, or by order. `left`: files that were left out.
    """
    of_poses = next((name for name in LABELS if name in poses.columns), None)
    if not of_poses or not isinstance(names[0], str):
        if len(names) != len(poses.lines):
            raise ScanError(
                f"{poses.path}: {len(names)} profiles for {len(poses.lines)} poses"
            )
        return (
            [str(name) for name in names],
            [*range(len(names))],
            "in order, the first pose with the first profile",
        )
    known, how = (
        {key: k for k, name in enumerate(names) for key in (last_number(name), name)},
        "by their names",
    )
    labels = [str(cell).removesuffix(".0") for cell in poses.columns[of_poses]]
    numbers = [{*map(last_number, some)} for some in (labels, names)]
    runs = [{*range(first, first + len(names))} for first in (0, 1)]
    if numbers in (runs, runs[::-1]):
        known = {
            ours: known[theirs]
            for ours, theirs in zip(*map(sorted, numbers), strict=True)
        }
        how = "by their numbers, where one counts from 0 and the other from 1"
    found = [known.get(label, known.get(last_number(label))) for label in labels]
    if None in found:
        among = f"; left out: {listed(left)} (--profiles)" if left else ""
        raise ScanError(
            f"{poses.path}: no profile for pose {labels[found.index(None)]}{among}"
        )
    first = [found.index(k) for k in found]
    twice = "profile {} is of pose {} already; give each profile its pose's name, or say which files: --profiles"
    poses.refuse(
        first < np.arange(len(found)),
        twice,
        [names[k] for k in found],
        [labels[row] for row in first],
    )
    if spare := {*range(len(names))} - {*found}:
        raise ScanError(f"{poses.path}: no pose for profile {names[min(spare)]}")
    return labels, found, how


def last_number(name: str) -> int | str:
    """The last whole number in a name; the name if there is none."""
    found = re.findall(r"\d+", name)
    return int(found[-1]) if found else name


def taken_as(
    poses: Table, convention: Convention, tool: tuple | None
) -> tuple[dict, str]:
    """Entries of a Scan, the tool taken off, and what the poses were taken for."""
    said = {name: poses.units[name] for name in convention.columns}
    columns = {name: poses.columns[name] for name in ("pose", *"xyz", *said)}
    if {*said.values()} == {"deg"} and not convention.sequence:
        hint = "are angles in some order: say in which, --pose-columns x,y,z and a,b,c; w,p,r or alpha,beta,gamma"
        raise ScanError(f"{poses.path}: {listed(said)} in degrees {hint}")
    angle = unit_of(
        poses.path, said, ("deg", "rad") if convention.sequence else ("1", "rad")
    )
    if angle == "rad" and convention.sequence:
        columns |= zip(said, np.degrees(poses.numbers(said)).T, strict=True)
    along = {axis: poses.units[axis] for axis in "xyz"}
    scale, lengths = to_mm(poses.path, along, poses.numbers("xyz"), REACH_MM[1] / 1000)
    entries = check_poses(replace(poses, columns=columns), scale)
    if tool:
        if not np.isfinite(tool).all():
            raise ScanError(f"--tool is {tool}; expected three mm and three angles")
        of_tool = convention if len(said) == 3 else named("FANUC angles")
        angles = (
            np.degrees(tool[3:]) if angle == "rad" and convention.sequence else tool[3:]
        )
        said_there = Table(Path("--tool"), {}, ["4 to 6"], "numbers")
        back = inverse(
            to_rotations(of_tool, [angles], said_there)[0], np.array(tool[:3])
        )
        R, T = entries["R_base_flange"], entries["p_base_flange"]
        entries |= {
            "R_base_flange": R @ back[0],
            "p_base_flange": carry(R, T, back[1]),
            "orientation": None,
        }
    meaning = (
        f"{convention.meaning} ({', '.join(said)}{angle and f' in {angle}, as said'})"
    )
    of = (
        f", of the tool at {tool[:3]} mm, turned by {tool[3:]}, {of_tool.meaning}"
        if tool
        else ""
    )
    return entries, f"{len(poses.lines)}, {meaning}, {lengths}{of}"


def frames_of(poses: Table, layout: Layout) -> list[str]:
    """Doubts about the robot's frames and external axes. Raises ScanError where they
    differ between poses.
    """
    doubts = []
    for name in filter(re.compile(r"uf|ut|e\d|gp\d .*").fullmatch, poses.columns):
        cells = poses.columns[name]
        if len({*cells}) > 1:
            apart = np.ptp(poses.numbers([name]))
            if apart > 0.5:  # mm or degrees
                raise ScanError(
                    f"{poses.path}: {FRAMES.get(name, name)} differs between poses; expected one for all"
                )
            doubts.append(
                f"{name} differs by up to {apart:.2g} between poses, and is taken to stand still"
            )
        elsewhere = (
            layout.mount != MOUNTS[0]
            if name == "uf"
            else name == "ut" and not layout.tool
        )
        if elsewhere and cells[0] != "0":
            hint = (
                "; for one on the flange give its frame: --tool X Y Z W P R"
                if name == "ut"
                else ""
            )
            doubts.append(
                f"the poses are of {FRAMES[name]} {cells[0]}, and so will be the sensor pose{hint}"
            )
    return doubts


def profiles_of(
    paths: list[Path], count: int, layout: Layout
) -> tuple[Sequence, list[np.ndarray], dict[str, str]]:
    """Names of profiles, or numbers, their points (n, 2), and the columns of x and z
    with their units. In one table for `count` poses, a profile is the rows that share a
    label; or a row: x and z in turn, or z under the first row's x.
    """
    tables = [table for path in paths for table in read_profiles(path, layout.entry)]
    # in the others nothing was seen
    full = [table for table in tables if table.columns]
    if not full:
        raise ScanError(f"{paths[0]}: no numbers in columns")
    check_alike(full)
    first = full[0]
    label = next((name for name in LABELS if name in first.columns), None)
    if (
        not label
        and len(paths) == 1
        and len(first.columns) > 4
        and len(first.lines) in (count, count + 1)
    ):
        rows = first.numbers(first.columns, blank=True)
        x, z = (
            (rows[:, ::2], rows[:, 1::2])
            if len(rows) == count
            else np.broadcast_arrays(rows[:1], rows[1:])
        )
        full = tables = [
            from_array(first.path, profile) for profile in np.stack([x, z], axis=-1)
        ]
    of_rows = np.array(first.columns.pop(label, ()))
    axes = x_and_z(full, layout.columns)
    points = [
        table.numbers(axes, blank=True) if table.columns else np.empty((0, 2))
        for table in tables
    ]
    names = (
        [path.stem for path in paths]
        if len(points) == len(paths) > 1
        else range(len(points))
    )
    if label and len(paths) == 1:
        names = [*dict.fromkeys(of_rows.tolist())]
        points = [points[0][of_rows == name] for name in names]
    return names, points, axes


def x_and_z(tables: list[Table], said: str) -> dict[str, str]:
    """The columns of x and z and their units: as said, of these names, or where there
    are no names, the two that vary. Raises ScanError.
    """
    units = tables[0].units
    varying = [
        name
        for name in tables[0].columns
        if len({cell for t in tables for cell in t.columns[name]}) > 1
    ]
    axes = dict.fromkeys(varying if all(map(str.isdigit, varying)) else "xz", "")
    if said:
        axes = names_and_units(said.split(","))
    if not len(axes) == len(axes.keys() & tables[0].columns) == 2 or (
        not said and "y" in varying
    ):
        raise ScanError(
            f"{tables[0].path}: columns {listed(tables[0].columns)}; say which are x and z: --columns x,z"
        )
    return {name: unit or units[name] for name, unit in axes.items()}


def seen_in_mm(
    folder: Path, profiles: list[np.ndarray], axes: dict, missing: float | None
) -> tuple[list, str]:
    """The points (n, 2) of profiles, mm, NaN where nothing was seen, and what they were
    taken for.
    """
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
    """From a file's units to mm, and in words; metres if all is less than `below` and
    no title says.
    """
    largest = np.nanmax(np.abs(values), initial=0)
    said = unit_of(path, units, SCALE)
    unit = said or ("m" if largest < below else "mm")
    return SCALE[
        unit
    ], f"in {unit} ({'as said, ' if said else ''}the largest is {largest:.10g})"
