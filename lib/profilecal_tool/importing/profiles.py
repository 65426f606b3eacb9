"""The profiles in files: which rows are whose, which columns are x and z, their unit,
and which pose each is of.
"""

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from numpy import ndarray

from profilecal.scan.scan import FARTHEST_MM
from profilecal.scan.tables import ScanError, Table, listed
from profilecal_tool.importing.arrays import ENDINGS, array, from_array
from profilecal_tool.importing.layout import Layout
from profilecal_tool.importing.makers import LABELS
from profilecal_tool.importing.nested import points_in_list
from profilecal_tool.importing.tables import (
    check_alike,
    closed_text,
    from_rows,
    lines_of,
    names_and_units,
    to_mm,
)


def read_profiles(path: Path, entry: str = "") -> list[Table]:
    """Points of a profile, or of several in one array, under the names in titles, or
    "1", "2", …; no columns where nothing was seen.

    `entry` names the list or array where there are several. Raises ScanError.
    """
    if path.suffix.lower() in ENDINGS:
        values = array(path, entry)
        if values.ndim == 2:
            values = values[None]
        if values.shape[1] <= 3 < values.shape[2]:  # a point a column
            values = values.mT
        return [from_array(path, profile) for profile in values]
    text = closed_text(path)
    rows = points_in_list(path, text, entry)
    if not rows and not re.search(r"\b\d", text):  # titles at most
        return [Table(path, {}, [])]
    return [from_rows(path, rows or lines_of(text))]


def profiles_of(
    paths: list[Path], count: int, layout: Layout
) -> tuple[Sequence, list[ndarray], dict]:
    """Names of profiles, or numbers, their points (n, 2), and the columns of x and z
    with their units.

    Each file has a profile; or one has all, for `count` poses: a profile is the rows
    that share a label, or a row, or a part of an array. Raises ScanError.
    """
    said = layout.columns
    tables = [table for path in paths for table in read_profiles(path, layout.entry)]
    # in the others nothing was seen
    full = [table for table in tables if table.columns]
    if not full:
        raise ScanError(f"{paths[0]}: no numbers in columns")
    check_alike(full)
    first = full[0]
    label = next((name for name in LABELS if name in first.columns), None)
    labels = np.array(first.columns.pop(label)) if label else None
    if len(paths) == 1:
        if labels is not None:
            return by_label(first, labels, said)
        if len(first.columns) > 4 and len(first.lines) in (count, count + 1):
            tables = full = by_row(first, count)
    axes = x_and_z(full, said)
    points = [
        table.numbers(axes, blank=True) if table.columns else np.empty((0, 2))
        for table in tables
    ]
    if len(points) == len(paths) > 1:
        return [path.stem for path in paths], points, axes
    return range(len(points)), points, axes


def by_label(
    table: Table, labels: ndarray, said: str
) -> tuple[Sequence, list[ndarray], dict]:
    """A profile of the rows that share a label (rows,), as `profiles_of` has it."""
    axes = x_and_z([table], said)
    points = table.numbers(axes, blank=True)
    names = [*dict.fromkeys(labels.tolist())]
    return names, [points[labels == name] for name in names], axes


def by_row(table: Table, count: int) -> list[Table]:
    """A profile in each of `count` rows: x and z in turn; where there is a row more, z
    under the first row's x.
    """
    rows = table.numbers(table.columns, blank=True)
    if len(rows) == count:
        x, z = rows[:, ::2], rows[:, 1::2]
    else:
        x, z = np.broadcast_arrays(rows[:1], rows[1:])
    profiles = np.stack([x, z], axis=-1)
    return [from_array(table.path, profile) for profile in profiles]


def x_and_z(tables: list[Table], said: str) -> dict[str, str]:
    """The columns of x and z and their units: as said, of these names, or where there
    are no names, the two that vary. Raises ScanError.
    """
    first = tables[0]
    varying = []
    for name in first.columns:
        cells = chain.from_iterable(table.columns[name] for table in tables)
        if len(set(cells)) > 1:
            varying.append(name)
    if said:
        axes = names_and_units(said.split(","))
    elif all(map(str.isdigit, varying)):
        axes = dict.fromkeys(varying, "")
    else:
        axes = {"x": "", "z": ""}
    both = len(axes) == len(axes.keys() & first.columns) == 2
    if not both or (not said and "y" in varying):
        raise ScanError(
            f"{first.path}: columns {listed(first.columns)}; "
            "say which are x and z: --columns x,z"
        )
    return {name: unit or first.units[name] for name, unit in axes.items()}


