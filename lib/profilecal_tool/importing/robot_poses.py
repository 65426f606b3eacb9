"""The robot's poses: their numbers as they stand, their units, and whose they are."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import zip_longest
from os.path import commonpath
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame, concat, to_numeric

from profilecal.scan.conventions import CONVENTIONS, named
from profilecal.scan.folder import check_poses
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.blocks import (
    Block,
    Column,
    Files,
    counted,
    is_of_other,
    parts_called,
)
from profilecal_tool.importing.makers import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    OF_POSES,
    ROBOTS,
    WORDS,
    XYZ,
    likely_unit,
    scale_of,
)
from profilecal_tool.importing.questions import Layout, Question, Taken, ranges
from profilecal_tool.importing.read_file import names_of

Entries = dict[str, Any]  # of a Scan
FARTHEST_M = 20.0  # no robot reaches so far; a position in mm is farther somewhere
NEAR_MM = 200.0  # few flanges stay so near: it may be cm or inches
LIKELY_MM = 1000.0  # the farthest that a flange is, for a guess at a unit
HINT = "w,p,r: R = Rz Ry Rx; a,b,c: KUKA; rx,ry,rz: a vector; "
HINT += "alpha,beta,gamma: Stäubli; o,a,t; qw,qx,qy,qz"
FANUC = named("FANUC angles").columns
OF_ABB = named("quaternion").columns
OF_LIBRARIES = ("qx", "qy", "qz", "qw")
OF_ANGLES = {name for one in CONVENTIONS if one.sequence for name in one.columns}


def poses_in(blocks: Iterable[Block], said: str) -> list[Block]:
    """The poses in the blocks of a file; `said`: titles from a user."""
    titles, found = said.split(","), []
    for block in blocks:
        rows = block.table
        # matrices below one another, each closed by its last row
        is_matrix = rows.shape[1] == 4 and len(rows) % 4 == 0
        if is_matrix and (rows[3::4] == [0, 0, 0, 1]).all(axis=None):
            table = DataFrame(rows.to_numpy().reshape(-1, 16), rows.index[::4])
            block = replace(block, table=table, titles=counted(16))
        if said:
            if len(titles) != len(block.titles):
                continue
            block = replace(block, titles=titles)
        found += block.poses.values()
    return found


def robot_poses(files: Files, layout: Layout) -> Block:
    """The robot's poses in files. Raises ScanError; Question where it is uncertain."""
    parts = []
    for path, blocks in files.items():
        found = poses_in(blocks, layout.pose_columns)
        if not found:
            raise question_on_file(path, blocks, layout.pose_columns)
        parts += parts_called(found, layout.entry, "flange", "is the robot's pose")
    first = parts[0]
    check_whose(first, layout.entry.lower())
    for part in parts:
        if part.titles != first.titles:
            found = f"columns {listed(part.titles)}, where others differ"
            raise ScanError(f"{part.path}: {found}")
    table = concat([part.table for part in parts])
    if len(files) == 1:
        return replace(first, table=table)
    # a further column of the files' names; where a row stands says the file too
    name_of = dict(zip(files, names_of(files), strict=True))
    paths = [part.path for part in parts for _ in part.table.index]
    table[len(first.titles)] = [name_of[path] for path in paths]
    pairs = zip(table.index, paths, strict=True)
    table.index = [f"{line} of {path.name}" for line, path in pairs]
    titles = [*first.titles, "file"]
    return replace(first, path=Path(commonpath(files)), table=table, titles=titles)


def check_whose(poses: Block, entry: str) -> None:
    """Raise Question where poses are of something else than the robot, and that is not
    the entry, or where columns are called alike; ScanError where they are inverses.
    """
    is_asked_for = entry and entry in poses.called.lower()
    if is_of_other(poses.called) and not is_asked_for:
        sentence = f"{poses.path}: poses are of {poses.called}; are they the flange's?"
        raise Question(sentence, entry=poses.called)
    called = f"{poses.path.name} {poses.called}".strip()
    if any(word in called.lower() for word in WORDS["inverse"]):
        found = f"{called} is called as the inverse: invert or rename"
        raise ScanError(f"{poses.path.parent}: {found}")
    # a second x or z may be a profile's
    for column in poses.having("y", *poses.convention.columns):
        if column.owner == poses.chosen[column.role].owner:
            alike = "which of those called alike?"
            raise question_on_columns(poses, alike, poses.columns)


def question_on_file(path: Path, blocks: list[Block], said: str) -> ScanError:
    """Why there are no poses in a file."""
    if not blocks or any(block.having("joint") for block in blocks):
        hint = "joint angles are none: export Cartesian poses"
        return ScanError(f"{path}: no poses; {hint}")
    placed = [b for b in blocks if {*XYZ} <= {column.role for column in b.columns}]
    likely = max(placed or blocks, key=lambda block: len(block.table))
    sentence = f"--pose-columns says {said}" if said else "what are they?"
    return question_on_columns(likely, sentence, likely.columns)


