"""The robot's poses: their numbers as they stand, their units, and whose they are."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from os.path import commonpath
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame, concat, to_numeric

from profilecal.scan.conventions import named
from profilecal.scan.folder import check_poses
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.blocks import (
    Block,
    Blocks,
    Column,
    Files,
    Poses,
    columns_titled,
    counted,
    is_of_other,
    lists_among,
    of_one_entry,
)
from profilecal_tool.importing.folder_files import names_of
from profilecal_tool.importing.makers import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    OF_POSES,
    ROBOTS,
    WORDS,
    XYZ,
    scale_of,
)
from profilecal_tool.importing.questions import Layout, Question, Taken, ranges

Fields = dict[str, Any]  # of a Scan, by name
FARTHEST_M = 20.0  # no robot reaches so far; a position in mm is farther somewhere
NEAR_MM = 200.0  # few flanges stay so near: it may be cm or inches
HINT = (
    "--pose-columns says it; w,p,r: R = Rz Ry Rx; a,b,c: KUKA; rx,ry,rz: a vector, "
    "rad; alpha,beta,gamma: Stäubli; o,a,t; qw,qx,qy,qz"
)
FANUC = named("FANUC angles")
OF_ABB = named("quaternion").columns
OF_VECTOR = ("rx", "ry", "rz")
OF_LIBRARIES = ("qx", "qy", "qz", "qw")


def poses_in(blocks: Blocks, said: str) -> Blocks:
    """The poses in the blocks of a file; `said`: titles from a user."""
    titles = said.split(",")
    found: Blocks = []
    for block in blocks:
        rows = block.table
        # matrices below one another, each closed by its last row
        is_matrix = rows.shape[1] == 4 and len(rows) % 4 == 0
        if is_matrix and (rows[3::4] == [0, 0, 0, 1]).all(axis=None):
            rows = DataFrame(rows.to_numpy().reshape(-1, 16), rows.index[::4])
            block = retitled(block, rows, counted(16))
        if not said:
            found += block.poses
        elif len(titles) == len(block.columns):
            found += retitled(block, rows, titles).poses
    return found


def retitled(block: Block, table: DataFrame, titles: list[str]) -> Block:
    """A block with another table or other titles."""
    return replace(block, table=table, columns=columns_titled(table, titles))


def robot_poses(files: Files, layout: Layout) -> Poses:
    """The robot's poses in files. Raises ScanError; Question where it is uncertain."""
    tables, first = {}, None
    for path, blocks in files.items():
        found = poses_in(blocks, layout.pose_columns)
        if not found:
            raise question_on_file(path, blocks, layout.pose_columns)
        poses = of_one_entry(found, layout.entry, "flange", "is the robot's pose")
        first = first or poses[0]
        for block in poses:
            if block.titles != first.titles:
                raise ScanError(
                    f"{path}: columns {listed(block.titles)}, where others differ"
                )
        tables[path] = concat([block.table for block in poses])
    check_whose(first, layout.entry)
    if len(files) == 1:
        return replace(first, table=tables[first.path])
    table = concat(tables).copy()  # by files and lines, as one piece
    # a further column of the files' names; where a row stands says the file too
    names, place = names_of(files), Path(commonpath(files))
    if len(table) > len(files) and len({path.parent for path in files}) > 1:
        raise ScanError(
            f"{place}: several poses in each of {listed(names)}; import each folder by "
            "itself; calibrate takes several scans"
        )
    name_of = dict(zip(files, names, strict=True))
    file = Column(-1, "file", "file", "label")
    table[file.at] = [name_of[path] for path, _ in table.index]
    table.index = [f"{line} of {path.name}" for path, line in table.index]
    columns = [*first.columns, file]
    return replace(first, path=place, table=table, columns=columns)


def check_whose(poses: Poses, said: str) -> None:
    """Raise Question where poses are of something else than the robot, which is not the
    entry that a user says; ScanError where they are inverses by their name, or where
    further columns of the same owner are called alike, but for x and z, which may be a
    profile's.
    """
    is_said = said and said.lower() in poses.entry.lower()
    if is_of_other(poses.entry) and not is_said:
        raise Question(
            f"{poses.path}: poses are of {poses.entry}; are they the flange's?",
            entry=poses.entry,
        )
    name = f"{poses.path.name} {poses.entry}".strip()
    if any(word in name.lower() for word in WORDS["inverse"]):
        raise ScanError(
            f"{poses.path.parent}: {name} may be the inverse: invert it, or rename it"
        )
    for column in poses.having("y", *poses.convention.columns):
        if column.owner == poses.chosen[column.role].owner:
            raise question_on_columns(poses, "which of those called alike?")


def question_on_file(path: Path, blocks: Blocks, said: str) -> ScanError:
    """A ScanError for a file without poses; a Question where it is likely what its
    columns are.
    """
    blocks = [block for block in blocks if block.kind == "pose"]  # not tools
    if not blocks:
        return ScanError(
            f"{path}: no poses; expected Cartesian ones, neither joints nor pulses"
        )
    block = max(blocks, key=lambda block: len(block.columns))
    likely = likely_pose(block)
    sentence = "what are they?"
    if said:
        sentence = f"no pose in {said}"
    elif block.having("joint") and not likely:
        sentence = "joint angles: export Cartesian poses"
    return question_on_columns(block, sentence, likely)


def with_roles(
    columns: Iterable[Column], roles: Iterable[str], unit: str = ""
) -> list[Column]:
    """Columns as they likely are, in a unit where they say none."""
    pairs = zip(columns, roles, strict=True)
    return [c._replace(role=role, unit=c.unit or unit) for c, role in pairs]


