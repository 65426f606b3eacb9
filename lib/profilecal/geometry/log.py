"""The robot's log: where the flange was at any time, and how it moved."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from profilecal.geometry.poses import rotations

# times the usual time between rows: a log is cut where more is missing
GAP = 5.0
# about so much, in seconds, the clocks of a robot and a scanner may differ
DELAY_S = 0.2


@dataclass(frozen=True, eq=False)
class Log:
    """Poses of the flange in the base frame that the robot recorded on its way.

    Between them the flange follows cubic splines of its position and its orientation;
    beyond their ends, and in gaps, it goes on as it went. A straight line serves where
    only two rows are to be had.
    """

    t: ndarray  # (L,) s by the robot's clock, increasing
    R: ndarray  # (L, 3, 3)
    p: ndarray  # (L, 3) mm

    @cached_property
    def pieces(self) -> list[ndarray]:
        """The rows of each piece without a gap that has two or more."""
        steps = np.diff(self.t)
        cuts = np.flatnonzero(steps > GAP * np.median(steps)) + 1
        pieces = np.split(np.arange(len(self.t)), cuts)
        return [rows for rows in pieces if len(rows) > 1]

    @cached_property
    def splines(self) -> list[tuple[CubicSpline, RotationSpline]]:
        """Of the position and of the orientation, for each piece."""
        return [
            (
                CubicSpline(self.t[rows], self.p[rows]),
                RotationSpline(self.t[rows], Rotation.from_matrix(self.R[rows])),
            )
            for rows in self.pieces
        ]

    def away(self, times: ndarray) -> ndarray:
        """How far times (P,) are from the nearest row, (P,) s."""
        after = np.searchsorted(self.t, times).clip(1, len(self.t) - 1)
        near = self.t[[after - 1, after]]
        return np.abs(near - times).min(axis=0)

    def at(self, times: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """Where the flange is at times (P,): R (P, 3, 3), p (P, 3) mm, and its twist
        (P, 6), the velocity in mm/s and the angular velocity in rad/s, both along the
        base's axes.
        """
        R = np.empty((len(times), 3, 3))
        p = np.empty((len(times), 3))
        twist = np.empty((len(times), 6))
        ends = self.t[[rows[[0, -1]] for rows in self.pieces]]
        middles = (ends[:-1, 1] + ends[1:, 0]) / 2
        piece = np.searchsorted(middles, times)
        for k in np.unique(piece):
            own = piece == k
            inside = np.clip(times[own], *ends[k])
            beyond = (times[own] - inside)[:, None]
            of_position, of_rotation = self.splines[k]
            R_inside = of_rotation(inside).as_matrix()
            v = of_position(inside, 1)
            # scipy's angular velocity is along the flange's axes
            w = (R_inside @ of_rotation(inside, 1)[..., None])[..., 0]
            R[own] = rotations(w * beyond) @ R_inside
            p[own] = of_position(inside) + v * beyond
            twist[own] = np.hstack([v, w])
        return R, p, twist
