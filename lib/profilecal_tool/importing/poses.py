"""The robot's poses: their numbers as they stand, their units, and whose they are."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from numpy import ndarray
from pandas import DataFrame

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import Convention, named, to_rotations
from profilecal.scan.folder import check_poses
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.answers import Layout, Question, only, scale_of
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.makers import ROBOTS, SETS, UNITS
from profilecal_tool.importing.programs import frames
from profilecal_tool.importing.roles import columns_of, convention_of, poses_in

FARTHEST_M = 20.0  # no robot reaches so far; a position in mm is farther somewhere
BESIDE = {"t": "time"} | {role: role for role in ("label", "time", "tool", "base")}
KINDS = "w,p,r: R = Rz Ry Rx; a,b,c: KUKA; rx,ry,rz: a vector; o,a,t; qw,qx,qy,qz"


@dataclass(frozen=True)
class Poses:
    """Rows with a pose each, of one file or of many."""

    path: Path
    table: DataFrame  # columns by role; the index is where a row stands
    units: dict[str, str]  # of position and angles
    order: list[str]  # the roles of all columns, as they stand
    robot: dict[str, Any]  # a row of makers.toml; {} for tables
    name: str  # of the pose, where there were several
    offset: DataFrame | None = None  # the tool's frames that stand beside it

    @property
    def convention(self) -> Convention:
        """Of the orientations."""
        return convention_of(self.units)

    def numbers(self, names: Sequence[str]) -> ndarray:
        """Columns as numbers (rows, columns). Raises ScanError."""
        columns = {name: self.table[name].to_numpy() for name in names}
        return Table(self.path, columns, self.table.index).numbers(names)


def poses_of(blocks: Iterable[Block], said: str) -> dict[str, list[Poses]]:
    """The poses in the blocks of a file, by the name of what has them."""
    found = {}
    for block in map(matrices, blocks):
        columns = columns_of(block, said)
        for of, own in poses_in(columns).items():
            others = [c for c in columns[::-1] if c not in own.values()]
            taken = {BESIDE[c.role]: c.at for c in others if c.role in BESIDE}
            taken |= {role: column.at for role, column in own.items()}
            table = block.table.iloc[:, [*taken.values()]].set_axis([*taken], axis=1)
            units = {role: columns[at].unit for role, at in taken.items()}
            order = [column.role for column in columns]
            name = " ".join(filter(None, (block.name, of)))
            robot = ROBOTS.get(block.robot, {})
            poses = Poses(block.path, table, units, order, robot, name)
            found.setdefault(name, []).append(poses)
    return found


def matrices(block: Block) -> Block:
    """Matrices below one another as rows of 16 numbers."""
    table = block.table
    if not block.is_bare or table.shape[1] != 4 or len(table) % 4:
        return block
    if not (table.iloc[3::4] == [0, 0, 0, 1]).all(axis=None):
        return block
    rows = DataFrame(table.to_numpy().reshape(-1, 16), table.index[::4])
    return Block(block.path, rows, [*map(str, range(1, 17))])


def joined(files: Sequence[tuple[Path, list[Block]]], layout: Layout) -> Poses:
    """The robot's poses in files. Raises Question."""
    parts = []
    titles = len(layout.pose_columns.split(",")) if layout.pose_columns else 0
    for path, blocks in files:
        found = poses_of(blocks, layout.pose_columns)
        if titles and all(len(block.titles) != titles for block in blocks):
            sentence = f"--pose-columns says {titles} columns; which are"
            raise ScanError(f"{path}: {sentence} {listed(blocks[0].titles)}")
        roles = {column.role for block in blocks for column in columns_of(block)}
        if not found and blocks and "joint" not in roles:
            raise unknown(max(blocks, key=lambda block: len(block.table)))
        if not found:
            raise ScanError(
                f"{path}: no poses; joint angles are none: export Cartesian"
            )
        own = [name for name in found if layout.entry.lower() in name.lower()] or found
        words = {name: {*re.split(r"[\W_]+", name.lower())} for name in own}
        things = [n for n in own if words[n] & SETS["other"]]
        robots = [n for n in own if words[n] & SETS["robot"] and n not in things]
        flanges = [name for name in robots if "flange" in words[name]]
        if things == [*own] and not layout.entry:
            sentence = f"poses are of {listed(own)}; are they the flange's?"
            raise Question(f"{path}: {sentence}", entry=things[0])
        several = {name: found[name] for name in flanges or robots or own}
        own = only(path, several, "is the robot's pose", "entry")
        others = listed(name for name in found if name != own[0].name)
        beside = f"{own[0].name}, not {others}" if others else own[0].name
        offset = found.get("tcp_offset", [None])[0]
        parts += [replace(p, name=beside, offset=offset and offset.table) for p in own]
    first = parts[0]
    called = f"{first.path.name} {first.name.partition(',')[0]}".strip()
    if any(word in called.lower() for word in SETS["inverse"]):
        sentence = "is called as the inverse of a pose: invert it, or rename it"
        raise ScanError(f"{first.path.parent}: {called} {sentence}")
    tables = []
    for part in parts:
        if part.units != first.units:
            raise ScanError(
                f"{part.path}: columns {listed(part.units)}, where others differ"
            )
        is_named = len(files) > 1 and "label" not in part.table
        tables.append(
            part.table.assign(**{"label": part.path.stem} if is_named else {})
        )
    return replace(first, table=pandas.concat(tables))


