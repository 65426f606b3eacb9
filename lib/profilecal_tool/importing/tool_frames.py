"""Tools and bases that programs declare: taken off poses, named, or asked about."""

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np
from pandas import DataFrame

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import named, pose_matrices
from profilecal.scan.tables import ScanError, listed, naming
from profilecal_tool.importing.blocks import Block, Part, label_of
from profilecal_tool.importing.makers import ROBOTS, WORDS
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


def of_one_frame(
    poses: Part, program: Program, which: str, layout: Layout
) -> tuple[Part, str]:
    """The poses that have one tool or base, as programs and columns say, and its name,
    "" if none is known.

    Raises Question where they have several; ScanError where lines that name no pose do.
    """
    # a pose's name, "" where a line names none, and its frame's
    uses = [(row.get("name", ""), row.get(which, "")) for row in program["uses"]]
    uses = [(pose.lower(), frame.lower()) for pose, frame in uses if frame]
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
    # what is offered first, of those used equally often: what a program's first move
    # has, or else the flange
    if not poses.robot:
        names.sort(key=lambda name: name not in WORDS[f"no_{which}"])
    if len(names) > 1:
        several = f"{poses.path}: moves have {which}s {listed(names)}"
        answer = f"{which}={max(of_all or names, key=frames.count)}"
        raise Question(f"{several}; of which are the poses?", where=answer)
    return poses, "".join(names)


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
    elif used not in WORDS["no_tool"]:
        maker = ROBOTS.get(poses.robot)
        kind = maker.tools_in if maker and used else "tool"
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
    rows = program[kind]
    columns = [*poses.chosen]
    # beside each pose in Universal Robots' logs
    if offset := poses.poses.get("tcp_offset"):
        table = DataFrame(offset.numbers_of(columns), columns=columns)
        rows = table.to_dict("records")
    tools = []
    with naming(f"{poses.path}: tool"):
        for row in rows:
            numbers = tuple(float(row[column]) for column in columns)
            tools.append((row.get("name", "").lower(), numbers))
    # one that is declared without a name is used at once
    frames = {numbers for name, numbers in tools if name == used}
    if len(frames) == 1:
        return frames.pop()
    if used or frames:
        which = f"tool {used}" if used else "a tool"
        sentence = f"poses are of {which}, of which {len(frames)} frames are here"
        hint = "where is it on the flange? (X Y Z in mm, angles as poses have)"
        raise Question(f"{poses.path}: {sentence}; {hint}", tool=[*"XYZABC"])
    # what is at the flange's origin is none
    declared = sorted({name for name, numbers in tools if any(numbers[:3])})
    if declared:
        answer = declared[0] if len(declared) == 1 else "NAME"
        sentence = f"tool {' or '.join(declared)} is declared, and no line uses it"
        hint = "are poses of it? (--tool 0 0 0 0 0 0: of the flange)"
        raise Question(f"{poses.path}: {sentence}; {hint}", where=f"tool={answer}")
    return None


def entries_of_flange(
    entries: Entries, poses: Part, tool: Sequence[float], layout: Layout
) -> Entries:
    """Entries of a Scan with the flange's poses in place of the tool's (3 + k,)."""
    turn, (angle, _) = poses.convention, angle_of(poses)
    # a user says it in mm, and as W, P, R where the poses have no three angles
    length = 1.0 if layout.tool else length_of(poses)[0]
    if layout.tool and len(turn.columns) != 3:
        turn, angle = named("FANUC angles"), 1.0
    position, angles = np.split(np.array([tool]), [3], axis=1)
    T_flange_tool = pose_matrices(position * length, angles * angle, turn.name)
    # what the entries say of the flange is so far of the tool
    T_base_tool = homogeneous(entries["R_base_flange"], entries["p_base_flange"])
    T = T_base_tool @ np.linalg.inv(T_flange_tool)
    flange = {"R_base_flange": T[:, :3, :3], "p_base_flange": T[:, :3, 3]}
    return entries | flange | {"orientation": None}
