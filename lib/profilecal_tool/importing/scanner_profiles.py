"""Profiles in files: their points, in mm, and what tells them apart."""

import re
from dataclasses import replace
from os.path import commonpath
from pathlib import Path

import numpy as np
from numpy import ndarray
from pandas import Series, concat, factorize

from profilecal.geometry.checks import FARTHEST_MM, READINGS_MM
from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.blocks import (
    LARGEST_POSE,
    Block,
    Blocks,
    Chosen,
    Column,
    Files,
    column_titled,
    label_of,
    of_one_entry,
)
from profilecal_tool.importing.makers import (
    LENGTH_UNITS,
    UNIT_OF_CODE,
    scale_of,
)
from profilecal_tool.importing.questions import (
    Layout,
    Question,
    Taken,
    one_or_ask,
    ranges,
)
from profilecal_tool.importing.read_file import BEGIN, names_of

LIKELY_MM = 150.0  # the farthest that a scanner sees, for a guess at a unit
NARROW_MM = 10.0  # few scanners see so little: it may be cm or inches
A_GAP = 1 / 3  # of the extent of all points: surfaces that are seen are nearer
# a name, a unit or none, a number
X_ABOVE = (
    r"(?<![a-z])x[ _-]?(?:{})[ _]*[\[(]?(?:mm)?[\])]?"
    r"[\s\"':=;,]*([-+]?\d+(?:[.,]\d+)?)"
)
START_AND_PITCH = "start|offset|origin", "pitch|resolution|interval|step"


def with_a_point_a_row(block: Block, layout: Layout) -> Block:
    """A block with a point in each row, of one with a profile in each; what stands
    beside is repeated. Raises ScanError where x is nowhere, or where a first column
    may be one of numbers or times.
    """
    x, z = block.having("x"), block.having("z")
    if len(z) <= LARGEST_POSE:
        return block
    heights = block.numbers(z, blank=True)
    if block.is_bare and len(heights) > 1 and (np.diff(heights[:, 0]) > 0).all():
        raise ScanError(
            f"{block.path}: column {z[0].title} rises from row to row, as numbers and "
            "times do; give titles: n, z1, z2, …"
        )
    repeated = [column for column in block.columns if column not in (*x, *z)]
    for column in repeated:
        if {"x", "z"} <= {str(cell).lower() for cell in block.table[column.at]}:
            raise ScanError(
                f"{block.path}: by column {column.title}, rows are of x and of z by "
                "turns; give columns x1, z1, x2, z2, …"
            )
    rows = block.table[[column.at for column in repeated]]
    table = rows.loc[rows.index.repeat(len(z))]
    of_x = x[0].unit if len(x) == len(z) else ""
    further = (
        (Column(-1, "nth", role="nth"), np.arange(len(heights))[:, None]),
        (Column(-1, "x", "x", "x", "profile", of_x), x_of_heights(block, layout)),
        (Column(-1, "z", "z", "z", "profile", z[0].unit), heights),
    )
    for at, (column, cells) in enumerate(further, len(block.columns)):
        table[at] = np.broadcast_to(cells, heights.shape).ravel()
        repeated.append(column._replace(at=at))
    return replace(block, table=table, columns=repeated)


def x_of_heights(block: Block, layout: Layout) -> ndarray:
    """Where along x the columns of heights are: in columns of their own, in titles that
    do not only count, from 0 or 1, or by a start and a pitch, said or in words where
    the file begins. Raises ScanError where those are not there, or differ.
    """
    x, z = block.having("x"), block.having("z")
    if len(x) == len(z):
        return block.numbers(x, blank=True)
    places = np.array([cell_number(column.title) for column in z])
    counts = np.arange(len(z))
    only_count = block.is_bare or [*places] in ([*counts], [*counts + 1])
    if np.isfinite(places).all() and not only_count:
        return places
    start_and_pitch = layout.x
    if not start_and_pitch:
        begin = block.path.read_bytes()[:BEGIN].decode(errors="replace").lower()
        found = [{*re.findall(X_ABOVE.format(one), begin)} for one in START_AND_PITCH]
        if [*map(len, found)] != [1, 1]:
            raise ScanError(
                f"{block.path}: z alone; where is it along x? --x START PITCH says it; "
                "or give titles: x1, z1, …"
            )
        start_and_pitch = [float(value.replace(",", ".")) for (value,) in found]
    start, pitch = start_and_pitch
    return start + pitch * counts


