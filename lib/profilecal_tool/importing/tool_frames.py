"""Tools and bases that programs declare: taken off poses, named, or asked about."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy import ndarray
from pandas import DataFrame

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import Convention, pose_matrices
from profilecal.scan.tables import ScanError, listed, naming
from profilecal_tool.importing.blocks import Blocks, Poses, label_of
from profilecal_tool.importing.makers import ROBOTS, WORDS, XYZ
from profilecal_tool.importing.questions import Layout, Question
from profilecal_tool.importing.robot_poses import (
    FANUC,
    Fields,
    angle_scale,
    length_scale,
)

Row = dict  # what stands in a line, by name
Numbers = Sequence[float]  # of a tool: its position and angles, as they stand
Program = dict[str, list[Row]]  # the rows of each kind of line
UNTURNED = {"qw", "r11", "r22", "r33"}  # are 1 in a frame that does not turn
AT_ONCE = ""  # the name of a tool that is used where it is declared, without a name


def lines_of_program(blocks: Blocks, maker: str) -> Program:
    """What lines of each kind say in a maker's programs, in any file."""
    program = defaultdict(list)
    for block in blocks:
        if maker and block.robot == maker:
            table = block.table.set_axis(block.titles, axis=1).astype(object)
            table = table.fillna("").map(str.lower)  # to robots, P1 is p1
            program[block.kind] += table.to_dict("records")
    return program


def tools_in_data(blocks: Blocks, poses: Poses, to_mm: float) -> list[Row]:
    """Frames that no program of these poses declares: poses that do not change and are
    called a tool; and, beside poses in a table, files that are called so or have a line
    on one. Without numbers where these are not known, or may be in other units than the
    poses', which this scale makes mm.
    """
    tools = []
    for block in blocks:
        stem = block.path.stem.lower()
        is_tool = block.kind == "tool" or (stem in WORDS["tool"] and not block.poses)
        if is_tool and not poses.robot:
            is_of_poses = block.path.is_relative_to(poses.path)
            tools.append({"name": AT_ONCE if is_of_poses else f"in {block.path.name}"})
        for frame in block.poses:
            name = (frame.entry or frame.sheet or stem).lower()
            if name not in WORDS["tool"]:
                continue
            numbers = frame.numbers_of(frame.chosen)
            reach_mm = np.abs(numbers[:, :3]).max() * to_mm
            is_in_m = 0 < reach_mm < 1  # for no tool is so short
            frames = DataFrame(numbers, columns=[*frame.chosen]).drop_duplicates()
            # beside each pose of a table, in Universal Robots' logs
            if name == "tcp_offset" and block.columns == poses.columns:
                name = AT_ONCE
            if is_in_m or frame.units(frame.chosen) - poses.units(poses.chosen):
                tools.append({"name": name})
            elif name == AT_ONCE or len(frames) == 1:
                tools += frames.assign(name=name).to_dict("records")
    return tools


def of_one_frame(
    poses: Poses, program: Program, which: str, layout: Layout
) -> tuple[Poses, str]:
    """The poses of one frame, and its name: the one that a user wants, or else the only
    one that there is; "" if none is known. `which`: "tool" or "base".

    Raises Question where poses have several; ScanError where lines of no pose do, which
    does not matter if a user says the tool's numbers.
    """
    # of each pose that lines name, and of all by the other lines
    of_pose, of_all = defaultdict(list), []
    for row in program["uses"]:
        pose, frame = row.get("name", ""), row.get(which, "")
        if frame:
            (of_pose[pose] if pose else of_all).append(frame)
    column, wanted = layout.wanted
    is_said = column == which
    several = sorted({*of_all, wanted} if is_said else {*of_all})
    if len(several) > 1 and not (which == "tool" and layout.tool):
        raise ScanError(
            f"{poses.path}: no line says which poses are of {which} "
            f"{' or '.join(several)}; split it, one per {which}"
        )
    if not is_said:
        return poses, only_frame(poses, of_pose, of_all, which)
    others = {pose for pose, frames in of_pose.items() if {*frames} != {wanted}}
    return without(poses, others), wanted


def only_frame(poses: Poses, of_pose: dict[str, list], of_all: list, which: str) -> str:
    """The only frame that lines and columns say; "" if there is none. That some poses
    have none says nothing of the others::

        P1 tScan, P2 nothing     tScan
        P1 tool0, P2 nothing     not known
        P1 tool0, P2 tool0       tool0

    Raises Question for several: likely of that of all, or else of the one that is used
    most often; of equals a program's first tool, but in a table the flange.
    """
    columns = poses.having(which)
    in_columns = [label_of(cell).lower() for c in columns for cell in poses.table[c.at]]
    frames = [*chain(*of_pose.values()), *of_all, *in_columns]
    none = WORDS[f"no_{which}"]
    names = [*dict.fromkeys(frames)]
    if len(names) > 1:
        names.sort(key=lambda name: name in none, reverse=not poses.robot)
        answer = max(names, key=(of_all or frames).count)
        raise Question(
            f"{poses.path}: moves have {which}s {listed(names)}; of which are the "
            "poses?",
            where=f"{which}={answer}",
        )
    only = frames[0] if frames else ""
    is_of_all = bool(of_all or in_columns)
    is_of_each = poses.names and of_pose.keys() >= {*poses.names}
    if only in none and not (is_of_all or is_of_each):
        return ""
    return only


