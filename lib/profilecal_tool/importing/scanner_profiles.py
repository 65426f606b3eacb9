"""Profiles in files: their points, and what tells one profile from the next."""

from dataclasses import replace
from os.path import commonpath
from pathlib import Path

import numpy as np
from numpy import ndarray
from pandas import Series, concat, factorize

from profilecal.scan.tables import ScanError, listed
from profilecal_tool.importing.blocks import (
    Block,
    Blocks,
    Column,
    Files,
    Points,
    column_titled,
    label_of,
    of_one_entry,
)
from profilecal_tool.importing.folder_files import names_of
from profilecal_tool.importing.points_in_mm import in_mm
from profilecal_tool.importing.questions import Layout, Question, Taken, one_or_ask

Profiles = Series  # points (n, 2) of each, mm, NaN where nothing was seen, by its name


def points_in(block: Block, said: str) -> Points | None:
    """The points of a block, by the columns that a user says, or else by titles.

    Raises ScanError; Question for several.
    """
    pairs = {}
    for x in block.having("x"):
        for z in block.having("z"):
            if x.owner == z.owner:
                pairs[f"{block.title(x)},{block.title(z)}"] = [x, z]
    if said:
        pair = columns_said(block, said)
        pairs = {said: pair} if len(pair) == 2 else {}
    # one row of many x and z may be a profile, or a head of settings
    if not pairs or (len(pairs) > 1 and len(block.table) < 2):
        return None
    x, z = pairs[one_or_ask(block.path, [*pairs], "columns are x and z", "columns")]
    if x.at == z.at:
        raise ScanError(f"--columns {said}: x and z are one column")
    # without an owner, blocks of the same titles are one entry
    entry = x.owner or ",".join(block.titles[:4])
    return replace(block, chosen={"x": x, "z": z}, entry=entry)


def columns_said(block: Block, said: str) -> list[Column]:
    """The columns of a block that a user says by numbers, from 1, or by titles, as far
    as they are there; with the units that are said. Raises ScanError for more than two.
    """
    columns = {column.name: column for column in block.columns}
    columns |= {str(column.at + 1): column for column in block.columns}
    titles = [column_titled(0, title) for title in said.split(",")]
    if len(titles) > 2:
        raise ScanError(f"--columns {said}: expected two, of x and z")
    found = [(columns.get(title.name), title.unit) for title in titles]
    return [c._replace(unit=unit or c.unit) for c, unit in found if c]


def points_of_file(blocks: Blocks, layout: Layout) -> Blocks:
    """The points in the blocks of a file, of one entry; none where the largest block
    has none. Raises Question.
    """
    blocks = [b for b in blocks if len(b.table) and not b.robot]
    largest = max(blocks, key=lambda block: block.table.size, default=None)
    if not largest or not points_in(largest, layout.columns):
        return []
    found = [points for b in blocks if (points := points_in(b, layout.columns))]
    return of_one_entry(found, layout.entry, "profile", "is the profile")


def read_profiles(
    files: Files, expected: int, layout: Layout
) -> tuple[Profiles, str, Taken]:
    """The profiles in files, of the name "" where they have none; their entry; and what
    was taken for granted. A file among several has one profile. `expected`: how many a
    table alone should have, 0 if that is not known.

    Raises ScanError; Question for a file with numbers, but without points.
    """
    place = Path(commonpath(files))
    found = []
    for blocks in files.values():
        points = points_of_file(blocks, layout)
        if not points and any(len(block.table) > 1 for block in blocks):
            raise question_on_points(blocks, layout.columns)
        found.append(points)
    tables = [points for each in found for points in each]
    if not tables:
        raise ScanError(f"{place}: no profiles in these rows")
    if len(files) == 1:
        expected = expected if len(tables) == 1 else 0
        rows = concat([rows_of_each(points, expected, layout) for points in tables])
    else:
        rows = Series([rows_of_one(each, layout) for each in found], names_of(files))
    xz, taken = in_mm(place, tables, layout)
    points = np.split(xz, np.cumsum(rows)[:-1])
    return Series(points, rows.index), tables[0].entry, taken


def rows_of_one(tables: Blocks, layout: Layout) -> int:
    """How many rows the one profile in a file has, whose tables are below one another.

    Raises ScanError for tables between blank lines: no title tells what they are.
    """
    if len(tables) > 1 and tables[0].is_bare:
        raise ScanError(
            f"{tables[0].path}: {len(tables)} tables: give titles, or no blank lines"
        )
    return sum(rows_of_each(points, 1, layout).sum() for points in tables)


