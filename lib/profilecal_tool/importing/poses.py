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
from pandas import DataFrame, Series

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import Convention, named, to_rotations
from profilecal.scan.folder import check_poses
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.answers import Layout, Question, only, scale_of
from profilecal_tool.importing.blocks import Block, by_number
from profilecal_tool.importing.makers import ROBOTS, SETS, UNITS
from profilecal_tool.importing.roles import (
    KEYS,
    Column,
    columns_of,
    convention_of,
    pose_columns,
)

FARTHEST_M = 20.0  # no robot reaches so far; a position in mm is farther somewhere
BESIDE = {"t": "time"} | {role: role for role in ("label", "time", "tool", "base")}
KINDS = "w,p,r: R = Rz Ry Rx; a,b,c: KUKA; rx,ry,rz: a vector; o,a,t; qw,qx,qy,qz"
ANGLES = ("w", "p", "r")  # what angles without a name most often are


@dataclass(frozen=True)
class Poses:
    """Rows with a pose each, of one file or of many."""

    block: Block  # that they are of, or the first of several
    name: str  # of the pose, where there were several
    columns: list[Column]  # of the block
    units: dict[str, str]  # by role, of position, angles and what stands beside
    table: DataFrame  # columns by role; the index is where a row stands
    offset: DataFrame | None = None  # the tool's frames that stand beside it

    @property
    def path(self) -> Path:
        """Of the first file."""
        return self.block.path

    @property
    def convention(self) -> Convention:
        """Of the orientations."""
        return convention_of(self.units)

    @property
    def robot(self) -> dict[str, Any]:
        """What makers.toml says of the program; {} for tables."""
        return ROBOTS.get(self.block.robot, {})

    def numbers(self, names: Sequence[str]) -> ndarray:
        """Columns as numbers (rows, columns). Raises ScanError."""
        columns = {name: self.table[name].to_numpy() for name in names}
        return Table(self.path, columns, self.table.index).numbers(names)


def poses_of(blocks: Iterable[Block], said: str) -> dict[str, list[Poses]]:
    """The poses in the blocks of a file, by the name of what has them; `said`: titles
    from a user.
    """
    found = defaultdict(list)
    titles = said.split(",")
    for block in map(matrices, blocks):
        if said and len(titles) == len(block.titles):
            block = replace(block, titles=titles)
        columns = columns_of(block)
        poses = pose_columns(columns) if block.kind == "pose" else {}
        for owner, chosen in poses.items():
            others = [c for c in columns[::-1] if c not in chosen.values()]
            beside = {BESIDE[c.role]: c for c in others if c.role in BESIDE}
            chosen = beside | chosen
            table = block.table.iloc[:, [column.at for column in chosen.values()]]
            units = {role: column.unit for role, column in chosen.items()}
            name = f"{block.name} {owner}".strip()
            table = table.set_axis([*chosen], axis=1)
            found[name].append(Poses(block, name, columns, units, table))
    return found


def matrices(block: Block) -> Block:
    """Matrices below one another as rows of 16 numbers."""
    rows = block.table
    if not block.is_bare or rows.shape[1] != 4 or len(rows) % 4:
        return block
    if not (rows.iloc[3::4] == [0, 0, 0, 1]).all(axis=None):
        return block
    table = DataFrame(rows.to_numpy().reshape(-1, 16), rows.index[::4])
    return replace(block, table=table, titles=by_number(16))


def beside_points(block: Block) -> Block:
    """A table with a pose beside each point, or profile, numbered by its pose if it has
    neither labels nor times.
    """
    columns = columns_of(block)
    poses = pose_columns(columns).values()
    chosen = [column for roles in poses for column in roles.values()]
    roles = {column.role for column in columns if column not in chosen}
    if not chosen or roles & {*KEYS}:
        return block
    cells = block.table.iloc[:, [column.at for column in chosen]]
    numbers = cells.groupby([*cells], sort=False, dropna=False).ngroup() + 1
    table = block.table.assign(label=numbers)
    return replace(block, table=table, titles=[*block.titles, "label"])


def robot_poses(files: Sequence[tuple[Path, list[Block]]], layout: Layout) -> Poses:
    """The robot's poses in files. Raises Question."""
    parts = []
    for path, blocks in files:
        found = poses_of(blocks, layout.pose_columns)
        if not found:
            refuse(path, blocks, layout.pose_columns)
        parts += of_robot(path, found, layout.entry)
    first = parts[0]
    tables = []
    for part in parts:
        if part.units != first.units:
            titles = listed(part.block.titles)
            raise ScanError(f"{part.path}: columns {titles}, where others differ")
        is_named = len(files) > 1 and "label" not in part.table
        label = {"label": part.path.stem} if is_named else {}
        tables.append(part.table.assign(**label))
    return replace(first, table=pandas.concat(tables))


