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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

WEAK = 0.1  # of the measurement by hand
LEAST_TURN_DEG = 1.0  # flange orientations that differ by less are taken for one
HAND_PRECISION = np.repeat([10.0, np.radians(5.0)], 3)  # mm and rad


def units_by_hand(targets: Sequence) -> ndarray:
    """What one would know by hand of the sensor pose, then of each target's free shifts
    and turns, (n,) mm and rad.
    """
    by_hand = HAND_PRECISION[[0, 3]]
    of_targets = [np.repeat(by_hand, [len(t.shifts), len(t.turns)]) for t in targets]
    return np.concatenate([HAND_PRECISION, *of_targets])


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
    rank: ndarray | int  # (...) of the whole information matrix
    parameters: int

    @property
    def status(self) -> ndarray:
        """ "ok", "weak" or "unobservable", (...)."""
        worst = self.sd[..., 0]
        unobservable = (self.rank < self.parameters) | ~(worst < 1)
        known = np.where(worst < WEAK, "ok", "weak")
        return np.where(unobservable, "unobservable", known)


def spectrum(information: ndarray, units: ndarray) -> Spectrum:
    """Of information matrices (..., n, n), the sensor pose first; `units` (n,) are
    known by hand, mm and rad.
    """
    in_units = information * units[:, None] * units
    values, vectors = np.linalg.eigh(in_units)
    largest = values[..., -1:]
    rank = (values > 1e-10 * largest).sum(axis=-1)
    variances = 1 / np.maximum(values, 1e-14 * largest)
    pose = HAND_PRECISION[:, None] * vectors[..., :6, :]
    covariance = (pose * variances[..., None, :]) @ pose.mT
    return of_covariance(covariance, rank, len(units))


def of_covariance(
    covariance: ndarray, rank: ndarray | int = 6, parameters: int = 6
) -> Spectrum:
    """Of covariances (..., 6, 6) of the sensor pose, mm and rad, and the rank (...)
    behind them.
    """
    in_units = covariance / HAND_PRECISION[:, None] / HAND_PRECISION
    variances, axes = np.linalg.eigh(in_units)
    sd = np.sqrt(np.maximum(variances, 0))[..., ::-1]
    directions = axes.mT[..., ::-1, :]
    return Spectrum(covariance, sd, directions, rank, parameters)


def turns(R_flange: ndarray) -> tuple[ndarray, ndarray]:
    """How far flange orientations (P, 3, 3) turn from their mean.

    Root mean square angles (3,) in degrees about three axes, largest first, and the
    first of these axes (3,), in the flange's frame.
    """
    rotations = Rotation.from_matrix(R_flange)
    turned = (rotations.mean().inv() * rotations).as_rotvec(degrees=True)
    _, squares, axes = np.linalg.svd(turned.T @ turned / len(turned))
    return np.sqrt(squares), axes[0]


def name_axis(vector: ArrayLike, frame: str) -> str:
    """A direction as people say it: "the flange's z", or by its components."""
    unit = np.asarray(vector) / np.linalg.norm(vector)
    k = int(np.argmax(np.abs(unit)))
    if abs(unit[k]) >= np.cos(np.radians(15)):
        return f"the {frame}'s {'xyz'[k]}"
    unit = unit * np.sign(unit[k])
    components = ", ".join(f"{component + 0.0:.2f}" for component in unit)
    return f"({components}) in the {frame}'s frame"


def name_direction(
    direction: ArrayLike,
    R_sensor: ndarray,
    frame: str,
) -> str:
    """A direction (6,) of the sensor pose in units of the measurement by hand, in the
    frame that the pose is in.
    """
    words = "translation along", "rotation about"
    vectors = np.reshape(direction, (2, 3))
    return " with ".join(
        f"{words[k]} {name_axis(R_sensor @ vectors[k], frame)}"
        for k in main_parts(direction)
    )


def brief(value: float) -> str:
    """Two digits, or a whole number; never 1e+02."""
    return f"{value:#.2g}".rstrip(".") if abs(value) < 99.5 else f"{value:.0f}"


def shift_and_turn(mm_deg: Iterable[float], between: str = "and") -> str:
    """Three shifts and three turns (6,) in words, "open" for NaN."""
    words = ["open" if np.isnan(value) else brief(value) for value in mm_deg]
    return f"{'  '.join(words[:3])} mm along {between} {'  '.join(words[3:])}°"


def size_direction(sd: float, direction: ndarray) -> str:
    """The shift and the turn that a standard deviation along a direction (6,) consists
    of.
    """
    vectors = np.reshape(sd * direction * HAND_PRECISION, (2, 3))
    shift, turn = np.linalg.norm(vectors, axis=1)
    sizes = f"{brief(shift)} mm", f"{brief(np.degrees(turn))}°"
    return " with ".join(sizes[k] for k in main_parts(direction))


def main_parts(direction: ArrayLike) -> list[int]:
    """Shift (0), turn (1), or both, the larger first: those that matter in a direction
    (6,).
    """
    squares = np.sum(np.reshape(direction, (2, 3)) ** 2, axis=1)
    return [k for k in np.argsort(-squares) if squares[k] > 0.2]


def explain(
    found: Spectrum, R_sensor: ndarray, R_flange: ndarray, frame: str
) -> list[str]:
    """Sentences a person can act on, none where all is well.

    `R_flange` (P, 3, 3): the flange in the base, the other way round for a sensor pose
    in the `frame` "base".
    """
    if found.status == "ok":
        return []
    # the directions, up to three, that are as bad as the status says
    limit = 1 if found.status == "unobservable" else WEAK
    count = int((found.sd >= limit).sum()) or 1
    if count >= 3 and np.linalg.norm(found.directions[:3, 3:]) < 0.3:
        what = "translation in every direction"
    else:
        worst = found.directions[: min(count, 3)]
        what = "; ".join(name_direction(v, R_sensor, frame) for v in worst)
    why = why_open(R_flange, frame)
    if found.rank < found.parameters or found.sd[0] >= 10:
        known = "left open"
    else:
        size = size_direction(found.sd[0], found.directions[0])
        known = f"known only to {size}"
    verbs = {"unobservable": "cannot be determined", "weak": "is poorly determined"}
    return [f"{what} {verbs[str(found.status)]} ({known}): {why}"]


def why_open(R_flange: ndarray, frame: str) -> str:
    """What the flange's orientations (P, 3, 3) lack, and what to add."""
    angles, axis = turns(R_flange)
    main = name_axis(axis, frame)
    others = [c for c in "xyz" if not main.endswith(f"'s {c}")]
    if len(others) == 3:
        others = ["xyz"[np.argmin(np.abs(axis).round(1))]]
    whose = "its" if frame == "flange" else f"the {frame}'s"
    other = f"{whose} {' or '.join(others)}"
    spread = np.linalg.norm(angles)
    about_others = np.linalg.norm(angles[1:])
    if spread < LEAST_TURN_DEG:
        return (
            f"all flange orientations agree within {max(spread, 0.01):.2g}°; "
            "add poses tilted by 15° or more about two axes"
        )
    if about_others < LEAST_TURN_DEG:
        return (
            f"all rotations are about {main}; "
            f"tilt the flange about {other} by 15° or more in some poses"
        )
    if about_others < 10:
        return (
            f"but for turns about {main}, the orientations differ by only "
            f"{about_others:.2g}°; tilt the flange about {other} by 15° or more "
            "in some poses"
        )
    return (
        "cross the target at other places and in other directions of motion, "
        "inside each group of poses too"
    )