def unknown(block: Block) -> Question:
    """What the columns of poses are."""
    names = [c.role if c.role in {*"xyz", *BESIDE} else "" for c in columns_of(block)]
    free = [k for k, name in enumerate(names) if not name]
    wanted = [axis for axis in "xyz" if axis not in names]
    is_turn = len(free) - len(wanted) == 4
    wanted += ["qw", "qx", "qy", "qz"] if is_turn else "wpr"
    for k, name in zip(free, wanted, strict=False):
        names[k] = name
    turns = [k for k, name in enumerate(names) if name in "wpr" and name]
    table = block.table.iloc[:, turns].select_dtypes("number")
    small = max([*table.abs().max(), 0]) <= 2 * np.pi
    units = dict.fromkeys("wpr", "rad") if small else {}
    return asked(
        block.path, f"columns {listed(block.titles)}; what are they?", names, units
    )


def asked(path: Path, sentence: str, names: Sequence[str], units: dict) -> Question:
    """What columns of poses are, by an answer that may be right."""
    titles = [f"{n} [{units[n]}]" if units.get(n) else n or "_" for n in names]
    return Question(f"{path}: {sentence} ({KINDS})", pose_columns=",".join(titles))


def scales_of(poses: Poses) -> tuple[float, float, str]:
    """The scales of positions to mm and of angles to what their convention has, and the
    units in words. Raises Question.
    """
    farthest = np.linalg.norm(poses.numbers("xyz"), axis=1).max()
    usual = poses.robot.get("unit", "mm")
    if not poses.robot and farthest < FARTHEST_M:
        usual = "m"
    length = scale_of(poses.path, {poses.units[axis] for axis in "xyz"}, usual)
    in_words = poses.units["x"] or usual
    turn = poses.convention
    is_vector = turn.name == "rotation vector"
    if not (turn.sequence or is_vector):
        return length, 1.0, in_words
    numbers = poses.numbers(turn.columns)
    unit = poses.units[turn.columns[0]] or poses.robot.get("angle", "")
    small = np.abs(numbers).max() <= 2 * np.pi
    unclear = small and not is_vector
    if is_vector:
        unclear = (np.linalg.norm(numbers, axis=1) > np.pi).any()
    unclear = UNITS.get(unit) == 1 and is_vector if unit else unclear
    if unclear and not poses.robot:
        turned = dict(zip(turn.columns, "wpr", strict=True)) if is_vector else {}
        names = [turned.get(name, name) for name in poses.order]
        rad = dict.fromkeys((*turn.columns, *"wpr"), "rad") if small else {}
        sentence = f"angles up to {np.abs(numbers).max():.4g}; which, rad or deg?"
        raise asked(poses.path, sentence, names, poses.units | rad)
    unit = unit or ("rad" if is_vector else "deg")
    angle = scale_of(poses.path, {poses.units[n] for n in turn.columns}, unit)
    return length, angle / UNITS["rad"] if is_vector else angle, f"{in_words}, {unit}"