def of_robot(path: Path, found: Mapping[str, list], entry: str) -> list[Poses]:
    """The poses that are the robot's, by what they are called. Raises ScanError."""
    names = [name for name in found if entry.lower() in name.lower()] or [*found]
    ranks = {name: rank(name) for name in names}
    best = max(ranks.values())
    if best == 0 and not entry:
        sentence = f"poses are of {listed(names)}; are they the flange's?"
        raise Question(f"{path}: {sentence}", entry=names[0])
    several = [name for name in names if ranks[name] == best]
    poses = found[only(path, several, "is the robot's pose", "entry")]
    called = f"{path.name} {poses[0].name}"
    if any(word in called.lower() for word in SETS["inverse"]):
        sentence = "is called as the inverse of a pose: invert it, or rename it"
        raise ScanError(f"{path.parent}: {called} {sentence}")
    others = listed(name for name in found if found[name] is not poses)
    beside = f", not {others}" if others else ""
    offset = found["tcp_offset"][0].table if "tcp_offset" in found else None
    return [replace(one, name=one.name + beside, offset=offset) for one in poses]


def rank(name: str) -> int:
    """How much a pose is called as the flange's: 0, as that of something else."""
    words = {*re.split(r"[\W_]+", name.lower())}
    if words & SETS["other"]:
        return 0
    return 1 + bool(words & SETS["robot"]) + ("flange" in words)


def refuse(path: Path, blocks: Sequence[Block], said: str) -> None:
    """Say why there are no poses in a file. Raises Question."""
    largest = max(blocks, key=lambda block: len(block.table), default=None)
    roles = {column.role for block in blocks for column in columns_of(block)}
    if largest is None or "joint" in roles:
        raise ScanError(f"{path}: no poses; joint angles are none: export Cartesian")
    titles = f"columns {listed(largest.titles)}"
    if said and said.count(",") + 1 != len(largest.titles):
        raise ScanError(f"{path}: {titles}; --pose-columns says {said}")
    columns = columns_of(largest)
    known = [c.role if c.role in {*"xyz", *BESIDE} else "" for c in columns]
    wanted = [axis for axis in "xyz" if axis not in known]
    is_quaternion = known.count("") - len(wanted) == 4
    wanted += ["qw", "qx", "qy", "qz"] if is_quaternion else ANGLES
    names = [name or (wanted.pop(0) if wanted else "_") for name in known]
    turns = [at for at, name in enumerate(names) if name in ANGLES]
    angles = largest.table.iloc[:, turns].select_dtypes("number").abs()
    small = max(angles.max(), default=0) <= 2 * np.pi
    units = dict.fromkeys(ANGLES, "rad") if small else {}
    raise which_columns(path, f"{titles}; what are they?", names, units)


def which_columns(
    path: Path, sentence: str, names: Sequence[str], units: Mapping[str, str]
) -> Question:
    """What columns of poses are, by an answer that may be right."""
    titles = [f"{n} [{units[n]}]" if units.get(n) else n or "_" for n in names]
    return Question(f"{path}: {sentence} ({KINDS})", pose_columns=",".join(titles))


def length_of(poses: Poses) -> tuple[float, str]:
    """The scale of positions to mm, and their unit."""
    farthest = np.linalg.norm(poses.numbers("xyz"), axis=1).max()
    usual = "m" if farthest < FARTHEST_M and not poses.robot else "mm"
    usual = poses.robot.get("unit", usual)
    scale = scale_of(poses.path, {poses.units[axis] for axis in "xyz"}, usual)
    return scale, poses.units["x"] or usual


