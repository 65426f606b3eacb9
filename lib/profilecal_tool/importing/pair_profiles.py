"""Which pose each profile was measured at: by label, by time, in order."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy import ndarray

from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.column_meanings import columns_of
from profilecal_tool.importing.questions import Question
from profilecal_tool.importing.robot_poses import Poses

DATE = r"((?:19|20)\d\d)\D?([01]\d)\D?([0-3]\d)\D{0,2}"
MOMENT = re.compile(DATE + r"([0-2]\d)\D?([0-5]\d)\D?([0-5]\d)")
STAMP = re.compile(MOMENT.pattern + r"(?:[.,_](\d{1,6}))?")
SECONDS = re.compile(r"\d{9,}(?:\.\d+)?|\d+\.\d+")  # since 1970, or since anything
WHOLE = re.compile(r"(?<![\d.])\d+(?!\d*\.\d)")
UNITS_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STILL = 1e-4  # of the largest number: by so little a robot at rest differs
A_MOMENT_S = 0.5  # poses in such a time are no stops
TWICE = -2  # in place of a row
Way = tuple[str, str]  # a column of labels, and how names are compared with it
Keys = tuple[str, Sequence, Sequence]  # how; what poses have, and what profiles want


@dataclass(frozen=True)
class Pairing:
    """A pose for each profile, or a log of a robot in motion."""

    rows: ndarray  # (P,) of the poses, -1: none; in motion all (L,), as time goes on
    how: str
    log: tuple[ndarray, ndarray] | None = None  # times (L,) of poses, (P,) of profiles


def pair_profiles(poses: Poses, names: Sequence[str]) -> Pairing:
    """The pose of each profile. Raises ScanError."""
    found = paired_by_label(poses, names) or paired_by_time(poses, names)
    order, how = rows_in_order(poses)
    if not found and len(names) == len(order):
        found = Pairing(order, how)
    if not found:
        counts = f"{len(names)} profiles for {len(order)} poses"
        sentence = f"{counts}, and no label or time that both have; add a column"
        hint = "or say which files: --profiles, or when they were taken: --times"
        raise ScanError(f"{poses.path}: {sentence}, {hint}")
    if found.log:
        return found
    how, served = found.how, {*found.rows.tolist()}
    labels = [*poses.labels.values()][:1]
    lost = [name for name, row in zip(names, found.rows, strict=True) if row < 0]
    idle = [own[k] for own in labels for k in range(len(own)) if k not in served]
    for what, left in (("pose", lost), ("profile", idle)):
        how += f"; left out, without a {what}: {listed(left)}" if left else ""
    return Pairing(found.rows, how)


def rows_in_order(poses: Poses) -> tuple[ndarray, str]:
    """The rows as a program moves to them, or else as they stand; and this in words."""
    every = poses.labels.values()
    row_of = {label: row for own in every for row, label in enumerate(own)}
    uses = [block.table for block in poses.read_with if block.kind == "uses"]
    moves = [name for table in uses for name in table.get("name", [])]
    driven = [row_of[name] for name in dict.fromkeys(moves) if name in row_of]
    if driven:
        return np.array(driven), "in order of the moves"
    return np.arange(len(poses.table)), "in order"


def paired_by_label(poses: Poses, names: Sequence[str]) -> Pairing | None:
    """The pairing by whole names, else by a number in them: of the labels, and of the
    numbers, those that serve most poses, and more than half.

    Raises ScanError where two serve as many and differ, and where a label stands twice.
    """
    for ways_of in (compare_names, compare_numbers):
        ways = {
            (title, how): rows_having(keys, wanted)
            for title, labels in poses.labels.items()
            for how, keys, wanted in ways_of(labels, names)
        }
        served = {way: len({*rows} - {-1}) for way, rows in ways.items()}
        most = max(served.values(), default=0)
        best = [way for way in ways if served[way] == most]
        best.sort(key=lambda way: (np.diff(ways[way]) == 1).all())  # counts rows
        if most * 2 <= len(poses.table) or (ways[best[0]] >= 0).mean() < 0.5:
            continue
        for other in best[1:]:
            check_alike(poses, names, best[0], other, ways)
        title, how = best[0]
        rows = ways[best[0]]
        if (rows == TWICE).any():
            name = names[rows.argmin()]
            sentence = f"two poses have the {title} of profile {name}; leave one out"
            raise ScanError(f"{poses.path}: {sentence}")
        return Pairing(rows, f"by the {how}")
    return None


def rows_having(keys: Sequence, wanted: Sequence) -> ndarray:
    """The row of what each profile wants (P,), among what poses have; -1 if none has
    it, TWICE if several do.
    """
    row_of = {}
    for row, key in enumerate(keys):
        row_of[key] = TWICE if key in row_of else row
    return np.array([row_of.get(one, -1) for one in wanted])


def check_alike(
    poses: Poses, names: Sequence[str], way: Way, other: Way, ways: dict[Way, ndarray]
) -> None:
    """Raise ScanError where two ways to pair differ; Question where these are of two
    columns of labels.
    """
    differing = np.flatnonzero(ways[way] != ways[other])
    if len(differing) == 0:
        return
    words = " or ".join(f"by {title} and the {how}" for title, how in (way, other))
    sentence = f"{poses.path}: which pose has profile {names[differing[0]]}: {words}?"
    if way[0] == other[0]:
        raise ScanError(f"{sentence} Rename the profiles' files")
    columns = columns_of(poses.block)
    titles = [
        "_" if column.name == other[0] else title
        for column, title in zip(columns, poses.block.titles, strict=True)
    ]
    raise Question(sentence, pose_columns=",".join(titles))


def compare_names(labels: Sequence[str], names: Sequence[str]) -> Iterator[Keys]:
    """By whole names, without folder and ending; by mere numbers only if all fit."""
    keys, wanted = (
        [re.sub(r".*[/\\]|\.[a-z]\w*$", "", text.lower()) for text in texts]
        for texts in (labels, names)
    )
    if {*wanted} <= {*keys} or not "".join(wanted).isdigit():
        yield "names", keys, wanted


def compare_numbers(labels: Sequence[str], names: Sequence[str]) -> Iterator[Keys]:
    """By the last number of labels that are called alike, as a program may have a home,
    too: P22 by that behind P in 001_P22. Counted from 0 and from 1 if all fit so.
    """
    stems = [re.sub(r"\d+", "", label) for label in labels]
    usual = max({*stems}, key=stems.count, default="")
    numbers = [WHOLE.findall(label) for label in labels]
    keys = [
        int(own[-1]) if own and stem == usual else None
        for own, stem in zip(numbers, stems, strict=True)
    ]
    behind = re.compile(rf"(?<![^\W_]){re.escape(usual)}(\d+)", re.IGNORECASE)
    found = [behind.findall(name) if usual else [] for name in names]
    if not all(found):
        found = [WHOLE.findall(MOMENT.sub("", name)) for name in names]
    for k, field in enumerate(zip(*found, strict=False), 1):
        how, wanted = f"number {k} in the names", [*map(int, field)]
        shift = (0 in wanted) - (0 in keys)
        shifted = [one + shift for one in wanted]
        if shift and {*shifted} <= {*keys} and not {*wanted} <= {*keys}:
            how, wanted = f"{how}, from 0 and from 1", shifted
        yield how, keys, wanted
    several = numbers_in(labels)
    if max(map(len, several)) > 1:
        yield "numbers in the names", several, numbers_in(names)


def numbers_in(texts: Iterable[str]) -> list[tuple[int, ...]]:
    """All numbers in each text, but for times."""
    found = (re.findall(r"\d+", MOMENT.sub("", text)) for text in texts)
    return [tuple(map(int, own)) for own in found]


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


def times_in_s(cells: Iterable, unit: float) -> ndarray:
    """The times of cells in a unit, s."""
    return (np.array([time_said(str(cell)) for cell in cells]) * unit).round(9)


def paired_by_time(poses: Poses, names: Sequence[str]) -> Pairing | None:
    """The poses nearest in time, of a log only those where the robot stands still; or
    the log, where profiles were taken as the robot moved.
    """
    unit = UNITS_S.get(poses.units.get("time", ""), 1.0)
    t, times = (
        times_in_s(cells, unit) for cells in (poses.table.get("time", []), names)
    )
    if len(t) < 2 or not np.isfinite([*t, *times]).all():
        return None
    order = np.argsort(t, kind="stable")
    t = t[order]
    after = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    apart = np.abs(t[[after - 1, after]] - times)
    rows = order[after - 1 + apart.argmin(axis=0)]
    apart = apart.min(axis=0)
    step = np.median(np.diff(t))
    near = apart <= step
    still = stands_still(poses, order)[after - 1]
    if near.mean() < 0.5:
        return None
    if step <= A_MOMENT_S and still[near].mean() < 0.5:
        return Pairing(order, "by time, in motion", (t, times))
    how = "by time"
    if len(t) > 2 * len(names):
        near, how = near & still, "by time, where the robot stands still"
    how += f", up to {apart[near].max(initial=0):.2g} s apart"
    return Pairing(np.where(near, rows, -1), how) if near.mean() >= 0.5 else None


def stands_still(poses: Poses, order: ndarray) -> ndarray:
    """Whether a robot is where it was a line before, for all lines but the first."""
    still = np.full(len(order) - 1, True)
    for names in ("xyz", poses.convention.columns):
        values = poses.numbers(names)[order]
        steps = np.abs(np.diff(values, axis=0))
        if names != "xyz":
            steps = np.minimum(steps, np.abs(360 - steps))  # degrees begin again
        still &= (steps < STILL * np.abs(values).max()).all(axis=1)
    return still
