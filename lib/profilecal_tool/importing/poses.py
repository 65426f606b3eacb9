"""The poses in files: what their numbers mean, their units, and the frames that they
are of.
"""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import REACH_MM
from profilecal.geometry.poses import carry, inverse
from profilecal.scan.conventions import (
    CONVENTIONS,
    LARGEST_ANGLE_DEG,
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
    ANGLES,
    BASE_SAID,
    EXTERNAL,
    FRAMES,
    INVERSE,
    NO_FRAME,
    OTHER_ANGLES,
    PROGRAM,
    TOOL_OFFSET,
    TOOL_SAID,
    TOOL_WORDS,
    UNNAMED,
    UNSAID,
    VECTOR,
    VECTORS,
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
        if len(arrays) == 1 and not INVERSE.search(min(arrays).lower()):
            values = arrays.popitem()[1]
            return stacked(from_array(path, values.reshape(len(values), -1))), []
        tree = {name: values.astype(str).tolist() for name, values in arrays.items()}
        poses, guessed = poses_in(path, tree, layout.entry)
        return in_table(path, poses), guessed
    text = closed_text(path, layout.encoding, layout.entry, of_poses=True)
    is_bare = len(text) > LONGEST / 10 and not re.search(r"[\[{(<=]", text[:LONGEST])
    if len(text) < LONGEST and not is_bare:
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
    rows = lines_of(AROUND.sub(" ", text))
    table = stacked(from_rows(path, rows, among_words=True))
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
    rows = 3
    if len(values) % 4 == 0:
        matrices = values.reshape(-1, 4, 4)  # or written column by column
        ends = (matrices[:, 3, :3], matrices[:, :3, 3])
        rows += any(np.allclose(end, 0, atol=1e-6) for end in ends)
    if len(values) % rows:
        return table
    return from_array(table.path, values.reshape(-1, 4 * rows))


def pose_table(
    paths: list[Path], layout: Layout, left: list[str]
) -> tuple[Table, Convention, list[str]]:
    """The poses in a file, in files of one each, or in a program of several files, with
    columns as conventions name them: as said, or as titles or usual numbers have them;
    and what was guessed. A file among those that are `left` may say their tool.

    Raises ScanError.
    """
    names = {stem(path.name) for path in paths}
    if len(names) == len(paths) > 1 and all(map(PROGRAM.search, names)):
        folder = paths[0].parent
        texts = [closed_text(path, layout.encoding, "") for path in paths]
        tables = [in_table(folder, positions_in(folder, "\n".join(texts)))]
        guessed = []
    else:
        readings = [read_poses(path, layout) for path in paths]
        tables = [table for table, _ in readings]
        guessed = readings[0][1]
    check_alike(tables)
    units = by_words(tables[0].units)
    table = tables[0] if len(tables) == 1 else one_each(paths, tables)
    many = Counter(map(stem, units))
    bare = [*filter(str.isdigit, units)]
    bare = bare or [name for name in units if many[stem(name)] in UNNAMED]
    said = layout.pose_columns
    if not said and len(bare) in UNNAMED:
        said = UNNAMED[len(bare)]
        if len(bare) > 8 and is_by_columns(table.numbers(bare)):
            said = ",".join(np.reshape(said.split(","), (-1, 4)).T.ravel())
            guessed.append("matrices are written column by column (--pose-columns)")
    titles = names_and_units(said.split(",")) if said else {}
    olds = next((some for some in (bare, units) if len(some) == len(titles)), titles)
    new = dict(zip(olds, titles, strict=True))
    new |= {f"tool {old}": f"tool {name}" for old, name in new.items()}
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
        free = len(bare) or len(units)
        answer = "x,y,z,qx,qy,qz,qw" if free == 7 else "x,y,z,w,p,r" + (free - 6) * ",_"
        raise ScanError(
            f"{table.path}: {len(table.columns)} columns, {listed(table.columns)}; say "
            f'what they are, in their order, such as --pose-columns "{answer}"; '
            f"orientations are {known}; _ stands for others"
        )
    columns = dict(zip(units, table.columns.values(), strict=True))
    names = (paths[0].stem.lower(), *([] if layout.pose_columns else table.columns))
    if inverses := [name for name in names if INVERSE.search(name)]:
        columns.setdefault("inverse", inverses[:1] * len(table.lines))
    if len(tables) > 1:
        columns.setdefault("pose", table.lines)
    if "tool x" in columns:
        columns.setdefault("tool", len(table.lines) * ["offset"])
    if UNSAID not in columns:
        texts = [
            paths[0].stem,
            *(f"tool: {name}" for name in left if re.match(TOOL_WORDS, name, re.I)),
        ]
        if paths[0].suffix not in ENDINGS:
            text = closed_text(paths[0], layout.encoding, layout.entry, of_poses=True)
            texts.append(text[: LONGEST // 10])
        for which, said in {"tool": TOOL_SAID, "base": BASE_SAID}.items():
            for match in said.finditer("\n".join(texts)):
                name = match[match.lastindex].strip()
                if name.strip("-+0., ;\t") and name.lower() not in NO_FRAME:
                    columns.setdefault(which, len(table.lines) * [name])
    table = replace(table, columns=columns, units=units)
    return table, conventions[0], guessed


def by_words(units: dict[str, str]) -> dict[str, str]:
    """Columns and their units, called as words in their names are that we know, if
    each is there once: "tcp_x" is x.
    """
    known = {*"xyz"}.union(*(convention.columns for convention in CONVENTIONS))
    words = {
        name: known & {*placed(re.split(r"[\W_]+", name), [""])[1]}
        or known & words_in(name)
        for name in units
    }
    of_flange = {name: words[name] for name in units if "flange" in name}
    by_flange = set().union(*of_flange.values())
    meant = [of_flange.get(name, own - by_flange) for name, own in words.items()]
    named = {}
    for own, (name, unit) in zip(meant, units.items(), strict=True):
        if offset := TOOL_OFFSET.fullmatch(name):
            name = f"tool {offset[1]}"
        elif re.fullmatch(TOOL_WORDS, name) and "tool" not in units | named:
            name = "tool"
        elif len(own) == 1 and meant.count(own) == 1:
            is_vector = re.match(rf"(?:{VECTORS})_", name)
            name, unit = min(own), unit or ("1" if is_vector else "")
        named[name] = unit
    return named


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
    columns = {
        name: [table.columns[name][0] for table in tables] for name in tables[0].units
    }
    return Table(folder, columns, labels_of_files(paths), "pose")


def taken_as(
    poses: Table, convention: Convention, layout: Layout
) -> tuple[dict, str, str, list[str]]:
    """Entries of a Scan, what the poses were taken for, what they are of: the flange,
    or a tool that is taken off or not; and what else is to be told. Raises ScanError.
    """
    units = {name: poses.units[name] for name in convention.columns}
    columns = {name: poses.columns[name] for name in ("pose", *"xyz", *units)}
    doubts = check_angles(poses, convention, layout.pose_columns)
    known = ANGLES if convention.sequence else OTHER_ANGLES
    angle = unit_of(poses.path, units, known)
    if known[angle] != 1:
        columns |= zip(units, poses.numbers(units).T * known[angle], strict=True)
    along = {axis: poses.units[axis] for axis in "xyz"}
    scale, lengths = to_mm(poses.path, along, poses.numbers("xyz"), REACH_MM[1] / 1000)
    entries = check_poses(replace(poses, columns=columns), scale)
    R, p = entries["R_base_flange"], entries["p_base_flange"]
    if "inverse" in poses.columns:
        name = poses.columns["inverse"][0]
        spread = np.var(p, axis=0).sum()
        R, p = inverse(R, p)
        if np.var(p, axis=0).sum() > spread and layout.entry.lower() != name:
            raise ScanError(
                f"{poses.path}: {name} names the inverse of the robot's pose, but its "
                "positions lie closer together than those of its inverse; if it has "
                "the poses, call it gripper2base there; if it has their inverses: "
                f"--entry {name}"
            )
        doubts.append(f"{name} is taken for the inverse of the robot's pose, by name")
    as_said = f" in {angle}, as said" if angle.isalpha() else ""
    angles = f"{', '.join(units)}{as_said}"
    words = f"{len(poses.lines)}, {convention.meaning} ({angles}), {lengths}"

    frames = {
        which: frame_of(poses, which, convention, scale, known[angle])
        for which in ("base object", "base", "tool", UNSAID)
    }
    unsaid, of_tool = frames.pop(UNSAID), convention
    if len(convention.columns) != 3:
        of_tool = named("FANUC angles")
    off = [
        f"{which} {poses.columns[which][0]} at {frame[1][0].round(3).tolist()} mm"
        for which in FRAMES
        if (frame := frames[which])
    ]
    tool, more = tool_on(poses, layout, convention.columns[-1])
    doubts += more
    of = tool or "the flange (--tool if they are of a tool)"
    if UNSAID in poses.columns and not layout.tool:
        name, numbers = poses.columns[UNSAID][0], "X Y Z W P R"
        if unsaid:
            numbers = numbers_given(*unsaid, of_tool, known[angle])
        of = f"the flange, or tool {name}, not taken off"
        doubts.append(
            f"the file has the frame of tool {name} and does not say whether the poses "
            f"are of it; if they are: --tool {numbers}"
        )
    if off:
        of = (
            f"{tool or 'the flange'}: the file has {' and '.join(off)}, taken off "
            "(--tool 0 0 0 0 0 0 leaves a tool on)"
        )
    if frames["tool"] and not layout.tool:
        R_tool, p_tool = frames["tool"]
        far = np.abs(p_tool).max()
        if far and not 2 <= far <= 2000:
            in_mm = p_tool * (1000 if far < 2 else 0.001)
            numbers = numbers_given(R_tool, in_mm, of_tool, known[angle])
            raise ScanError(
                f"{poses.path}: the tool is at {p_tool[0].round(3).tolist()} mm, if it "
                f"has the unit of the poses; say where it is, such as --tool {numbers}"
            )
    if layout.tool:
        frames["tool"] = frame_given(layout.tool, of_tool, known[angle])
        of = "the tool given, taken off"
    for which, frame in frames.items():
        if frame and which == "tool":
            R_tool_flange, p_tool_flange = inverse(*frame)
            R, p = R @ R_tool_flange, carry(R, p, p_tool_flange)
        elif frame:
            R, p = frame[0] @ R, carry(*frame, p)
    if R is not entries["R_base_flange"]:
        entries |= {"R_base_flange": R, "p_base_flange": p, "orientation": None}
    return entries, words, of, doubts


@np.errstate(over="ignore")
def check_angles(poses: Table, convention: Convention, said: str) -> list[str]:
    """What was guessed of angles or rotation vectors.

    Raises ScanError where nobody said whether angles are degrees or radians, and they
    may be both or neither; or where rx, ry, rz seem to be angles.
    """
    names = convention.columns
    units = {poses.units[name] for name in names}
    values = np.abs(poses.numbers(names))
    largest = values.max()
    angle = "deg" if "deg" in units or largest > 2 * np.pi else "rad"
    far = largest > LARGEST_ANGLE_DEG
    if convention.sequence and units == {""} and (far or angle == "rad"):
        unit = "mrad" if far else "rad"
        titles = {name: f"{name} [{unit}]" for name in names}
        raise ScanError(
            f"{poses.path}: {listed(names)} are at most {largest:.4g}: {unit}, or deg"
            f'rees? Say so: --pose-columns "{retitled(poses, titles)}", or with [deg]'
        )
    lengths = np.linalg.norm(values, axis=1)
    is_long = lengths > np.pi + 0.001
    if names != VECTOR or said or not (is_long.any() or "deg" in units):
        return []
    # what angles have at most, if R = Rz Ry Rx or Rx Ry Rz; controllers go on to count
    # a little beyond half a turn
    are_angles = (values < np.pi * np.array([1, 0.5, 1]) + 0.001).all()
    if "1" in units or (largest < 4 and np.median(lengths) < np.pi and not are_angles):
        return [
            f"rx, ry, rz are taken for rotation vectors, {is_long.sum()} of them "
            f"longer than π, {lengths.max():.4g} at most (--pose-columns)"
        ]
    angles = dict(zip(names, (f"{name} [{angle}]" for name in "wpr"), strict=True))
    sentence = (
        "rx, ry, rz of length {:.4g}, where rotation vectors have at most π: angles, "
        "it seems; say which: R = Rz Ry Rx by --pose-columns "
        f'"{retitled(poses, angles)}", R = Rx Ry Rz with alpha, beta, gamma there; or, '
        "if they are vectors, with rx, ry, rz"
    )
    poses.refuse(is_long | ("deg" in units), sentence, lengths)
    return []


def retitled(poses: Table, titles: dict[str, str]) -> str:
    """All columns of poses, some with other titles, as --pose-columns has them."""
    return ",".join(titles.get(name, name) for name in poses.units)


def frame_of(
    poses: Table, which: str, convention: Convention, scale: float, degrees: float
) -> tuple[ndarray, ndarray] | None:
    """Rotations (P, 3, 3) and places (P, 3), mm, of the poses' tool or base, if the
    file has its frame, with angles of so many degrees each, and that is not zero.
    """
    names = [f"{which} {column}" for column in (*"xyz", *convention.columns)]
    if not {*names} <= poses.columns.keys():
        return None
    values = poses.numbers(names, blank=True)
    has = np.isfinite(values).all(axis=1)  # others are of none
    R, p = np.tile(np.eye(3), (len(has), 1, 1)), np.nan_to_num(values[:, :3]) * scale
    R[has] = to_rotations(convention, values[has, 3:] * degrees)
    return (R, p) if p.any() or not np.allclose(R, np.eye(3)) else None


def numbers_given(R: ndarray, p: ndarray, of_tool: Convention, degrees: float) -> str:
    """What says the first of some tools' frames: the numbers of `frame_given`."""
    row = (*p[0], *from_rotations(of_tool, R)[0] / degrees)
    return " ".join(f"{value:.7g}" for value in row)


def frame_given(
    tool: tuple[float, ...], of_tool: Convention, degrees: float
) -> tuple[ndarray, ndarray]:
    """The frame of a tool, x, y, z, mm, and three angles on the flange, of so many
    degrees each as the poses' own. Raises ScanError for numbers that are none.
    """
    if not np.isfinite(tool).all():
        raise ScanError(f"--tool is {tool}; expected three mm and three angles")
    where = Table(Path("--tool"), {}, ["4 to 6"], "numbers")
    angles = np.array([tool[3:]]) * degrees
    return to_rotations(of_tool, angles, where), np.array([tool[:3]])


@np.errstate(invalid="ignore")  # words differ by nothing that is a number
def tool_on(poses: Table, layout: Layout, turn: str) -> tuple[str, list[str]]:
    """The tool that poses are of and that is not taken off, in words, if there is one;
    and doubts about the robot's frames and external axes. A column that ends with
    `turn` has a frame's last angle, if the file has the frame as it has poses.

    Raises ScanError where they differ between poses by more than a little.
    """
    # whether the sensor pose will be of another frame than the flange or the base
    elsewhere = {"base": layout.mount != MOUNTS[0], "tool": not layout.tool}
    hints = {"tool": "; for one on the flange give its frame: --tool X Y Z W P R"}
    doubts = []
    tool = ""
    for name in poses.columns:
        if name not in FRAMES and not EXTERNAL.fullmatch(name):
            continue
        frame = FRAMES.get(name, name)
        held = poses.columns.get(f"{name} {turn}", [""] * len(poses.lines))
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
            doubts.append(
                f"the poses are of {frame} {cells[0]}, "
                f"and so will be the sensor pose{hints.get(name, '')}"
            )
            if name == "tool":
                tool = f"tool {cells[0]}, not taken off"
    return tool, doubts
