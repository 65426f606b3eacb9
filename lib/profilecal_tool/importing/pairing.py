"""Which pose each profile was measured at: by label, by time, in order."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy import ndarray

from profilecal.calibration.observe import A_MOMENT_S
from profilecal.scan.tables import ScanError, listed, number
from profilecal_tool.importing.poses import Poses

STAMP = re.compile(
    r"((?:19|20)\d\d)\D?([01]\d)\D?([0-3]\d)\D{0,2}"
    r"([0-2]\d)\D?([0-5]\d)\D?([0-5]\d)(?:[.,_](\d{1,6}))?"
)
SECONDS = re.compile(r"\d{9,}(?:\.\d+)?|\d+\.\d+")  # since 1970, or since anything
WHOLE = re.compile(r"(?<![\d.])\d+(?!\d*\.\d)")
UNITS_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STILL = 1e-4  # of the largest number: by so little a robot at rest differs


@dataclass(frozen=True)
class Pairing:
    """A pose for each profile, or a log of a robot in motion."""

    rows: ndarray  # (P,) of the poses, -1: none; in motion all (L,), as time goes on
    how: str
    log: tuple[ndarray, ndarray] | None = None  # times (L,) of poses, (P,) of profiles


def paired(poses: Poses, names: Sequence[str]) -> Pairing:
    """The pose of each profile. Raises ScanError."""
    labels = [*map(str, poses.table.get("label", []))]
    found = paired_by_label(labels, names) or paired_by_time(poses, names)
    if not found and len(names) == len(poses.table):
        found = Pairing(np.arange(len(names)), "in order")
    if not found:
        counts = f"{len(names)} profiles for {len(poses.table)} poses"
        sentence = f"{counts}, and no label or time that both have; add a column"
        hint = "or say which files: --profiles, or when they were taken: --times"
        raise ScanError(f"{poses.path}: {sentence}, {hint}")
    if found.log:
        return found
    how, served = found.how, {*found.rows.tolist()}
    lost = [name for name, row in zip(names, found.rows, strict=True) if row < 0]
    idle = [label for row, label in enumerate(labels) if row not in served]
    for what, left in (("pose", lost), ("profile", idle)):
        how += f"; left out, without a {what}: {listed(left)}" if left else ""
    return Pairing(found.rows, how)


def paired_by_label(labels: Sequence[str], names: Sequence[str]) -> Pairing | None:
    """The pairing by whole names, or by the number in them that serves most poses."""
    whole = {re.sub(r"\.[a-z]\w*$", "", one.lower()): k for k, one in enumerate(labels)}
    ways = {"names": [whole.get(name.lower(), -1) for name in names]}
    row_of = rows_by_number(labels)
    in_names = [WHOLE.findall(STAMP.sub("", name)) for name in names]
    for k, field in enumerate(zip(*in_names, strict=False), 1):
        numbers = {*map(int, field)}
        how, shift = f"number {k} in the names", (0 in numbers) - (0 in row_of)
        shifted = {one + shift for one in numbers}
        if shift and shifted <= row_of.keys() and not numbers <= row_of.keys():
            how += ", from 0 and from 1"
        else:
            shift = 0
        ways[how] = [row_of.get(int(one) + shift, -1) for one in field]
    served = {how: len({*rows} - {-1}) for how, rows in ways.items()}
    how = max(served, key=served.get)
    rows = np.array(ways[how])
    is_found = (rows >= 0).mean() >= 0.5 and served[how] * 2 > len(labels)
    return Pairing(rows, f"by the {how}") if is_found else None


def rows_by_number(labels: Sequence[str]) -> dict[int, int]:
    """The rows of labels by their last number, of those that are called alike: a
    program may have a home, too. None where a number comes twice.
    """
    stems = [re.sub(r"\d+", "", label) for label in labels]
    usual = max({*stems}, key=stems.count, default="")
    alike = [k for k, stem in enumerate(stems) if stem == usual]
    numbers = [(k, WHOLE.findall(labels[k])) for k in alike]
    pairs = [(int(found[-1]), k) for k, found in numbers if found]
    row_of = dict(pairs)
    return row_of if len(row_of) == len(pairs) else {}


def seconds(text: str) -> float:
    """The time that a text says, s; NaN if there is none."""
    if match := STAMP.search(text):
        *whole, part = match.groups()
        try:
            at = datetime(*map(int, whole), tzinfo=UTC).timestamp()
        except ValueError:
            return np.nan
        return at + float(f"0.{part or 0}")
    match = SECONDS.search(text)
    value = float(match[0]) if match else number(text)
    while 1e11 < value < np.inf:  # in ms, or less
        value /= 1000
    return value


def moments(cells: Iterable, unit: float) -> ndarray:
    """The times of cells in a unit, s."""
    return (np.array([seconds(str(cell)) for cell in cells]) * unit).round(9)


def paired_by_time(poses: Poses, names: Sequence[str]) -> Pairing | None:
    """The poses nearest in time, of a log only those where the robot stands still; or
    the log, where profiles were taken as the robot moved.
    """
    unit = UNITS_S.get(poses.units.get("time", ""), 1.0)
    t, times = (moments(cells, unit) for cells in (poses.table.get("time", []), names))
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
