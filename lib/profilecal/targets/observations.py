"""What the scanner saw of a target, from where the flange was."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.geometry.log import Log
from profilecal.geometry.poses import inverse
from profilecal.targets import TARGETS
from profilecal.targets.target import Target


@dataclass(frozen=True)
class Observations:
    """What the scanner saw of one target from P flange poses, in each of B problems.

    An array of what is the same in all problems may have the length 1 in place of B.
    """

    # of the target, one of TARGETS
    kind: str
    # (B|1, P, 3, 3) flange in the base frame; eye-to-hand: base in the flange frame
    R_flange: ndarray
    # (B|1, P, 3) mm
    T_flange: ndarray
    # (B|1, P, m, 2) x and z, m as the target's `points`; NaN where there is none
    points: ndarray
    # the target's, mm
    sizes: tuple[float, ...] = ()
    # (P,) poses of one flange orientation share a number
    group: ndarray | None = None
    eye_to_hand: bool = False
    # of what was seen from each pose, as a multiple of `Noise.profile_mm`²: (B|1, P, m)
    # of points' distances from a curve, else (B|1, P, 2m, 2m) of x and z of all points;
    # None: 1 for each coordinate, independent
    covariance: ndarray | None = None
    # of a ball: whether the three points of a pose stand for a fitted circle
    are_circles: bool = False
    # what was seen in motion: the robot's log, and when it was by the scanner's clock,
    # (B|1, P) s, NaN at rest
    log: Log | None = None
    times: ndarray | None = None
    # the robot's clock less the scanner's, at which the poses are, and whether it is so
    delay_s: float = 0.0
    delay_known: bool = False

    @property
    def target(self) -> type[Target]:
        """The class of the target."""
        return TARGETS[self.kind]

    @property
    def on_curve(self) -> bool:
        """Whether points lie anywhere on a curve, so that only their distance from it
        says something.
        """
        return self.target.points is None

    @property
    def arrays(self) -> dict[str, Any]:
        """What the first axis is a batch of."""
        names = ("R_flange", "T_flange", "points", "covariance", "times")
        own = vars(self)
        return {name: own[name] for name in names if own[name] is not None}

    @property
    def labels(self) -> ndarray:
        """Numbers from 0 (P,) that the poses of one rotation group share; without
        groups, each has its own.
        """
        if self.group is None:
            return np.arange(self.points.shape[1])
        return np.unique(self.group, return_inverse=True)[1]

    @property
    def moving(self) -> ndarray:
        """Which poses the flange went through without a stop, (B|1, P)."""
        if self.times is None:
            return np.zeros(self.points.shape[:2], bool)
        return np.isfinite(self.times)

    @property
    def twist(self) -> ndarray:
        """How the flange moves by itself, as seen from the target: its velocity, mm/s,
        and angular velocity, rad/s, along its own axes, (P, 6), of the first problem.

        Eye-to-hand, the "flange" is the base, and the target moves: it is the twist of
        the base as seen from the flange, at the flange's origin.
        """
        moving = self.moving[0]
        twist = np.zeros((len(moving), 2, 3))
        if self.log and self.times is not None:
            R, _, in_base = self.log.at(self.times[0, moving] + self.delay_s)
            parts = in_base.reshape(-1, 2, 3)
            twist[moving] = -parts if self.eye_to_hand else parts @ R
        return twist.reshape(-1, 6)

    def later(self, seconds: float) -> "Observations":
        """With the poses of what was seen in motion so much later in the log."""
        if self.log is None or self.times is None:
            return self
        delay_s, moving = self.delay_s + seconds, self.moving
        R, T = self.R_flange.copy(), self.T_flange.copy()
        there = self.log.at(self.times[moving] + delay_s)[:2]
        R[moving], T[moving] = inverse(*there) if self.eye_to_hand else there
        return replace(self, R_flange=R, T_flange=T, delay_s=delay_s)

    def keep(self, poses: Any) -> "Observations":
        """Only some poses, by mask or index."""
        kept = {name: array[:, poses] for name, array in self.arrays.items()}
        if self.group is not None:
            kept["group"] = self.group[poses]
        return replace(self, **kept)

    def take(self, chosen: Any) -> "Observations":
        """Some problems of a batch, by mask, index or slice."""
        taken = {
            name: array if len(array) == 1 else array[chosen]
            for name, array in self.arrays.items()
        }
        return replace(self, **taken)
