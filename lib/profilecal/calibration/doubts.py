"""What a scan gives cause to ask, which its residuals may not show."""

import numpy as np

from profilecal.geometry.observability import brief
from profilecal.scan.scan import Scan

# Poses in such a time, by a robot that is not so slow, are no stops.
A_MOMENT_S, AT_REST = 0.5, 1.0  # s, mm/s


def doubts(scan: Scan) -> list[str]:
    """All of them, in sentences."""
    return doubts_on_rest(scan) + doubts_on_columns(scan)


def doubts_on_rest(scan: Scan) -> list[str]:
    """That the poses were recorded in motion, as far as their times tell: between most
    of them, a moment apart, the robot moved.
    """
    if scan.log:
        return []
    order = np.argsort(scan.times)  # NaN last
    seconds = np.diff(scan.times[order])
    way = np.linalg.norm(np.diff(scan.p_base_flange[order], axis=0), axis=1)
    near = (seconds > 0) & (seconds < A_MOMENT_S)
    speeds = way[near] / seconds[near]
    if 2 * len(speeds) < len(order) or np.median(speeds) < AT_REST:
        return []
    speed = np.median(speeds)
    return [
        f"poses {np.median(seconds[near]):.2g} s apart, between which the robot moved "
        f"at {brief(speed)} mm/s: were they recorded in motion? Then clocks that "
        f"differ by 10 ms shift them by {brief(speed / 100)} mm, which these files do "
        "not show; write the robot's poses to log.csv, and sweep and t of each profile"
    ]


def doubts_on_columns(scan: Scan) -> list[str]:
    """That x and z of raw profiles are swapped: only z runs on along most of them."""
    if scan.measured != "profiles":
        return []
    runs_on = []
    for values in scan.values[:100]:
        steps = np.diff(values[np.isfinite(values).all(axis=1)], axis=0)
        if len(steps) > 9:
            runs_on.append((steps >= 0).all(axis=0) | (steps <= 0).all(axis=0))
    only_z = [z and not x for x, z in runs_on]
    if 2 * sum(only_z) <= len(only_z):
        return []
    return [
        "z, and not x, grows or falls all along most profiles, as x does along the "
        "laser line: are their columns swapped?"
    ]
