"""What a scan holds of measurements in motion: the robot's log, and when each profile
was taken by the scanner's clock.
"""

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.checks import check_array, check_positions, check_rotations
from profilecal.geometry.log import DELAY_S, Log
from profilecal.scan.toml import number

DELAY_MS = number(-1e3 * DELAY_S, 1e3 * DELAY_S)  # what a delay may be
SPEEDS = 1.0, 10_000.0  # mm/s, between which the fastest motion of a robot is


def checked_log(t: ArrayLike, R: ArrayLike, p: ArrayLike) -> Log:
    """A log of times (L,), s, and poses (L, 3, 3), (L, 3), mm. Raises ValueError."""
    times = check_array("log t", t, (None,))
    rotations = check_rotations("log R", R, len(times))
    log = Log(times, rotations, check_positions("log p", p, len(times)))
    if len(times) < 2:
        raise ValueError(f"log has {len(times)} rows; expected two or more")
    steps = np.diff(times)
    row = int(np.argmin(steps)) + 1
    if times[row] <= times[row - 1]:
        raise ValueError(
            f"log t is {times[row]:.12g} in row {row + 1}; "
            "expected later than in the row before"
        )
    low, high = SPEEDS
    fastest = (np.linalg.norm(np.diff(log.p, axis=0), axis=1) / steps).max()
    if not low <= fastest <= high:
        raise ValueError(
            f"log: the robot moves by {fastest:.3g} mm/s at most; "
            f"expected {low:g} to {high:g} mm/s somewhere: is t in seconds?"
        )
    return log


def check_times(log: Log, times: ndarray, labels: ndarray) -> None:
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
            f"by clocks that agree within {DELAY_S:g} s: subtract what they differ by"
        )


def moment_label(sweep: str, t: float) -> str:
    """The name of a profile that was taken in motion."""
    return f"{sweep}@{float(t)!r}"
