"""The robot's poses: their numbers as they stand, their units, and whose they are."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from pandas import DataFrame

from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.folder import check_poses
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.blocks import (
    Block,
    Column,
    Part,
    counted,
    is_of_other,
    parts_called,
)
from profilecal_tool.importing.makers import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    ROBOTS,
    WORDS,
    convention_of,
)
from profilecal_tool.importing.questions import (
    Layout,
    Question,
    scale_of,
)
from profilecal_tool.importing.read_file import names_of

FARTHEST_M = 20.0  # no robot reaches so far; a position in mm is farther somewhere
KINDS = "w,p,r: R = Rz Ry Rx; a,b,c: KUKA; rx,ry,rz: a vector; o,a,t; qw,qx,qy,qz"
QUATERNION, _, _, ANGLES, *_ = (convention.columns for convention in CONVENTIONS)
OF_ANGLES = {name for one in CONVENTIONS if one.sequence for name in one.columns}


def poses_in(blocks: Iterable[Block], said: str) -> list[Part]:
    """The poses in the blocks of a file; `said`: titles from a user."""
    titles, found = said.split(","), []
    for block in blocks:
        rows = block.table
        is_matrix = rows.shape[1] == 4 and len(rows) % 4 == 0
        if is_matrix and (rows[3::4] == [0, 0, 0, 1]).all(axis=None):
            table = DataFrame(rows.to_numpy().reshape(-1, 16), rows.index[::4])
            block = replace(block, table=table, titles=counted(16))
        if said and len(titles) != len(block.titles):
            continue
        block = replace(block, titles=titles) if said else block
        found += block.poses.values()
    return found


def robot_poses(files: Mapping[Path, list[Block]], layout: Layout) -> Part:
    """The robot's poses in files. Raises ScanError; Question where it is uncertain."""
    parts, paths = [], []
    for path, blocks in files.items():
        found = poses_in(blocks, layout.pose_columns)
        if not found:
            raise question_on_file(path, blocks, layout.pose_columns)
        own = parts_called(found, layout.entry, "flange", "is the robot's pose")
        parts += own
        paths += [path] * len(own)
    first = parts[0]
    called = f"{first.path.name} {first.name}".strip()
    if is_of_other(first.name) and not layout.entry:
        sentence = f"poses are of {first.name}; are they the flange's?"
        raise Question(f"{path}: {sentence}", entry=first.name)
    if any(word in called.lower() for word in WORDS["inverse"]):
        sentence = "is called as the inverse of a pose: invert it, or rename it"
        raise ScanError(f"{first.path.parent}: {called} {sentence}")
    titles = first.block.titles
    for part in parts:
        if part.block.titles != titles:
            found = listed(part.block.titles)
            raise ScanError(f"{part.path}: columns {found}, where others differ")
    table = pandas.concat([part.block.table for part in parts])
    if len({*paths}) > 1:
        counts = [len(part.block.table) for part in parts]
        table[len(titles)] = np.repeat(names_of(paths), counts)
        titles = [*titles, "file"]
    return replace(first, block=replace(first.block, table=table, titles=titles))


def question_on_file(path: Path, blocks: Sequence[Block], said: str) -> ScanError:
    """Why there are no poses in a file."""
    largest = max(blocks, key=lambda block: len(block.table), default=None)
    if largest is None or any(block.having("joint") for block in blocks):
        return ScanError(f"{path}: no poses; joint angles are none: export Cartesian")
    if said:
        titles = listed(largest.titles)
        return ScanError(f"{path}: columns {titles}; --pose-columns says {said}")
    return question_on_columns(largest, "what are they?", largest.columns)


