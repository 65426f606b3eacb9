"""Profiles in files: their points, in mm, and what tells them apart."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from pandas import DataFrame, Series

from profilecal.scan.scan import FARTHEST_MM
from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.column_meanings import (
    FEWEST,
    KEYS,
    Column,
    columns_of,
    meaning_of_title,
    poses_and_others,
    with_role,
)
from profilecal_tool.importing.makers import LENGTH_UNITS, UNIT_OF_CODE, WORDS
from profilecal_tool.importing.questions import (
    Layout,
    Question,
    of_entry,
    one_or_ask,
    scale_of,
)
from profilecal_tool.importing.read_file import names_of
from profilecal_tool.importing.robot_poses import label_of
from profilecal_tool.importing.text_tables import (
    Block,
    File,
    counted,
    dialect,
    numbers_of,
)

LIKELY_MM = 150.0  # the farthest that a scanner sees, for a guess at a unit
NARROW_MM = 10.0  # few scanners see so little: it may be cm or inches
MOSTLY = 0.8  # of the rows


class Points(NamedTuple):
    """A table with a point in each row."""

    block: Block
    x: Column
    z: Column

    @property
    def name(self) -> str:
        """What the points are called, or where they stand."""
        line = f"line {self.block.table.index[0]}"
        return self.block.name or self.x.owner or line


@dataclass(frozen=True)
class Profiles:
    """All points, by profile."""

    path: Path  # of the last file
    names: list[str]
    counts: list[int]  # of points
    xz: ndarray  # (n, 2)
    units: set[str]
    titles: str  # of x and z


def numbers_in(block: Block, columns: Sequence[Column]) -> ndarray:
    """Columns as numbers (rows, columns), NaN for blanks. Raises ScanError."""
    titles = [title_of(block, column) for column in columns]
    table = block.table.iloc[:, [column.at for column in columns]]
    return numbers_of(block.path, table.set_axis(titles, axis=1), blank=True)


def title_of(block: Block, column: Column) -> str:
    """A column's title, or its number where several have the same."""
    title = block.titles[column.at]
    return title if block.titles.count(title) == 1 else str(column.at + 1)


def rows_where(path: Path, blocks: list[Block], said: str) -> list[Block]:
    """The rows in which a column has a value, "sensor=0". Raises ScanError."""
    name, _, value = said.lower().partition("=")
    chosen = []
    for block in blocks:
        for at in (one.at for one in columns_of(block) if one.name == name):
            is_wanted = block.table.iloc[:, at].astype(str).str.lower() == value
            chosen.append(replace(block, table=block.table[is_wanted]))
    if not any(len(block.table) for block in chosen):
        titles = listed(title for block in blocks for title in block.titles)
        raise ScanError(f"{path}: no rows where {said}; the columns are {titles}")
    return [block for block in chosen if len(block.table)]


def points_from_rows(block: Block, layout: Layout) -> Block:
    """A block with a point in each row, of one with a profile in each.

    Raises ScanError where x is nowhere.
    """
    _, columns = poses_and_others(columns_of(block))
    x, z, axis, keys = (
        with_role(columns, role) for role in ("x", "z", "axis", "label")
    )
    if len(z) < FEWEST:
        return block
    heights = numbers_in(block, z)
    titles = np.array([cell_number(column.name) for column in z])
    if axis:  # rows of x and of z, as Gocators have
        is_x = (block.table.iloc[:, axis[0].at].str.lower() == "x").to_numpy()
        places, heights = heights[is_x], heights[~is_x]
        if len(places) != len(heights):
            sentence = f"{len(places)} rows of x, {len(heights)} of z"
            raise ScanError(f"{block.path}: {sentence}; expected as many")
    elif len(x) == len(z):
        places = numbers_in(block, x)
    elif np.isfinite(titles).all() and not block.is_bare:
        places = titles
    else:
        start, pitch = layout.x or x_above(block)
        places = start + pitch * np.arange(heights.shape[1])
    labels, title = counted(len(heights)), "label"
    if keys and len(block.table) == len(heights):
        labels, title = block.table.iloc[:, keys[0].at], keys[0].name
    points = {
        title: np.repeat(labels, heights.shape[1]),
        "x": np.broadcast_to(places, heights.shape).ravel(),
        "z": heights.ravel(),
    }
    return replace(block, table=DataFrame(points), titles=[*points])


def x_above(block: Block) -> list[float]:
    """The start and the pitch of x in the words above z. Raises ScanError."""
    _, decimal = dialect(block.above)
    above = block.above.lower().replace(decimal, ".")
    above = re.sub(r" +|(?<=[a-z])-(?=[a-z])", "_", above)
    values = []
    for which in ("start", "pitch"):
        words = "|".join(WORDS[which])
        values += re.findall(rf"(?:{words})[^-+.\d\n]*([-+.\d]+)", above)[:1]
    if len(values) < 2:
        sentence = "z alone, and x nowhere: --x START PITCH says it; or give titles"
        raise ScanError(f"{block.path}: {sentence}: x1, z1, x2, z2, …")
    return [*map(float, values)]


