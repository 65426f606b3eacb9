"""Which pose each profile was measured at: by label, by time, in order."""

import re
from collections.abc import Iterator, Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from pandas import Series, to_numeric
from pandas.api.types import is_numeric_dtype

from profilecal.scan.tables import ScanError, cell_number, listed
from profilecal_tool.importing.blocks import Poses
from profilecal_tool.importing.makers import TIME_UNITS, XYZ, scale_of
from profilecal_tool.importing.questions import Layout

STAMP = re.compile(
    r"(?<!\d)((?:19|20)\d\d)\D?([01]\d)\D?([0-3]\d)\D{0,2}"  # a date
    r"([0-2]\d)\D?([0-5]\d)\D?([0-5]\d(?:\.\d{1,6})?)"
)
STILL = 1e-4  # of the largest number: by so little a robot at rest differs
A_MOMENT_S = 0.5  # poses in such a time are no stops
Names = list[str]  # of profiles, or of poses


class Times(NamedTuple):
    """Of a robot's log, as time goes on, and of profiles; s."""

    log: ndarray  # (L,)
    profiles: ndarray  # (P,)


class Pairing(NamedTuple):
    """Poses with a profile each; or, in motion, the log and all profiles."""

    rows: ndarray  # of the table of poses: of the log, as time goes on
    how: str
    profiles: ndarray  # which are of these poses
    times: Times | None = None  # in motion


def pair_profiles(poses: Poses, names: Names, moves: Names, layout: Layout) -> Pairing:
    """The poses that have a profile, and it, by its name, "" where it has none;
    `moves`: the poses' names as a program's lines use them.

    Raises ScanError.
    """
    if layout.times:
        start, rate = layout.times
        if not rate > 0:
            raise ScanError(f"--times: {rate:g} profiles a second; expected some")
        # profiles are called by their times
        names = [f"{start + k / rate:.6f}" for k in range(len(names))]
    elif pairing := paired_by_label(poses, names):
        return pairing
    times = times_of(poses, names, layout)
    if times and (pairing := paired_by_time(poses, names, times)):
        return pairing
    return paired_in_order(poses, names, moves, times, layout)


def pairing_of(poses: Poses, names: Names, found: ndarray, how: str) -> Pairing:
    """The pairing of profiles whose poses were found in these rows (P,), -1: none; in
    the order of the poses. Raises ScanError where none was found.
    """
    if (found < 0).all():
        raise ScanError(f"{poses.path}: {how}, and no profile has a pose")
    labels, served = next(iter(poses.labels.values()), []), {*found}
    lost = [*compress(names, found < 0)]
    idle = [label for row, label in enumerate(labels) if row not in served]
    words = how
    for what, left in (("pose", lost), ("profile", idle)):
        words += f"; left out, without a {what}: {listed(left)}" if left else ""
    # behind the profiles that have none
    order = np.argsort(found, kind="stable")[len(lost) :]
    return Pairing(found[order], words, order)


def paired_in_order(
    poses: Poses, names: Names, moves: Names, times: Times | None, layout: Layout
) -> Pairing:
    """The poses as a program's lines use them, or as they are listed.

    Raises ScanError where there are not as many profiles, where times are said, which
    then no pose has, or where numbers say another order, or times of another clock.
    """
    known = poses.names
    in_program = [known.index(name) for name in dict.fromkeys(moves) if name in known]
    rows = np.array(in_program or range(len(poses.table)))
    if layout.times or len(names) != len(rows):
        raise ScanError(
            f"{poses.path}: {len(names)} profiles for {len(rows)} poses, and no label "
            "or time that both have; add a column, or say which files: --profiles, or "
            "when they were taken: --times"
        )
    for column in poses.having("label", "time"):
        numbers = to_numeric(poses.table[column.at], errors="coerce").dropna()
        if not in_program and not numbers.is_monotonic_increasing:
            raise ScanError(
                f"{poses.path}: {poses.title(column)} goes up and down, and profiles "
                "have no such number; sort the rows, or name files"
            )
    how = "in order of the lines that use them" if in_program else "in order"
    if times:
        both = times.log[rows], times.profiles
        order, order_of_profiles = (np.argsort(t, kind="stable") for t in both)
        if (order != order_of_profiles).any():
            raise ScanError(
                f"{poses.path}: times of poses and profiles are by two clocks, and "
                "in another order; sort the rows, or name files"
            )
        how += ", as times by two clocks, or numbers, have it"
    return pairing_of(poses, names, rows, how)


class Way(NamedTuple):
    """A way to compare labels and names."""

    is_whole: bool  # by names or several numbers, not by one number
    what: str
    keys: Sequence  # of labels
    sought: Sequence  # of names


