"""What the motions can and cannot determine, said in words.

The yardstick is a mount measured by hand, good to about 10 mm and 5°: it gives the
parameters one unit, so that millimetres and degrees compare, and it says what
"determined" means. A direction of the sensor pose is

- unobservable, where its standard deviation is no better than the measurement by hand,
  or where the information matrix has no rank there (an eigenvalue below 1e-10 of the
  largest), whatever the noise;
- weak, where it is no better than a tenth of that, 1 mm and 0.5°;
- ok otherwise.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from profilecal.geometry.fitting import with_sign
from profilecal.geometry.poses import unit

WEAK = 0.1  # of the measurement by hand
LEAST_TURN_DEG = 1.0  # flange orientations that differ by less are taken for one
HAND_PRECISION = np.repeat([10.0, np.radians(5.0)], 3)  # mm and rad
NO_RANK = 1e-10  # of the largest eigenvalue of the information
MOVES = 1e-4  # the sensor's part of a direction of length one: less is rounding
OPEN = 10.0  # of the measurement by hand: a size that is no longer told
ENOUGH_TURN_DEG = 10.0  # about the axes beside the main one
ALONG = np.cos(np.radians(15))  # of a unit vector along an axis
MATTERS = 0.2  # of the square of a direction: a part that is told
# the turns of three directions together: where they are less, all three are shifts,
# to about 10°
LITTLE_TURN = 0.3


@dataclass(frozen=True)
class Spectrum:
    """How well each direction of the sensor pose is known, worst first; leading axes
    are a batch.
    """

    # (..., 6, 6) of δ = (ρ, φ) in the sensor's frame, mm and rad
    covariance: ndarray
    sd: ndarray  # (..., 6) standard deviations over the measurement by hand
    # (..., 6, 6) rows: the directions in units of the measurement by hand, length one
    directions: ndarray
    # (...) whether a direction without rank moves the sensor
    is_open: ndarray | bool

    @property
    def status(self) -> ndarray:
        """ "ok", "weak" or "unobservable", (...)."""
        worst = self.sd[..., 0]
        known = np.where(worst < WEAK, "ok", "weak")
        return np.where(~(worst < 1) | self.is_open, "unobservable", known)


def spectrum(information: ndarray, units: ndarray) -> Spectrum:
    """Of information matrices (..., n, n), the sensor pose first. `units` (n,): the sd
    of each parameter if it is measured by hand, mm and rad.
    """
    values, vectors = np.linalg.eigh(units[:, None] * information * units)
    largest, parts = values[..., -1:], vectors[..., :6, :]
    moves = np.linalg.norm(parts, axis=-2) > MOVES
    is_open = (moves & (values <= NO_RANK * largest)).any(axis=-1)
    pose = units[:6, None] * parts
    # smaller eigenvalues are rounding
    variances = 1 / np.maximum(values, 1e-14 * largest)
    covariance = (pose * variances[..., None, :]) @ pose.mT
    return of_covariance(covariance, is_open)


def of_covariance(covariance: ndarray, is_open: ndarray | bool = False) -> Spectrum:
    """Of covariances (..., 6, 6) of the sensor pose, mm and rad, some of which are
    known to say too little (...).
    """
    in_units = covariance / HAND_PRECISION[:, None] / HAND_PRECISION
    variances, vectors = np.linalg.eigh(in_units)
    sd = np.sqrt(np.maximum(variances[..., ::-1], 0))
    return Spectrum(covariance, sd, vectors.mT[..., ::-1, :], is_open)


def turns(R_flange: ndarray) -> tuple[ndarray, ndarray]:
    """How far flange orientations (P, 3, 3) turn from their mean.

    Root mean square angles (3,) in degrees about three axes, largest first, and the
    first of these axes (3,), in the flange's frame.
    """
    R = Rotation.from_matrix(R_flange)
    off = (R.mean().inv() * R).as_rotvec(degrees=True)
    _, squares, axes = np.linalg.svd(off.T @ off / len(off))
    return np.sqrt(squares), axes[0]


def axis_along(axis: ndarray) -> str:
    """The axis of its frame, "x", "y" or "z", that a unit vector is along; "" for
    none.
    """
    k = np.abs(axis).argmax()
    return "xyz"[k] if abs(axis[k]) >= ALONG else ""


def name_axis(vector: ArrayLike, frame: str) -> str:
    """A direction as people say it: "the flange's z", or by its components."""
    axis = unit(np.asarray(vector))
    if one := axis_along(axis):
        return f"the {frame}'s {one}"
    # a sum with zero is never -0
    components = ", ".join(f"{c:.2f}" for c in with_sign(axis) + 0.0)
    return f"({components}) in the {frame}'s frame"


def of_main_parts(direction: ArrayLike, *words: str) -> str:
    """Words on the shift, on the turn, or on both, the larger first: on those that
    matter in a direction (6,).
    """
    squares = np.square(direction).reshape(2, 3).sum(axis=1)
    return " with ".join(words[k] for k in (-squares).argsort() if squares[k] > MATTERS)


def name_direction(
    direction: ArrayLike,
    R_sensor: ndarray,
    frame: str,
) -> str:
    """A direction (6,) of the sensor pose in units of the measurement by hand, in the
    frame that the pose is in.
    """
    parts = np.reshape(direction, (2, 3)) @ R_sensor.T
    along, about = (name_axis(part, frame) for part in parts)
    return of_main_parts(
        direction, f"translation along {along}", f"rotation about {about}"
    )


def brief(value: float) -> str:
    """Two digits, or a whole number; never 1e+02."""
    return f"{value:#.2g}".rstrip(".") if abs(value) < 99.5 else f"{value:.0f}"


def shift_and_turn(mm_deg: Iterable[float], between: str = "and") -> str:
    """Three shifts and three turns (6,) in words, "open" for NaN."""
    words = ["open" if np.isnan(size) else brief(size) for size in mm_deg]
    return f"{'  '.join(words[:3])} mm along {between} {'  '.join(words[3:])}°"


def how_far(delta: ndarray) -> tuple[str, str]:
    """The shift and the turn of δ (6,), mm and rad, in words."""
    shift, turn = np.linalg.norm(delta.reshape(2, 3), axis=1)
    return f"{brief(shift)} mm", f"{brief(np.degrees(turn))}°"


def size_direction(sd: float, direction: ndarray) -> str:
    """The shift and the turn that a standard deviation along a direction (6,) consists
    of.
    """
    return of_main_parts(direction, *how_far(sd * HAND_PRECISION * direction))


def why_open(R_flange: ndarray, frame: str) -> str:
    """What the flange's orientations (P, 3, 3) lack, and what to add."""
    angles, axis = turns(R_flange)
    spread, about_others = np.linalg.norm(angles), np.linalg.norm(angles[1:])
    if spread < LEAST_TURN_DEG:
        return (
            f"all flange orientations differ by only {max(spread, 0.01):.2g}°; "
            "add poses tilted by 15° or more about two axes"
        )
    if not about_others < ENOUGH_TURN_DEG:
        return (
            "cross the target at other places and in other directions of motion, "
            "inside each group of poses too"
        )
    main, one = name_axis(axis, frame), axis_along(axis)
    # both others of an axis of the frame, or the one that is most nearly square to it;
    # rounded, so that no last digit decides
    others = "xyz"[np.abs(axis).round(1).argmin()]
    if one:
        others = " or ".join("xyz".replace(one, ""))
    other = f"its {others}" if frame == "flange" else f"the {frame}'s {others}"
    only = f"all rotations are about {main}"
    if about_others >= LEAST_TURN_DEG:
        differ = f"the orientations differ by only {about_others:.2g}°"
        only = f"but for turns about {main}, {differ}"
    return f"{only}; tilt the flange about {other} by 15° or more in some poses"


def explain(
    found: Spectrum, R_sensor: ndarray, R_flange: ndarray, frame: str
) -> list[str]:
    """Sentences a person can act on, none where all is well.

    `R_flange` (P, 3, 3): the flange in the base, the other way round for a sensor pose
    in the `frame` "base".
    """
    status, worst = found.status, found.sd[0]
    if status == "ok":
        return []
    least, verb = 1.0, "cannot be determined"
    if status == "weak":
        least, verb = WEAK, "is poorly determined"
    unknown = found.directions[:3][: max(1, (found.sd >= least).sum())]
    what = "; ".join(name_direction(one, R_sensor, frame) for one in unknown)
    # they are square to each other
    if len(unknown) == 3 and np.linalg.norm(unknown[:, 3:]) < LITTLE_TURN:
        what = "translation in every direction"
    known = f"known only to {size_direction(worst, unknown[0])}"
    if found.is_open or worst >= OPEN:
        known = "left open"
    return [f"{what} {verb} ({known}): {why_open(R_flange, frame)}"]
