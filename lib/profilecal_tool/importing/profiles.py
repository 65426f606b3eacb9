"""The profiles in files: which rows are whose, which columns are x and z, and their
unit.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.scan.scan import FARTHEST_MM
from profilecal.scan.tables import ScanError, Table, listed, number
from profilecal_tool.importing.arrays import (
    ENDINGS,
    points_in_array,
    vertices_in,
)
from profilecal_tool.importing.layout import Layout
from profilecal_tool.importing.makers import (
    CODE,
    LABELS,
    SCANNERS,
    TIMES,
    X_PITCH,
    X_START,
)
from profilecal_tool.importing.nested import points_in, points_in_list
from profilecal_tool.importing.tables import (
    ROW,
    apart,
    blocks,
    changed,
    check_alike,
    closed_text,
    floats,
    from_rows,
    is_rising,
    labels_of_files,
    lines_of,
    mm_of,
    names_and_units,
    numbered,
    rows_of,
    stem,
    to_mm,
    words_in,
)


def read_profiles(path: Path, count: int, layout: Layout) -> Table:
    """A file's points, one a row, of a profile or of several, for `count` poses; no
    columns where nothing was seen. Raises ScanError.
    """
    start = layout.x
    if path.suffix.lower() in ENDINGS:
        table = points_in_array(path, layout.entry, count)
    elif (table := vertices_in(path)) is None:
        text = closed_text(path, layout.encoding, layout.entry)
        if not re.search(r"\b\d", text):  # titles at most
            return Table(path, {}, [])
        table = points_in(path, text, layout.entry) or from_rows(
            path, points_in_list(path, text, layout.entry) or lines_of(text)
        )
        start = start or start_and_pitch(text)
    if not table.columns:
        return table
    if layout.in_one and ROW not in table.columns:
        table = apart(table)[1]
    return chosen_rows(across(table, count, start), layout.where)


def start_and_pitch(text: str) -> tuple[float, float] | None:
    """x of the first point, and from one to the next, if lines above a table say so, or
    titles above numbers.
    """
    rows = [fields for _, fields in lines_of(text[:5000])]
    said = [" ".join(fields) for fields in rows]
    for titles, numbers in pairwise(rows):
        if len(titles) == len(numbers) > 2:
            said += map(" ".join, zip(titles, numbers, strict=True))
    head = "\n".join(said)
    start, pitch = X_START.search(head), X_PITCH.search(head)
    return (float(start[1]), float(pitch[1])) if start and pitch else None


def across(table: Table, count: int, start: tuple[float, float] | None) -> Table:
    """The table with a point a row where a row or a column has the points of a profile.

    z is below x, below numbered names (x1, z1, …), or in a row after one of x, or x
    follows from `start` and pitch; without titles x and z are in turn, or z is below
    the x of the first row. Raises ScanError where there is no x.
    """
    names, lines = [*table.columns], np.array(table.lines)
    x, z = numbered(names, "x"), numbered(names, "z")
    z = z or [name for name in names if np.isfinite(number(name))]
    heights = [n for n in names if "z" in words_in(n)]
    if len(names) < 3:
        heights = heights or names[-1:]
    is_down = len(x) == len(z) == count != len(lines)
    if names[0] == "x" and len({*map(stem, names[1:])}) == 1 < len(names) - 4:
        if is_rising(table.numbers("x", blank=True)[:, 0]):
            x, z, is_down = ["x"], names[1:], True
    elif start and len(heights) == 1 and not any("x" in words_in(n) for n in names):
        z, is_down = heights, True
    if len(z) < 5 and not is_down:
        return table
    values, titles = table.numbers(z, blank=True), floats(z)
    along = table.numbers(x, blank=True) if x else titles
    unit = table.units[z[0]]
    units = {"x": table.units[x[0]] if x else unit, "z": unit}
    if start and not x:
        count_of_points = len(values) if is_down else len(z)
        along = start[0] + start[1] * np.arange(count_of_points)
    if is_down:
        table = replace(table, columns={}, lines=lines)
        return long(table, along.T, values.T, units)
    columns = {n: np.array(table.columns[n]) for n in names if n not in (*x, *z)}
    if "x" in columns:  # above the names of rows
        columns["name"] = columns.pop("x")
    every = np.full(len(values), "Z")
    kinds = next((c for c in columns.values() if {"Z"} <= {*c} <= {*"XYZI"}), every)
    rows = np.flatnonzero(kinds == "Z")
    is_bare = not columns and not start and not x
    if "X" in kinds:
        along = values[kinds == "X"]
    elif np.isfinite(titles).all() and titles[0] not in (0, 1):
        along = titles
    elif len(x) == len(z) or start:
        pass
    elif len(values) == count and is_bare and not is_smooth(values):
        along, values = values[:, ::2], values[:, 1::2]
    elif len(values) == count + 1 and is_bare and is_rising(values[0]):
        along, rows = values[0], rows[1:]
    elif len(z) < 12:
        return table
    else:
        raise without_x(table)
    if along.ndim > 1 and len(along) != len(rows):
        raise ScanError(
            f"{table.path}: {len(along)} rows of x and {len(rows)} of z; is the file "
            "cut short?"
        )
    columns = {name: cells[rows] for name, cells in columns.items()}
    table = replace(table, columns=columns, lines=lines[rows, None])
    return long(table, along, values[rows], units)


def long(table: Table, x: ndarray, z: ndarray, units: dict) -> Table:
    """A table of P profiles with a point a row, of z (P, n) and x of all or of each."""
    index = np.repeat(np.arange(len(z)), z.shape[1])
    columns = {name: cells[index] for name, cells in table.columns.items()}
    columns[ROW] = index + 1
    columns |= {"x": np.broadcast_to(x, z.shape).ravel(), "z": z.ravel()}
    units = dict.fromkeys(columns, "") | units
    lines = np.broadcast_to(table.lines, z.shape).ravel()
    return replace(table, columns=columns, lines=lines, units=units)


def is_smooth(rows: ndarray) -> bool:
    """Whether neighbours in rows differ little: z, not x and z in turn."""
    quarter, most = np.nanpercentile(rows, [25, 75])
    return np.nanmedian(np.abs(np.diff(rows))) < (most - quarter) / 10


def chosen_rows(table: Table, where: str) -> Table:
    """The rows in which a column says what the user wants: "sensor=0".

    Raises ScanError where there is no such column.
    """
    name, _, value = (part.strip().lower() for part in where.partition("="))
    if not where:
        return table
    if name not in table.columns:
        raise ScanError(
            f"{table.path}: no column {name!r}; there are {listed(table.columns)} "
            "(--where NAME=VALUE)"
        )
    cells, wanted = table.columns[name], number(value)
    taken = floats(cells) == wanted
    if not np.isfinite(wanted):
        taken = np.array([str(cell).strip().lower() == value for cell in cells])
    return rows_of(table, np.flatnonzero(taken))


def profiles_of(
    tables: list[Table], count: int, layout: Layout, of_poses: Collection[str] = ()
) -> tuple[list, list[int], ndarray, dict]:
    """Names of profiles, or numbers; how many points each has; all points (n, 2), one
    profile below the other; and the columns of x and z with their units.

    `tables` have the points of a file each; one alone has those for `count` poses, of
    several `count` is 0. `of_poses`: the columns of poses. Raises ScanError.
    """
    # in the others nothing was seen
    full = [table for table in tables if table.columns]
    if not full:
        raise ScanError(f"{tables[0].path}: no numbers in columns")
    check_alike(full)
    axes = x_and_z(full, layout)
    names, points = [], [np.empty((0, 2))]
    counts = []
    files = labels_of_files([table.path for table in tables])
    for file, table in zip(files, tables, strict=True):
        if not table.columns:
            names.append(file)
            counts.append(0)
            continue
        xz = table.numbers(axes, blank=True)
        own = rows_by_label(labels_of(table, xz, count, axes, of_poses))
        for label, rows in own.items():
            check_is_one(rows_of(table, rows), xz[rows, 0], axes, layout)
            counts.append(len(rows))
            if count:
                is_number = isinstance(label, int)
                names.append(label if is_number else str(label).removesuffix(".0"))
            else:
                of_row = f" {label}" if len(own) > 1 else ""
                names.append(f"{file}{of_row}")
        points.append(xz[np.concatenate([*own.values()])])
    return names, counts, np.concatenate(points), axes


def rows_by_label(labels: ndarray) -> dict[Any, ndarray]:
    """The rows of each label (n,), in the order in which labels first come."""
    starts = np.flatnonzero(changed(labels))  # most follow one that is the same
    number_of = {}
    numbers = [number_of.setdefault(k, len(number_of)) for k in labels[starts].tolist()]
    of_rows = np.repeat(numbers, np.diff(starts, append=len(labels)))
    order = np.argsort(of_rows, kind="stable")
    rows = np.split(order, np.cumsum(np.bincount(of_rows))[:-1])
    return dict(zip(number_of, rows, strict=True))


def labels_of(
    table: Table, xz: ndarray, count: int, axes: Collection, of_poses: Collection
) -> ndarray:
    """What tells the profiles of a file apart, (n,): the cells of a column, or numbers.

    A column has them in blocks, about `count` of them if its name does not say it, best
    one that poses have, too. A file of many, for which `count` is 0, has a profile, or
    one in each of its rows.
    """
    others = [name for name in table.columns if not is_other(name, axes)]
    others.sort(key=lambda name: (name not in of_poses, not TIMES.search(name)))
    if not count:
        others = [ROW] if {*table.columns} == {*axes, ROW} else []
    for name in (name for name in (*LABELS, *others) if name in others):
        k = blocks(table.columns[name])
        is_usual = name in (*LABELS, ROW) or count / 2 <= k <= 2 * count
        is_time = TIMES.search(name) is not None  # of a log, one for each profile
        one_each = k == len(xz) and (is_time or name == ROW)
        if one_each or ((is_usual or is_time) and 1 < k <= len(xz) / 2):
            return np.array(table.columns[name])
    return np.searchsorted(starts_of(xz, count), np.arange(len(xz)), "right")


def is_other(name: str, axes: Collection) -> bool:
    """Whether a column has points' places, or says which scanner saw them."""
    return name in axes or bool(words_in(name) & {"y", *SCANNERS})


