"""The robot's poses: their numbers as they stand, their units, and whose they are."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from numpy import ndarray
from pandas import DataFrame

from profilecal.scan.conventions import CONVENTIONS, Convention
from profilecal.scan.folder import check_poses
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.column_meanings import (
    KEYS,
    columns_of,
    columns_of_poses,
    poses_and_others,
)
from profilecal_tool.importing.makers import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    ROBOTS,
    WORDS,
    Robot,
    convention_of,
)
from profilecal_tool.importing.questions import (
    Layout,
    Question,
    of_entry,
    one_or_ask,
    scale_of,
)
from profilecal_tool.importing.read_file import names_of
from profilecal_tool.importing.text_tables import Block, File, counted, numbers_of

FARTHEST_M = 20.0  # no robot reaches so far; a position in mm is farther somewhere
BESIDE = {"t": "time", "time": "time", "tool": "tool", "base": "base"}
KINDS = "w,p,r: R = Rz Ry Rx; a,b,c: KUKA; rx,ry,rz: a vector; o,a,t; qw,qx,qy,qz"
ANGLES = ("w", "p", "r")  # what angles without a name most often are
OF_ANGLES = {name for one in CONVENTIONS if one.sequence for name in one.columns}


@dataclass(frozen=True)
class Poses:
    """Rows with a pose each, of one file or of many."""

    block: Block  # that they are of, or the first of several
    name: str  # of the pose, where there were several
    units: dict[str, str]  # by role, of position, angles and what stands beside
    table: DataFrame  # columns by role; the index is where a row stands
    said: bool  # what its columns are
    offset: DataFrame | None = None  # the tool's frames that stand beside it
    read_with: Sequence[Block] = ()  # in any file, with tools and uses

    @property
    def path(self) -> Path:
        """Of the first file."""
        return self.block.path

    @property
    def convention(self) -> Convention:
        """Of the orientations."""
        return convention_of(self.units)

    @property
    def labels(self) -> dict[str, list[str]]:
        """The poses' labels, by the titles of their columns."""
        labels = self.table.filter(like="label ")
        return {name[6:]: [*map(label_of, labels[name])] for name in labels}

    def without_repeats(self) -> "Poses":
        """Each pose once, of rows of points, under the label that counts least."""
        labels = [*self.table.filter(like="label ")]
        others = [[*{*labels} - {one}] for one in labels] or [[]]
        tables = [self.table.drop(columns=some).drop_duplicates() for some in others]
        return replace(self, table=min(tables, key=len))

    @property
    def robot(self) -> Robot | None:
        """What makers.toml says of the program; None for tables."""
        return ROBOTS.get(self.block.robot)

    def numbers(self, names: Sequence[str]) -> ndarray:
        """Columns as numbers (rows, columns). Raises ScanError."""
        return numbers_of(self.path, self.table[[*names]])


def label_of(cell: Any) -> str:
    """A label: 7 for 7.0, as a column with blanks has it."""
    return f"{cell:.12g}" if isinstance(cell, float) else str(cell)


def poses_of(blocks: Iterable[Block], said: str) -> dict[str, list[Poses]]:
    """The poses in the blocks of a file, by the name of what has them; `said`: titles
    from a user.
    """
    by_name = defaultdict(list)
    titles = said.split(",")
    for block in map(matrices_as_rows, blocks):
        if said and len(titles) == len(block.titles):
            block = replace(block, titles=titles)
        columns = columns_of(block)
        poses = columns_of_poses(columns) if block.kind == "pose" else {}
        for owner, chosen in poses.items():
            others = [c for c in columns[::-1] if c not in chosen.values()]
            beside = {BESIDE[c.role]: c for c in others if c.role in BESIDE}
            free = [c for c in columns if c.name and c.role in ("label", "")]
            labels = {f"label {c.name}": c for c in free}
            chosen = labels | beside | chosen
            table = block.table.iloc[:, [column.at for column in chosen.values()]]
            units = {role: column.unit for role, column in chosen.items()}
            name = f"{block.name} {owner}".strip() or "poses"
            table = table.set_axis([*chosen], axis=1)
            by_name[name].append(Poses(block, name, units, table, bool(said)))
    return by_name


