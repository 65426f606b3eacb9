"""Tools and bases that programs declare: taken off poses, named, or asked about."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pandas import DataFrame

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import Convention, named, pose_matrices
from profilecal.scan.tables import ScanError, listed, naming
from profilecal_tool.importing.blocks import Block, Part, label_of
from profilecal_tool.importing.makers import ROBOTS, WORDS, XYZ
from profilecal_tool.importing.questions import Layout, Question, Taken
from profilecal_tool.importing.robot_poses import Entries, angle_of, length_of

Program = dict[str, list[dict[str, str]]]  # rows of each kind of line


def lines_of_program(blocks: Iterable[Block], maker: str) -> Program:
    """What lines of each kind say in a maker's programs, in any file."""
    program = defaultdict(list)
    for block in blocks:
        if maker and block.robot == maker:
            table = block.table.set_axis(block.titles, axis=1)
            program[block.kind] += table.astype(object).fillna("").to_dict("records")
    return program


def tools_in_data(blocks: Iterable[Block], poses: Part) -> list[dict[str, Any]]:
    """Frames that no program of these poses declares: poses that do not change and are
    called a tool; and tools of programs beside poses in a table, without numbers, for
    these may be in other units.
    """
    tools = []
    for block in blocks:
        if block.kind == "tool" and not poses.robot:
            tools.append({"name": block.path.stem})
        for part in block.poses.values():
            name = (part.called or part.sheet).lower()
            if name not in WORDS["tool"]:
                continue
            numbers = part.numbers_of(part.chosen)
            frames = DataFrame(numbers, columns=[*part.chosen]).drop_duplicates()
            # beside each pose in Universal Robots' logs: used at once
            is_beside = name == "tcp_offset" and block.columns == poses.columns
            if is_beside or len(frames) == 1:
                frames = frames.assign(name="" if is_beside else name)
                tools += frames.to_dict("records")
    return tools


def of_one_frame(
    poses: Part, program: Program, which: str, layout: Layout
) -> tuple[Part, str]:
    """The poses that have one tool or base, as programs and columns say, and its name,
    "" if none is known, or if lines say of some poses alone that they have none.

    Raises Question where they have several; ScanError where lines that name no pose do.
    """
    # a pose's name, "" where a line names none, and its frame's
    rows = [row for row in program["uses"] if row.get(which)]
    uses = [(row.get("name", "").lower(), row[which].lower()) for row in rows]
    option, said = layout.wanted
    if option == which:
        uses.append(("", said))
    of_all = sorted({frame for pose, frame in uses if not pose})
    if len(of_all) > 1:
        sentence = f"no line says which poses are of {which} {' or '.join(of_all)}"
        raise ScanError(f"{poses.path}: {sentence}; split it, one per {which}")
    if option == which:
        return without(poses, {pose for pose, frame in uses if frame != said}), said
    frames = [frame for _, frame in uses]
    for column in poses.having(which):
        frames += [label_of(cell).lower() for cell in poses.table[column.at]]
    names = [*dict.fromkeys(frames)]
    # what is offered first, of those used equally often: a program's first tool, or
    # else the flange
    names.sort(key=lambda name: (name in WORDS[f"no_{which}"]) == bool(poses.robot))
    if len(names) > 1:
        several = f"{poses.path}: moves have {which}s {listed(names)}"
        answer = f"{which}={max(of_all or names, key=frames.count)}"
        raise Question(f"{several}; of which are the poses?", where=answer)
    labels = {label.lower() for label in poses.labels.get("name", [""])}
    is_of_each = of_all or poses.having(which) or labels <= {*dict(uses)}
    known = [n for n in names if is_of_each or n not in WORDS[f"no_{which}"]]
    return poses, "".join(known)


def without(poses: Part, names: set[str]) -> Part:
    """The poses but for those of some names, in small letters."""
    labels = poses.labels.get("name", [])
    kept = [row for row, label in enumerate(labels) if label.lower() not in names]
    return poses.rows_at(kept) if labels else poses