def rows_of_each(points: Points, expected: int, layout: Layout) -> Series:
    """How many rows each profile in a table has, under its name, or its sheet's; they
    follow each other, as `profile_of_each_row` tells. Raises Question.
    """
    profile, names = profile_of_each_row(points, expected)
    check_one_section(points, profile, layout)
    rows = np.bincount(profile)
    return Series(rows, names or [points.sheet] * len(rows))


def profile_of_each_row(points: Points, expected: int) -> tuple[ndarray, list[str]]:
    """The profile of each row, from 0, and what profiles are called, if they are. So
    many are expected, 0 where that is not known; if several, or not known, they are
    told by the first of these that the table has::

        label a, a, b, b    0, 0, 1, 1, called a, b: unless a value comes back
                            later, or each row has its own, as points' numbers
        time 0, 0, 2, 2     0, 0, 1, 1, called 0, 2: unless a value comes back
        nth 0, 0, 1, 1      0, 0, 1, 1
        poses P, P, Q, Q    0, 0, 1, 1
        x 1, 2, 1, 2        0, 0, 1, 1, if two are expected;
                            0, 1, 2, 3, if four are

    and else all rows are of one.
    """
    rows = len(points.table)
    if expected == 1:
        return np.zeros(rows, int), []
    # a t that is no angle of o, a, t is a time
    for column in points.having("label", "time", "t", "nth"):
        cells = points.table[column.at].ffill()  # a label may stand once for many rows
        profile, labels = factorize(cells, use_na_sentinel=False)
        is_of_points = column.role == "label" and len(labels) == rows != expected
        if (np.diff(profile) >= 0).all() and not is_of_points:
            return profile, [] if column.role == "nth" else [*map(label_of, labels)]
    if points.poses:
        posed = points.table.drop(columns=[c.at for c in points.unposed])
        begins = (posed != posed.shift()).any(axis=1)
    else:
        x = Series(points.numbers_of("x", blank=True)[:, 0]).ffill().bfill()
        goes_back = x.diff() * (x.iloc[-1] - x.iloc[0]) < 0
        is_stack = goes_back.sum() + 1 == expected
        # or each row is one, of a point
        begins = (goes_back & is_stack) | (rows == expected)
    profile = begins.cumsum().to_numpy()
    return profile - profile[0], []


def check_one_section(points: Points, profile: ndarray, layout: Layout) -> None:
    """Raise Question where rows of a profile are of several scanners or sections, or
    lie along y.
    """
    x, z = points.chosen["x"], points.chosen["z"]
    for column in points.having("y", "sensor", "label"):
        role, cells = column.role, points.table[column.at]
        each = cells.groupby(profile).nunique()
        is_said = column.at in (x.at, z.at) or layout.wanted == (column.name, "*")
        counts_points = role == "label" and (2 * each > np.bincount(profile)).any()
        if each.max() < 2 or is_said or counts_points:
            continue
        values = sorted(cells.dropna().unique())
        sentence = f"{points.path}: {column.name} is {values[0]} to {values[-1]}"
        if role == "y" and points.table[x.at].nunique() < 2:
            answer = f"{points.title(column)},{points.title(z)}"
            raise Question(f"{sentence}, x always the same", columns=answer)
        # of sections, the one in the middle
        one = label_of(min(values, key=abs) if role == "y" else values[0])
        hint = f" (all: --where '{column.name}=*')" if role == "label" else ""
        raise Question(f"{sentence} in one profile{hint}", where=f"{column.name}={one}")


def question_on_points(blocks: Blocks, said: str) -> ScanError:
    """A Question on which columns are x and z: likely two, if no others have more than
    whole numbers, as counts and intensities are; or else a ScanError.
    """
    block = max(blocks, key=lambda block: len(block.table))
    unknown = [t for t in said.split(",") if t and not columns_said(block, t)]
    row = listed(block.table.iloc[len(block.table) // 2])
    found = f"no {listed(unknown) or 'x and z'} in columns {listed(block.titles)}"
    sentence = f"{block.path}: {found}; a row is {row}; --columns says them"
    numeric = block.table.select_dtypes("number")
    likely = [str(at + 1) for at in numeric if (numeric[at] % 1).any()]
    if len(likely) != 2:
        return ScanError(sentence)
    return Question(sentence, columns=",".join(likely))
