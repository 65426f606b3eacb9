"""Tools and bases that programs declare: taken off poses, or named."""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas
from numpy import ndarray
from pandas import DataFrame, Series

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import from_rotations, named, to_rotations
from profilecal.scan.tables import ScanError, listed
from profilecal_tool.importing.makers import WORDS
from profilecal_tool.importing.questions import Layout, Question
from profilecal_tool.importing.read_file import where_a_tool_is_said
from profilecal_tool.importing.robot_poses import Poses, angle_unit, length_unit


def entries_of_flange(
    entries: dict[str, Any],
    poses: Poses,
    layout: Layout,
    others: Iterable[Path],
    taken: dict[str, str],
) -> dict[str, Any]:
    """Entries of a Scan with the flange's poses in place of the tool's. Where nothing
    is known of a tool, other files than that of the poses may speak of one.

    Raises ScanError.
    """
    numbers, taken["tool"] = tool_to_take_off(poses, layout, others)
    if numbers is None:
        return entries
    turn = poses.convention
    (length, _), (angle, _) = length_unit(poses), angle_unit(poses)
    if layout.tool:
        length = 1.0
        if len(turn.columns) != len(numbers) - 3:
            turn, angle = named("FANUC angles"), 1.0
    R = to_rotations(turn, numbers[None, 3:] * angle)
    tool = homogeneous(R, numbers[None, :3] * length)
    T = homogeneous(entries["R_base_flange"], entries["p_base_flange"])
    T = T @ np.linalg.inv(tool)
    flange = {"R_base_flange": T[:, :3, :3], "p_base_flange": T[:, :3, 3]}
    return entries | flange | {"orientation": None}


def tool_to_take_off(
    poses: Poses, layout: Layout, others: Iterable[Path]
) -> tuple[ndarray | None, str]:
    """The tool's position and angles to take off, and what the poses are of in words.

    Raises ScanError.
    """
    tables = defaultdict(DataFrame)
    for block in poses.read_with:
        if block.robot and block.robot == poses.block.robot:
            tables[block.kind] = pandas.concat([tables[block.kind], block.table])
    words = {}
    for which in ("base", "tool"):
        names = frames_named(tables["uses"], which) | frames_named(poses.table, which)
        words[which] = listed(sorted(names - WORDS["no_frame"]))
        if words[which] and len(names) > 1 and not (layout.tool and which == "tool"):
            sentence = f"moves have {which}s {listed(sorted(names))}; expected one"
            raise ScanError(f"{poses.path}: {sentence}: leave the others out")
    base = f"; in base {words['base']}, not taken off" if words["base"] else ""
    if layout.tool:
        return np.array(layout.tool), f"the one given, taken off{base}"
    frames = tables["tool"] if poses.offset is None else poses.offset
    if "name" in frames:
        frames = frames[frames["name"].str.lower() == words["tool"]]
    frames = frames.get([*"xyz", *poses.convention.columns], DataFrame())
    frames = frames.astype(float).drop_duplicates()
    if len(frames) > 1:
        sentence = f"the tool has {len(frames)} frames; expected one"
        raise ScanError(f"{poses.path}: {sentence}: --tool X Y Z A B C says which")
    if len(frames):
        at = frames.iloc[0].to_numpy()
        return at, f"{words['tool'] or 'one'} at {at[:3].tolist()}, taken off{base}"
    if words["tool"]:
        sentence = f"poses are of tool {words['tool']}, whose frame is not here"
        raise Question(f"{poses.path}: {sentence}; mm, and angles?", tool=[0] * 6)
    if not names and "name" in tables["tool"] and not poses.robot.tools_are_poses:
        ask_about_declared(poses, tables["tool"], words["base"])
    own = [] if names else [poses.path]
    said = "" if "flange" in poses.name else where_a_tool_is_said([*own, *others])
    found = f"not taken off: {said}" if said else "none"
    return None, f"{found}; taken for the flange's poses{base}"


def ask_about_declared(poses: Poses, frames: DataFrame, base: str) -> None:
    """Raise Question where a program declares a tool that no line uses."""
    for _, frame in frames.iterrows():
        name = str(frame["name"]).lower()
        numbers = frame[[*"xyz", *poses.convention.columns]].to_numpy(float)
        if name in {*base.split(", ")} | WORDS["no_frame"] or not numbers[:3].any():
            continue
        at, turned = numbers[:3] * length_unit(poses)[0], numbers[3:]
        if len(turned) > 3:
            R = to_rotations(poses.convention, turned[None])
            turned = from_rotations(named("FANUC angles"), R)[0]
        six = np.round([*at, *turned], 6).tolist()
        sentence = f"tool {frame['name']} is declared, and no line uses it"
        hint = "are poses of it? (--tool 0 0 0 0 0 0: of the flange)"
        raise Question(f"{poses.path}: {sentence}; {hint}", tool=six)


def frames_named(table: DataFrame, which: str) -> set[str]:
    """The tools or bases that a table names."""
    names = table.get(which, Series(dtype=str)).dropna().astype(str)
    return {name.lower().partition("[")[0] for name in names}
