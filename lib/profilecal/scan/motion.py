"""What a scan holds of measurements in motion: the robot's log, and when each profile
was taken by the scanner's clock.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.checks import check_array, check_positions, check_rotations
from profilecal.geometry.log import DELAY_S, Log
from profilecal.geometry.poses import rotation_groups

SPEEDS = 1.0, 10_000.0  # mm/s, between which the fastest motion of a robot is


def checked_log(t: ArrayLike, R: ArrayLike, p: ArrayLike) -> Log:
    """A log of times (L,), s, and poses (L, 3, 3), (L, 3), mm. Raises ValueError."""
    times = check_array("log t", t, (None,))
    rotations = check_rotations("log R", R, len(times))
    log = Log(times, rotations, check_positions("log p", p, len(times)))
    steps = np.diff(times)
    if len(times) < 2 or not (steps > 0).all():
        row = int(np.argmin(steps)) + 1 if len(times) > 1 else 0
        raise ValueError(
            f"log t does not increase in row {row + 1}; "
            "expected two rows or more, each later than the one before"
        )
    low, high = SPEEDS
    fastest = (np.linalg.norm(np.diff(log.p, axis=0), axis=1) / steps).max()
    if not low <= fastest <= high:
        raise ValueError(
            f"log: the robot moves by {fastest:.3g} mm/s at most; "
            f"expected {low:g} to {high:g} mm/s somewhere: is t in seconds?"
        )
    return log


def check_times(log: Log, times: ndarray, labels: Sequence[str]) -> None:
    """Refuse times (P,) at which the log has no pose. Raises ValueError."""
    moving = np.isfinite(times)
    if not moving.any():
        raise ValueError("a log without times; expected when each profile was taken")
    away = np.zeros(len(times))
    away[moving] = log.away(times[moving])
    worst = int(np.argmax(away))
    if away[worst] > max(DELAY_S, np.median(np.diff(log.t))):
        raise ValueError(
            f"profile {labels[worst]} is {away[worst]:.3g} s from the nearest row of "
            f"the log, which goes from {log.t[0]:g} to {log.t[-1]:g} s; expected times "
            "by clocks that agree within 0.2 s: subtract what they differ by"
        )


def moment_label(sweep: str, t: float) -> str:
    """The name of a profile that was taken in motion."""
    return f"{sweep}@{float(t)!r}"


def with_motion(
    log: Log,
    times: ArrayLike | None,
    sweeps: Sequence[str],
    at_rest: Mapping[str, Any],
) -> dict[str, Any]:
    """Entries of a Scan from when each of P profiles was taken (P,), NaN at rest, the
    names of their sweeps (P,), and the entries of those at rest, in their order.

    Profiles of one sweep are a group. Raises ValueError.
    """
    times = np.asarray(times, dtype=float)
    if times.shape != (len(sweeps),):
        raise ValueError(
            f"times has shape {times.shape} for {len(sweeps)} sweeps; expected a time "
            "and the name of a sweep for each profile"
        )
    still = np.flatnonzero(~np.isfinite(times))
    R, p = np.empty((len(times), 3, 3)), np.empty((len(times), 3))
    R[still], p[still] = at_rest["R_base_flange"], at_rest["p_base_flange"]
    group = np.asarray(at_rest["group"])
    if not group.size:
        group = rotation_groups(R[still])
    labels = [*map(moment_label, sweeps, times)]
    groups = [f"sweep {name}" for name in sweeps]
    for row, label, number in zip(still, at_rest["labels"], group, strict=True):
        labels[row], groups[row] = label, f"at rest {number}"
    return {
        "labels": tuple(labels),
        "R_base_flange": R,
        "p_base_flange": p,
        "group": np.unique(groups, return_inverse=True)[1],
        "log": log,
        "times": times,
        "sweeps": tuple(sweeps),
    }
