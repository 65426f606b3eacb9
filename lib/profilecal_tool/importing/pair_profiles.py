"""Which pose each profile was measured at: by label, by time, in order."""

import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy import ndarray
from pandas import Series

from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.blocks import Part
from profilecal_tool.importing.questions import Layout

STAMP = re.compile(
    r"((?:19|20)\d\d)\D?([01]\d)\D?([0-3]\d)\D{0,2}"  # a date
    r"([0-2]\d)\D?([0-5]\d)\D?([0-5]\d(?:\.\d{1,6})?)"
)
SECONDS = re.compile(r"\d{9,}(?:\.\d+)?|\d+\.\d+")  # since 1970, or since anything
UNITS_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STILL = 1e-4  # of the largest number: by so little a robot at rest differs
A_MOMENT_S = 0.5  # poses in such a time are no stops

# rows (P,) of the poses, -1: none; in motion all (L,), as time goes on, with times (L,)
# of poses and (P,) of profiles; and how
Pairing = tuple[ndarray, tuple[ndarray, ndarray] | None, str]


def pair_profiles(
    poses: Part, names: Sequence[str], moves: Iterable[str], layout: Layout
) -> Pairing:
    """The pose of each profile; `moves`: the poses' names as a program moves to them.

    Raises ScanError.
    """
    if layout.times:
        start, rate = layout.times
        if not rate > 0:
            raise ScanError(f"--times: {rate:g} profiles a second; expected some")
        names = [f"{start + k / rate:.6f}" for k in range(len(names))]
    labels = [*poses.labels.values(), []][0]
    driven = [labels.index(name) for name in dict.fromkeys(moves) if name in labels]
    order = np.array(driven or range(len(poses.block.table)))
    found = paired_by_label(poses, names) or paired_by_time(poses, names)
    if not found and len(names) == len(order):
        found = order, None, "in order of the moves" if driven else "in order"
    if not found:
        counts = f"{len(names)} profiles for {len(order)} poses"
        sentence = f"{counts}, and no label or time that both have; add a column"
        hint = "or say which files: --profiles, or when they were taken: --times"
        raise ScanError(f"{poses.path}: {sentence}, {hint}")
    rows, log, how = found
    lost = [name for name, row in zip(names, rows, strict=False) if row < 0]
    without = {*range(len(labels))} - {*rows}
    idle = [labels[row] for row in without]
    for what, left in (("pose", lost), ("profile", idle)):
        how += f"; left out, without a {what}: {listed(left)}" if left else ""
    return rows, log, how


def paired_by_label(poses: Part, names: Sequence[str]) -> Pairing | None:
    """The pairing by the labels, and the names or numbers in them, that serve most
    poses, and more than half of them and of the profiles; a number comes last.

    Raises ScanError where two serve as many and differ, and where a label stands twice.
    """
    found, most = [], (False, 0.5)
    for title, labels in poses.labels.items():
        for how, keys, wanted in ways_to_compare(labels, names):
            row_of = {key: row for row, key in enumerate(keys)}
            rows = np.array([row_of.get(one, -1) for one in wanted])
            served = len({*rows} - {-1}) / len(row_of)
            part = ("number " not in how, min((rows >= 0).mean(), served))
            if part[1] > 0.5 and part >= most:
                found = found if part == most else []
                found.append((rows, how, title, keys))
                most = part
    if not found:
        return None
    rows, how, title, keys = found[0]
    for others, way, other, _ in found[1:]:
        if (others != rows).any():
            name = names[np.argmax(others != rows)]
            words = f"by {title} and the {how} or by {other} and the {way}"
            hint = "Rename the profiles' files, or --pose-columns: _ for other columns"
            raise ScanError(f"{poses.path}: which pose has {name}: {words}? {hint}")
    again = Series(keys).duplicated(keep=False).to_numpy()[rows] & (rows >= 0)
    if again.any():
        sentence = f"two poses have the {title} of profile {names[again.argmax()]}"
        raise ScanError(f"{poses.path}: {sentence}; leave one out")
    return rows, None, f"by the {how}"


def ways_to_compare(
    labels: Sequence[str], names: Sequence[str]
) -> Iterator[tuple[str, list, Sequence]]:
    """How, with what labels have, and what names want: whole names, without folder and
    ending, if they are more than numbers; all numbers, as in 2_07; or the last number
    of the labels and each in the names, counted from 0 and from 1 if all fit so.
    """
    keys, wanted = (
        [re.sub(r".*[/\\]|\.[a-z]\w*$", "", text.lower()) for text in texts]
        for texts in (labels, names)
    )
    if not "".join(wanted).isdigit():
        yield "names", keys, wanted
    of_labels, of_names = (
        [(*map(int, re.findall(r"\d+", STAMP.sub("", text))),) for text in texts]
        for texts in (labels, names)
    )
    if max(map(len, of_labels)) > 1:
        yield "numbers in the names", of_labels, of_names
    keys = [[None, *numbers][-1] for numbers in of_labels]
    for k, wanted in enumerate(zip(*of_names, strict=False), 1):
        shift = (0 in wanted) - (0 in keys)
        shifted = [one + shift for one in wanted]
        if shift and {*shifted} <= {*keys}:
            yield f"number {k} in the names, from 0 and from 1", keys, shifted
        else:
            yield f"number {k} in the names", keys, wanted


def time_said(text: str) -> float:
    """The time that a text says, s; NaN if there is none."""
    if match := STAMP.search(text):
        year, month, day, hour, minute, second = match.groups()
        try:
            date = np.datetime64(f"{year}-{month}-{day}T{hour}:{minute}", "s")
        except ValueError:
            return np.nan
        return float(date.astype(int)) + float(second)
    match = SECONDS.search(text)
    value = cell_number(match[0] if match else text)
    while 1e11 < value < np.inf:  # in ms, or less
        value /= 1000
    return value


def paired_by_time(poses: Part, names: Sequence[str]) -> Pairing | None:
    """The poses nearest in time, of a log only those where the robot stands still; or
    the log, where profiles were taken as the robot moved.
    """
    columns = poses.block.having("time", "t")
    if not columns:
        return None
    cells, unit = poses.block.table[columns[0].at], UNITS_S.get(columns[0].unit, 1.0)
    t = np.array([time_said(str(cell)) * unit for cell in cells]).round(9)
    times = np.array([time_said(name) * unit for name in names]).round(9)
    if len(t) < 2 or not np.isfinite([*t, *times]).all():
        return None
    order = np.argsort(t, kind="stable")
    t, step = t[order], np.median(np.diff(t[order]))
    after = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    apart = np.abs(t[[after - 1, after]] - times)
    rows = order[after - 1 + apart.argmin(axis=0)]
    near = apart.min(axis=0) <= step
    if near.mean() < 0.5:
        return None
    still = stands_still(poses, order[after - 1], order[after])
    if step <= A_MOMENT_S and still[near].mean() < 0.5:
        return order, (t, times), "by time, in motion"
    how = "by time"
    if len(t) > 2 * len(names):
        near, how = near & still, "by time, where the robot stands still"
    largest = apart.min(axis=0)[near].max(initial=0)
    return np.where(near, rows, -1), None, f"{how}, up to {largest:.2g} s apart"


def stands_still(poses: Part, before: ndarray, after: ndarray) -> ndarray:
    """Whether the poses in rows before and after a time are the same."""
    still = np.full(len(before), True)
    for roles in ("xyz", poses.convention.columns):
        values = poses.numbers(roles)
        steps = np.abs(values[after] - values[before]).max(axis=1)
        still &= steps < STILL * np.abs(values).max()
    return still