def x_and_z_in(block: Block, said: str) -> tuple[Column, Column] | None:
    """The columns of x and z, if there are any. Raises Question."""
    if said:
        return x_and_z_said(block, said)
    _, free = poses_and_others(columns_of(block))
    pairs = {
        f"{title_of(block, x)},{title_of(block, z)}": (x, z)
        for x in with_role(free, "x")
        for z in with_role(free, "z")
        if x.owner == z.owner
    }
    if not pairs or (len(pairs) > 1 and len(block.table) < 2):
        return None
    return pairs[one_or_ask(block.path, [*pairs], "columns are x and z", "columns")]


def x_and_z_said(block: Block, said: str) -> tuple[Column, Column] | None:
    """The columns of x and z that a user names, or numbers, maybe with units."""
    columns = [meaning_of_title(*one) for one in enumerate(block.titles)]
    chosen = [
        column._replace(unit=named.unit or column.unit)
        for named in (meaning_of_title(0, name) for name in said.split(","))
        for column in columns
        if named.name in (column.name, str(column.at + 1))
    ]
    places = [column.at for column in chosen]
    if len({*places}) < len(places):
        raise ScanError(f"--columns {said}: x and z are one column")
    return tuple(chosen) if len(chosen) == 2 else None


def point_tables(blocks: Sequence[Block], layout: Layout) -> list[Points]:
    """The tables of points in a file; none where the largest table is none of points.

    Raises ScanError.
    """
    tables = []
    largest = max(blocks, key=lambda block: block.table.size, default=None)
    for block in blocks:
        points = block if layout.columns else points_from_rows(block, layout)
        if pair := x_and_z_in(points, layout.columns):
            tables.append(Points(points, *pair))
        elif block is largest:
            return []
    names = of_entry([one.name for one in tables], layout.entry or "profile")
    return [one for one in tables if one.name in names] or tables


def profile_tables(
    path: Path, blocks: list[Block], layout: Layout, one_each: bool
) -> list[Points]:
    """The tables of points in a file of profiles: one, or some that are alike where
    it holds them all.

    Raises Question.
    """
    if layout.where:
        blocks = rows_where(path, blocks, layout.where)
    tables = point_tables(blocks, layout)
    if not tables and any(len(block.table) > 1 for block in blocks):
        sentence = f"no x and z in columns {listed(blocks[0].titles)}"
        raise Question(f"{path}: {sentence}", columns=likely_pair(blocks))
    # a lone row of as many columns as no table has is of a head, as PCD's SIZE 4 4 4
    widths = {len(one.block.titles) for one in tables if len(one.block.table) > 1}
    tables = [one for one in tables if len(one.block.titles) in widths] or tables
    kinds = {(table.block.name, *table.block.titles): table for table in tables}
    names = [table.name for table in (tables if one_each else kinds.values())]
    if names:
        one_or_ask(path, names, "is the profile", "entry")
    return tables


def read_profiles(
    files: Iterable[File], one_each: bool, layout: Layout, poses: int
) -> Profiles:
    """The profiles in files: one in each, or those of so many poses in one.

    Raises ScanError.
    """
    names, counts, parts, units, paths = [], [], [], set(), []
    for path, blocks in files:
        paths.append(path)
        tables = profile_tables(path, blocks, layout, one_each)
        for table in tables:
            block, *pair = table
            labels = np.zeros(len(block.table))
            if not one_each:
                several = poses if len(tables) == 1 else 0
                labels = profile_of_each_row(block, several, len(counts) + 1)
            check_one_section(table, labels)
            begins = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1).tolist()]
            counts += np.diff([*begins, len(labels)]).tolist()
            names += map(label_of, labels[begins])
            parts.append(numbers_in(block, pair))
            units |= {column.unit for column in pair}
            titles = ",".join(title_of(block, column) for column in pair)
        if one_each and not tables:  # nothing was seen
            counts.append(0)
    if one_each:
        names = names_of(paths)
    if not parts:
        raise ScanError(f"{path}: no profiles in it")
    xz = np.concatenate(parts) if len(parts) > 1 else parts[0]
    return Profiles(path, names, counts, xz, units, titles)


def profile_of_each_row(block: Block, poses: int, first: int) -> ndarray:
    """The profile of each row: by a label or a time whose values do not come back, and
    that counts no points; else numbers from the first on, evenly by so many poses.
    """
    columns, rows = columns_of(block), len(block.table)
    for column in (one for role in KEYS for one in with_role(columns, role)):
        labels = block.table.iloc[:, column.at].to_numpy()
        runs = 1 + np.count_nonzero(labels[1:] != labels[:-1])
        counts_points = column.role == "label" and runs == rows != poses
        if runs == Series(labels).nunique() and not counts_points:
            return labels
    each = rows // poses if poses and rows % poses == 0 else rows
    return np.arange(rows) // each + first