def entries_of(
    poses: Poses, layout: Layout, programs: str, taken: dict[str, str]
) -> dict[str, Any]:
    """Entries of a Scan; what was taken for granted goes to `taken`.

    Raises ScanError.
    """
    turn = poses.convention
    length, angle, units = scales_of(poses)
    columns = {name: poses.table[name].to_numpy() for name in ("pose", *"xyz")}
    angles = poses.numbers(turn.columns) * angle
    columns |= dict(zip(turn.columns, angles.T, strict=True))
    entries = check_poses(Table(poses.path, columns, [*poses.table.index]), length)
    taken["poses"] = f"{poses.path.name}: {len(poses.table)} {poses.name} in {units}"
    taken["pose_columns"] = f"{', '.join(poses.units)}: {turn.meaning}"
    numbers, taken["tool"] = tool_of(poses, layout, programs)
    if layout.tool:
        length = 1.0
        if len(turn.columns) != 3:
            turn, angle = named("FANUC angles"), 1.0
    if numbers is not None:
        R = to_rotations(turn, numbers[None, 3:] * angle)
        tool = homogeneous(R, numbers[None, :3] * length)
        T = homogeneous(entries["R_base_flange"], entries["p_base_flange"])
        T = T @ np.linalg.inv(tool)
        entries |= {"R_base_flange": T[:, :3, :3], "p_base_flange": T[:, :3, 3]}
        entries["orientation"] = None
    return entries


def tool_of(poses: Poses, layout: Layout, programs: str) -> tuple[ndarray | None, str]:
    """The tool's position and angles to take off, and what the poses are of in words.

    Raises ScanError.
    """
    tools, used = frames(poses.robot, programs)
    if poses.offset is not None:
        tools = poses.offset
    for which, names in used.items():
        if which in poses.table:
            names |= {*poses.table[which].fillna("none").astype(str)}
        used[which] = {name.lower().partition("[")[0] for name in names}
    bases = used["base"] - SETS["no_frame"]
    if bases and len(used["base"]) > 1:
        raise ScanError(
            f"{poses.path}: moves have bases {listed(sorted(used['base']))}; expected "
            "one: leave the others out"
        )
    base = f"; in base {listed(sorted(bases))}, not taken off" if bases else ""
    if layout.tool:
        return np.array(layout.tool), f"the one given, taken off{base}"
    if "name" in tools:
        tools = tools[tools["name"].str.lower().isin(used["tool"])]
    tools = tools.get([*"xyz", *poses.convention.columns], DataFrame())
    tools = tools.astype(float).drop_duplicates()
    own = used["tool"] - SETS["no_frame"]
    if len(tools) > 1 or (own and len(used["tool"]) > 1):
        raise ScanError(
            f"{poses.path}: moves have tools {listed(sorted(used['tool']))}; expected "
            "one: leave the others out, or say its frame: --tool X Y Z A B C"
        )
    if len(tools):
        at = tools.iloc[0].to_numpy()
        return at, f"{' '.join(own)} at {at[:3].tolist()}, taken off{base}"
    if own:
        return None, f"{' '.join(own)}, whose frame is not here: not taken off{base}"
    return None, f"none: taken for the flange's poses{base}"