def without(poses: Poses, names: set[str]) -> Poses:
    """The poses but for those of some names, in small letters."""
    if not poses.names:
        return poses
    return poses.rows_at([name not in names for name in poses.names])


def of_one_tool(
    poses: Poses, program: Program, blocks: Blocks, layout: Layout
) -> tuple[Poses, ndarray | None, str]:
    """The poses of one tool, as their program and blocks of all files say; where it is
    on the flange (4, 4), mm, None for the flange itself; and words on it.

    Raises ScanError; Question.
    """
    poses, base = of_one_frame(poses, program, "base", layout)
    poses, tool = of_one_frame(poses, program, "tool", layout)
    if poses.table.empty:
        raise ScanError(f"{poses.path}: no poses where {layout.where}")
    to_mm, unit = length_scale(poses)
    T_flange_tool, words = None, "none; taken for the flange's poses"
    if layout.tool:
        T_flange_tool = matrix_of(layout.tool, 1.0, convention_of_tool(poses), poses)
        words = "the one given, taken off"
    else:
        tools_in = ROBOTS[poses.robot].tools_in if tool and poses.robot else "tool"
        rows = program[tools_in] + tools_in_data(blocks, poses, to_mm)
        numbers = numbers_of_tool(poses, rows, tool)
        if numbers:
            T_flange_tool = matrix_of(numbers, to_mm, poses.convention, poses)
            words = f"{tool or 'one'} at {[*numbers[:3]]} {unit}, taken off"
        if tools_in == "pose":
            poses = without(poses, {tool})
    if base not in {"", *WORDS["no_base"]}:
        words += f"; in base {base}, not taken off"
    if program["beside"]:
        words += "; moves beside poses, such as offsets, are not read"
    return poses, T_flange_tool, words


def matrix_of(
    numbers: Numbers, to_mm: float, convention: Convention, poses: Poses
) -> ndarray:
    """A tool's frame on the flange (4, 4), mm; its angles have the poses' unit."""
    scale, _ = angle_scale(poses)
    position, angles = np.split(np.array([numbers]), [3], axis=1)
    return pose_matrices(position * to_mm, angles * scale, convention.name)[0]


def numbers_of_tool(poses: Poses, rows: list[Row], tool: str) -> Numbers | None:
    """The numbers of the tool that poses have, by its name, "" if none is known; None
    where they are the flange's. `rows` say of tools their names and their numbers, in
    the poses' convention. Raises Question.
    """
    found = defaultdict(set)  # numbers, by the name
    with naming(f"{poses.path}: tool"):
        for row in rows:
            numbers = tuple(float(row.get(role, "nan")) for role in poses.chosen)
            found[row.get("name", AT_ONCE).lower()].add(numbers)
    # a frame that neither moves nor turns is none
    none = tuple(float(role in UNTURNED) for role in poses.chosen)
    declared = sorted(name for name, every in found.items() if every - {none})
    if tool == AT_ONCE and declared and AT_ONCE not in found:
        tool, *others = declared
        if others or np.isfinite([*found[tool]]).all():
            answer = "NAME" if others else tool
            raise Question(
                f"{poses.path}: tool {' or '.join(declared)} is declared, which no "
                "known line uses; are poses of it? (--tool 0 0 0 0 0 0: of the flange)",
                where=f"tool={answer}",
            )
    if tool not in found and tool in {AT_ONCE, *WORDS["no_tool"]}:
        return None
    whole = [numbers for numbers in found[tool] if np.isfinite(numbers).all()]
    if len(whole) == 1:
        return whole[0]
    whose = f"tool {tool}" if tool else "a tool without a name"
    letters = (*XYZ, *convention_of_tool(poses).columns)
    raise Question(
        f"{poses.path}: poses may be of {whose}, of which {len(whole) or 'no'} frames "
        "are here; where is it on the flange? (X Y Z in mm, angles as poses have; all "
        "0 for the flange's poses)",
        tool=[*map(str.upper, letters)],
    )


def check_moves_beside(poses: Poses, program: Program) -> None:
    """Raise ScanError where lines move beside one of these poses, and none to it."""
    kinds = "beside", "uses"
    beside, used = ({row.get("name") for row in program[kind]} for kind in kinds)
    if found := (beside - used).intersection(poses.names):
        raise ScanError(
            f"{poses.path}: moves go beside {listed(sorted(found))}, such as by an "
            "offset, and none to them; where were profiles taken? Write those poses"
        )


def convention_of_tool(poses: Poses) -> Convention:
    """The convention in which a user says a tool's angles: the poses', or W, P, R where
    these have no three.
    """
    convention = poses.convention
    return convention if len(convention.columns) == 3 else FANUC


def fields_of_flange(fields: Fields, T_flange_tool: ndarray) -> Fields:
    """Fields of a Scan with the flange's poses in place of the tool's."""
    T_base_tool = homogeneous(fields["R_base_flange"], fields["p_base_flange"])
    T = T_base_tool @ np.linalg.inv(T_flange_tool)
    return fields | {
        "R_base_flange": T[:, :3, :3],
        "p_base_flange": T[:, :3, 3],
        "orientation": None,
    }
