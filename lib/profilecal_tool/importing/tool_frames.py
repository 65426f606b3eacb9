"""Tools and bases that programs declare: taken off poses, named, or asked about."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import named, to_rotations
from profilecal.scan.tables import listed
from profilecal_tool.importing.blocks import Block, Part, label_of
from profilecal_tool.importing.makers import ROBOTS, WORDS
from profilecal_tool.importing.questions import Layout, Question
from profilecal_tool.importing.robot_poses import angle_of, length_of

TO_FILL_IN = ("X", "Y", "Z", "A", "B", "C")  # an answer that nobody can guess


def said_in_program(
    poses: Part, beside: Iterable[Block], kind: str, columns: Sequence[str]
) -> list[list[str]]:
    """What programs of the poses' maker say in any file, of a kind: rows of columns, in
    which "" stands for what a line does not say.
    """
    rows = []
    for block in beside:
        if block.robot and (block.robot, block.kind) == (poses.block.robot, kind):
            table = block.table.set_axis(block.titles, axis=1)
            table = table.reindex(columns=columns).astype(object)
            rows += table.fillna("").to_numpy().tolist()
    return rows


def of_one_frame(
    poses: Part, beside: Iterable[Block], which: str, layout: Layout
) -> tuple[Part, str]:
    """The poses that have one tool or base, and its name, "" if none is known.

    Raises Question where they have several.
    """
    uses = said_in_program(poses, beside, "uses", ["name", which])
    for column in poses.block.having(which):
        uses += [[None, label_of(cell)] for cell in poses.block.table[column.at]]
    uses = [(name, frame.lower().partition("[")[0]) for name, frame in uses if frame]
    frames = [frame for _, frame in uses]
    names = sorted({*frames})
    said = layout.where.lower()
    if said.startswith(f"{which}="):
        names = [said.partition("=")[2]]
        others = {name for name, frame in uses if frame != names[0]}
        labels = poses.labels.get("name", [])
        rows = [row for row, label in enumerate(labels) if label not in others]
        poses = poses.at(rows) if labels else poses
    if len(names) > 1:
        sentence = f"moves have {which}s {listed(names)}; of which are the poses?"
        answer = f"{which}={max(names, key=frames.count)}"
        raise Question(f"{poses.path}: {sentence}", where=answer)
    return poses, (names or [""])[0]


def of_one_tool(
    poses: Part, beside: Sequence[Block], layout: Layout, taken: dict[str, str]
) -> tuple[Part, Sequence[float] | None]:
    """The poses of one tool, and its position and angles as they stand; None if it is
    the flange. Raises Question.
    """
    poses, base = of_one_frame(poses, beside, "base", layout)
    poses, used = of_one_frame(poses, beside, "tool", layout)
    columns = ["name", *"xyz", *poses.convention.columns]
    maker = ROBOTS.get(poses.block.robot)
    kind = maker.tools_in if maker and used else "tool"
    rows = said_in_program(poses, beside, kind, columns)
    if offset := poses.block.poses.get("tcp_offset"):
        rows = [["", *row] for row in offset.numbers(columns[1:]).tolist()]
    frames = {(name.lower(), *map(float, at)) for name, *at in rows}
    own = [at for name, *at in frames if name == used]
    declared = sorted(name for name, *at in frames if any(at[:3]))
    tool, words = None, "none; taken for the flange's poses"
    if layout.tool:
        tool, words = layout.tool, "the one given, taken off"
    elif used in WORDS["no_frame"]:
        tool = None
    elif len(own) == 1:
        tool, words = own[0], f"{used or 'one'} at {own[0][:3]}, taken off"
    elif used or own:
        has = f"{len(own)} frames are" if own else "frame is not"
        sentence = f"poses are of tool {used}, whose {has} here"
        raise Question(f"{poses.path}: {sentence}; mm, and angles?", tool=TO_FILL_IN)
    elif declared:
        sentence = f"tool {listed(declared)} is declared, and no line uses it"
        hint = "are poses of it? (--tool 0 0 0 0 0 0: of the flange)"
        name = declared[0] if len(declared) == 1 else "NAME"
        raise Question(f"{poses.path}: {sentence}; {hint}", where=f"tool={name}")
    if base not in {"", *WORDS["no_frame"]}:
        words += f"; in base {base}, not taken off"
    taken["tool"] = words
    return poses, tool


def entries_of_flange(
    entries: dict[str, Any], poses: Part, tool: Sequence[float], layout: Layout
) -> dict[str, Any]:
    """Entries of a Scan with the flange's poses in place of the tool's (3 + k,)."""
    turn, (angle, _) = poses.convention, angle_of(poses, layout)
    length = 1.0 if layout.tool else length_of(poses)[0]
    if layout.tool and len(turn.columns) != 3:
        turn, angle = named("FANUC angles"), 1.0
    position, angles = np.split(np.array([tool]), [3], axis=1)
    R = to_rotations(turn, angles * angle)
    T = homogeneous(entries["R_base_flange"], entries["p_base_flange"])
    T = T @ np.linalg.inv(homogeneous(R, position * length))
    flange = {"R_base_flange": T[:, :3, :3], "p_base_flange": T[:, :3, 3]}
    return entries | flange | {"orientation": None}