def question_on_columns(
    block: Block, sentence: str, columns: list[Column]
) -> ScanError:
    """What columns of poses are, by an answer that may be right: what is missing stands
    in the columns of numbers that are not known, in the usual order. Two columns that
    are called alike are not known; roles of angles are forgotten if need be.
    """
    sentence = f"{block.path}: columns {listed(block.titles)}; {sentence} ({HINT})"
    numeric = block.table.apply(to_numeric, errors="coerce").dropna(axis=1, how="all")
    if block.path.is_dir():
        columns = columns[:-1]  # of several files; the last is ours
    posed = [c for c in columns if c.at in numeric and c.role in {"", *OF_POSES}]
    quaternion = OF_ABB if "q1" in block.titles else OF_LIBRARIES
    # first keep all roles that are known; if the rest does not fit, only x, y, z
    for kept in (OF_POSES, XYZ):
        roles = [c.role for c in posed if c.role in kept]
        known = {c.role: c.at for c in posed if roles.count(c.role) == 1}
        free = [c.at for c in posed if c.at not in known.values()]
        wanted = missing_roles({*known}, {*roles}, len(free), quaternion)
        if len(wanted) <= len(free):
            break
    else:  # neither fits: there is no answer to offer
        return ScanError(sentence)
    guessed = dict(zip_longest(free, wanted, fillvalue="_"))
    turns = [c.at for c in columns if guessed.get(c.at, c.role) in OF_ANGLES]
    largest = numeric.filter(turns).abs().to_numpy().max(initial=0)
    small = "rad" if largest <= 2 * np.pi else ""
    titles = []
    for column in columns:
        unit = column.unit or (small if column.at in turns else "")
        # such as tcp_x; _x without an owner
        titled = f"{column.owner}_{column.role}" if column.role else column.name
        name = guessed.get(column.at, titled).strip("_") or "_"
        titles.append(f"{name} [{unit}]" if unit else name)
    return Question(sentence, pose_columns=",".join(titles))


def missing_roles(
    known: set[str], begun: set[str], free: int, quaternion: Sequence[str]
) -> list[str]:
    """The roles of a pose beside those that are known, for so many columns: of the
    convention that is begun, or else of this quaternion or FANUC's angles.
    """
    wanted = [axis for axis in XYZ if axis not in known]
    likely = max(CONVENTIONS, key=lambda one: len(begun.intersection(one.columns)))
    turn = likely.columns
    if begun.isdisjoint(turn):
        turn = quaternion if free - len(wanted) == 4 else FANUC
    return wanted + [name for name in turn if name not in known]


def length_of(poses: Block) -> tuple[float, str]:
    """The unit of positions, mm, and its name. Raises Question where it may be cm or
    inches.
    """
    units = poses.units("xyz")
    farthest = np.linalg.norm(poses.numbers_of("xyz"), axis=1).max()
    usual = "m" if farthest < FARTHEST_M else "mm"
    if poses.robot:
        usual = ROBOTS[poses.robot].unit
    elif not units and FARTHEST_M <= farthest < NEAR_MM:
        columns, unit = [*poses.columns], likely_unit(farthest, LIKELY_MM)
        for axis in XYZ:
            column = poses.chosen[axis]
            columns[column.at] = column._replace(unit=unit)
        doubt = f"positions up to {farthest:.4g}; cm, in or mm?"
        raise question_on_columns(poses, doubt, columns)
    return scale_of(poses.path, units, usual, LENGTH_UNITS)


def angle_of(poses: Block) -> tuple[float, str]:
    """The unit of angles, in that of their convention, and its name behind a comma; 1
    and "" for numbers that have none.

    Raises Question where it may be another.
    """
    turn = poses.convention
    if turn.name in ("quaternion", "matrix"):
        return 1.0, ""
    usual, units = "deg" if turn.sequence else "rad", poses.units(turn.columns)
    if doubt := doubt_of_angles(poses, units):
        columns = [*poses.columns]
        if not turn.sequence:  # most often they are W, P, R, and no vector
            for name, role in zip(turn.columns, FANUC, strict=True):
                column = poses.chosen[name]
                columns[column.at] = column._replace(role=role)
        raise question_on_columns(poses, doubt, columns)
    scale, unit = scale_of(poses.path, units, usual, ANGLE_UNITS)
    return scale / ANGLE_UNITS[usual], f", {unit}"


def doubt_of_angles(poses: Block, units: set[str]) -> str:
    """What speaks against angles in degrees, or a vector in radians; "" for nothing."""
    is_vector = not poses.convention.sequence
    if is_vector and units - {"rad"}:
        return f"are they a vector in {listed(units)}? (then convert it to rad)"
    if units:
        return ""
    numbers = poses.numbers_of(poses.convention.columns)
    if is_vector:
        length = np.linalg.norm(numbers, axis=1).max()
        found = f"a vector of {length:.4g} rad is longer than pi; are they w, p, r?"
        is_no_vector = length > np.pi and not poses.robot
        return f"{found} (in deg: convert it to rad)" if is_no_vector else ""
    largest = np.abs(numbers).max()
    is_small = largest <= 2 * np.pi
    return f"angles up to {largest:.4g}; which, rad or deg?" if is_small else ""


def pose_entries(poses: Block, labels: list[str], taken: Taken) -> Entries:
    """Entries of a Scan; what was taken for granted goes to `taken`.

    Raises ScanError.
    """
    numbers = poses.numbers_of(poses.chosen)
    length, unit = length_of(poses)
    angle, of_angle = angle_of(poses)
    numbers[:, 3:] *= angle
    columns = dict(zip(poses.chosen, numbers.T, strict=True))
    others = listed(called for called in poses.poses if called != poses.called)
    beside = f", not {others}" if others else ""
    name = "poses" if poses.called in ("", "pose") else f"poses of {poses.called}"
    words = f"{len(labels)} {name}{beside} in {unit}{of_angle}"
    places = ranges("XYZ", numbers[:, :3] * length)
    taken["poses"] = f"{poses.path.name}: {words}: {places}"
    taken["pose_columns"] = f"{', '.join(poses.chosen)}: {poses.convention.meaning}"
    table = Table(poses.path, {"pose": labels} | columns, poses.table.index)
    return check_poses(table, length)
