"""Which pose each profile was measured at: by a column that has the profiles' names or
numbers, by the time of both, or in order.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from statistics import mode
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from profilecal.calibration.observe import A_MOMENT_S
from profilecal.scan.tables import ScanError, Table, listed, number
from profilecal_tool.importing.makers import LABELS, TIMES
from profilecal_tool.importing.tables import rows_of, stem

STAMP = re.compile(
    r"((?:19|20)\d\d)\D?([01]\d)\D?([0-3]\d)"
    r"\D{0,2}([0-2]\d)\D?([0-5]\d)\D?([0-5]\d)(?:\D?(\d{1,6}))?"
)
DAY_FIRST = re.compile(r"\b([0-3]\d)\.([01]\d)\.((?:19|20)\d\d)")
CLOCK = re.compile(r"([0-2]\d)[-:.h]([0-5]\d)[-:.m]([0-5]\d(?:\.\d+)?)")
FILE = re.compile(r"(?s:.*[/\\])?(.*?)(?:\.0|\.[a-zA-Z]\w*)?")
UNITS_S = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
SECONDS = re.compile(r"\d{10,}(?:\.\d+)?|\d+\.\d+")  # since 1970, or since anything


class Pairing(NamedTuple):
    """A pose for each profile."""

    rows: ndarray  # (P,) of the poses; -1: none
    labels: Sequence  # of the poses; none where these have no names
    how: str

    @property
    def shares(self) -> tuple[float, float]:
        """Of the profiles that have a pose, and of the poses that have a profile."""
        has_pose = self.rows >= 0
        served = {*self.rows[has_pose].tolist()}
        return has_pose.mean(), len(served) / max(len(self.labels), 1)


def match(
    poses: Table, names: Sequence, turn: Collection[str], left: Sequence[str]
) -> tuple[Table, list[int], str]:
    """The poses that have a profile, as often as they have one, under labels; which
    profile each has; and how that was found.

    `names` of the profiles are numbers where they have none; `turn`: the columns of
    the poses' orientations; `left`: files that were left out. Raises ScanError.
    """
    pairing = paired(poses, names, turn)
    if pairing is None and len(names) == len(poses.lines):
        how = "in order, the first pose with the first profile"
        pairing = Pairing(np.arange(len(names)), [], how)
    if pairing is None:
        among = f"; left out: {listed(left)}" if left else ""
        many = "one profile" if len(names) == 1 else f"{len(names)} profiles"
        raise ScanError(
            f"{poses.path}: {many} for {len(poses.lines)} poses, and no column has "
            "names, numbers or times of profiles; add one, or say which files: "
            f"--poses, --profiles{among}"
        )
    rows, labels, how = pairing
    order = np.argsort(rows, kind="stable")
    order = order[rows[order] >= 0]
    taken = rows_of(poses, rows[order])
    is_once = len(labels) and len({*rows[order].tolist()}) == len(order)
    of_poses = [labels[row] for row in rows[order]] if is_once else []
    taken.columns["pose"] = of_poses or [str(names[k]) for k in order]
    lost = [names[k] for k in np.flatnonzero(rows < 0)]
    idle = [label for row, label in enumerate(labels) if row not in rows]
    for what, without in (("pose", lost), ("profile", idle)):
        if without:
            how += f"; left out, without a {what}: {listed(without)}"
    return taken, order.tolist(), how


def paired(poses: Table, names: Sequence, turn: Collection[str]) -> Pairing | None:
    """The pairing that most profiles and poses take part in, of those by a column that
    half of both do; else that by time, if both have times.
    """
    if not isinstance(names[0], str):
        return None
    # of a log only those whose name says it: others would fill the memory
    is_log = len(poses.lines) > 100 * len(names)
    found = []
    for column in dict.fromkeys((*LABELS, *([] if is_log else poses.columns))):
        if column in poses.columns.keys() - {*"xyz", *turn}:
            found += by_column(poses, column, names)
    found = [pairing for pairing in found if min(pairing.shares) >= 0.5]
    best = max(found, key=lambda pairing: sum(pairing.shares), default=None)
    return best or by_time(poses, names, turn)


def by_column(poses: Table, column: str, names: Sequence[str]) -> Iterator[Pairing]:
    """The pairings in which a column has the profiles' names, or the last, the last but
    one, … of the numbers in them. Raises ScanError where a label is there twice.
    """
    labels = [FILE.sub(r"\1", str(cell).strip()) for cell in poses.columns[column]]
    row_of = {}
    twice = [row_of.setdefault(label.lower(), k) < k for k, label in enumerate(labels)]
    if any(twice):
        if column in LABELS and sum(twice) < len(labels) / 2:
            poses.refuse(twice, "pose {} is there twice", labels)
        return
    rows = np.array([row_of.get(name.lower(), -1) for name in names])
    yield Pairing(rows, labels, f"by their names, as in column {column}")
    numbers = [re.findall(r"\d+", STAMP.sub("", name)) for name in names]
    fields = min(map(len, numbers))
    whole = [re.findall(r"(?<![.\d])\d+(?![.\d])", label)[-1:] for label in labels]
    of_rows = {row: int(number[0]) for row, number in enumerate(whole) if number}
    if len({*of_rows.values()}) < len(of_rows):  # a program may have a home, too
        usual = mode(map(stem, labels))
        of_rows = {k: of_rows[k] for k in of_rows if stem(labels[k]) == usual}
    row_of = {one: row for row, one in of_rows.items()}
    if len(row_of) < len(of_rows) or fields > 3:  # more may be a time
        return
    for k in range(1, fields + 1):
        of_profiles = [int(of_name[-k]) for of_name in numbers]
        how = f"by the numbers in their names, as in column {column}"
        shift = (0 in of_profiles) - (0 in row_of)
        shifted = [number + shift for number in of_profiles]
        if {*shifted} <= row_of.keys() and not {*of_profiles} <= row_of.keys():
            of_profiles = shifted
            how += ", where one counts from 0 and the other from 1"
        rows = np.array([row_of.get(number, -1) for number in of_profiles])
        yield Pairing(rows, labels, how)


def by_time(
    poses: Table, names: Sequence[str], turn: Collection[str]
) -> Pairing | None:
    """The pairing of profiles with the poses nearest in time, if both have times.

    None where times of half of the profiles are in no log, unless all are by clocks of
    two zones, whole or half hours apart, and in one way only.
    """
    of_poses, of_profiles = times_of(poses, names, turn)
    if len(of_poses) < 2:
        return None
    if at_once := nearest(poses, of_poses, of_profiles, turn):
        return at_once
    found = []
    for hours in np.arange(-14, 14.5, 0.5):
        shifted = nearest(poses, of_poses, of_profiles + 3600 * hours, turn)
        if shifted and shifted.rows.min() >= 0:
            how = f"{shifted.how}, with the profiles' clock {-hours:+g} h of the poses'"
            found.append(shifted._replace(how=how))
    return found[0] if len(found) == 1 else None


def nearest(
    poses: Table, of_poses: ndarray, of_profiles: ndarray, turn: Collection[str]
) -> Pairing | None:
    """The pairing of profiles with the poses nearest in time, s; None where half of
    them are in no log. Of one that goes on while the robot moves, only where it stands.
    """
    order = np.argsort(of_poses)
    of_poses = of_poses[order]
    after = np.clip(np.searchsorted(of_poses, of_profiles), 1, len(of_poses) - 1)
    apart = np.abs(of_poses[[after - 1, after]] - of_profiles)
    row = after - 1 + apart.argmin(axis=0)
    apart = apart.min(axis=0)
    is_near = apart <= np.median(np.diff(of_poses))
    how = "by time"
    if len(of_poses) > 2 * len(of_profiles):
        is_near &= stands_still(poses, order, turn)[after - 1]
        how = "by time, where the robot stands still"
    if is_near.mean() < 0.5:
        return None
    how += f", up to {apart[is_near].max():.2g} s apart"
    return Pairing(np.where(is_near, order[row], -1), [], how)


def times_of(
    poses: Table, names: Sequence[str], turn: Collection[str]
) -> tuple[ndarray, ndarray]:
    """The times of poses and of profiles, s; none where not all have one."""
    others = [name for name in poses.columns if name not in turn]  # t may be an angle
    columns = [name for name in others if TIMES.search(name)]
    cells = zip(*(poses.columns[name] for name in columns), strict=True)
    of_poses = all_seconds([" ".join(map(str, both)) for both in cells])
    of_profiles = all_seconds([*map(str, names)])
    if np.isnan([*of_poses, *of_profiles]).any():
        return np.empty(0), np.empty(0)
    return of_poses * unit_s(poses), of_profiles


def all_seconds(texts: Sequence[str]) -> ndarray:
    """The times (n,) that texts say, s: whole numbers too, among others that do."""
    values = np.array([*map(seconds, texts)])
    if np.isfinite(values).any():
        missing = np.flatnonzero(np.isnan(values))
        values[missing] = [number(texts[k]) for k in missing]
    return np.where(np.isfinite(values), values, np.nan)


def unit_s(table: Table) -> float:
    """The unit of a table's times, as a title says it, in s."""
    said = [unit for name, unit in table.units.items() if TIMES.search(name)]
    return next((UNITS_S[unit] for unit in said if unit in UNITS_S), 1.0)


