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

from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import Frames, inverse, nearest_rotation

# A way over which the errors change by as much as they are; over a radian they do too.
REACH_MM = 750.0
# A turn of the view counts as the way of a point so far from its middle.
VIEW_MM = 20.0
COEFFICIENTS = 27
# middle and steps of `SmoothErrors`
Known = tuple[ndarray, ndarray, ndarray]


@dataclass(frozen=True)
class SmoothErrors:
    """Of P profiles, for one unit of the errors' size, what each coefficient does.

    Motions (6) are of the view: a shift of its middle, mm, and a turn, rad, about the
    sensor's axes.
    """

    errors: ndarray  # (P, 6, 27) motions by each coefficient
    rigid: ndarray  # (P, 6, 12) the same by steps of the sensor pose, and of the base
    to_flange: ndarray  # (P, 6, 6) errors of the flange that are these motions
    middle: Frames  # orientation (3, 3) and position (3,) that they are counted from
    # (12, 27) the steps that take up the most of the errors
    steps: ndarray

    count = COEFFICIENTS

    @property
    def known(self) -> Known:
        """What other poses need to know of these."""
        return *self.middle, self.steps

    @property
    def left(self) -> ndarray:
        """Errors (P, 6, 27) of the flange without what the steps take up."""
        return self.to_flange @ (self.errors - self.rigid @ self.steps)

    def keeping(self, kept: ndarray) -> "SmoothErrors":
        """The same where only the profiles kept (P,) say what the steps are."""
        return replace(self, steps=taken_up(self.rigid[kept], self.errors[kept]))


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
    middle, steps = (nearest_rotation(R.mean(axis=0)), positions.mean(axis=0)), None
    if known:
        *middle, steps = known
    turns = Rotation.from_matrix(middle[0].T @ R).as_rotvec()
    ways = (positions - middle[1]) / REACH_MM
    by_turn, by_way = (np.kron(np.eye(3), part[:, None]) for part in (turns, ways))
    to_sensor = np.kron(np.eye(2), (R @ R_sensor).mT)
    if not to_hand:  # else the sensor's axes stand still in the base
        by_way = to_sensor[:, :3, :3] @ by_way
    of_flange = np.zeros((len(R), 6, COEFFICIENTS))
    of_flange[:, :3, :9] = by_way
    of_flange[:, :3, 9:18] = by_turn
    of_flange[:, 3:, 18:] = ratio * by_turn

    by_base = to_sensor @ shifting(R @ (R_sensor @ seen + T_sensor) + T)
    by_mount = np.broadcast_to(shifting(seen[None]), by_base.shape)
    rigid = np.concatenate([by_mount, by_base], axis=2)
    # the middle of the view from the flange
    arms = (T_sensor - to_hand * positions) @ R_sensor + seen
    errors = shifting(arms) @ of_flange
    if steps is None:
        steps = taken_up(rigid, errors)
    return SmoothErrors(errors, rigid, shifting(-arms), middle, steps)


def taken_up(rigid: ndarray, errors: ndarray) -> ndarray:
    """The steps (12, 27) of mount and base that take up the most of errors."""
    weight = np.repeat([1.0, VIEW_MM], 3)[:, None]
    flat = [(weight * part).reshape(-1, part.shape[2]) for part in (rigid, errors)]
    return np.linalg.lstsq(*flat, rcond=1e-9)[0]


def shifting(arm: ndarray) -> ndarray:
    """Motions (P, 6, 6) of the ends of arms (P, 3) by those of where they begin."""
    motions = np.tile(np.eye(6), (len(arm), 1, 1))
    motions[:, :3, 3:] = np.cross(np.eye(3), arm[:, None]).mT
    return motions
