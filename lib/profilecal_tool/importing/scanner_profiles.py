"""Profiles in files: their points, in mm, and what tells them apart."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
from numpy import ndarray

from profilecal.scan.scan import FARTHEST_MM
from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.blocks import (
    FEWEST,
    Block,
    Part,
    column_titled,
    label_of,
    parts_called,
)
from profilecal_tool.importing.makers import LENGTH_UNITS, UNIT_OF_CODE, WORDS
from profilecal_tool.importing.questions import (
    Layout,
    Question,
    one_or_ask,
    scale_of,
)
from profilecal_tool.importing.read_file import decoded_text, names_of
from profilecal_tool.importing.text_tables import BEGIN, dialect

LIKELY_MM = 150.0  # the farthest that a scanner sees, for a guess at a unit
NARROW_MM = 10.0  # few scanners see so little: it may be cm or inches


def with_a_point_a_row(block: Block, layout: Layout) -> Block:
    """A block with a point in each row, of one with a profile in each; what stands
    beside is repeated. Raises ScanError where x is nowhere.
    """
    x, z = block.having("x"), block.having("z")
    if len(z) < FEWEST or layout.columns:
        return block
    if block.having("axis"):
        raise ScanError(f"{block.path}: rows of x and of z in turn; export points")
    heights = block.numbers(z, blank=True)
    places = np.array([cell_number(column.name) for column in z])
    if len(x) == len(z):
        places = block.numbers(x, blank=True)
    elif block.is_bare or not np.isfinite(places).all():
        start, pitch = layout.x or x_above(block.path, layout.encoding)
        places = start + pitch * np.arange(len(z))
    table = block.table.drop(columns=[column.at for column in (*x, *z)])
    titles = [*(block.titles[at] for at in table), "profile", "x", "z"]
    table = table.loc[table.index.repeat(len(z))].assign(
        profile=np.arange(len(heights)).repeat(len(z)) + 1,
        x=np.broadcast_to(places, heights.shape).ravel(),
        z=heights.ravel(),
    )
    table.columns = range(len(titles))
    return replace(block, table=table, titles=titles)


def x_above(path: Path, encoding: str) -> list[float]:
    """The start and the pitch of x in words where a file begins. Raises ScanError."""
    begin = decoded_text(path, encoding)[:BEGIN].lower()
    _, decimal = dialect(begin)
    begin = re.sub(r"[ _-]+(?=[a-z])", "_", begin.replace(decimal, "."))
    words = ("|".join(WORDS[which]) for which in ("start", "pitch"))
    found = [re.search(rf"(?:{one})[^-+.\d\n]*([-+.\d]+)", begin) for one in words]
    if not all(found):
        sentence = "z alone, and x nowhere: --x START PITCH says it; or give titles"
        raise ScanError(f"{path}: {sentence}: x1, z1, x2, z2, …")
    return [float(match[1]) for match in found]


def points_in(block: Block, said: str) -> Part | None:
    """The points of a block, by the columns that a user says, or else by titles.

    Raises Question.
    """
    pairs = {}
    for x in block.having("x"):
        for z in block.having("z"):
            if x.owner == z.owner:
                pairs[f"{block.title(x.at)},{block.title(z.at)}"] = [x, z]
    if said:
        columns = {str(c.at + 1): c for c in block.columns}
        columns |= {c.name: c for c in block.columns}
        named = [column_titled(0, name) for name in said.split(",")]
        named = [one for one in named if one.name in columns]
        pair = [
            columns[one.name]._replace(unit=one.unit or columns[one.name].unit)
            for one in named
        ]
        pairs = {said: pair} if len(pair) == 2 else {}
    if not pairs or (len(pairs) > 1 and len(block.table) < 2):
        return None
    x, z = pairs[one_or_ask(block.path, [*pairs], "columns are x and z", "columns")]
    if x.at == z.at:
        raise ScanError(f"--columns {said}: x and z are one column")
    name = block.name or x.owner or ",".join(block.titles[:4])
    return Part(block, name, {"x": x, "z": z})


def point_tables(blocks: Iterable[Block], layout: Layout) -> list[Part]:
    """The tables of points in a file that are called alike, of more than a row if there
    are such; none where the largest table is none of points. Raises Question.
    """
    blocks = sorted(blocks, key=lambda block: -block.table.size)
    every = [points_in(block, layout.columns) for block in blocks]
    if not every or not every[0]:
        return []
    found = [part for part in every if part and len(part.block.table) > 1]
    if layout.entry or not found:
        found = [part for part in every if part]
    found.sort(key=lambda part: part.block.table.index[0])
    return parts_called(found, layout.entry, "profile", "is the profile")


def read_profiles(
    source: Iterable[tuple[Path, list[Block]]],
    one_each: bool,
    poses: int,
    layout: Layout,
    taken: dict[str, str],
) -> tuple[list[str], list[ndarray]]:
    """The profiles in files, one in each, or those of so many poses in one: names, and
    points (n, 2), mm. Raises ScanError.
    """
    names, counts, xz, units, paths = [], [], [], set(), []
    for path, blocks in source:
        paths.append(path)
        tables = point_tables(blocks, layout)
        if not tables and any(len(block.table) > 1 for block in blocks):
            raise question_on_points(blocks)
        if one_each and len(tables) > 1 and tables[0].block.is_bare:
            sentence = f"{len(tables)} tables of points; expected one"
            raise ScanError(f"{path}: {sentence}: give titles, or no blank lines")
        before = len(counts)
        for points in tables:
            several = poses if len(tables) == 1 else 0
            labels = np.zeros(len(points.block.table))
            if not one_each:
                labels = profile_of_each_row(points.block, several, len(counts) + 1)
            check_one_section(points, labels)
            begins = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1)]
            counts += [*np.diff([*begins, len(labels)])]
            names += map(label_of, labels[begins])
            xz.append(points.numbers("xz", blank=True))
            units |= points.units("xz")
        if one_each:  # nothing was seen, or a table goes on
            counts[before:] = [sum(counts[before:])]
    if not xz:
        raise ScanError(f"{path}: no profiles in it")
    taken["columns"] = ",".join(
        points.block.title(c.at) for c in points.columns.values()
    )
    points_mm = in_mm(path, np.concatenate(xz), units, layout, taken)
    values = np.split(points_mm, np.cumsum(counts)[:-1])
    return names_of(paths) if one_each else names, values


def profile_of_each_row(block: Block, poses: int, first: int) -> ndarray:
    """The profile of each row: by a label or a time whose values do not come back, and
    that counts no points; by the pose beside it; else numbers from the first on, evenly
    by so many poses.
    """
    rows = len(block.table)
    for column in block.having("label", "time", "t"):
        labels = block.table[column.at].to_numpy()
        runs = 1 + np.count_nonzero(labels[1:] != labels[:-1])
        counts_points = column.role == "label" and runs == rows != poses
        if runs == pandas.unique(labels).size and not counts_points:
            return labels
    if block.poses:
        posed = [c.at for own in block.poses.values() for c in own.columns.values()]
        return block.table.groupby(posed, sort=False, dropna=False).ngroup().to_numpy()
    each = rows // poses if poses and rows % poses == 0 else rows
    return np.arange(rows) // each + first


def check_one_section(points: Part, labels: ndarray) -> None:
    """Raise Question where rows of a profile are of several scanners or sections, or
    lie along y.
    """
    block, (x, z) = points.block, points.columns.values()
    for column in block.having("y", "sensor", "label"):
        cells, is_y = block.table[column.at], column.role == "y"
        each = cells.groupby(labels).agg(["nunique", "size"])
        again = (2 * each["nunique"] <= each["size"]).all()
        counts_points = column.role == "label" and not again
        is_other = column in (x, z) or (is_y and column.owner != x.owner)
        if counts_points or is_other or each["nunique"].max() < 2:
            continue
        values = sorted(cells.dropna().unique())
        sentence = f"{block.path}: {column.name} is {values[0]} to {values[-1]}"
        if is_y and block.table[x.at].nunique() < 2:
            answer = f"{block.title(column.at)},{block.title(z.at)}"
            raise Question(f"{sentence}, x always the same", columns=answer)
        one = min(values, key=abs) if is_y else values[0]
        raise Question(f"{sentence} in one profile", where=f"{column.name}={one}")


def question_on_points(blocks: Sequence[Block]) -> Question:
    """Which columns are x and z; likely the last two of numbers that vary."""
    block = max(blocks, key=lambda block: len(block.table))
    numeric = block.table.select_dtypes("number")
    varied = [str(at + 1) for at in numeric if numeric[at].nunique() > 1]
    sentence = f"{block.path}: no x and z in columns {listed(block.titles)}"
    return Question(sentence, columns=",".join(varied[-2:]))


def in_mm(
    path: Path, xz: ndarray, units: set[str], layout: Layout, taken: dict[str, str]
) -> ndarray:
    """Points (n, 2) as mm, and NaN where nothing was seen: z is blank, a code that is
    said or known, or zero where all else lies to one side. Raises ScanError.
    """
    z = xz[:, 1]
    codes = [code for code in UNIT_OF_CODE if (z == code).any()]
    of_codes = {UNIT_OF_CODE[code] for code in codes} - {""}
    codes += [] if layout.missing is None else [layout.missing]
    rest = z[~np.isin(z, codes) & np.isfinite(z)]
    if not codes and (rest == 0).any() and rest.any() and rest.min() * rest.max() == 0:
        codes = [0.0]
    unseen = np.isnan(xz).any(axis=1) | np.isin(z, codes)
    xz[unseen] = np.nan
    if unseen.all():
        raise ScanError(f"{path}: nothing was seen in any profile")
    said = ({layout.unit} - {""}) or units or of_codes
    scale, unit = scale_of(path, said, "mm", LENGTH_UNITS)
    xz *= scale
    low, high = np.nanmin(xz, axis=0).round(3), np.nanmax(xz, axis=0).round(3)
    taken["columns"] += f": {low.tolist()} to {high.tolist()} mm"
    taken["unit"] = unit
    words = listed(f"{code:.12g}" for code in codes) or "blank"
    taken["missing"] = f"{words}: {unseen.sum()} of {len(xz)} points"
    width, largest = high[0] - low[0], np.abs([low, high]).max()
    is_narrow = 0 < width < NARROW_MM and not said
    if is_narrow or not 1 <= largest <= FARTHEST_MM:
        sentence = f"{width:.4g} mm wide, up to {largest:.4g} mm away"
        hint = "the unit, or a code for nothing seen (--missing)?"
        farthest = np.nanmax(np.abs(xz)) / scale / LIKELY_MM + 1e-9
        off = {unit: abs(np.log(farthest * mm)) for unit, mm in LENGTH_UNITS.items()}
        likely = min(off, key=off.get)
        raise Question(f"{path}: {sentence}; is it {hint}", unit=likely)
    return xz