def driven(
    poses: Table, names: Sequence, turn: Collection[str], unit: float
) -> tuple[ndarray, ndarray, ndarray] | None:
    """The order (L,) and the times (L,) of poses that are a log of a robot in motion,
    and the times (P,) of profiles, of which it moved at most; None for others.

    A log has rows a moment apart. `unit`: of the profiles' times, s.
    """
    of_poses, of_profiles = times_of(poses, names, turn)
    of_profiles = (of_profiles * unit).round(9)
    if len(of_poses) < 4:
        return None
    order = np.argsort(of_poses, kind="stable")
    t = of_poses[order]
    row = np.searchsorted(t, of_profiles)
    inside = (row > 0) & (row < len(t))
    if np.median(np.diff(t)) > A_MOMENT_S or inside.mean() < 0.5:
        return None
    still = stands_still(poses, order, turn)[row[inside] - 1]
    return (order, t, of_profiles) if still.mean() < 0.5 else None


def stands_still(poses: Table, order: ndarray, turn: Collection[str]) -> ndarray:
    """Whether a robot is where it was a line before, for all lines of a log but the
    first: its numbers differ by less than 0.0001 of the largest.
    """
    still = np.full(len(order) - 1, True)
    for names in ("xyz", turn):
        numbers = poses.numbers(names)[order]
        steps = np.abs(np.diff(numbers, axis=0))
        steps = np.minimum(steps, np.abs(360 - steps))  # degrees begin again
        still &= (steps < 1e-4 * np.abs(numbers).max()).all(axis=1)
    return still


def seconds(text: str) -> float:
    """The time that a text says, s; NaN if there is none."""
    if match := STAMP.search(DAY_FIRST.sub(r"\3-\2-\1", text)):
        *whole, part = match.groups()
        with suppress(ValueError):
            at = datetime(*map(int, whole), tzinfo=UTC)
            return at.timestamp() + float(f"0.{part or 0}")
    if match := CLOCK.search(text):
        hours, minutes, rest = map(float, match.groups())
        return 3600 * hours + 60 * minutes + rest
    match = SECONDS.search(text)
    value = float(match[0]) if match else np.nan
    while value > 1e11:  # in ms, or less
        value /= 1000
    return value
