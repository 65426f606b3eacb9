"""The poses in files: what their numbers mean, their units, and the frames that they
are of.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from profilecal.geometry.checks import REACH_MM
from profilecal.geometry.poses import carry, inverse
from profilecal.scan.conventions import CONVENTIONS, Convention, named, to_rotations
from profilecal.scan.folder import check_poses
from profilecal.scan.scan import MOUNTS
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.arrays import ENDINGS, array, from_array
from profilecal_tool.importing.key_value import behind_names
from profilecal_tool.importing.layout import Layout
from profilecal_tool.importing.makers import FRAMES, FRAMES_AND_AXES, UNNAMED
from profilecal_tool.importing.nested import poses_in_lists
from profilecal_tool.importing.programs import in_brackets
from profilecal_tool.importing.tables import (
    apart,
    check_alike,
    closed_text,
    from_rows,
    lines_of,
    names_and_units,
    names_of,
    to_mm,
    unit_of,
    words_in,
)


def read_poses(path: Path, layout: Layout) -> Table:
    """Poses, one a row or one a matrix, of the first structure that a file has.

    Raises ScanError.
    """
    if path.suffix.lower() in ENDINGS:
        values = array(path)
        table = from_array(path, values.reshape(len(values), -1))
    else:
        text = closed_text(path, layout.encoding)
        rows = poses_in_lists(text)
        named = None if rows else behind_names(path, text)
        table = named or from_rows(path, rows or in_brackets(text) or lines_of(text))
    if len(table.lines) in (3, 4) and table.units.keys() == {*"1234"}:
        # the rows of one matrix
        return from_array(path, table.numbers(table.units).reshape(1, -1))
    return apart(table)[0] if layout.in_one else table


def pose_table(paths: list[Path], layout: Layout) -> tuple[Table, Convention]:
    """The poses in a file, or in files of one each, with columns as conventions name
    them: as said, or as titles or usual numbers have them. Raises ScanError.
    """
    tables = [read_poses(path, layout) for path in paths]
    check_alike(tables)
    units = by_words(tables[0].units)
    table = tables[0] if len(tables) == 1 else one_each(paths, tables)
    said = layout.pose_columns
    if not said and all(map(str.isdigit, units)):
        said = UNNAMED.get(len(units), "")
    if said:
        titles = names_and_units(said.split(","))
        both = zip(titles.items(), units.values(), strict=False)
        units = {name: unit or old for (name, unit), old in both}
    conventions = [
        convention
        for convention in CONVENTIONS
        if {*"xyz", *convention.columns} <= units.keys()
    ]
    if len(conventions) != 1 or len(units) != len(table.columns):
        known = "; ".join(",".join(convention.columns) for convention in CONVENTIONS)
        raise ScanError(
            f"{table.path}: {len(table.columns)} columns, {listed(table.columns)}; "
            "say what they are, in their order: --pose-columns x,y,z and one of "
            f"{known} (_ for others)"
        )
    columns = dict(zip(units, table.columns.values(), strict=True))
    if len(tables) > 1:
        columns.setdefault("pose", table.lines)
    return replace(table, columns=columns, units=units), conventions[0]


def by_words(units: dict[str, str]) -> dict[str, str]:
    """Columns and their units, called as words in their names are that we know, if
    each is there once: "tcp_x" is x.
    """
    known = {*"xyz"}.union(*(convention.columns for convention in CONVENTIONS))
    words = [words_in(name) & known for name in units]
    names = [
        min(own) if len(own) == 1 and words.count(own) == 1 else name
        for name, own in zip(units, words, strict=True)
    ]
    return dict(zip(names, units.values(), strict=True))


def one_each(paths: list[Path], tables: list[Table]) -> Table:
    """The table of poses in files of one each, whose names say where a row stands.

    Raises ScanError where a file holds several.
    """
    folder = paths[0].parent
    if any(len(table.lines) > 1 for table in tables):
        raise ScanError(
            f"{folder}: {names_of(paths)} may all be the robot's poses; "
            "expected one file, or one for each pose: --poses FILE"
        )
    columns: dict[str, Sequence] = {
        name: [table.columns[name][0] for table in tables] for name in tables[0].units
    }
    return Table(folder, columns, [path.stem for path in paths], "pose")


def taken_as(
    poses: Table, convention: Convention, tool: tuple[float, ...] | None
) -> tuple[dict, str]:
    """Entries of a Scan, the tool taken off, and what the poses were taken for.

    Raises ScanError.
    """
    units = {name: poses.units[name] for name in convention.columns}
    columns = {name: poses.columns[name] for name in ("pose", *"xyz", *units)}
    known = ("deg", "rad") if convention.sequence else ("1", "rad")
    if {*units.values()} == {"deg"} and not convention.sequence:
        raise ScanError(
            f"{poses.path}: {listed(units)} in degrees are angles in some order: say "
            "in which, --pose-columns x,y,z and a,b,c; w,p,r or alpha,beta,gamma"
        )
    angle = unit_of(poses.path, units, known)
    radians = angle == "rad" and convention.sequence != ""
    if radians:
        columns |= zip(units, np.degrees(poses.numbers(units)).T, strict=True)
    along = {axis: poses.units[axis] for axis in "xyz"}
    scale, lengths = to_mm(poses.path, along, poses.numbers("xyz"), REACH_MM[1] / 1000)
    entries = check_poses(replace(poses, columns=columns), scale)
    angles = f"{', '.join(units)}{angle and f' in {angle}, as said'}"
    words = f"{len(poses.lines)}, {convention.meaning} ({angles}), {lengths}"
    if not tool:
        return entries, words
    # three numbers say how a tool is turned: poses' own, if they have three
    of_tool = convention if len(units) == 3 else named("FANUC angles")
    entries |= without_tool(entries, tool, of_tool, radians)
    place, turn = tool[:3], tool[3:]
    at_tool = f"of the tool at {place} mm, turned by {turn}, {of_tool.meaning}"
    return entries, f"{words}, {at_tool}"


def without_tool(
    entries: dict, tool: tuple, of_tool: Convention, radians: bool
) -> dict:
    """Poses of the flange, as entries of a Scan, from entries with those of a tool.

    `tool` is x, y, z, mm, and three angles on the flange, in radians if the poses' own
    are. Raises ScanError for numbers that are none.
    """
    if not np.isfinite(tool).all():
        raise ScanError(f"--tool is {tool}; expected three mm and three angles")
    angles = np.degrees([tool[3:]]) if radians else np.array([tool[3:]])
    where = Table(Path("--tool"), {}, ["4 to 6"], "numbers")
    R_flange_tool = to_rotations(of_tool, angles, where)[0]
    R_tool_flange, p_tool_flange = inverse(R_flange_tool, np.array(tool[:3]))
    R, p = entries["R_base_flange"], entries["p_base_flange"]
    return {
        "R_base_flange": R @ R_tool_flange,
        "p_base_flange": carry(R, p, p_tool_flange),
        "orientation": None,
    }


def frames_of(poses: Table, mount: str, tool: tuple | None) -> list[str]:
    """Doubts about the robot's frames and external axes.

    Raises ScanError where they differ between poses by more than a little.
    """
    # whether the sensor pose will be of another frame than the flange or the base
    elsewhere = {"uf": mount != MOUNTS[0], "ut": not tool}
    hints = {"ut": "; for one on the flange give its frame: --tool X Y Z W P R"}
    doubts = []
    for name in filter(FRAMES_AND_AXES.fullmatch, poses.columns):
        frame = FRAMES.get(name, name)
        cells = poses.columns[name]
        if len({*cells}) > 1:
            apart = np.ptp(poses.numbers([name]))
            if apart > 0.5:  # mm or degrees
                raise ScanError(
                    f"{poses.path}: {frame} differs between poses; expected one for all"
                )
            doubts.append(
                f"{name} differs by up to {apart:.2g} between poses, "
                "and is taken to stand still"
            )
        if elsewhere.get(name) and cells[0] != "0":
            hint = hints.get(name, "")
            doubts.append(
                f"the poses are of {frame} {cells[0]}, "
                f"and so will be the sensor pose{hint}"
            )
    return doubts