def points_in(block: Block, said: str) -> Chosen | None:
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
    return block.choosing({"x": x, "z": z}, entry)


def columns_said(block: Block, said: str) -> list[Column]:
    """The columns of a block that a user says by titles or numbers, of those that are
    there; with the units that are said. Raises ScanError for more than two.
    """
    columns = {str(column.at + 1): column for column in block.columns}
    columns |= {column.name: column for column in block.columns}
    titles = [column_titled(0, title) for title in said.split(",")]
    if len(titles) > 2:
        raise ScanError(f"--columns {said}: expected two, of x and z")
    found = [(columns.get(title.name), title.unit) for title in titles]
    return [c._replace(unit=unit or c.unit) for c, unit in found if c]


def points_of_file(blocks: Blocks, layout: Layout) -> list[Chosen]:
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
) -> tuple[Series, str, Taken]:
    """The points (n, 2) mm of each profile, NaN where nothing was seen, under its name,
    "" if it has none; their entry; and what was taken for granted. A file among several
    has one profile. `expected`: how many a table alone should have, 0 if that is not
    known.

    Raises ScanError.
    """
    place = Path(commonpath(files))
    found = [points_or_ask(blocks, layout) for blocks in files.values()]
    tables = [points for each in found for points in each]
    if not tables:
        raise ScanError(f"{place}: no profiles in these rows")
    if len(files) == 1:
        expected = expected if len(tables) == 1 else 0
        rows = concat([rows_of_each(points, expected, layout) for points in tables])
    else:
        rows = Series([rows_of_one(each, layout) for each in found], names_of(files))
    xz, taken = in_mm(place, tables, layout)
    values = np.split(xz, np.cumsum(rows)[:-1])
    return Series(values, rows.index), tables[0].entry, taken


def points_or_ask(blocks: Blocks, layout: Layout) -> list[Chosen]:
    """The points in a file; none of one that is empty. Raises ScanError."""
    tables = points_of_file(blocks, layout)
    if not tables and any(len(block.table) > 1 for block in blocks):
        raise question_on_points(blocks, layout.columns)
    return tables


def rows_of_one(tables: list[Chosen], layout: Layout) -> int:
    """How many rows the one profile in a file has, whose tables are below one another.

    Raises ScanError for tables between blank lines: no title tells what they are.
    """
    if len(tables) > 1 and tables[0].is_bare:
        raise ScanError(
            f"{tables[0].path}: {len(tables)} tables: give titles, or no blank lines"
        )
    return sum(rows_of_each(points, 1, layout).sum() for points in tables)


def rows_of_each(points: Chosen, expected: int, layout: Layout) -> Series:
    """How many rows each profile in a table has, under its name, or its sheet's; which
    row is of which, `profile_of_each_row` tells. Raises Question.
    """
    profile, names = profile_of_each_row(points, expected)
    check_one_section(points, profile, layout)
    rows = np.bincount(profile)
    return Series(rows, names or [points.sheet] * len(rows))


def profile_of_each_row(points: Chosen, expected: int) -> tuple[ndarray, list[str]]:
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
        posed = points.table.drop(columns=[c.at for c in points.others])
        begins = (posed != posed.shift()).any(axis=1)
    else:
        x = Series(points.numbers_of("x", blank=True)[:, 0]).ffill().bfill()
        goes_back = x.diff() * (x.iloc[-1] - x.iloc[0]) < 0
        is_stack = goes_back.sum() + 1 == expected
        # or each row is one, of a point
        begins = (goes_back & is_stack) | (rows == expected)
    profile = begins.cumsum().to_numpy()
    return profile - profile[0], []