def likely_pose(block: Block) -> list[Column]:
    """What columns of numbers likely are: three of a position, or of no known role, and
    behind them W, P, R or, of unit length, a quaternion, which may stand before them.
    """
    numeric = block.table.apply(to_numeric, errors="coerce").dropna(axis=1, how="all")
    columns = [c for c in block.columns if c.at in numeric and not is_of_other(c.name)]
    columns = [column for column in columns if column.role in {"", *OF_POSES}]
    # those of the one list of six or seven numbers that has a name, or all
    lists = [c for n, c in lists_among(columns).items() if n and len(c) in (6, 7)]
    columns = lists[0] if len(lists) == 1 else columns
    for position, rest in ((columns[:3], columns[3:]), (columns[4:], columns[:4])):
        numbers = numeric[[column.at for column in rest]].to_numpy()
        is_unit = np.allclose(np.linalg.norm(numbers, axis=1), 1, atol=0.01)
        roles, unit = (), ""
        if len(rest) == 3:
            unit = likely_angle(numbers)
            is_vector = unit and rest[0] in chain(*lists)  # as Universal Robots have it
            roles = OF_VECTOR if is_vector else FANUC.columns
        elif len(rest) == 4 and is_unit:
            is_abb = rest[0].name.endswith(("0", "1"))  # of q0 … q3, q1 … q4
            roles = OF_ABB if is_abb else OF_LIBRARIES
        if roles and [c.role for c in position] in ([*XYZ], 3 * [""]):
            return with_roles(position, XYZ) + with_roles(rest, roles, unit)
    return []


def question_on_columns(
    block: Block, sentence: str, likely: Sequence[Column] = ()
) -> ScanError:
    """A Question on what columns of poses are, with an answer by what some likely are;
    a ScanError if nothing is likely.
    """
    sentence = f"{block.path}: columns {listed(block.titles)}; {sentence} ({HINT})"
    if not likely:
        return ScanError(sentence)
    answers = {c.at: c.answer for c in (*block.columns, *likely) if c.at >= 0}
    return Question(sentence, pose_columns=",".join(answers.values()))


def length_scale(poses: Poses) -> tuple[float, str]:
    """The scale of positions to mm, and their unit. Raises Question where that may be
    cm or inches.
    """
    units = poses.units(XYZ)
    farthest = np.linalg.norm(poses.numbers_of(XYZ), axis=1).max()
    usual = poses.robot and ROBOTS[poses.robot].unit
    if not usual:
        usual = "m" if farthest < FARTHEST_M else "mm"
        # one number, in m too far for a robot and in mm too near
        if not units and FARTHEST_M <= farthest < NEAR_MM:
            doubt = f"positions up to {farthest:.4g}; cm, in or mm?"
            in_cm = [poses.chosen[axis]._replace(unit="cm") for axis in XYZ]
            raise question_on_columns(poses, doubt, in_cm)
    return scale_of(poses.path, units, usual, LENGTH_UNITS)


def angle_scale(poses: Poses) -> tuple[float, str]:
    """The scale of angles to the unit of their convention, degrees or for a vector
    radians, and their unit; 1 and "" for numbers that have none. Raises Question where
    it may be another.
    """
    convention = poses.convention
    roles = convention.columns
    if convention.name in ("quaternion", "matrix"):
        return 1.0, ""
    usual = "deg" if convention.sequence else "rad"
    numbers, units = poses.numbers_of(roles), poses.units(roles)
    scale, unit = scale_of(poses.path, units, usual, ANGLE_UNITS)
    scale /= ANGLE_UNITS[usual]
    columns = [poses.chosen[role] for role in roles]
    likely = likely_angle(numbers)
    # controllers write such angles in degrees, programmers in either
    if convention.sequence and likely and not units:
        doubt = f"angles up to {np.abs(numbers).max():.4g}; which, rad or deg?"
        raise question_on_columns(poses, doubt, with_roles(columns, roles, likely))
    length = np.linalg.norm(numbers, axis=1).max()
    is_long = length > np.pi and not (units or poses.robot)
    # angles that are called like a vector, most often W, P, R
    if not convention.sequence and (is_long or scale != 1):
        what = listed(units) or "rad, longer than pi"
        doubt = f"a vector of {length:.4g} {what}; are they w, p, r?"
        wpr = with_roles(columns, FANUC.columns, likely)
        raise question_on_columns(poses, doubt, wpr)
    return scale, unit


def likely_angle(numbers: np.ndarray) -> str:
    """The unit of angles that may be radians; "" for those that are too large."""
    return "rad" if np.abs(numbers).max() <= 2 * np.pi else ""


def pose_fields(poses: Poses, labels: list[str]) -> tuple[Fields, Taken]:
    """Fields of a Scan, and what was taken for granted. Raises ScanError; Question for
    a unit.
    """
    numbers = poses.numbers_of(poses.chosen)
    to_mm, unit = length_scale(poses)
    scale, of_angle = angle_scale(poses)
    numbers[:, 3:] *= scale
    units = listed(filter(None, (unit, of_angle)))
    others = listed(o.entry for o in poses.poses if o.entry != poses.entry)
    not_read = f", not {others}" if others else ""
    name = "poses" if poses.entry in ("", "pose") else f"poses of {poses.entry}"
    words = f"{poses.path.name}: {len(labels)} {name}{not_read} in {units}"
    taken = {
        "poses": f"{words}: {ranges('XYZ', numbers[:, :3] * to_mm)}",
        "pose_columns": f"{', '.join(poses.chosen)}: {poses.convention.meaning}",
    }
    columns = dict(zip(poses.chosen, numbers.T, strict=True))
    table = Table(poses.path, {"pose": labels} | columns, poses.table.index)
    return check_poses(table, to_mm), taken  # with positions in mm
