"""A scan in memory, and the error that says what is wrong with one."""

from dataclasses import dataclass, field

import numpy as np


class ScanError(ValueError):
    """The folder's content is wrong; one sentence with the file, the row, the value and what was expected."""


@dataclass(frozen=True)
class Scan:
    """One scan: poses of the flange and what the scanner saw from each. Lengths in mm."""

    kind: str  # edge, disk, ball, plane or point
    labels: tuple[str, ...]  # (P,)
    R_base_flange: np.ndarray  # (P, 3, 3)
    T_base_flange: np.ndarray  # (P, 3)
    measured: str  # profiles, points, chords or arcs
    values: tuple[np.ndarray, ...]  # (P,) of (rows, columns), empty where the scanner saw nothing
    radius: float | None = None
    side: np.ndarray | None = None  # (P,) +1, -1, or 0 where the program is to decide
    group: np.ndarray | None = None  # (P,) whole numbers from 0
    group_given: bool = False
    noise: dict[str, float] = field(default_factory=dict)
    mount: str = "eye-in-hand"
    title: str = ""
    convention: str = "quaternion"
    truth: dict = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
