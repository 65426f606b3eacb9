"""Which pose each profile was measured at: by label, by time, in order."""

import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime

import numpy as np
from numpy import ndarray

from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.blocks import Part
from profilecal_tool.importing.questions import Layout

DATE = r"((?:19|20)\d\d)\D?([01]\d)\D?([0-3]\d)\D{0,2}"
MOMENT = re.compile(DATE + r"([0-2]\d)\D?([0-5]\d)\D?([0-5]\d)")
STAMP = re.compile(MOMENT.pattern + r"(?:[.,_](\d{1,6}))?")
SECONDS = re.compile(r"\d{9,}(?:\.\d+)?|\d+\.\d+")  # since 1970, or since anything
UNITS_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STILL = 1e-4  # of the largest number: by so little a robot at rest differs
A_MOMENT_S = 0.5  # poses in such a time are no stops
TWICE = -2  # in place of a row


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
        if not 0 < rate < np.inf:
            expected = "expected s, and profiles a second"
            raise ScanError(f"--times is {start:g} {rate:g}; {expected}")
        names = [f"{start + k / rate:.6f}" for k in range(len(names))]
    count, labels = len(poses.block.table), [*poses.labels.values()]
    found = paired_by_label(poses, names) or paired_by_time(poses, names)
    row_of = {label: row for own in labels[:1] for row, label in enumerate(own)}
    order = [row_of[name] for name in dict.fromkeys(moves) if name in row_of]
    how = "in order of the moves" if order else "in order"
    order = np.array(order or range(count))
    if not found and len(names) == len(order):
        found = order, None, how
    if not found:
        counts = f"{len(names)} profiles for {len(order)} poses"
        sentence = f"{counts}, and no label or time that both have; add a column"
        hint = "or say which files: --profiles, or when they were taken: --times"
        raise ScanError(f"{poses.path}: {sentence}, {hint}")
    rows, log, how = found
    if not log:
        lost = [name for name, row in zip(names, rows, strict=True) if row < 0]
        idle = [own[k] for own in labels[:1] for k in {*range(count)} - {*rows}]
        for what, left in (("pose", lost), ("profile", idle)):
            how += f"; left out, without a {what}: {listed(left)}" if left else ""
    return rows, log, how


def paired_by_label(poses: Part, names: Sequence[str]) -> Pairing | None:
    """The pairing by the labels, and the names or numbers in them, that serve most
    poses, and more than half of them and of the profiles.

    Raises ScanError where two serve as many and differ, and where a label stands twice.
    """
    found, best = [], (False, 0.5)
    for title, labels in poses.labels.items():
        for how, keys, wanted in ways_to_compare(labels, names):
            row_of = {}
            for row, key in enumerate(keys):
                row_of[key] = TWICE if key in row_of else row
            rows = np.array([row_of.get(one, -1) for one in wanted])
            part = min((rows != -1).mean(), len({*rows} - {-1}) / len(keys))
            # a number in a name counts less than all of the name
            served = ("number " not in how, part)
            if part > 0.5 and served >= best:
                found = found if served == best else []
                found.append((rows, title, how))
                best = served
            if best[0]:
                break
    if not found:
        return None
    rows, title, how = found[0]
    for others, other, way in found[1:]:
        differing = np.flatnonzero(others != rows)
        if len(differing):
            words = f"by {title} and the {how} or by {other} and the {way}"
            sentence = f"which pose has profile {names[differing[0]]}: {words}?"
            hint = "Rename the profiles' files, or --pose-columns: _ for other columns"
            raise ScanError(f"{poses.path}: {sentence} {hint}")
    if (rows == TWICE).any():
        sentence = f"two poses have the {title} of profile {names[rows.argmin()]}"
        raise ScanError(f"{poses.path}: {sentence}; leave one out")
    return rows, None, f"by the {how}"


def ways_to_compare(
    labels: Sequence[str], names: Sequence[str]
) -> Iterator[tuple[str, Sequence, Sequence]]:
    """How, with what labels have, and what names want: whole names, without folder and
    ending, if they are more than numbers, or all are there; all numbers, as in 2_07; or
    the last number of the labels and each in the names, counted from 0 and from 1 if
    all fit so.
    """
    keys, wanted = (
        [re.sub(r".*[/\\]|\.[a-z]\w*$", "", text.lower()) for text in texts]
        for texts in (labels, names)
    )
    if {*wanted} <= {*keys} or not "".join(wanted).isdigit():
        yield "names", keys, wanted
    of_labels, of_names = (
        [(*map(int, re.findall(r"\d+", MOMENT.sub("", text))),) for text in texts]
        for texts in (labels, names)
    )
    if max(map(len, of_labels)) > 1:
        yield "numbers in the names", of_labels, of_names
    keys = [numbers[-1] if numbers else None for numbers in of_labels]
    for k, wanted in enumerate(zip(*of_names, strict=False), 1):
        how, shift = f"number {k} in the names", (0 in wanted) - (0 in keys)
        shifted = [one + shift for one in wanted]
        if shift and {*shifted} <= {*keys}:
            how, wanted = f"{how}, from 0 and from 1", shifted
        yield how, keys, wanted


def time_said(text: str) -> float:
    """The time that a text says, s; NaN if there is none."""
    if match := STAMP.search(text):
        *whole, part = match.groups()
        try:
            at = datetime(*map(int, whole), tzinfo=UTC).timestamp()
        except ValueError:
            return np.nan
        return at + float(f"0.{part or 0}")
    match = SECONDS.search(text)
    value = float(match[0]) if match else cell_number(text)
    while 1e11 < value < np.inf:  # in ms, or less
        value /= 1000
    return value


def paired_by_time(poses: Part, names: Sequence[str]) -> Pairing | None:
    """The poses nearest in time, of a log only those where the robot stands still; or
    the log, where profiles were taken as the robot moved.
    """
    column = [*poses.block.having("time", "t"), None][0]
    if not column:
        return None
    t, times = (
        np.array([time_said(str(cell)) for cell in cells])
        for cells in (poses.block.table[column.at], names)
    )
    unit = UNITS_S.get(column.unit, 1.0)
    t, times = (t * unit).round(9), (times * unit).round(9)
    if len(t) < 2 or not np.isfinite([*t, *times]).all():
        return None
    order = np.argsort(t, kind="stable")
    t = t[order]
    after = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    apart = np.abs(t[[after - 1, after]] - times)
    rows = order[after - 1 + apart.argmin(axis=0)]
    apart, step = apart.min(axis=0), np.median(np.diff(t))
    near = apart <= step
    if near.mean() < 0.5:
        return None
    still = stands_still(poses.at(order))[after - 1]
    if step <= A_MOMENT_S and still[near].mean() < 0.5:
        return order, (t, times), "by time, in motion"
    how = "by time"
    if len(t) > 2 * len(names):
        near, how = near & still, "by time, where the robot stands still"
    if not near.any():
        return None
    how += f", up to {apart[near].max():.2g} s apart"
    return np.where(near, rows, -1), None, how


def stands_still(poses: Part) -> ndarray:
    """Whether a robot is where it was a line before, for all lines but the first."""
    still = np.full(len(poses.block.table) - 1, True)
    for names in ("xyz", poses.convention.columns):
        values = poses.numbers(names)
        steps = np.abs(np.diff(values, axis=0))
        if names != "xyz":
            steps = np.minimum(steps, np.abs(360 - steps))  # degrees begin again
        still &= (steps < STILL * np.abs(values).max()).all(axis=1)
    return still
