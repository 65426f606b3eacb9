"""A scan in memory, and the error that says what is wrong with one."""

from dataclasses import dataclass, field

import numpy as np

from profilecal.geometry.poses import inverse
from profilecal.targets import TARGETS
from profilecal.targets.target import Target


class ScanError(ValueError):
    """The folder's content is wrong; one sentence with the file, the row, the value and
    what was expected.
    """


@dataclass(frozen=True)
class Scan:
    """One scan: poses of the flange and what the scanner saw from each. Lengths in mm."""

    kind: str  # edge, disk, ball, plane or point
    labels: tuple[str, ...]  # (P,)
    R_base_flange: np.ndarray  # (P, 3, 3)
    T_base_flange: np.ndarray  # (P, 3)
    measured: str  # profiles, points, chords or arcs
    # (P,) of (rows, columns), empty where the scanner saw nothing
    values: tuple[np.ndarray, ...]
    sizes: tuple[float, ...] = ()  # the target's lengths
    side: np.ndarray | None = None  # (P,) +1, -1, or 0 where the program is to decide
    group: np.ndarray | None = None  # (P,) whole numbers from 0
    group_given: bool = False
    noise: dict[str, float] = field(default_factory=dict)
    mount: str = "eye-in-hand"
    title: str = ""
    convention: str = "quaternion"
    # (P, k) the convention's columns as they were read
    orientation: np.ndarray | None = None
    # of a simulated one; it is written, and not read
    truth: dict = field(default_factory=dict)

    @property
    def target(self) -> type[Target]:
        """The class of the target."""
        return TARGETS[self.kind]

    @property
    def measures(self) -> dict[str, float]:
        """The target's lengths by name, mm."""
        return dict(zip(self.target.lengths, self.sizes, strict=True))

    @property
    def description(self) -> str:
        """The target in words."""
        return ", ".join(
            [
                self.kind,
                *(f"{name} {value:g} mm" for name, value in self.measures.items()),
            ]
        )

    def base_flange(self, poses) -> tuple[np.ndarray, np.ndarray]:
        """Some poses (k,) as the calibration takes them: rotations (k, 3, 3),
        translations (k, 3) of the flange in the base frame; eye-to-hand, of the base in
        the flange frame.
        """
        R, T = self.R_base_flange[poses], self.T_base_flange[poses]
        return inverse(R, T) if self.mount == "eye-to-hand" else (R, T)
