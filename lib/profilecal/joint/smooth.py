"""Errors of a robot that vary smoothly with its pose: joints and lengths are wrong by
little, and no visit changes that.

The flange's error is taken for a linear function of where the flange is, seen from the
middle of all poses: a shift along the base's axes by the way; a shift and a turn about
the sensor's axes by the turn; 27 coefficients, as likely to be positive as negative.

Much of it no residual can show, whatever the target: a mount and a base that are a
little different move every profile nearly alike. What they take up is taken out of the
errors, by least squares over the poses as they move the middle of the view, so that the
mount of the linear model is the one that these poses show.

A wrist that turns over between two poses errs by a jump, which is none of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import Frames, inverse, nearest_rotation

# A way over which the errors change by as much as they are; over a radian they do too.
REACH_MM = 750.0
# A turn of the view counts as the way of a point so far from its middle.
VIEW_MM = 20.0
COEFFICIENTS = 27
# shifts (3, 3) of the ends of the three axes by turns
BY_AXES = np.cross(np.eye(3), np.eye(3)[:, None]).mT
# middle and steps of `SmoothErrors`
Known = Sequence[ArrayLike]


@dataclass(frozen=True)
class SmoothErrors:
    """Of P profiles, for one unit of the errors' size, what each coefficient does.

    Motions (6) are of the view: a shift of its middle, mm, and a turn, rad, about the
    sensor's axes.
    """

    rigid: ndarray  # (P, 6, 12) motions by steps of the sensor pose and of the base
    errors: ndarray  # (P, 6, 27) motions by each coefficient
    arms: ndarray  # (P, 3) from the flange to the middle, in the sensor's frame
    middle: Frames  # orientation (3, 3) and position (3,) that they are counted from
    # (12, 27) the steps of sensor pose and base that take up the most of the errors
    steps: ndarray

    count = COEFFICIENTS

    @property
    def known(self) -> Known:
        """What other poses need to know of these."""
        return *self.middle, self.steps

    def columns(self, by_flange: ndarray) -> ndarray:
        """By how much each coefficient moves rows (P, K, 27) that a motion of the
        flange moves by `by_flange` (P, K, 6), without what the steps take up.
        """
        by_view = by_flange @ shifting(-self.arms)
        return by_view @ self.errors - (by_view @ self.rigid) @ self.steps

    def keeping(self, kept: ndarray | slice) -> "SmoothErrors":
        """The same where only the profiles kept (P,) say what the steps are: those that
        take up the most of their errors, by least squares.
        """
        rigid, errors = self.rigid[kept], self.errors[kept]
        weighed = np.repeat([1.0, VIEW_MM**2], 3)[:, None] * rigid
        products = np.tensordot(weighed, rigid, ((0, 1), (0, 1)))
        across = np.tensordot(weighed, errors, ((0, 1), (0, 1)))
        units = np.diag(products)[:, None] ** -0.5
        inverse = np.linalg.pinv(units * products * units.T, 1e-12, hermitian=True)
        return replace(self, steps=units * (inverse @ (units * across)))


def smooth_errors(
    poses: Frames,
    sensor: Frames,
    seen: ndarray,
    ratio: float,
    to_hand: bool = False,
    known: Known | None = None,
) -> SmoothErrors:
    """Of `poses` of the flange (P, 3, 3), (P, 3), `to_hand` of the base in its frame,
    and a `sensor` pose (3, 3), (3,) that has the middle of its view at `seen` (3,).

    `ratio`: an error of the orientation, rad, to one of the position. `known`: middle
    and steps, if others say what they are.
    """
    R, T = poses
    R_sensor, T_sensor = sensor
    positions = inverse(R, T)[1] if to_hand else T
    if known:
        rotation, place, steps = map(np.asarray, known)
    else:
        rotation, place = nearest_rotation(R.mean(axis=0)), positions.mean(axis=0)
        steps = np.zeros((12, COEFFICIENTS))  # until they are found
    to_sensor = (R @ R_sensor).mT
    places = R @ (R_sensor @ seen + T_sensor) + T  # of the middle, in the base
    rigid = np.zeros((len(R), 6, 12))
    rigid[:, :, :6] = shifting(seen)
    rigid[:, :3, 6:9] = rigid[:, 3:, 9:] = to_sensor
    rigid[:, :3, 9:] = to_sensor @ shifts_by_turn(places)

    # to hand, the sensor's axes stand still in the base
    axes = np.eye(3)[None] if to_hand else to_sensor
    ways = (positions - place) / REACH_MM
    turns = Rotation.from_matrix(rotation.T @ R, assume_valid=True).as_rotvec()
    of_turn = np.eye(3)[..., None] * turns[:, None, None]
    of_flange = np.zeros((len(R), 2, 3, 3, 3, 3))
    of_flange[:, 0, :, 0] = axes[..., None] * ways[:, None, None]
    of_flange[:, 0, :, 1] = of_turn
    of_flange[:, 1, :, 2] = ratio * of_turn
    arms = (T_sensor - to_hand * positions) @ R_sensor + seen
    moved = shifting(arms) @ of_flange.reshape(-1, 6, COEFFICIENTS)
    errors = SmoothErrors(rigid, moved, arms, (rotation, place), steps)
    return errors if known else errors.keeping(slice(None))


def shifting(arms: ndarray) -> ndarray:
    """Motions (..., 6, 6) of the ends of arms (..., 3) by those of where they begin."""
    motions = np.zeros((*arms.shape[:-1], 6, 6))
    motions[..., range(6), range(6)] = 1.0
    motions[..., :3, 3:] = shifts_by_turn(arms)
    return motions


def shifts_by_turn(arms: ndarray) -> ndarray:
    """By how much a turn w shifts the ends of arms (..., 3), w × arm: (..., 3, 3)."""
    return np.tensordot(arms, BY_AXES, 1)