def check_one_section(points: Chosen, profile: ndarray, layout: Layout) -> None:
    """Raise Question where rows of a profile are of several scanners or sections, or
    lie along y.
    """
    x, z = points.chosen.values()
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
    """Which columns are x and z; likely two, if no others have more than whole numbers,
    as counts and intensities are.
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


def in_mm(place: Path, tables: list[Chosen], layout: Layout) -> tuple[ndarray, Taken]:
    """The points (n, 2) of tables as mm, NaN where nothing was seen; and what was taken
    for granted. Raises ScanError; Question where a code or the unit is uncertain.
    """
    xz = np.concatenate([points.numbers_of("xz", blank=True) for points in tables])
    codes = codes_in(xz[:, 1], layout)
    unseen = np.isnan(xz).any(axis=1) | np.isin(xz[:, 1], codes)
    xz[unseen] = np.nan
    if unseen.all():
        raise ScanError(f"{place}: nothing was seen in any profile")
    # a user may say that no height stands for nothing (--missing 1e9)
    is_none_said = layout.missing not in (None, *codes)
    if not is_none_said:
        check_codes(place, xz[~unseen], layout)
    units = units_said(tables, codes, layout)
    scale, unit = scale_of(place, units, "mm", LENGTH_UNITS)
    xz *= scale
    check_size(place, xz, scale, bool(units))
    words = listed(f"{code:.12g}" for code in codes) or "blank"
    first = tables[0]
    titles = ",".join(map(first.title, first.chosen.values()))
    columns = f"{titles}: {ranges('XZ', xz)}"
    missing = f"{words}: {unseen.sum()} of {len(xz)} points"
    return xz, {"columns": columns, "unit": unit, "missing": missing}


def units_said(tables: list[Chosen], codes: list[float], layout: Layout) -> set[str]:
    """The units of points that a user says, or titles, or codes for nothing seen."""
    if layout.unit:
        return {layout.unit}
    of_titles = {column.unit for points in tables for column in points.chosen.values()}
    if of_titles == {""}:
        return {UNIT_OF_CODE.get(code, "") for code in codes} - {""}
    # x or z without a unit, beside the other in um, is none in um
    return {unit or "mm" for unit in of_titles}


def codes_in(z: ndarray, layout: Layout) -> list[float]:
    """The heights that stand for nothing seen: makers' codes and a user's, or else 0
    where all other heights lie to one side.
    """
    codes = [code for code in (*UNIT_OF_CODE, layout.missing) if (z == code).any()]
    seen = z[np.isfinite(z)]
    if layout.missing is None and 0 in seen and not seen.min() < 0 < seen.max():
        codes = codes or [0.0]
    return codes


def check_size(path: Path, xz: ndarray, scale: float, is_said: bool) -> None:
    """Raise Question where points (n, 2) mm are so near each other, so near or so far
    away that their unit, of so many mm, may be another one.
    """
    x, z = xz[~np.isnan(xz[:, 1])].T
    width, largest = np.ptp(x), np.abs([x, z]).max()
    is_narrow = 0 < width < NARROW_MM and not is_said
    if is_narrow or not READINGS_MM[0] <= largest <= FARTHEST_MM:
        usual = LIKELY_MM / largest * scale  # of the unit, in mm
        likely = min(LENGTH_UNITS, key=lambda u: abs(np.log(LENGTH_UNITS[u] / usual)))
        raise Question(
            f"{path}: {width:.4g} mm wide, up to {largest:.4g} mm away; is it the unit "
            "(of x and of z?), or a code for nothing seen (--missing)?",
            unit=likely,
        )


def check_codes(path: Path, xz: ndarray, layout: Layout) -> None:
    """Raise Question where a height may stand for nothing seen."""
    z = xz[:, 1]
    for code in (0.0, z.min(), z.max()):
        if is_likely_code(xz, code):
            count = np.count_nonzero(z == code)
            found = f"{path}: z is {code:.12g} at {count} of {len(z)} points"
            if layout.missing is not None:
                raise ScanError(f"{found}: a second code? leave them blank")
            sentence = f"{found}; was nothing seen there? (else: --missing 1e9)"
            raise Question(sentence, missing=code)


def is_likely_code(xz: ndarray, code: float) -> bool:
    """Whether a height is farther from all other points than these are from each other
    and very large, or than a third of that and recurs; or it is 0, and several points
    are 0, 0.

    >>> seen = [[0, 100], [9, 105]]
    >>> for others in ([[2, 96], [3, 96]], [[2, 96]], [[2, 1e6]], [[2, 99], [3, 99]]):
    ...     print(bool(is_likely_code(np.array(seen + others), others[0][1])))
    True
    False
    True
    False
    >>> bool(is_likely_code(np.array([[0, 0], [0, 0], [1, 5], [2, -5]]), 0))
    True
    """
    if code == 0 and (xz == 0).all(axis=1).sum() > 1:
        return True
    others = xz[xz[:, 1] != code]
    recurs = len(xz) - len(others) > 1
    if len(others) < 2 or not (recurs or abs(code) >= FARTHEST_MM):
        return False
    extent = np.ptp(others, axis=0).max()
    return np.abs(others[:, 1] - code).min() > extent * (A_GAP if recurs else 1)