def matrices_as_rows(block: Block) -> Block:
    """Matrices below one another as rows of 16 numbers."""
    rows = block.table
    if not block.is_bare or rows.shape[1] != 4 or len(rows) % 4:
        return block
    if not (rows.iloc[3::4] == [0, 0, 0, 1]).all(axis=None):
        return block
    table = DataFrame(rows.to_numpy().reshape(-1, 16), rows.index[::4])
    return replace(block, table=table, titles=counted(16))


def labelled_by_pose(block: Block) -> Block:
    """A table with a pose beside each point, or profile, numbered by its pose if it has
    neither labels nor times.
    """
    posed, others = poses_and_others(columns_of(block))
    if not posed or {*KEYS} & {column.role for column in others}:
        return block
    cells = block.table.iloc[:, [column.at for column in posed]]
    numbers = cells.groupby([*cells], sort=False, dropna=False).ngroup() + 1
    table = pandas.concat([block.table, numbers.rename("label")], axis=1)
    return replace(block, table=table, titles=[*block.titles, "label"])


def robot_poses(
    files: Sequence[File], layout: Layout, beside: Sequence[Block]
) -> Poses:
    """The robot's poses in files, with all tables of these and of files beside them.

    Raises Question.
    """
    parts = []
    said = layout.pose_columns
    for path, blocks in files:
        by_name = poses_of(blocks, said)
        widths = {len(block.titles) for block in blocks}
        if not by_name or (said and said.count(",") + 1 not in widths):
            ask_what_columns_are(path, blocks, said)
        parts += poses_of_robot(path, by_name, layout.entry)
    first = parts[0]
    tables = []
    names = names_of([part.path for part in parts])
    for part, name in zip(parts, names, strict=True):
        if part.units != first.units:
            titles = listed(part.block.titles)
            raise ScanError(f"{part.path}: columns {titles}, where others differ")
        label = {"label file": name} if len(files) > 1 else {}
        tables.append(part.table.assign(**label))
    return replace(first, table=pandas.concat(tables), read_with=beside)


def poses_of_robot(path: Path, by_name: Mapping[str, list], entry: str) -> list[Poses]:
    """The poses that are the robot's, by what they are called. Raises ScanError."""
    names = of_entry(by_name, entry) or [*by_name]
    ranks = {name: likeness_to_flange(name) for name in names}
    best = max(ranks.values())
    if best == 0 and not entry:
        sentence = f"poses are of {listed(names)}; are they the flange's?"
        raise Question(f"{path}: {sentence}", entry=names[0])
    several = [name for name in names if ranks[name] == best]
    poses = by_name[one_or_ask(path, several, "is the robot's pose", "entry")]
    called = f"{path.name} {poses[0].name}"
    if any(word in called.lower() for word in WORDS["inverse"]):
        sentence = "is called as the inverse of a pose: invert it, or rename it"
        raise ScanError(f"{path.parent}: {called} {sentence}")
    others = listed(name for name in by_name if by_name[name] is not poses)
    beside = f", not {others}" if others else ""
    offsets = [one.table for one in by_name.get("tcp_offset", [])]
    offset = pandas.concat(offsets) if offsets else None
    return [replace(one, name=one.name + beside, offset=offset) for one in poses]


def likeness_to_flange(name: str) -> int:
    """How much a pose is called as the flange's: 0, as that of something else."""
    words = {*re.split(r"[\W_]+", name.lower())}
    if words & WORDS["other"]:
        return 0
    return 1 + bool(words & WORDS["robot"]) + ("flange" in words)


def ask_what_columns_are(path: Path, blocks: Sequence[Block], said: str) -> None:
    """Say why there are no poses in a file. Raises Question."""
    largest = max(blocks, key=lambda block: len(block.table), default=None)
    roles = {column.role for block in blocks for column in columns_of(block)}
    if largest is None or "joint" in roles:
        raise ScanError(f"{path}: no poses; joint angles are none: export Cartesian")
    if said and said.count(",") + 1 != len(largest.titles):
        titles = listed(largest.titles)
        raise ScanError(f"{path}: columns {titles}; --pose-columns says {said}")
    known = [column.role for column in columns_of(largest)]
    wanted = [axis for axis in "xyz" if axis not in known]
    is_quaternion = known.count("") - len(wanted) == 4
    wanted += ["qw", "qx", "qy", "qz"] if is_quaternion else ANGLES
    names = [name or (wanted.pop(0) if wanted else "") for name in known]
    raise question_on_columns(largest, "what are they?", names)