def angle_of(poses: Poses) -> tuple[float, str]:
    """The scale of angles to what their convention has, and their unit.

    Raises Question where it may be another.
    """
    turn = poses.convention
    is_vector = turn.name == "rotation vector"
    if not turn.sequence and not is_vector:
        return 1.0, ""
    numbers = poses.numbers(turn.columns)
    unit = poses.units[turn.columns[0]] or poses.robot.get("angle", "")
    small = np.abs(numbers).max() <= 2 * np.pi
    unclear = small and not unit
    if is_vector:
        is_long = np.linalg.norm(numbers, axis=1).max() > np.pi
        unclear = UNITS.get(unit) == 1 or (is_long and not unit)
    if unclear and not poses.robot:
        names = dict(zip(turn.columns, ANGLES, strict=True)) if is_vector else {}
        roles = [names.get(column.role, column.role) for column in poses.columns]
        units = dict.fromkeys((*turn.columns, *ANGLES), "rad" if small else "")
        sentence = f"angles up to {np.abs(numbers).max():.4g}; which, rad or deg?"
        raise which_columns(poses.path, sentence, roles, poses.units | units)
    unit = unit or ("rad" if is_vector else "deg")
    scale = scale_of(poses.path, {poses.units[name] for name in turn.columns}, unit)
    return scale / UNITS["rad"] if is_vector else scale, f", {unit}"


def entries_of(
    poses: Poses, layout: Layout, programs: Sequence[Block], taken: dict[str, str]
) -> dict[str, Any]:
    """Entries of a Scan; what was taken for granted goes to `taken`.

    Raises ScanError.
    """
    turn, (length, unit), (angle, of_angle) = (
        poses.convention,
        length_of(poses),
        angle_of(poses),
    )
    columns = {name: poses.table[name].to_numpy() for name in ("pose", *"xyz")}
    angles = poses.numbers(turn.columns) * angle
    columns |= dict(zip(turn.columns, angles.T, strict=True))
    entries = check_poses(Table(poses.path, columns, [*poses.table.index]), length)
    words = f"{poses.path.name}: {len(poses.table)} {poses.name} in {unit}{of_angle}"
    if left := poses.block.left:
        words += f"; {left} lines of as many numbers are no poses"
    taken["poses"] = words
    taken["pose_columns"] = f"{', '.join(poses.units)}: {turn.meaning}"
    numbers, taken["tool"] = tool_of(poses, layout, programs)
    if numbers is None:
        return entries
    if layout.tool:
        length = 1.0
        if len(turn.columns) != 3:
            turn, angle = named("FANUC angles"), 1.0
    R = to_rotations(turn, numbers[None, 3:] * angle)
    tool = homogeneous(R, numbers[None, :3] * length)
    T = homogeneous(entries["R_base_flange"], entries["p_base_flange"])
    T = T @ np.linalg.inv(tool)
    flange = {"R_base_flange": T[:, :3, :3], "p_base_flange": T[:, :3, 3]}
    return entries | flange | {"orientation": None}


def tool_of(
    poses: Poses, layout: Layout, programs: Iterable[Block]
) -> tuple[ndarray | None, str]:
    """The tool's position and angles to take off, and what the poses are of in words.

    Raises ScanError.
    """
    tables = defaultdict(DataFrame)
    for block in programs:
        if block.robot and block.robot == poses.block.robot:
            tables[block.kind] = pandas.concat([tables[block.kind], block.table])
    words = {}
    for which in ("tool", "base"):
        names = names_in(tables["uses"], which) | names_in(poses.table, which)
        words[which] = listed(sorted(names - SETS["no_frame"]))
        if words[which] and len(names) > 1 and not (layout.tool and which == "tool"):
            sentence = f"moves have {which}s {listed(sorted(names))}; expected one"
            raise ScanError(f"{poses.path}: {sentence}: leave the others out")
    base = f"; in base {words['base']}, not taken off" if words["base"] else ""
    if layout.tool:
        return np.array(layout.tool), f"the one given, taken off{base}"
    tools = tables["tool"] if poses.offset is None else poses.offset
    if "name" in tools:
        tools = tools[tools["name"].str.lower() == words["tool"]]
    tools = tools.get([*"xyz", *poses.convention.columns], DataFrame())
    tools = tools.astype(float).drop_duplicates()
    if len(tools) > 1:
        hint = "expected one: say its frame: --tool X Y Z A B C"
        raise ScanError(f"{poses.path}: the tool is said {len(tools)} times; {hint}")
    if len(tools):
        at = tools.iloc[0].to_numpy()
        return at, f"{words['tool']} at {at[:3].tolist()}, taken off{base}"
    if words["tool"]:
        return None, f"{words['tool']}, whose frame is not here: not taken off{base}"
    return None, f"none: taken for the flange's poses{base}"


def names_in(table: DataFrame, which: str) -> set[str]:
    """The tools or bases that a table names, "none" where a row has none."""
    names = table.get(which, Series(dtype=str))
    return {name.lower().partition("[")[0] for name in names.astype(str)}