def ways_to_compare(labels: Names, names: Names) -> Iterator[Way]:
    """The ways to compare labels and the names of profiles.

    >>> for way in ways_to_compare(["p1", "p2", "p3"], ["a/scan_0.csv", "scan_1"]):
    ...     print(*way)
    True profiles' names ['p1', 'p2', 'p3'] ['scan_0', 'scan_1']
    False number in place 1 of the profiles' names +1 [1, 2, 3] [1, 2]
    >>> for way in ways_to_compare(["1.1", "1.10"], ["1", "2"]):
    ...     print(*way)
    True numbers in the profiles' names [(1, 1), (1, 10)] [(1,), (2,)]
    False number in place 1 of the profiles' names [1, 10] (1, 2)
    >>> for way in ways_to_compare(["P 2", "P 3", "P 4"], ["1", "2", "3"]):
    ...     print(*way)
    False number in place 1 of the profiles' names +1 [2, 3, 4] [2, 3, 4]

    Names are without folder and ending; they are no names if they are only numbers.
    Several numbers, as in 1.10, are compared as a whole too, or else the last of a
    label. Numbers are compared as they are, or shifted, where profiles count from 0 and
    poses from 1 or where both then have the same: in the way that fits all names, or in
    both.
    """
    stems = [*map(stem_of, names)]
    if not "".join(stems).isdigit():
        yield Way(True, "profiles' names", [*map(stem_of, labels)], stems)
    of_labels, of_names = [*map(numbers_in, labels)], [*map(numbers_in, names)]
    if max(map(len, of_labels)) > 1:
        yield Way(True, "numbers in the profiles' names", of_labels, of_names)
    last = [numbers[-1] if numbers else None for numbers in of_labels]
    for k, sought in enumerate(zip(*of_names, strict=False), 1):
        shift = (0 in sought) - (0 in last)
        if None not in last and len({*sought}) == len({*last}):
            shift = min(last) - min(sought)
        shifted = [one + shift for one in sought]
        what = f"number in place {k} of the profiles' names"
        fits, fits_shifted = ({*some} <= {*last} for some in (sought, shifted))
        if fits or not fits_shifted:
            yield Way(False, what, last, sought)
        if shift and not fits:
            yield Way(False, f"{what} {shift:+d}", last, shifted)


class Match(NamedTuple):
    """Which poses have the labels that profiles have, by one way to compare them."""

    way: Way
    title: str  # of the labels' column
    rows: ndarray  # of the poses; (P,) of each profile, -1: none
    share: float  # of the poses and of the profiles that it serves, the smaller one

    @property
    def how(self) -> str:
        """What is compared."""
        return f"by {self.title} and the {self.way.what}"


def paired_by_label(poses: Poses, names: Names) -> Pairing | None:
    """The pairing by the labels, and the names or numbers in them, that serve most
    poses, and more than half of them and of the profiles, or else all profiles.

    Raises ScanError where another column says otherwise of a profile, and where a label
    stands twice.
    """
    matches = []
    for title, labels in poses.labels.items():
        for way in ways_to_compare(labels, names):
            row_of = {key: row for row, key in enumerate(way.keys)}  # the last so
            rows = np.array([row_of.get(key, -1) for key in way.sought])
            served = {*rows} - {-1}
            share = min((rows >= 0).mean(), len(served) / len(row_of))
            has_all = len(served) == len(rows)  # a pose of its own for each profile
            if share > 0.5 or has_all:
                matches.append(Match(way, title, rows, share))
    if not matches:
        return None
    best = max(matches, key=lambda match: (match.way.is_whole, match.share))
    check_others(poses, names, best, matches)
    keys = best.way.keys
    is_again = Series(keys).duplicated().to_numpy()
    for name, row in zip(names, best.rows, strict=True):
        if row >= 0 and is_again[row]:
            one, other = poses.table.index[[keys.index(keys[row]), row]]
            raise ScanError(
                f"{poses.path} lines {one} and {other}: two poses of profile {name}; "
                "leave one out"
            )
    return pairing_of(poses, names, best.rows, best.how)


def check_others(poses: Poses, names: Names, best: Match, matches: list[Match]) -> None:
    """Raise ScanError where a match that is as good as the best, or of another column,
    in which a lost cell makes it serve fewer, has another pose for a profile.
    """
    for other in matches:
        differs = (np.minimum(other.rows, best.rows) >= 0) & (other.rows != best.rows)
        is_as_good = other.share == best.share or other.title != best.title
        is_as_good &= other.way.is_whole == best.way.is_whole
        if is_as_good and differs.any():
            name = names[differs.argmax()]
            raise ScanError(
                f"{poses.path}: which pose has {name}: {best.how} or {other.how}? "
                "Rename the profiles' files, or --pose-columns: _ for other columns"
            )


