"""What the motions can and cannot determine, said in words.

The yardstick is a mount measured by hand, good to about 10 mm and 5°: it gives the
parameters one unit, so that millimetres and degrees compare, and it says what
"determined" means. A direction of the sensor pose is

- unobservable, where its standard deviation is no better than the measurement by hand,
  or where the information matrix
  has no rank there (an eigenvalue below 1e-10 of the largest), whatever the noise;
- weak, where it is no better than a tenth of that, 1 mm and 0.5°;
- ok otherwise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

WEAK = 0.1  # of the measurement by hand
LEAST_TURN_DEG = 1.0  # flange orientations that differ by less are taken for one
# of the measurement by hand, mm and rad
HAND_PRECISION = np.repeat([10.0, np.radians(5.0)], 3)


def units_by_hand(targets: Sequence) -> np.ndarray:
    """What one would know by hand of the sensor pose, then of each target's free shifts
    and turns, (n,) mm and rad.
    """
    mm, rad = HAND_PRECISION[0], HAND_PRECISION[3]
    return np.concatenate(
        [
            HAND_PRECISION,
            *([mm] * len(t.shifts) + [rad] * len(t.turns) for t in targets),
        ]
    )


@dataclass(frozen=True)
class Spectrum:
    """How well each direction of the sensor pose is known, worst first; leading axes
    are a batch.
    """

    # (..., 6, 6) of δ = (ρ, φ) in the sensor's frame, mm and rad
    covariance: np.ndarray
    sd: np.ndarray  # (..., 6) standard deviations over the measurement by hand
    # (..., 6, 6) rows: the directions in units of the measurement by hand, length one
    directions: np.ndarray
    rank: np.ndarray  # (...) of the whole information matrix
    parameters: int

    @property
    def status(self) -> np.ndarray:
        """ "ok", "weak" or "unobservable", (...)."""
        short = (self.rank < self.parameters) | ~(self.sd[..., 0] < 1)
        return np.where(
            short, "unobservable", np.where(self.sd[..., 0] < WEAK, "ok", "weak")
        )


def spectrum(information, units) -> Spectrum:
    """Of information matrices (..., n, n), the sensor pose first; `units` (n,) are
    known by hand, mm and rad.
    """
    A = information * units[:, None] * units
    values, vectors = np.linalg.eigh(A)
    largest = values[..., -1:]
    rank = (values > 1e-10 * largest).sum(axis=-1)
    inverse = 1 / np.maximum(values, 1e-14 * largest)
    pose = vectors[..., :6, :]
    C = (pose * inverse[..., None, :]) @ pose.mT
    return of_covariance(C * HAND_PRECISION[:, None] * HAND_PRECISION, rank, len(units))


def of_covariance(covariance, rank, parameters: int) -> Spectrum:
    """Of covariances (..., 6, 6) of the sensor pose, mm and rad, and the rank (...)
    behind them.
    """
    variance, axes = np.linalg.eigh(
        covariance / HAND_PRECISION[:, None] / HAND_PRECISION
    )
    sd, directions = np.sqrt(np.maximum(variance, 0))[..., ::-1], axes.mT[..., ::-1, :]
    return Spectrum(covariance, sd, directions, rank, parameters)


def turns(R_flange) -> tuple[np.ndarray, np.ndarray]:
    """How far flange orientations (P, 3, 3) turn from their mean: rms angles (3,) in
    degrees about three axes, largest first, and the first of these axes (3,), in the
    flange's frame.
    """
    rotations = Rotation.from_matrix(R_flange)
    turned = (rotations.mean().inv() * rotations).as_rotvec(degrees=True)
    _, square, axes = np.linalg.svd(turned.T @ turned / len(turned))
    return np.sqrt(square), axes[0]


def name_axis(vector, frame: str) -> str:
    """A direction as people say it: "the flange's z", or by its components."""
    vector = np.asarray(vector) / np.linalg.norm(vector)
    k = int(np.argmax(np.abs(vector)))
    if abs(vector[k]) >= np.cos(np.radians(15)):
        return f"the {frame}'s {'xyz'[k]}"
    vector = vector * np.sign(vector[k])
    return f"({', '.join(f'{c + 0.0:.2f}' for c in vector)}) in the {frame}'s frame"


def name_direction(direction, R_sensor, frame: str = "flange") -> str:
    """A direction (6,) of the sensor pose in units of the measurement by hand, in the
    frame that the pose is in.
    """
    words, parts = (
        ("translation along", "rotation about"),
        np.reshape(direction, (2, 3)),
    )
    return " with ".join(
        f"{words[k]} {name_axis(R_sensor @ parts[k], frame)}"
        for k in main_parts(direction)
    )


def size_direction(sd: float, direction) -> str:
    """The shift and the turn that a standard deviation along a direction (6,) consists
    of.
    """
    shift, turn = np.linalg.norm(
        np.reshape(sd * direction * HAND_PRECISION, (2, 3)), axis=1
    )
    parts = f"{shift:.2g} mm", f"{np.degrees(turn):.2g}°"
    return " with ".join(parts[k] for k in main_parts(direction))


def main_parts(direction) -> list[int]:
    """Shift (0), turn (1), or both, the larger first: those that matter in a direction
    (6,).
    """
    square = np.sum(np.reshape(direction, (2, 3)) ** 2, axis=1)
    return [k for k in np.argsort(-square) if square[k] > 0.2]


def explain(found: Spectrum, R_sensor, R_flange, frame: str = "flange") -> list[str]:
    """Sentences a person can act on, none where all is well. `R_flange` (P, 3, 3): the
    flange in the base, the other way round for a sensor pose in the `frame` "base".
    """
    if found.status == "ok":
        return []
    angles, axis = turns(R_flange)
    spread, about_others, main = (
        np.linalg.norm(angles),
        np.linalg.norm(angles[1:]),
        name_axis(axis, frame),
    )
    others = [c for c in "xyz" if not main.endswith(f"'s {c}")]
    other = " or ".join(others) if len(others) == 2 else "another axis"
    bad = int((found.sd >= (1 if found.status == "unobservable" else WEAK)).sum()) or 1
    if bad >= 3 and np.linalg.norm(found.directions[:3, 3:]) < 0.3:
        what = "translation in every direction"
    else:
        what = "; ".join(
            name_direction(v, R_sensor, frame) for v in found.directions[: min(bad, 3)]
        )
    sd = found.sd[0]
    left_open = found.rank < found.parameters or sd >= 10
    known = (
        "left open"
        if left_open
        else f"known only to {size_direction(sd, found.directions[0])}"
    )
    verb = (
        "cannot be determined"
        if found.status == "unobservable"
        else "is poorly determined"
    )
    if spread < LEAST_TURN_DEG:
        same = f"all flange orientations agree within {max(spread, 0.01):.2g}°"
        why = f"{same}; add poses tilted by 15° or more about two axes"
    elif about_others < LEAST_TURN_DEG:
        why = f"all rotations are about {main}; add a pose tilted about {other} by 15° or more"
    elif about_others < 10:
        why = (
            f"but for turns about {main}, the orientations differ by only {about_others:.2g}°; "
            f"tilt the flange about {other} by 15° or more"
        )
    else:
        why = "cross the target at other places and in other directions of motion, inside each group of poses too"
    return [f"{what} {verb} ({known}): {why}"]
