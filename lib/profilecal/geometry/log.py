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
    def ends(self) -> ndarray:
        """The first and the last rows (2, K) of pieces without a gap that have two or
        more.
        """
        steps = np.diff(self.t)
        cuts = np.flatnonzero(steps > GAP * np.median(steps)) + 1
        ends = np.array([np.r_[0, cuts], np.r_[cuts, len(self.t)] - 1])
        return ends[:, ends[0] < ends[1]]

    @cached_property
    def splines(self) -> tuple[CubicSpline, RotationSpline]:
        """Of the position and of the orientation: each piece's own, in one; what they
        say in gaps is of no use.
        """

        def through(rows: slice) -> tuple[CubicSpline, RotationSpline]:
            t, R = self.t[rows], Rotation.from_matrix(self.R[rows])
            return CubicSpline(t, self.p[rows]), RotationSpline(t, R)

        of_position, of_rotation = through(slice(None))
        for first, last in self.ends.T:
            p, R = through(slice(first, last + 1))
            of_position.c[:, first:last] = p.c
            of_rotation.interpolator.c[:, first:last] = R.interpolator.c
        return of_position, of_rotation

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
        first, last = self.t[self.ends]
        piece = np.searchsorted((last[:-1] + first[1:]) / 2, times)
        before = np.nextafter(last, first)[piece]  # from its last row on, a gap
        inside = np.clip(times, first[piece], before)
        beyond = (times - inside)[:, None]
        of_position, of_rotation = self.splines
        R = of_rotation(inside).as_matrix()
        v = of_position(inside, 1)
        # scipy's angular velocity is along the flange's axes
        w = np.matvec(R, of_rotation(inside, 1))
        p = of_position(inside) + v * beyond
        return rotations(w * beyond) @ R, p, np.hstack([v, w])
