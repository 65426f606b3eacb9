"""The robot's log: where the flange was at any time, and how it moved."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from profilecal.geometry.poses import rotations

# times the usual time between rows: where more is missing, a log is cut
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
    def pieces(self) -> tuple[ndarray, CubicSpline, RotationSpline]:
        """The first and the last rows (2, K) of pieces without a gap that have two or
        more, and splines of the position and of the orientation: each piece's own, in
        one; what they say in gaps is of no use.
        """
        steps = np.diff(self.t)
        beside = np.pad(steps, 1, "edge")
        # usual is a step as most are or, where the rate changes, as one beside it
        usual = np.maximum(np.median(steps), np.minimum(beside[:-2], beside[2:]))
        near = steps <= GAP * usual
        # steps begin to be near at one row, and cease at another
        ends = np.diff(near, prepend=False, append=False).nonzero()[0].reshape(-1, 2)
        place, orientation = self._along(slice(None))
        for first, last in ends:
            own = self._along(slice(first, last + 1))
            place.c[:, first:last] = own[0].c
            orientation.interpolator.c[:, first:last] = own[1].interpolator.c
        return ends.T, place, orientation

    def _along(self, rows: slice) -> tuple[CubicSpline, RotationSpline]:
        """Through some rows alone."""
        t, R = self.t[rows], Rotation.from_matrix(self.R[rows])
        return CubicSpline(t, self.p[rows]), RotationSpline(t, R)

    def away(self, times: ndarray) -> ndarray:
        """How far times (P,) are from the nearest row of a piece, (P,) s."""
        t = np.concatenate(
            [self.t[first : last + 1] for first, last in self.pieces[0].T]
        )
        nearest = np.searchsorted((t[:-1] + t[1:]) / 2, times)
        return np.abs(times - t[nearest])

    def at(self, times: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """Where the flange is at times (P,): R (P, 3, 3), p (P, 3) mm, and its twist
        (P, 6), the velocity in mm/s and the angular velocity in rad/s, both along the
        base's axes.
        """
        ends, place, orientation = self.pieces
        first, last = self.t[ends]
        nearest = np.searchsorted((last[:-1] + first[1:]) / 2, times)
        # at the last row itself begins the gap
        last = np.nextafter(last, first)
        inside = np.clip(times, first[nearest], last[nearest])
        beyond = (times - inside)[:, None]
        turn = orientation(inside).as_matrix()
        velocity, spin = place(inside, 1), np.matvec(turn, orientation(inside, 1))
        p = place(inside) + beyond * velocity
        return rotations(beyond * spin) @ turn, p, np.hstack([velocity, spin])