def of_one_tool(
    poses: Part, program: Program, layout: Layout, taken: Taken
) -> tuple[Part, Sequence[float] | None]:
    """The poses of one tool, and its position and angles as they stand; None if it is
    the flange. Raises Question.
    """
    poses, base = of_one_frame(poses, program, "base", layout)
    poses, used = of_one_frame(poses, program, "tool", layout)
    tool, words = None, "none; taken for the flange's poses"
    if layout.tool:
        tool, words = layout.tool, "the one given, taken off"
    else:
        kind = ROBOTS[poses.robot].tools_in if used and poses.robot else "tool"
        tool = frame_of_tool(poses, program, used, kind)
        if tool:
            words = f"{used or 'one'} at {[*tool[:3]]}, taken off"
        if kind == "pose":
            poses = without(poses, {used})
    if base not in {"", *WORDS["no_base"]}:
        words += f"; in base {base}, not taken off"
    if program["moved"]:
        words += "; moves beside poses, such as offsets, are not read"
    taken["tool"] = words
    return poses, tool


def frame_of_tool(
    poses: Part, program: Program, used: str, kind: str
) -> Sequence[float] | None:
    """The frame of the tool that poses have, as lines of a kind say it, in the
    convention of the poses; None where there are no tools. Raises Question.
    """
    tools = []
    with naming(f"{poses.path}: tool"):
        for row in program[kind]:
            numbers = tuple(float(row.get(role, "nan")) for role in poses.chosen)
            tools.append((row.get("name", "").lower(), numbers))
    # one that is declared without a name is used at once
    frames = {own for name, own in tools if name == used and np.isfinite(own).all()}
    if len(frames) == 1:
        return frames.pop()
    if used not in {"", *WORDS["no_tool"]} or frames:
        which = f"tool {used}" if used else "a tool without a name"
        sentence = f"poses are of {which}, of which {len(frames)} frames are here"
        hint = "where is it on the flange? (X Y Z in mm, angles as poses have)"
        letters = map(str.upper, (*XYZ, *convention_of_tool(poses).columns))
        raise Question(f"{poses.path}: {sentence}; {hint}", tool=[*letters])
    # what is at the flange's origin is none
    declared = sorted({name for name, numbers in tools if any(numbers[:3])})
    if declared and not used:
        answer = declared[0] if len(declared) == 1 else "NAME"
        sentence = f"tool {' or '.join(declared)} is declared, which no known line uses"
        hint = "are poses of it? (--tool 0 0 0 0 0 0: of the flange)"
        raise Question(f"{poses.path}: {sentence}; {hint}", where=f"tool={answer}")
    return None


def convention_of_tool(poses: Part) -> Convention:
    """Of a tool's angles, as a user says them: the poses', or W, P, R where these have
    no three.
    """
    turn = poses.convention
    return turn if len(turn.columns) == 3 else named("FANUC angles")


def entries_of_flange(
    entries: Entries, poses: Part, tool: Sequence[float], layout: Layout
) -> Entries:
    """Entries of a Scan with the flange's poses in place of the tool's (3 + k,)."""
    turn, length, (angle, _) = poses.convention, length_of(poses)[0], angle_of(poses)
    if layout.tool:  # which a user says in mm
        turn, length = convention_of_tool(poses), 1.0
    position, angles = np.split(np.array([tool]), [3], axis=1)
    T_flange_tool = pose_matrices(position * length, angles * angle, turn.name)
    # what the entries say of the flange is so far of the tool
    T_base_tool = homogeneous(entries["R_base_flange"], entries["p_base_flange"])
    T = T_base_tool @ np.linalg.inv(T_flange_tool)
    flange = {"R_base_flange": T[:, :3, :3], "p_base_flange": T[:, :3, 3]}
    return entries | flange | {"orientation": None}
