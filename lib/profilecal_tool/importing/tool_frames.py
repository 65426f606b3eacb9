"""Tools and bases that programs declare: taken off poses, named, or asked about."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pandas import DataFrame

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import named, to_rotations
from profilecal.scan.tables import listed, naming
from profilecal_tool.importing.blocks import XYZ, Block, label_of
from profilecal_tool.importing.makers import ROBOTS, WORDS
from profilecal_tool.importing.questions import Layout, Question
from profilecal_tool.importing.robot_poses import angle_of, length_of

TO_FILL_IN = ("X", "Y", "Z", "A", "B", "C")  # an answer that nobody can guess


def said_in_program(
    poses: Block, beside: Iterable[Block], kind: str
) -> list[dict[str, str]]:
    """What lines of a kind say in programs of the poses' maker, in any file."""
    rows = []
    for block in beside:
        if (block.robot, block.kind) == (poses.robot, kind):
            table = block.table.set_axis(block.titles, axis=1)
            rows += table.astype(object).fillna("").to_dict("records")
    return rows


def of_one_frame(
    poses: Block, beside: Iterable[Block], which: str, layout: Layout
) -> tuple[Block, str]:
    """The poses that have one tool or base, as programs and columns say, and its name,
    "" if none is known.

    Raises Question where they have several.
    """
    rows = said_in_program(poses, beside, "uses")
    uses = [(row.get("name", ""), row.get(which, "")) for row in rows]
    for column in poses.having(which):
        uses += [("", label_of(cell)) for cell in poses.table[column.at]]
    uses = [(name, used.lower().partition("[")[0]) for name, used in uses if used]
    option, _, said = layout.where.lower().partition("=")
    if option == which:
        others = {name.lower() for name, used in uses if used != said}
        return without(poses, others), said
    used = [name for _, name in uses]
    names = [*dict.fromkeys(used)]
    if not poses.robot:  # a program's first is what the first move has
        names.sort(key=lambda name: name not in WORDS["no_frame"])  # the flange first
    if len(names) > 1:
        several = f"{poses.path}: moves have {which}s {listed(names)}"
        answer = f"{which}={max(names, key=used.count)}"
        raise Question(f"{several}; of which are the poses?", where=answer)
    return poses, "".join(names)


def without(poses: Block, names: set[str]) -> Block:
    """The poses but for those of some names, in small letters."""
    labels = poses.labels.get("name", [])
    kept = [row for row, label in enumerate(labels) if label.lower() not in names]
    return poses.at(kept) if labels else poses


def of_one_tool(
    poses: Block, beside: list[Block], layout: Layout, taken: dict[str, str]
) -> tuple[Block, Sequence[float] | None]:
    """The poses of one tool, and its position and angles as they stand; None if it is
    the flange. Raises Question.
    """
    poses, base = of_one_frame(poses, beside, "base", layout)
    poses, used = of_one_frame(poses, beside, "tool", layout)
    tool, words = None, "none; taken for the flange's poses"
    if layout.tool:
        tool, words = layout.tool, "the one given, taken off"
    elif used not in WORDS["no_frame"]:
        maker = ROBOTS.get(poses.robot)
        kind = maker.tools_in if maker and used else "tool"
        tool = frame_of_tool(poses, beside, used, kind)
        if tool:
            words = f"{used or 'one'} at {[*tool[:3]]}, taken off"
        if kind == "pose":
            poses = without(poses, {used})
    if base not in {"", *WORDS["no_frame"]}:
        words += f"; in base {base}, not taken off"
    if said_in_program(poses, beside, "moved"):
        words += "; moves beside poses, such as offsets, are not read"
    taken["tool"] = words
    return poses, tool


def frame_of_tool(
    poses: Block, beside: Iterable[Block], used: str, kind: str
) -> Sequence[float] | None:
    """The frame of the tool that poses have, as lines of a kind say it, in the
    convention of the poses; None where there are no tools. Raises Question.
    """
    rows = said_in_program(poses, beside, kind)
    columns = [*XYZ, *poses.convention.columns]
    if offset := poses.poses.get("tcp_offset"):
        table = DataFrame(offset.numbers_of(columns), columns=columns)
        rows = table.to_dict("records")
    frames, declared = set(), set()
    with naming(f"{poses.path}: tool"):
        for row in rows:
            name = row.get("name", "").lower()
            numbers = tuple(float(row[column]) for column in columns)
            if name == used:
                frames.add(numbers)
            if any(numbers[:3]):  # a frame that is turned alone is no tool
                declared.add(name)
    if len(frames) == 1:
        return frames.pop()
    if used or frames:
        which = f"tool {used}" if used else "a tool"
        has = f"{len(frames)} frames are" if frames else "frame is not"
        raise Question(
            f"{poses.path}: poses are of {which}, whose {has} here; mm, and angles?",
            tool=TO_FILL_IN,
        )
    if declared:
        names = " or ".join(sorted(declared))
        answer = names if len(declared) == 1 else "NAME"
        sentence = f"tool {names} is declared, and no line uses it"
        hint = "are poses of it? (--tool 0 0 0 0 0 0: of the flange)"
        raise Question(f"{poses.path}: {sentence}; {hint}", where=f"tool={answer}")
    return None


def entries_of_flange(
    entries: dict[str, Any], poses: Block, tool: Sequence[float], layout: Layout
) -> dict[str, Any]:
    """Entries of a Scan with the flange's poses in place of the tool's (3 + k,)."""
    turn, (angle, _) = poses.convention, angle_of(poses)
    length = 1.0 if layout.tool else length_of(poses)[0]
    if layout.tool and len(turn.columns) != 3:
        turn, angle = named("FANUC angles"), 1.0
    position, angles = np.split(np.array([tool]), [3], axis=1)
    R = to_rotations(turn, angles * angle)
    T = homogeneous(entries["R_base_flange"], entries["p_base_flange"])
    T = T @ np.linalg.inv(homogeneous(R, position * length))
    flange = {"R_base_flange": T[:, :3, :3], "p_base_flange": T[:, :3, 3]}
    return {**entries, **flange, "orientation": None}