def stem_of(text: str) -> str:
    """A file's name without folder and ending, in small letters."""
    return re.sub(r".*[/\\]|\.[a-z]\w*$", "", text.lower())


def numbers_in(text: str) -> tuple:
    """All numbers in a name but those of a date and time."""
    return tuple(map(int, re.findall(r"\d+", STAMP.sub("", text))))


def time_in(text: str, unit_s: float) -> float:
    """The time that a text says, s, in this unit if by a bare number; or NaN.

    >>> [float(time_in(text, 1.0)) for text in ("31.12.1970 00:00:01", "00:00:01")]
    [31449601.0, nan]
    """
    if "." in text[:3]:  # 31.12.2026, German
        text = re.sub(r"^(\d\d)\.(\d\d)\.((?:19|20)\d\d)", r"\3-\2-\1", text)
    if match := STAMP.search(text):
        moment = "{}-{}-{}T{}:{}:{}".format(*match.groups())
        try:
            return np.datetime64(moment, "us").astype(float) / 1e6
        except ValueError:
            return np.nan
    if re.search(r"\d:\d|\d\.\d+\.\d", text):  # a clock's, or another date's
        return np.nan
    # seconds since 1970, or since anything
    match = re.search(r"\d{9,}(?:\.\d+)?|\d+\.\d+", text)
    value = round(cell_number(match[0] if match else text) * unit_s, 9)
    while 1e11 < value < np.inf:  # s until the year 5138, so these are ms, us or ns
        value /= 1000
    return value


def times_of(poses: Poses, names: Names, layout: Layout) -> Times | None:
    """The times of poses and profiles, if all have some, in the unit of the poses; in s
    if a user says them. Raises ScanError for numbers of an unknown unit.
    """
    columns = poses.having("time", "t")  # a t that is no angle of o, a, t
    if not columns:
        return None
    unit_s, cells = 1.0, poses.table[columns[0].at]
    if is_numeric_dtype(cells):
        units = {columns[0].unit} - {""}
        unit_s, _ = scale_of(poses.path, units, "s", TIME_UNITS)
    else:  # a day and a time of day may stand in two columns
        cells = poses.table[[c.at for c in columns]].astype(str).agg(" ".join, axis=1)
    if all(map(str.isdigit, names)) and int(names[-1]) <= len(names):
        return None  # 0 … n are no seconds
    of_names = 1.0 if layout.times else unit_s
    log = np.array([time_in(cell, unit_s) for cell in cells.astype(str)])
    profiles = np.array([time_in(name, of_names) for name in names])
    return Times(log, profiles) if np.isfinite([*log, *profiles]).all() else None


def paired_by_time(poses: Poses, names: Names, times: Times) -> Pairing | None:
    """The poses nearest in time, of a log only those where the robot stands still; or
    the log, where profiles were taken as the robot moved; None by another clock.
    """
    if len(times.log) < 2:
        return None
    order = np.argsort(times.log, kind="stable")
    t = times.log[order]
    step = np.median(np.diff(t))
    # moments of the log between which a profile was taken, and the one nearest to it
    after = np.clip(np.searchsorted(t, times.profiles), 1, len(t) - 1)
    nearest = np.searchsorted((t[1:] + t[:-1]) / 2, times.profiles)
    apart = np.abs(t[nearest] - times.profiles)
    is_near = apart <= step
    if is_near.mean() < 0.5:  # most are beside the log: by another clock
        return None
    still = np.full(len(nearest), True)
    for roles in (XYZ, poses.convention.columns):
        values = poses.numbers_of(roles)[order]
        steps = np.abs(values[after] - values[after - 1]).max(axis=1)
        still &= steps < STILL * np.abs(values).max()
    # most were taken on the way
    if step <= A_MOMENT_S and still[is_near].mean() < 0.5:
        every, way = np.arange(len(names)), times._replace(log=t)
        return Pairing(order, "by time, in motion", every, way)
    how = "by time"
    if len(t) > 2 * len(times.profiles):  # a log that goes on, no list of stops
        is_near, how = is_near & still, "by time, where the robot stands still"
    largest = apart[is_near].max(initial=0)
    found = np.where(is_near, order[nearest], -1)
    how = f"{how}, up to {largest:.2g} s apart"
    return pairing_of(poses, names, found, how)