def check_one_section(table: Points, labels: ndarray) -> None:
    """Raise Question where rows of a profile are of several scanners or sections, or
    lie along y.
    """
    block, x, z = table
    for column in columns_of(block):
        is_y = column.role == "y" and column.owner == x.owner
        if not is_y and column.role not in ("sensor", "label"):
            continue
        cells = block.table.iloc[:, column.at]
        each = cells.groupby(labels).agg(["nunique", "size"])
        if each["nunique"].max() < 2:
            continue
        values = sorted(cells.unique())
        sentence = f"{block.path}: {column.name} is {values[0]} to {values[-1]}"
        if is_y and block.table.iloc[:, x.at].nunique() < 2:
            answer = f"{title_of(block, column)},{title_of(block, z)}"
            raise Question(f"{sentence}, x always the same", columns=answer)
        if column.role == "sensor" or (2 * each["nunique"] <= each["size"]).all():
            one = min(values, key=abs) if is_y else values[0]
            raise Question(f"{sentence} in one profile", where=f"{column.name}={one}")


def likely_pair(blocks: Sequence[Block]) -> str:
    """The numbers of two columns that may be x and z: of those that vary the last one
    that mostly rises, and the next.
    """
    table = max(blocks, key=lambda block: len(block.table)).table
    table = table.set_axis(counted(table.shape[1]), axis=1).select_dtypes("number")
    table = table.loc[:, table.nunique() > 1]
    rises = ((table.diff() > 0).mean() > MOSTLY).to_numpy()[:-1]
    first = max(np.flatnonzero(rises), default=-2)
    return ",".join([*table][first:][:2])


def codes_for_unseen(z: ndarray, missing: float | None) -> list[float]:
    """The numbers that stand where nothing was seen: those said or known, and zero
    where all else lies to one side.
    """
    codes = [code for code in UNIT_OF_CODE if (z == code).any()]
    lowest = np.nanmin(z, initial=0)
    digits = f"{lowest:.7g}".strip("-").replace(".", "")
    if len(digits) > 2 and {*digits} == {"9"}:  # of -999.999 in any unit
        codes.append(lowest)
    if missing is not None:
        return [*codes, missing]
    rest = z[~np.isin(z, codes) & np.isfinite(z)]
    has_zeros = (rest == 0).any() and rest.any()
    is_one_sided = has_zeros and rest.min() * rest.max() == 0
    return [*codes, 0.0] if is_one_sided else codes


def convert_to_mm(profiles: Profiles, layout: Layout, taken: dict[str, str]) -> None:
    """Make points mm, and NaN where nothing was seen. Raises ScanError."""
    xz = profiles.xz
    codes = codes_for_unseen(xz[:, 1], layout.missing)
    unseen = np.isnan(xz).any(axis=1) | np.isin(xz[:, 1], codes)
    xz[unseen] = np.nan
    if unseen.all():
        raise ScanError(f"{profiles.path}: nothing was seen in any profile")
    of_codes = {UNIT_OF_CODE.get(code, "") for code in codes}
    said = {layout.unit} - {""} or profiles.units - {""} or of_codes - {""}
    units = said or {"mm"}
    scale = scale_of(profiles.path, units, "mm", LENGTH_UNITS)
    xz *= scale
    low, high = np.nanmin(xz, axis=0).round(3), np.nanmax(xz, axis=0).round(3)
    taken["columns"] = f"{profiles.titles}: {low.tolist()} to {high.tolist()} mm"
    taken["unit"] = listed(units)
    words = listed(f"{code:.12g}" for code in codes) or "blank"
    taken["missing"] = f"{words}: {unseen.sum()} of {len(xz)} points"
    width, largest = high[0] - low[0], np.abs([low, high]).max()
    is_narrow = width < NARROW_MM and max(profiles.counts) > 1 and not said
    if is_narrow or not 1 <= largest <= FARTHEST_MM:
        sentence = f"{width:.4g} mm wide, up to {largest:.4g} mm away"
        hint = "the unit, or a code for nothing seen (--missing)?"
        unit = likely_unit(np.nanmax(np.abs(xz)) / scale)
        raise Question(f"{profiles.path}: {sentence}; is it {hint}", unit=unit)


def likely_unit(largest: float) -> str:
    """The unit in which a number is most like what a scanner sees."""

    def off(unit: str) -> float:
        return abs(np.log((largest * LENGTH_UNITS[unit] + 1e-9) / LIKELY_MM))

    return min(LENGTH_UNITS, key=off)
