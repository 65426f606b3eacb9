"""What the disk and ball methods share: rotation from vector pairs, translation from
one fixed point.

Symbols as in the disk paper (Chen et al. 2018): R_tcp, T_tcp are the flange pose in the
base frame, q the fixed point in the sensor frame, R_sensor and T_sensor the sensor pose
on the flange.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import UnobservableError, check_count
from profilecal.geometry.observability import HAND_PRECISION, LEAST_TURN_DEG, turns
from profilecal.geometry.poses import carry, homogeneous, nearest_rotation


@dataclass(frozen=True, repr=False)
class TwoStepSolution:
    """The sensor pose on the flange: rotation first, then translation."""

    rotation: Any  # of the disk and the ball a `RotationSolution`
    translation: Any  # likewise a `TranslationSolution`

    @property
    def R_sensor(self) -> ndarray:
        """(..., 3, 3) from sensor to flange."""
        return self.rotation.R_sensor

    @property
    def T_sensor(self) -> ndarray:
        """(..., 3) mm, the sensor's origin in the flange frame."""
        return self.translation.T_sensor

    @property
    def pose(self) -> ndarray:
        """(..., 4, 4) from sensor to flange, mm."""
        return homogeneous(self.R_sensor, self.T_sensor)

    def __repr__(self) -> str:
        with np.printoptions(precision=6, suppress=True, threshold=9, edgeitems=2):
            return f"{type(self).__name__}(\n{self.R_sensor},\n{self.T_sensor})"


@dataclass(frozen=True)
class RotationSolution:
    """R_sensor X = Y solved on SO(3): Eqs 14-16 and 44-45 of the disk paper."""

    X: ndarray  # (..., 3, n) vectors in the sensor frame
    Y: ndarray  # (..., 3, n) the same vectors in the flange frame
    R_sensor: ndarray  # (..., 3, 3)


@dataclass(frozen=True)
class TranslationSolution:
    """T_sensor in the least-squares sense, and how well the fixed point is met: Eqs
    17-20, Section III-D.
    """

    T_sensor: ndarray  # (..., 3) mm
    # (..., n, 3) the fixed point in the base frame, from each pose, mm
    q_b_i: ndarray
    q_b: ndarray  # (..., 3) their mean, Eq. 20
    accuracy: ndarray  # (...) largest distance from the mean, mm


def solve_rotation(X: ndarray, Y: ndarray) -> RotationSolution:
    """R_sensor X = Y for vectors (..., 3, n): Eq. 16, kept from being a reflection."""
    return RotationSolution(X, Y, nearest_rotation(Y @ X.mT))


def solve_translation(
    R_tcp: ndarray, T_tcp: ndarray, q: ndarray, R_sensor: ndarray
) -> TranslationSolution:
    """T_sensor from poses R_tcp (..., n, 3, 3), T_tcp (..., n, 3) mm and one fixed
    point, which each sees at q (..., n, 3) mm: Eqs 17-20 of the disk paper.

    The point is R_tcp (R_sensor q + T_sensor) + T_tcp in the base frame (Eq. 1), the
    same from all poses. The difference of poses i and i + 1 is linear in T_sensor,

        (R_i - R_i+1) T_sensor
            = (R_i+1 R_sensor q_i+1 + T_i+1) - (R_i R_sensor q_i + T_i),

    and all differences are stacked to M T_sensor = N (Eqs 17 and 18). Eq. 19 is solved
    by an orthogonal factorisation, not by the normal equations, which square the
    condition number.
    """
    turned = carry(R_tcp, T_tcp, q @ R_sensor.mT)
    M = -np.diff(R_tcp, axis=-3)
    M = M.reshape(*M.shape[:-3], -1, 3)
    N = np.diff(turned, axis=-2)
    N = N.reshape(*N.shape[:-2], -1)
    T_sensor = np.matvec(np.linalg.pinv(M), N)
    q_b_i = carry(R_tcp, turned, T_sensor[..., None, :])
    q_b = q_b_i.mean(axis=-2)
    accuracy = np.linalg.norm(q_b_i - q_b[..., None, :], axis=-1).max(axis=-1)
    return TranslationSolution(T_sensor, q_b_i, q_b, accuracy)


def check_fit(
    X: ndarray,
    Y: ndarray,
    R_sensor: ndarray,
    accuracy: float | ndarray = 0.0,
    also: str = "",
) -> None:
    """Refuse an answer that fits what it is of no better than a measurement by hand
    would: vectors (3, n) in R_sensor X = Y, and a fixed point, met to `accuracy`, mm.

    Noise does not explain this, readings of other poses do; `also` asks what else may.
    """
    most_mm, *_, most = HAND_PRECISION
    off = np.linalg.norm(R_sensor @ X - Y) / np.linalg.norm(Y)
    if not (off <= most and accuracy <= most_mm):  # true for NaN
        raise ValueError(
            f"no sensor pose fits: with the best, vectors differ by {off:.2g} of their "
            f"length and the point by {accuracy:.2g} mm; expected at most {most:.2g} "
            f"and {most_mm:g} mm: are the poses those of the flange in the base, the "
            f"readings theirs, row by row, and all in mm{also}?"
        )


def check_spread(spread_deg: np.floating, what: str, so: str) -> None:
    """Refuse data that spread by less than LEAST_TURN_DEG, or are not finite."""
    if not spread_deg >= LEAST_TURN_DEG:
        needed = f"at least {LEAST_TURN_DEG:g}° needed"
        raise UnobservableError(f"{what} (within {spread_deg:.2g}°, {needed}), so {so}")


def check_line(vectors: ndarray, what: str, so: str) -> None:
    """Refuse vectors (n, 3) that all run along one line."""
    first, second, *_ = np.linalg.svd(vectors, compute_uv=False)
    check_spread(np.degrees(np.arctan2(second, first)), what, so)


def check_orientations(R_tcp: ndarray, name: str = "orientations") -> None:
    """Refuse fewer than three poses (n, 3, 3), one orientation, or one axis."""
    n = len(R_tcp)
    check_count(name, n, 3, "two turns about different axes fix the translation")
    angles, main = turns(R_tcp)
    check_spread(
        np.linalg.norm(angles),
        f"all {n} poses have one orientation",
        "the translation cannot be known; turn the flange between poses, "
        "about at least two axes",
    )
    axis = np.array2string(main, precision=2, suppress_small=True)
    check_spread(
        np.linalg.norm(angles[1:]),
        f"all {n} poses turn about one axis, {axis} of the flange",
        "the translation along it cannot be known; "
        "add a pose tilted about another axis",
    )