def seen_in_mm(
    folder: Path, profiles: list[ndarray], axes: dict, missing: float | None
) -> tuple[list[ndarray], str]:
    """The points (n, 2) of profiles, mm, NaN where nothing was seen, and what they were
    taken for. Raises ScanError for sizes that no scanner sees.

    Where z is `missing`, nothing was seen; if that is None, zeros are that where all
    else is to one side of them.
    """
    points = np.concatenate(profiles)
    z = points[:, 1]
    seen = ~np.isnan(points).any(axis=1)
    if missing is None and {*np.sign(z[seen])} in ({0, 1}, {0, -1}):
        missing = 0.0
    seen &= z != missing
    points[~seen] = np.nan
    scale, lengths = to_mm(folder, axes, points, 1.0)
    points *= scale
    if not 1 <= np.nanmax(np.abs(points), initial=0) <= FARTHEST_MM:
        raise ScanError(
            f"{folder}: the profiles are {lengths}; expected 1 to {FARTHEST_MM:g} mm: "
            "is it the unit, or where nothing was seen (--missing)?"
        )
    ranges = ", ".join(
        f"{axis} (column {name}) "
        f"from {np.nanmin(values):.4g} to {np.nanmax(values):.4g} mm"
        for axis, name, values in zip("xz", axes, points.T, strict=True)
    )
    where = "" if missing is None else f", where z is {missing:g}"
    unseen = f"nothing seen in {(~seen).sum()} of them{where}"
    ends = np.cumsum([len(profile) for profile in profiles])
    values = np.split(points, ends[:-1])
    return values, f"{len(points)} points, {lengths}, {ranges}, {unseen}"


def match(
    poses: Table, names: Sequence, left: Sequence[str]
) -> tuple[list[str], list[int], str]:
    """The poses' labels, which profile each has, and how it was found: by its name or
    its last number, or by order.

    `names` of the profiles are numbers where they have none; `left`: files that were
    left out. Raises ScanError where a pose or a profile is left over.
    """
    column = next((name for name in LABELS if name in poses.columns), None)
    if not column or not isinstance(names[0], str):
        if len(names) != len(poses.lines):
            raise ScanError(
                f"{poses.path}: {len(names)} profiles for {len(poses.lines)} poses"
            )
        how = "in order, the first pose with the first profile"
        return [str(name) for name in names], [*range(len(names))], how
    labels = [str(cell).removesuffix(".0") for cell in poses.columns[column]]
    known, how = known_names(labels, names)
    order = [known.get(label, known.get(last_number(label), -1)) for label in labels]
    if -1 in order:
        among = f"; left out: {listed(left)} (--profiles)" if left else ""
        raise ScanError(
            f"{poses.path}: no profile for pose {labels[order.index(-1)]}{among}"
        )
    first = [order.index(k) for k in order]
    poses.refuse(
        first < np.arange(len(order)),
        "profile {} is of pose {} already; "
        "give each profile its pose's name, or say which files: --profiles",
        [names[k] for k in order],
        [labels[row] for row in first],
    )
    if spare := {*range(len(names))} - {*order}:
        raise ScanError(f"{poses.path}: no pose for profile {names[min(spare)]}")
    return labels, order, how


def known_names(labels: list[str], names: Sequence[str]) -> tuple[dict, str]:
    """Which profile a pose has, by its label or the last number in it, and how that is
    known.
    """
    known: dict[int | str, int] = {}
    for k, name in enumerate(names):
        known |= {last_number(name): k, name: k}
    numbers = [{*map(last_number, some)} for some in (labels, names)]
    runs = [{*range(first, first + len(names))} for first in (0, 1)]
    if numbers not in (runs, runs[::-1]):
        return known, "by their names"
    pairs = zip(*map(sorted, numbers), strict=True)
    known = {of_pose: known[of_profile] for of_pose, of_profile in pairs}
    return known, "by their numbers, where one counts from 0 and the other from 1"


def last_number(name: str) -> int | str:
    """The last whole number in a name; the name if there is none."""
    numbers = re.findall(r"\d+", name)
    return int(numbers[-1]) if numbers else name