def starts_of(xz: ndarray, count: int) -> ndarray:
    """The rows where another of `count` profiles begins: after as many rows each, if x
    begins anew at most of them, or where it does; none if neither is so.
    """
    n, (x, z) = len(xz), xz.T
    seen = np.flatnonzero(np.isfinite(x + z) & (z != 0) & (z != x))
    jumps = begins_anew(x[seen])
    before, after = seen[jumps], seen[jumps + 1]
    if count and n % count == 0:
        each = np.arange(n // count, n, n // count)
        among = np.searchsorted(each, [before, after], "right")
        at_each = (among[0] < among[1]).sum()
        if 2 * at_each >= len(each) and at_each > 0.8 * len(jumps):
            return each
    return after if len(after) == count - 1 else after[:0]


def begins_anew(x: ndarray) -> ndarray:
    """The indices after which x (n,) goes back by far more than it went on."""
    steps = np.diff(x)
    usual = np.median(steps) if len(steps) else 0.0
    return np.flatnonzero(-np.sign(usual) * steps > 9 * np.abs(usual))


def check_is_one(profile: Table, x: ndarray, axes: Collection, layout: Layout) -> None:
    """Raise ScanError where a profile's points are of several.

    A column names a few scanners, or has its values in blocks, or x is never twice
    where it has the same value; or x begins anew after as many points each.
    """

    def goes_on(x: ndarray) -> bool:
        return len(begins_anew(x)) == 0 and len({*x.tolist()}) == len(x)

    jumps = begins_anew(x)
    twice = len(jumps) or len(x) - len({*x.tolist()}) > len(x) / 4
    for name, cells in profile.columns.items():
        if name in (*axes, ROW):
            continue
        values = [v for v in dict.fromkeys(cells) if not np.isnan(number(str(v)))]
        if len(values) < 2:
            continue
        is_y, is_said = "y" in words_in(name), bool(layout.columns)
        parts = (x[np.array(cells) == value] for value in values)
        several = len(values) <= len(x) / 4 and (
            (is_other(name, axes) and not is_y and len(values) < 5)
            or (twice and all(map(goes_on, parts)))
        )
        which = f"{profile.path}: {name} is {values[0]} to {values[-1]} in one profile"
        if several:
            value = min(values, key=lambda cell: abs(number(str(cell))))
            what = f"a cloud of {len(values)} profiles" if is_y else "of several"
            raise ScanError(
                f"{which}, {what}, where a pose has one; say which: "
                f"--where {name}={value}"
            )
        if is_y and not is_said:
            raise ScanError(
                f"{which}, which lies in y = 0; say which columns are its x and z: "
                "--columns x,z"
            )
    starts = [0, *(jumps + 1)]
    k = len(starts)
    is_back = np.ptp(x[starts]) < np.ptp(x) / 10
    if k > 1 and is_back and np.array_equal(starts, np.arange(k) * len(x) / k):
        raise ScanError(
            f"{profile.path}: x begins anew after each {len(x) // k} points: {k} "
            "profiles in one; keep one in each file, or number them in a column"
        )


def check_one_scanner(
    folder: Path, names: list[str], profiles: Sequence[ndarray], p: ndarray
) -> None:
    """Raise ScanError where profiles from the same place of the flange p (P, 3), one
    after the other, are mostly more than 1 mm apart at the same x, or at no same x.
    """
    apart = {}
    for k in np.flatnonzero((p[1:] == p[:-1]).all(axis=1)):
        one, other = (v[~np.isnan(v[:, 1])] for v in profiles[k : k + 2])
        if len(one) and len(other):
            one, (x, z) = one[one[:, 0].argsort()], other.T
            there = np.interp(x, *one.T, np.nan, np.nan)
            apart[k] = np.nanmedian([*np.abs(there - z), FARTHEST_MM])
    if apart and np.median([*apart.values()]) > 1:
        k = max(apart, key=apart.get)
        own, other = ({*re.findall(r"[^\W_]+", name)} for name in names[k : k + 2])
        raise ScanError(
            f"{folder}: {names[k]} and {names[k + 1]} have the same pose and are "
            f"{apart[k]:.3g} mm apart: of two scanners? say which: --profiles "
            f"'*{min(own - other)}*'"
        )


def x_and_z(tables: list[Table], layout: Layout) -> dict[str, str]:
    """The columns of x and z and their units: as said, as their titles say, or where
    there are no titles, the two that vary. Raises ScanError.
    """
    first = tables[0]
    names = [name for name in first.columns if name != ROW]
    likely = []
    if layout.columns:
        axes = names_and_units(layout.columns.split(","))
    else:
        mean = [
            [axis] if axis in names else [n for n in names if axis in words_in(stem(n))]
            for axis in "xz"
        ]
        if len(names) == 2 and [] in mean:
            of_other = mean.index([])
            mean[of_other] = [name for name in names if [name] not in mean]
        axes = {some[0]: "" for some in mean if len(some) == 1}
        likely = [some[0] for some in mean if some]
    if not axes and len(likely) < 2:
        bare = [*filter(str.isdigit, names)]
        likely = likely_axes(
            {
                name: np.concatenate([floats(table.columns[name]) for table in tables])
                for name in bare or names
            }
        )
        axes = dict.fromkeys(likely if bare else (), "")
    x = next(iter(axes), "")
    are_two = len(axes) == len(axes.keys() & first.columns) == 2
    is_guessed = are_two and not (layout.columns or "x" in words_in(x))
    if len(names) == 1 or (is_guessed and is_count(first.columns[x])):
        raise without_x(first)
    if not are_two:
        raise ScanError(
            f"{first.path}: columns {listed(first.columns)}; say which are x and z, "
            f'such as --columns "{",".join(likely[:2] or names[-2:])}"; or, '
            "if there is z alone, where x begins and how far points are apart: "
            "--x START PITCH"
        )
    own = first.units
    return {
        name: "mm" if layout.x and name == "x" else layout.unit or unit or own[name]
        for name, unit in axes.items()
    }


@np.errstate(invalid="ignore", divide="ignore")
def likely_axes(columns: dict[str, ndarray]) -> list[str]:
    """What may be x and z of columns without titles: those that vary; of more than two
    those with fractions, the one with the most even steps first.
    """
    varied = [n for n, v in columns.items() if np.fmin.reduce(v) < np.fmax.reduce(v)]
    if len(varied) < 3:
        return varied
    evenness = {}
    for name in varied:
        cells = columns[name]
        steps = np.diff(cells[cells != 0])
        usual = np.nanmedian(steps)
        if np.nansum(cells % 1):
            evenness[name] = -np.abs(usual) / np.nanmedian(np.abs(steps - usual))
    return sorted(evenness, key=evenness.get)


def is_count(cells: Sequence) -> bool:
    """Whether cells count points: 0, 1, 2, … or 1, 2, 3, …"""
    first = floats(cells[:9]).tolist()
    return first in ([*range(len(first))], [*range(1, len(first) + 1)])


def without_x(table: Table) -> ScanError:
    """That z is there and x is not."""
    return ScanError(
        f"{table.path}: z alone, and x nowhere; say where it "
        "begins and how far points are apart: --x START PITCH"
    )


def seen_in_mm(
    folder: Path, counts: list[int], points: ndarray, axes: dict, missing: float | None
) -> tuple[list[ndarray], str]:
    """The points of profiles with so many each, mm, NaN where nothing was seen, and
    what they were taken for; `points` (n, 2) of all are changed.

    Raises ScanError for sizes that no scanner sees.

    Nothing was seen where z is `missing`, or a code; and where it is zero and all else
    to one side of that, if `missing` is None.
    """
    z = points[:, 1]
    codes = [] if missing is None else [missing]
    codes += codes_in(z[np.isfinite(points).all(axis=1) & (z != missing)])
    seen = ~np.isnan(points).any(axis=1) & ~np.isin(z, codes)
    if missing is None and {*np.sign(z[seen])} in ({0, 1}, {0, -1}):
        codes.append(0.0)
        seen &= z != 0
    points[~seen] = np.nan
    where = " or ".join(f"{code:.10g}" for code in codes)
    unseen = (
        f"nothing seen in {(~seen).sum()} of them{where and f', where z is {where}'}"
    )
    unseen += doubt_of_code(z[seen])

    taken = [to_mm(folder, {axis: unit}, points, 1.0) for axis, unit in axes.items()]
    points *= [scale for scale, _ in taken]
    lengths = ", ".join(dict.fromkeys(words for _, words in taken))
    largest = np.nanmax(np.abs(points), initial=0)
    if not 1 <= largest <= FARTHEST_MM:
        fine = ("um", "0.1 um", "0.01 um")
        likely = [unit for unit in fine if 20 < largest * mm_of(unit) < 2000]
        if len(likely) != 1 or any(axes.values()) or np.nansum(points % 1):
            units = " or ".join(f"'{unit}'" for unit in likely) or "UNIT"
            raise ScanError(
                f"{folder}: the profiles are {lengths}; expected 1 to {FARTHEST_MM:g} "
                f"mm: is it the unit (--unit {units}), or where nothing was seen "
                "(--missing)?"
            )
        points *= mm_of(likely[0])
        lengths = f"in {likely[0]} (the largest whole number is {largest:.10g})"
    ranges = ", ".join(
        f"{axis} (column {name}) "
        f"from {np.nanmin(values):.4g} to {np.nanmax(values):.4g} mm"
        for axis, name, values in zip("xz", axes, points.T, strict=True)
    )
    values = np.split(points, np.cumsum(counts)[:-1])
    count = f"{len(counts)} with {len(points)} points"
    return values, f"{count}, {lengths}, {ranges}, {unseen}"


def codes_in(z: ndarray) -> list[float]:
    """The numbers that stand for nothing seen: up to three that repeat, and are farther
    from the others in z (n,) than these are spread; a tenth of it for usual codes.
    """
    values, counts = np.unique(z, return_counts=True)
    most = [1, 2, 3] if len(values) > 20 else []
    for end in (*map(slice, most), *(slice(-k, None) for k in most)):
        codes = values[end]
        if counts[end].min() < 3:
            continue
        others = z[~np.isin(z, codes)]
        low, high = np.percentile(others, [1, 99])
        apart = max(low - codes[-1], codes[0] - high)
        is_usual = all(CODE.fullmatch(f"{code:.10g}") for code in codes)
        if apart > (high - low) / (10 if is_usual else 1):
            return [*codes.tolist(), *codes_in(others)]
    return []


def doubt_of_code(z: ndarray) -> str:
    """A number that much of z (n,) is, which may stand for nothing seen."""
    values, counts = np.unique(z, return_counts=True)
    if not len(z) or counts.max() < len(z) / 5:
        return ""
    most = values[counts.argmax()]
    share = f"{counts.max() / len(z):.0%} of the others have z = {most:.10g}"
    return f"; {share}: if nothing was seen there, --missing {most:.10g}"