def question_on_columns(block: Block, sentence: str, roles: Sequence[str]) -> Question:
    """What columns of poses are, by an answer that may be right."""
    columns = columns_of(block)
    turns = [at for at, role in enumerate(roles) if role in OF_ANGLES]
    angles = block.table.iloc[:, turns].select_dtypes("number").abs()
    small = "rad" if angles.to_numpy().max(initial=0) <= 2 * np.pi else ""
    titles = []
    for column, role in zip(columns, roles, strict=True):
        unit = column.unit or (small if column.at in turns else "")
        titles.append(f"{role} [{unit}]" if unit else role or column.name)
    sentence = f"{block.path}: columns {listed(block.titles)}; {sentence} ({KINDS})"
    return Question(sentence, pose_columns=",".join(titles))


def length_unit(poses: Poses) -> tuple[float, str]:
    """The scale of positions to mm, and their unit."""
    farthest = np.linalg.norm(poses.numbers("xyz"), axis=1).max()
    usual = "m" if farthest < FARTHEST_M else "mm"
    usual = poses.robot.unit if poses.robot else usual
    units = {poses.units[axis] for axis in "xyz"}
    scale = scale_of(poses.path, units, usual, LENGTH_UNITS)
    return scale, poses.units["x"] or usual


def angle_unit(poses: Poses) -> tuple[float, str]:
    """The scale of angles to what their convention has, and their unit.

    Raises Question where it may be another.
    """
    turn = poses.convention
    is_vector = turn.name == "rotation vector"
    if not turn.sequence and not is_vector:
        return 1.0, ""
    numbers = poses.numbers(turn.columns)
    largest = np.abs(numbers).max()
    unit = poses.robot.angle if poses.robot else poses.units[turn.columns[0]]
    is_small = largest <= 2 * np.pi
    unclear = is_small and not unit
    if is_vector:
        is_long = np.linalg.norm(numbers, axis=1).max() > np.pi
        unclear = is_long if not unit else ANGLE_UNITS[unit] == 1 and not poses.said
    if unclear and not poses.robot:
        names = dict(zip(turn.columns, ANGLES, strict=True)) if is_vector else {}
        columns = columns_of(poses.block)
        roles = [names.get(column.role, column.role) for column in columns]
        sentence = f"angles up to {largest:.4g}; which, rad or deg?"
        if is_vector and unit:
            sentence = f"are they a vector in {unit}?"
        raise question_on_columns(poses.block, sentence, roles)
    unit = unit or ("rad" if is_vector else "deg")
    units = {poses.units[name] for name in turn.columns}
    scale = scale_of(poses.path, units, unit, ANGLE_UNITS)
    return scale / ANGLE_UNITS["rad"] if is_vector else scale, f", {unit}"


def pose_entries(poses: Poses, taken: dict[str, str]) -> dict[str, Any]:
    """Entries of a Scan; what was taken for granted goes to `taken`.

    Raises ScanError.
    """
    turn = poses.convention
    length, unit = length_unit(poses)
    angle, of_angle = angle_unit(poses)
    columns = {name: poses.table[name].to_numpy() for name in ("pose", *"xyz")}
    angles = poses.numbers(turn.columns) * angle
    columns |= dict(zip(turn.columns, angles.T, strict=True))
    words = f"{poses.path.name}: {len(poses.table)} {poses.name} in {unit}{of_angle}"
    if left := poses.block.left:
        words += f"; lines with as many numbers that are no poses: {left}"
    taken["poses"] = words
    taken["pose_columns"] = f"{', '.join(poses.units)}: {turn.meaning}"
    return check_poses(Table(poses.path, columns, [*poses.table.index]), length)