def question_on_columns(
    block: Block, sentence: str, columns: Sequence[Column]
) -> Question:
    """What columns of poses are, by an answer that may be right: what is missing stands
    in the columns of numbers that are not known, in the usual order.
    """
    numeric = block.table.select_dtypes("number")
    free = [column.at for column in columns if not column.role and column.at in numeric]
    roles = {column.role for column in columns}
    wanted = [axis for axis in "xyz" if axis not in roles]
    if not convention_of(roles):
        wanted += QUATERNION if len(free) - len(wanted) == 4 else ANGLES
    guessed = dict(zip(free, wanted, strict=False))
    turns = [c.at for c in columns if guessed.get(c.at, c.role) in OF_ANGLES]
    angles = numeric.filter(turns).abs().to_numpy()
    small = "rad" if angles.max(initial=0) <= 2 * np.pi else ""
    titles = []
    for column in columns:
        unit = column.unit or (small if column.at in turns else "")
        name = guessed.get(column.at, column.name)
        titles.append(f"{name} [{unit}]" if unit else name)
    sentence = f"{block.path}: columns {listed(block.titles)}; {sentence} ({KINDS})"
    return Question(sentence, pose_columns=",".join(titles))


def length_of(poses: Part) -> tuple[float, str]:
    """The unit of positions, mm, and its name."""
    farthest = np.linalg.norm(poses.numbers("xyz"), axis=1).max()
    usual = "m" if farthest < FARTHEST_M else "mm"
    if poses.block.robot:
        usual = ROBOTS[poses.block.robot].unit
    return scale_of(poses.path, poses.units("xyz"), usual, LENGTH_UNITS)


def angle_of(poses: Part, layout: Layout) -> tuple[float, str]:
    """The unit of angles, in that of their convention, and its name.

    Raises Question where it may be another.
    """
    turn, robot = poses.convention, ROBOTS.get(poses.block.robot)
    if turn.name in ("quaternion", "matrix"):
        return 1.0, ""
    is_vector, units = not turn.sequence, poses.units(turn.columns)
    numbers, columns = poses.numbers(turn.columns), poses.block.columns
    doubt = ""
    if is_vector and not layout.pose_columns and units - {"rad"}:
        doubt = f"are they a vector in {listed(units)}?"
    elif not units:
        largest = np.linalg.norm(numbers, axis=1).max()
        if largest > np.pi if is_vector else np.abs(numbers).max() <= 2 * np.pi:
            doubt = f"angles up to {np.abs(numbers).max():.4g}; which, rad or deg?"
    if doubt and not robot:
        if is_vector:  # most often it is none
            unknown = poses.columns.values()
            columns = [c._replace(role=c.role * (c not in unknown)) for c in columns]
        raise question_on_columns(poses.block, doubt, columns)
    usual = "rad" if is_vector else "deg"
    units = {robot.angle} - {""} if robot else units
    scale, unit = scale_of(poses.path, units, usual, ANGLE_UNITS)
    return scale / ANGLE_UNITS[usual], f", {unit}"


def pose_entries(
    poses: Part, labels: Sequence[str], layout: Layout, taken: dict[str, str]
) -> dict[str, Any]:
    """Entries of a Scan; what was taken for granted goes to `taken`.

    Raises ScanError.
    """
    turn = poses.convention
    (length, unit), (angle, of_angle) = length_of(poses), angle_of(poses, layout)
    angles = poses.numbers(turn.columns) * angle
    columns = dict(zip("xyz", poses.numbers("xyz").T, strict=True))
    columns |= zip(turn.columns, angles.T, strict=True)
    others = listed(p.name for p in poses.block.poses.values() if p.name != poses.name)
    beside = f", not {others}" if others else ""
    name = "poses" if poses.name in ("", "pose") else poses.name
    words = f"{len(labels)} {name}{beside} in {unit}{of_angle}"
    taken["poses"] = f"{poses.path.name}: {words}"
    taken["pose_columns"] = f"{', '.join(poses.columns)}: {turn.meaning}"
    lines = [*poses.block.table.index]
    return check_poses(Table(poses.path, {"pose": labels} | columns, lines), length)
