"""Errors of a robot that vary smoothly with its pose: joints and lengths are wrong by
little, and no visit changes that.

The flange's error is taken for a linear function of the displacement d (3) and the turn
θ (3) of the flange from the middle of all poses. It is the sum of a shift A d along the
base's axes, a shift B θ along the sensor's axes, and a turn C θ, times the `ratio`,
about the sensor's axes. A, B and C are 3 × 3: these are 27 coefficients, as likely to
be positive as negative.

Much of this error no residual can show, whatever the target: a mount and a base that
are a little different move every profile nearly alike. `steps` are those of mount and
base that take up the most of the errors, by least squares over the poses as the errors
move the middle of the view. The steps are taken out of the errors, so that the mount of
the linear model is the one that these poses show.

Real errors bend. A joint errs about an axis v that itself turns with the pose: after a
turn θ, the flange has the axis at

    exp(-θ×) v = v - θ × v + θ × (θ × v) / 2 - ...

The first term is an error of mount or base, the second a smooth error; the third is
a smooth error times θ / 2. So each smooth error has three `bends`: itself times half of
each component of the turn. Ten orientations say little of so many bends; bends are not
estimated, but considered (`LinearModel.by_bends`).

A wrist that turns over between two poses errs by a jump, which is no smooth error.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import Frames, inverse, nearest_rotation
from profilecal.joint.nesting import parts_of

# The size of the errors is what they come to over a displacement so long, or a turn of
# a radian.
REACH_MM = 750.0
# A turn of the view counts as the shift of a point so far from the view's middle.
VIEW_MM = 20.0
COEFFICIENTS = 27
SIZE = 6 * (12 + COEFFICIENTS)  # numbers of the motions of a profile, without bends
# shifts of the ends of three arms along the axes, by turns about them: (arm, shift's
# axis and turn's axis), turn × arm
BY_AXES = np.cross(np.eye(3), np.eye(3)[:, None]).mT.reshape(3, 9)
# middle and steps of `SmoothErrors`
Known = Sequence[ArrayLike]


@dataclass(frozen=True)
class SmoothErrors:
    """What each coefficient does to P profiles, for one unit of the errors' size.

    Motions (6) are of the flange: a shift, mm, and a turn, rad, about the sensor's
    axes. Motions are made where they are needed, of some profiles at a time: those of
    60,000 profiles take 110 MB.
    """

    # (P, 3, 3), (P, 3) the flange in the base; to hand, the base in the flange's frame
    poses: Frames
    sensor: Frames  # (3, 3), (3,)
    seen: ndarray  # (3,) the middle of the sensor's view, in the sensor's frame
    ratio: float  # an error of the orientation, rad, to one of the position
    to_hand: bool
    middle: Frames  # the orientation (3, 3) and the position (3,) in the middle
    displacements: ndarray  # (P, 3) of the flange from the middle, over REACH_MM
    turns: ndarray  # (P, 3) of the flange from the middle, rad
    # (12, count) the steps of sensor pose and base that take up the most of the errors
    steps: ndarray
    # whether the coefficients are those of bends instead, 3 of each of the 27
    bends: bool = False

    @property
    def count(self) -> int:
        """How many coefficients there are."""
        return COEFFICIENTS * 3**self.bends

    @property
    def known(self) -> Known:
        """What smooth errors of other poses need to be the same errors."""
        return *self.middle, self.steps

    def columns(
        self, by_flange: ndarray, profiles: ndarray | slice = slice(None)
    ) -> ndarray:
        """By how much each coefficient moves rows (some, rows, count) of some profiles,
        without what the steps take up. Motions of the flange move these rows by
        `by_flange` (some, rows, 6).
        """
        columns = np.empty((*by_flange.shape[:2], self.count))
        numbers = np.arange(len(self.poses[0]))[profiles]
        for part in parts_of(len(columns), SIZE):
            rigid, errors = self.motions(numbers[part])
            by = by_flange[part]
            columns[part] = by @ errors - (by @ rigid) @ self.steps
        return columns

    def keeping(self, kept: ndarray) -> "SmoothErrors":
        """The same where only the profiles kept (P,) say what the steps are: those that
        take up the most of the errors, by least squares, as the errors move the view.

        The steps are found anew also where they were `known` (`smooth_errors`). Nobody
        keeps some profiles of these: a model of known steps has no smooth errors, but
        their columns among A's (`Problem.model`).
        """
        weights = np.repeat([1.0, VIEW_MM], 3)[:, None]
        products = np.zeros((12, 12 + self.count))
        numbers = np.flatnonzero(kept)
        for part in parts_of(len(numbers), SIZE):
            some = numbers[part]
            motions = np.concatenate(self.motions(some), axis=2)
            of_view = weights * shifting(self.arms(some) + self.seen) @ motions
            flat = of_view.reshape(-1, 12 + self.count)
            products += flat[:, :12].T @ flat
        rigid, across = products[:, :12], products[:, 12:]
        units = np.diag(rigid)[:, None] ** -0.5
        steps = np.linalg.lstsq(units * rigid * units.T, units * across, 1e-12)[0]
        return replace(self, steps=units * steps)

    def motions(self, some: ndarray) -> tuple[ndarray, ndarray]:
        """Of some profiles (some,), by number: motions (some, 6, 12) by steps of the
        sensor pose and of the base, and (some, 6, count) by each coefficient.
        """
        R, T = (array[some] for array in self.poses)
        to_sensor = (R @ self.sensor[0]).mT
        rigid = np.zeros((len(R), 6, 12))
        rigid[:, :, :6] = shifting(-self.arms(some))
        rigid[:, :3, 6:9] = rigid[:, 3:, 9:] = to_sensor
        if not self.to_hand:  # there the base turns about itself
            rigid[:, :3, 9:] = to_sensor @ shifts_by_turn(T)

        # along which axes (6, 3) the rows of A, B and C move the flange; to hand, the
        # sensor's axes stand still in the base
        axes = np.zeros((len(R), 6, 3, 3))
        axes[:, :3, 0] = np.eye(3) if self.to_hand else to_sensor
        axes[:, :3, 1] = np.eye(3)
        axes[:, 3:, 2] = self.ratio * np.eye(3)
        turns = self.turns[some]
        # what their columns multiply
        ways = np.stack([self.displacements[some], turns, turns], axis=1)
        errors = axes[..., None] * ways[:, None, :, None]
        errors = errors.reshape(-1, 6, COEFFICIENTS)
        if self.bends:
            bends = errors[:, :, None] * turns[:, None, :, None] / 2
            errors = bends.reshape(-1, 6, self.count)
        return rigid, errors

    def arms(self, some: ndarray) -> ndarray:
        """From flange to sensor, of some profiles, in the sensor's frame, (some|1,
        3).
        """
        R_sensor, arms = self.sensor
        if self.to_hand:
            R, T = (array[some] for array in self.poses)
            arms = arms - positions(R, T, to_hand=True)
        return np.atleast_2d(arms @ R_sensor)


def smooth_errors(
    poses: Frames,
    sensor: Frames,
    seen: ndarray,
    ratio: float,
    to_hand: bool = False,
    known: Known | None = None,
) -> SmoothErrors:
    """The smooth errors of `poses`, counted from their middle; the steps are found.
    `known`: middle and steps, if others say what they are.
    """
    R, T = poses
    places = positions(R, T, to_hand)
    rotation, place = nearest_rotation(R.mean(axis=0)), places.mean(axis=0)
    steps = np.zeros((12, COEFFICIENTS))  # until they are found
    if known:
        rotation, place, steps = map(np.asarray, known)
    displacements = (places - place) / REACH_MM
    turns = Rotation.from_matrix(rotation.T @ R, assume_valid=True).as_rotvec()
    counted = (rotation, place), displacements, turns, steps
    errors = SmoothErrors(poses, sensor, seen, ratio, to_hand, *counted)
    return errors if known else errors.keeping(np.ones(len(R), dtype=bool))


def positions(R: ndarray, T: ndarray, to_hand: bool) -> ndarray:
    """(P, 3) of the flange in the base, of poses of `SmoothErrors`."""
    return inverse(R, T)[1] if to_hand else T


def shifting(arms: ndarray) -> ndarray:
    """Motions (..., 6, 6) of the ends of arms (..., 3) by those of where they begin."""
    motions = np.zeros((*arms.shape[:-1], 6, 6))
    motions[:] = np.eye(6)
    motions[..., :3, 3:] = shifts_by_turn(arms)
    return motions


def shifts_by_turn(arms: ndarray) -> ndarray:
    """By how much a turn w shifts the ends of arms (..., 3), w × arm: (..., 3, 3)."""
    return (arms @ BY_AXES).reshape(*arms.shape, 3)
