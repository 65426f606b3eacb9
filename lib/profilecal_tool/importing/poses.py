"""The poses in files: what their numbers mean, their units, and the frames that they
are of.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import REACH_MM
from profilecal.geometry.poses import carry, inverse
from profilecal.scan.conventions import (
    CONVENTIONS,
    Convention,
    from_rotations,
    named,
    to_rotations,
)
from profilecal.scan.folder import check_poses
from profilecal.scan.scan import MOUNTS
from profilecal.scan.tables import ScanError, Table, listed, naming, number
from profilecal_tool.importing.arrays import ENDINGS, are_poses, arrays_in, from_array
from profilecal_tool.importing.key_value import Named, in_table
from profilecal_tool.importing.layout import Layout
from profilecal_tool.importing.makers import (
    BY_COLUMNS,
    EXTERNAL,
    FRAMES,
    NO_FRAME,
    PROGRAM,
    UNNAMED,
    UNSAID,
)
from profilecal_tool.importing.nested import (
    NESTED,
    chosen_place,
    placed,
    poses_in,
    tree_of,
)
from profilecal_tool.importing.programs import check_axes, positions_in
from profilecal_tool.importing.tables import (
    apart,
    check_alike,
    closed_text,
    from_rows,
    holds_numbers,
    labels_of_files,
    lines_of,
    names_and_units,
    names_of,
    stem,
    to_mm,
    unit_of,
    words_in,
)

LONGEST = 10_000_000  # characters of nested text or of a program
# brackets around numbers, not around units
AROUND = re.compile(r"\[(?=[\[\s\d.+-])|(?<=[\]\s\d.])\]")


def read_poses(path: Path, layout: Layout) -> tuple[Table, list[str]]:
    """Poses, one a row or one a matrix, of the first structure that a file has; and
    what was guessed. Raises ScanError.
    """
    if path.suffix.lower() in ENDINGS:
        arrays = {
            name: values
            for name, values in arrays_in(path).items()
            if are_poses(values)
        }
        if len(arrays) == 1:
            values = arrays.popitem()[1]
            return stacked(from_array(path, values.reshape(len(values), -1))), []
        tree = {name: values.astype(str).tolist() for name, values in arrays.items()}
        poses, guessed = poses_in(path, tree, layout.entry)
        return in_table(path, poses), guessed
    text = closed_text(path, layout.encoding, layout.entry, of_poses=True)
    if len(text) < LONGEST:
        with naming(path):
            tree = tree_of(text)
            poses, guessed = poses_in(path, tree, layout.entry, len(text))
            poses = poses or one_kind(path, positions_in(path, text), layout.entry)
        if poses:
            return in_table(path, poses), guessed
    elif NESTED.match(text) or PROGRAM.search(path.name):
        raise ScanError(
            f"{path}: {len(text) / 1e6:.0f} MB; poses in nested text or in a program "
            f"are expected in at most {LONGEST / 1e6:.0f}: leave some out"
        )
    rows = [*lines_of(AROUND.sub(" ", text))]
    are_numbers = [holds_numbers(fields) for _, fields in rows]
    first = are_numbers.index(True) if any(are_numbers) else 0
    # words between the rows and after them
    rows[first:] = [rows[k] for k in range(first, len(rows)) if are_numbers[k]]
    table = stacked(from_rows(path, rows))
    return apart(table)[0] if layout.in_one else table, []


def one_kind(path: Path, poses: list[Named], entry: str) -> list[Named]:
    """The robot's poses, where a program or log has as many of other kinds.

    Raises ScanError where it is not clear which these are.
    """
    counts = Counter(pose.kind for pose in poses)
    if len(counts) < 2 or len({*counts.values()}) > 1:
        return poses
    kind = chosen_place(path, [*counts], entry)
    return [pose for pose in poses if pose.kind == kind]


def stacked(table: Table) -> Table:
    """The table with a matrix a row, where four columns without names are matrices
    below one another.
    """
    if table.units.keys() != {*"1234"}:
        return table
    values = table.numbers(table.units)
    whole = len(values) % 4 == 0 and is_homogeneous(values.reshape(-1, 4, 4))
    rows = 4 if whole else 3
    if len(values) % rows:
        return table
    return from_array(table.path, values.reshape(-1, 4 * rows))


def is_homogeneous(matrices: ndarray) -> bool:
    """Whether all last rows of matrices (n, 4, 4) begin with 0, 0, 0, or all last
    columns.
    """
    ends = (matrices[:, 3, :3], matrices[:, :3, 3])
    return any(np.allclose(end, 0, atol=1e-6) for end in ends)


def pose_table(
    paths: list[Path], layout: Layout
) -> tuple[Table, Convention, list[str]]:
    """The poses in a file, in files of one each, or in a program of several files, with
    columns as conventions name them: as said, or as titles or usual numbers have them;
    and what was guessed. Raises ScanError.
    """
    names = {stem(path.name) for path in paths}
    if len(names) == len(paths) > 1 and all(map(PROGRAM.search, names)):
        folder = paths[0].parent
        texts = [closed_text(path, layout.encoding, "") for path in paths]
        tables = [in_table(folder, positions_in(folder, "\n".join(texts)))]
        guessed: list[str] = []
    else:
        readings = [read_poses(path, layout) for path in paths]
        tables = [table for table, _ in readings]
        guessed = readings[0][1]
    check_alike(tables)
    units = by_words(tables[0].units)
    table = tables[0] if len(tables) == 1 else one_each(paths, tables)
    bare = [name for name in units if name.isdigit()]
    said = layout.pose_columns
    if not said and len(bare) in UNNAMED:
        said = UNNAMED[len(bare)]
        if len(bare) in BY_COLUMNS and is_by_columns(table.numbers(bare)):
            said = BY_COLUMNS[len(bare)]
            guessed.append("matrices are written column by column (--pose-columns)")
    titles = names_and_units(said.split(",")) if said else {}
    olds = next((some for some in (bare, units) if len(some) == len(titles)), titles)
    new = dict(zip(olds, titles, strict=True))
    units = {new.get(old, old): unit for old, unit in units.items()}
    units = {name: titles.get(name) or unit for name, unit in units.items()}
    conventions = [
        convention
        for convention in CONVENTIONS
        if {*"xyz", *convention.columns} <= units.keys()
    ]
    is_whole = titles.keys() <= units.keys() and len(units) == len(table.columns)
    if len(conventions) != 1 or not is_whole:
        check_axes(table.path, units)
        known = "; ".join(",".join(convention.columns) for convention in CONVENTIONS)
        raise ScanError(
            f"{table.path}: {len(table.columns)} columns, {listed(table.columns)}; "
            "say what they are, in their order: --pose-columns x,y,z and one of "
            f"{known} (_ for others)"
        )
    columns = dict(zip(units, table.columns.values(), strict=True))
    if len(tables) > 1:
        columns.setdefault("pose", table.lines)
    table = replace(table, columns=columns, units=units)
    return table, conventions[0], guessed


def by_words(units: dict[str, str]) -> dict[str, str]:
    """Columns and their units, called as words in their names are that we know, if
    each is there once: "tcp_x" is x.
    """
    known = {*"xyz"}.union(*(convention.columns for convention in CONVENTIONS))
    words = [
        known & ({*placed(re.split(r"[\W_]+", name), [""])[1]} or words_in(name))
        for name in units
    ]
    names = [
        min(own) if len(own) == 1 and words.count(own) == 1 else name
        for name, own in zip(units, words, strict=True)
    ]
    return dict(zip(names, units.values(), strict=True))


def is_by_columns(values: ndarray) -> bool:
    """Whether matrices (n, 12) or (n, 16) are written column by column."""
    if values.shape[1] == 16:
        return not values[:, 3:12:4].any()
    rotations = values[:, :9].reshape(-1, 3, 3)
    return np.allclose(rotations @ rotations.mT, np.eye(3), atol=0.01)


def one_each(paths: list[Path], tables: list[Table]) -> Table:
    """The table of poses in files of one each, whose names say where a row stands.

    Raises ScanError where a file holds several.
    """
    folder = paths[0].parent
    if any(len(table.lines) > 1 for table in tables):
        raise ScanError(
            f"{folder}: {names_of(paths)} may all be the robot's poses; "
            "expected one file, or one for each pose: --poses FILE"
        )
    columns: dict[str, Sequence] = {
        name: [table.columns[name][0] for table in tables] for name in tables[0].units
    }
    return Table(folder, columns, labels_of_files(paths), "pose")


def taken_as(
    poses: Table, convention: Convention, layout: Layout
) -> tuple[dict, str, str]:
    """Entries of a Scan, what the poses were taken for, and what they are of: the
    flange, or a tool that is taken off. Raises ScanError.
    """
    units = {name: poses.units[name] for name in convention.columns}
    columns = {name: poses.columns[name] for name in ("pose", *"xyz", *units)}
    known = ("deg", "rad") if convention.sequence else ("1", "rad")
    check_angles(poses, convention, layout.pose_columns)
    angle = unit_of(poses.path, units, known)
    radians = angle == "rad" and convention.sequence != ""
    if radians:
        columns |= zip(units, np.degrees(poses.numbers(units)).T, strict=True)
    along = {axis: poses.units[axis] for axis in "xyz"}
    scale, lengths = to_mm(poses.path, along, poses.numbers("xyz"), REACH_MM[1] / 1000)
    entries = check_poses(replace(poses, columns=columns), scale)
    angles = f"{', '.join(units)}{angle and f' in {angle}, as said'}"
    words = f"{len(poses.lines)}, {convention.meaning} ({angles}), {lengths}"

    frames = {
        which: frame_of(poses, which, convention, scale)
        for which in ("base object", "base", "tool")
    }
    off = [
        f"{which} {poses.columns[which][0]} at {frame[1][0].round(3).tolist()} mm"
        for which in FRAMES
        if (frame := frames[which])
    ]
    of = "the flange (--tool if they are of a tool)"
    if off:
        of = (
            f"the flange: the file has {' and '.join(off)}, taken off (--tool 0 0 0 0 "
            "0 0 leaves a tool on)"
        )
    if layout.tool:
        frames["tool"] = frame_given(layout.tool, angles_of(convention), radians)
        of = "the tool given, taken off"
    R, p = entries["R_base_flange"], entries["p_base_flange"]
    for which, frame in frames.items():
        if frame and which == "tool":
            R_tool_flange, p_tool_flange = inverse(*frame)
            R, p = R @ R_tool_flange, carry(R, p, p_tool_flange)
        elif frame:
            R, p = frame[0] @ R, carry(*frame, p)
    if any(frames.values()):
        entries |= {"R_base_flange": R, "p_base_flange": p, "orientation": None}
    return entries, words, of


def check_angles(poses: Table, convention: Convention, said: str) -> None:
    """Raise ScanError where nobody said whether angles are degrees or radians, and they
    may be both; or where rx, ry, rz seem to be angles.
    """
    names = convention.columns
    units = {poses.units[name] for name in names}
    values = poses.numbers(names)
    largest = np.abs(values).max()
    angle = "deg" if "deg" in units or largest > 2 * np.pi else "rad"
    if convention.sequence and angle == "rad" and units == {""} and not said:
        columns = ",".join(f"{name} [rad]" for name in names)
        raise ScanError(
            f"{poses.path}: {listed(names)} are at most {largest:.4g}: radians, or "
            f'degrees? Say so: --pose-columns "x,y,z,{columns}", or with [deg]'
        )
    if convention.name != "rotation vector":
        return
    angles = dict(zip(names, (f"{name} [{angle}]" for name in "wpr"), strict=True))
    columns = ",".join(angles.get(name, name) for name in poses.units)
    lengths = np.linalg.norm(values, axis=1)
    sentence = (
        "rx, ry, rz of length {:.4g}, where rotation vectors have at most π: angles, "
        f'it seems; say which: R = Rz Ry Rx by --pose-columns "{columns}", R = Rx Ry '
        "Rz with alpha, beta, gamma there; or, if they are vectors, with rx, ry, rz"
    )
    asked = (lengths > np.pi + 0.001) & (not said)
    poses.refuse(asked | ("deg" in units), sentence, lengths)


def frame_of(
    poses: Table, which: str, convention: Convention, scale: float
) -> tuple[ndarray, ndarray] | None:
    """Rotations (P, 3, 3) and places (P, 3), mm, of the poses' tool or base, if the
    file has its frame and that is not zero.
    """
    names = [f"{which} {column}" for column in (*"xyz", *convention.columns)]
    if not {*names} <= poses.columns.keys():
        return None
    values = poses.numbers(names, blank=True)
    has = np.isfinite(values).all(axis=1)  # others are of none
    R, p = np.tile(np.eye(3), (len(has), 1, 1)), np.nan_to_num(values[:, :3]) * scale
    R[has] = to_rotations(convention, values[has, 3:])
    return (R, p) if p.any() or not np.allclose(R, np.eye(3)) else None


def frame_given(
    tool: tuple[float, ...], of_tool: Convention, radians: bool
) -> tuple[ndarray, ndarray]:
    """The frame of a tool, x, y, z, mm, and three angles on the flange, in radians if
    the poses' own are. Raises ScanError for numbers that are none.
    """
    if not np.isfinite(tool).all():
        raise ScanError(f"--tool is {tool}; expected three mm and three angles")
    angles = np.degrees([tool[3:]]) if radians else np.array([tool[3:]])
    where = Table(Path("--tool"), {}, ["4 to 6"], "numbers")
    return to_rotations(of_tool, angles, where), np.array([tool[:3]])


@np.errstate(invalid="ignore")  # words differ by nothing that is a number
def frames_of(poses: Table, convention: Convention, layout: Layout) -> list[str]:
    """Doubts about the robot's frames and external axes.

    Raises ScanError where they differ between poses by more than a little.
    """
    # whether the sensor pose will be of another frame than the flange or the base
    elsewhere = {"base": layout.mount != MOUNTS[0], "tool": not layout.tool}
    hints = {"tool": "; for one on the flange give its frame: --tool X Y Z W P R"}
    doubts = []
    for name in poses.columns:
        if name not in FRAMES and not EXTERNAL.fullmatch(name):
            continue
        frame = FRAMES.get(name, name)
        held = poses.columns.get(f"{name} x", [""] * len(poses.lines))
        cells = [*map(str, poses.columns[name])]
        pairs = zip(cells, held, strict=True)
        unknown = [cell for cell, x in pairs if not x and cell.lower() not in NO_FRAME]
        if unknown and len({*cells}) > 1:
            apart = np.ptp([*map(number, cells)])
            if not apart <= 0.5:  # mm or degrees
                several = listed(dict.fromkeys(cells))
                raise ScanError(
                    f"{poses.path}: {frame} differs between poses, {several}; expected "
                    "one for all: import those of one, in a file of their own, --poses"
                )
            doubts.append(
                f"{name} differs by up to {apart:.2g} between poses, "
                "and is taken to stand still"
            )
        if elsewhere.get(name) and unknown:
            hint = hints.get(name, "")
            doubts.append(
                f"the poses are of {frame} {cells[0]}, "
                f"and so will be the sensor pose{hint}"
            )
    if UNSAID in poses.columns and not layout.tool:
        name = poses.columns[UNSAID][0]
        numbers = "X Y Z W P R"
        if frame := frame_of(poses, UNSAID, convention, 1.0):
            turn = from_rotations(angles_of(convention), frame[0])[0]
            numbers = " ".join(f"{value:.7g}" for value in (*frame[1][0], *turn))
        doubts.append(
            f"the file has the frame of tool {name} and does not say whether the poses "
            f"are of it; if they are: --tool {numbers}"
        )
    return doubts


def angles_of(convention: Convention) -> Convention:
    """The three numbers of --tool: poses' own, if they have three."""
    return convention if len(convention.columns) == 3 else named("FANUC angles")
