"""Which pose each profile was measured at: by label, by time, in order."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy import ndarray

from profilecal.calibration.observe import A_MOMENT_S
from profilecal.scan.tables import ScanError, number, some
from profilecal_tool.importing.poses import Poses

STAMP = re.compile(
    r"((?:19|20)\d\d)\D?([01]\d)\D?([0-3]\d)\D{0,2}"
    r"([0-2]\d)\D?([0-5]\d)\D?([0-5]\d)(?:[.,_](\d{1,6}))?"
)
SECONDS = re.compile(r"\d{9,}(?:\.\d+)?|\d+\.\d+")  # since 1970, or since anything
WHOLE = re.compile(r"(?<![\d.])\d+(?!\d*\.\d)")
UNITS_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Pairing:
    """A pose for each profile, or a log of a robot in motion."""

    rows: ndarray  # (P,) of the poses, -1: none; in motion all (L,), as time goes on
    how: str
    log: tuple[ndarray, ndarray] | None = None  # times (L,) of poses, (P,) of profiles


def paired(poses: Poses, names: Sequence[str]) -> Pairing:
    """The pose of each profile. Raises ScanError."""
    labels = [*map(str, poses.table.get("label", []))]
    found = by_label(labels, names) or by_time(poses, names)
    if not found and len(names) == len(poses.table):
        found = Pairing(np.arange(len(names)), "in order")
    if not found:
        raise ScanError(
            f"{poses.path}: {len(names)} profiles for {len(poses.table)} poses, and no "
            "label or time that both have; add a column, or say which files: "
            "--profiles, or when they were taken: --times"
        )
    if found.log:
        return found
    how, served = found.how, {*found.rows.tolist()}
    lost = [name for name, row in zip(names, found.rows, strict=True) if row < 0]
    idle = [label for row, label in enumerate(labels) if row not in served]
    for what, left in (("pose", lost), ("profile", idle)):
        how += f"; left out, without a {what}: {some(left)}" if left else ""
    return Pairing(found.rows, how)


def by_label(labels: Sequence[str], names: Sequence[str]) -> Pairing | None:
    """The pairing by whole names, or by the number in them that serves most poses."""
    plain = {re.sub(r"\.[a-z]\w*$", "", one.lower()): k for k, one in enumerate(labels)}
    found = {"names": [plain.get(name.lower(), -1) for name in names]}
    stems = [re.sub(r"\d+", "", label) for label in labels]
    usual = max({*stems}, key=stems.count, default="")  # a program may have a home, too
    numbers = {k: WHOLE.findall(label) for k, label in enumerate(labels)}
    own = {k: int(n[-1]) for k, n in numbers.items() if n and stems[k] == usual}
    row_of = {one: k for k, one in own.items()}
    fields = zip(*(WHOLE.findall(STAMP.sub("", name)) for name in names), strict=False)
    for k, field in enumerate(fields if len(row_of) == len(own) else [], 1):
        of_names = np.array(field, dtype=int)
        shift = (0 in of_names) - (0 in row_of)
        if {*of_names} <= row_of.keys() or not {*(of_names + shift)} <= row_of.keys():
            shift = 0
        how = f"number {k} in the names" + ", from 0 and from 1" * (shift != 0)
        found[how] = [row_of.get(one, -1) for one in (of_names + shift).tolist()]
    how = max(found, key=lambda how: len({*found[how]} - {-1}))
    rows = np.array(found[how])
    is_found = (rows >= 0).mean() >= 0.5 and len({*rows} - {-1}) * 2 > len(labels)
    return Pairing(rows, f"by the {how}") if is_found else None


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


def by_time(poses: Poses, names: Sequence[str]) -> Pairing | None:
    """The poses nearest in time, of a log only those where the robot stands still; or
    the log, where profiles were taken as the robot moved.
    """
    unit = UNITS_S.get(poses.units.get("time", ""), 1.0)
    own, of_names = (
        (np.array([seconds(str(cell)) for cell in cells]) * unit).round(9)
        for cells in (poses.table.get("time", []), names)
    )
    if len(own) < 2 or not np.isfinite([*own, *of_names]).all():
        return None
    order = np.argsort(own, kind="stable")
    t = own[order]
    after = np.clip(np.searchsorted(t, of_names), 1, len(t) - 1)
    apart = np.abs(t[[after - 1, after]] - of_names)
    rows = order[after - 1 + apart.argmin(axis=0)]
    step = np.median(np.diff(t))
    near = apart.min(axis=0) <= max(step, 0)
    still = stands_still(poses, order)[after - 1]
    if step <= A_MOMENT_S and near.mean() >= 0.5 > still[near].mean():
        return Pairing(order, "by time, in motion", (t, of_names))
    how = "by time"
    if len(t) > 2 * len(names):
        near, how = near & still, "by time, where the robot stands still"
    how += f", up to {apart.min(axis=0)[near].max(initial=0):.2g} s apart"
    return Pairing(np.where(near, rows, -1), how) if near.mean() >= 0.5 else None


def stands_still(poses: Poses, order: ndarray) -> ndarray:
    """Whether a robot is where it was a line before, for all lines of a log but the
    first: its numbers differ by less than 0.0001 of the largest.
    """
    still = np.full(len(order) - 1, True)
    for names in ("xyz", poses.convention.columns):
        values = poses.numbers(names)[order]
        steps = np.abs(np.diff(values, axis=0))
        steps = np.minimum(steps, np.abs(360 - steps))  # degrees begin again
        still &= (steps < 1e-4 * np.abs(values).max()).all(axis=1)
    return still
