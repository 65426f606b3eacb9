"""The disk method of Chen et al. 2018: chords to sensing data (Section III-B), sensing
data to pose (III-C, III-D).
"""

from dataclasses import dataclass

import numpy as np

from profilecal.closed_form.two_step import (
    TwoStepSolution,
    solve_rotation,
    solve_translation,
)
from profilecal.geometry.fitting import Ellipse, fit_ellipse, from_components


@dataclass(frozen=True)
class SensingData:
    """What Section III-B makes of the chords of a scan, with every quantity on the way."""

    # (..., 3) flange position at which the scan plane passes through the disk's centre,
    # mm, Eq. 10
    T_tcp: np.ndarray
    q: np.ndarray  # (..., 3) the disk's centre in the sensor frame, mm, Eq. 11
    # (..., 3) from one tangent position to the other, sensor frame, mm, Eq. 12
    D_i: np.ndarray
    D_b: np.ndarray  # (..., 3) the same in the base frame, mm, Eq. 13
    # (..., 2) unit vector of the chords, x and z of the sensor frame
    direction: np.ndarray
    e: np.ndarray  # (..., 5, 2) the elliptic points in the rotated frame, mm, Eq. 5
    # (...) the argument of Eq. 9's arccos; noise can push it out of [-1, 1]
    cos_alpha: np.ndarray

    @property
    def alpha(self) -> np.ndarray:
        """Angle between the scan plane and the disk in radians, Eq. 9; 0 or π where the
        arccos does not exist.
        """
        return np.arccos(np.clip(self.cos_alpha, -1, 1))

    @property
    def clipped(self) -> np.ndarray:
        """Where Eq. 9's arccos does not exist, (...)."""
        return ~(np.abs(self.cos_alpha) <= 1)


def sensing_data(
    tips, T_start, T_end, s, radius: float, heights: str = "regression"
) -> SensingData:
    """Sensing data of scans from their chords' tips (..., m, 2, 2), in order of the
    motion: Eqs 4-13, no guards.

    Of each chord the tip of smaller x comes first. T_start and T_end (..., 3), mm:
    flange positions of the first and the last; s (...): +1 where the motion is towards
    the sensor's +y, else -1. `heights`: see `chord_weights`.
    """
    m = tips.shape[-3]
    points = np.moveaxis(tips, -2, -3).reshape(*tips.shape[:-3], 2 * m, 2)
    vectors = points.mT @ chord_weights(m, heights)
    return sensing_data_from_ellipse(
        fit_ellipse(points), vectors, T_start, T_end, s, radius
    )


def chord_weights(m: int, heights: str = "regression") -> np.ndarray:
    """Weights (2m, 5) that make five vectors of the tips of m chords, all first tips
    before all second ones.

    They are the mean chord, then two points each of the lines that place e4 and e5 on
    the line e1e2. `heights` "published": these lines are the first and the last chord,
    whose noise stays however many chords there are; "regression": they run along the
    mean chord, at the ends of the straight line fitted to the heights of all chords,
    which the motion spaces evenly. Raises ValueError for others.
    """
    chord = np.repeat([-1 / m, 1 / m], m)
    if heights == "regression":
        middles = np.tile(line_ends(m), (2, 1)) / 2
        lines = middles[:, :, None] + np.outer(chord, [-0.5, 0.5])[:, None, :]
    elif heights == "published":
        lines = np.zeros((2 * m, 2, 2))
        lines[[0, m - 1, m, 2 * m - 1], [0, 1, 0, 1], [0, 0, 1, 1]] = 1
    else:
        raise ValueError(
            f"heights is {heights!r}; expected 'regression' or 'published'"
        )
    return np.column_stack([chord, lines.reshape(2 * m, 4)])


def line_ends(m: int) -> np.ndarray:
    """Weights (m, 2) giving the first and last value of the straight line through m
    values at equal steps.
    """
    step = np.linspace(-1, 1, m)
    return 1 / m + np.outer(step, [-1, 1]) / (step @ step)


def sensing_data_from_ellipse(
    ellipse: Ellipse, vectors, T_start, T_end, s, radius: float
) -> SensingData:
    """As `sensing_data`, from the fitted ellipse and the vectors (..., 2, 5), x and z,
    that `chord_weights` makes. x̄ and z̄, the frame of Eq. 4, run along the chords and
    across. Components come first: NumPy is fast along long axes only.
    """
    chord, *lines = np.moveaxis(vectors, (-1, -2), (0, 1))
    cos, sin = chord / np.hypot(*chord)

    def turned(vector):  # R_θ: into the frame of Eq. 4
        return cos * vector[0] + sin * vector[1], cos * vector[1] - sin * vector[0]

    x3, z3 = turned(np.moveaxis(ellipse.centre, -1, 0))
    S_x, S_z = np.moveaxis(ellipse.shape, (-2, -1), (0, 1))
    S_xz, S_zz = turned(cos * S_z - sin * S_x)
    # a chord at height z̄ has its middle at x̄_3 + slope (z̄ - z̄_3), on the line e1e2
    slope = S_xz / S_zz

    def height(a, b):  # at which the line through a and b meets e1e2
        (xa, za), (xb, zb) = turned(a), turned(b)
        rise = (zb - za) / (xb - xa)
        return (za + rise * (x3 - slope * z3 - xa)) / (1 - rise * slope)

    z4, z5 = height(*lines[:2]), height(*lines[2:])
    way = np.where(z5 < z4, -1.0, 1.0) * np.sqrt(S_zz)
    z = np.stack([z3 - way, z3 + way, z3, z4, z5])
    x = x3 + (z - z3) * slope
    with np.errstate(divide="ignore", invalid="ignore"):
        eta = (z - z5) / (z4 - z5)  # Eq. 7: all five points are on one line
    end, to_start = (
        np.moveaxis(np.broadcast_to(T, (*z3.shape, 3)), -1, 0)
        for T in (T_end, T_start - T_end)
    )
    T_3, D_b = end + eta[2] * to_start, (eta[1] - eta[0]) * to_start  # Eqs 8, 13
    dx, dz = x[0] - x[1], z[0] - z[1]
    cos_alpha = ((D_b**2).sum(axis=0) - dx**2 - dz**2 - 4 * radius**2) / (
        4 * radius * dz
    )
    inside = np.clip(cos_alpha, -1, 1)
    D_y, D_z = 2 * radius * s * np.sqrt(1 - inside**2), dz + 2 * radius * inside
    return SensingData(
        T_tcp=np.moveaxis(T_3, 0, -1),
        q=from_components(
            ellipse.centre[..., 0], np.zeros_like(z3), ellipse.centre[..., 1]
        ),
        D_i=from_components(cos * dx - sin * D_z, D_y, sin * dx + cos * D_z),
        D_b=np.moveaxis(D_b, 0, -1),
        direction=from_components(cos, sin),
        e=np.moveaxis(np.stack([x, z]), (0, 1), (-1, -2)),
        cos_alpha=cos_alpha,
    )


def disk_equations(R_tcp, T_tcp, q, D_i, D_b) -> TwoStepSolution:
    """Sensor pose from the flange's orientations (..., n, 3, 3) and `SensingData`, each
    (..., n, 3) mm, without guards: `closed_form` has them. Eq. 14's vectors are given
    unit length.
    """
    X = (D_i / np.linalg.norm(D_i, axis=-1, keepdims=True)).mT
    D_b = D_b / np.linalg.norm(D_b, axis=-1, keepdims=True)
    Y = np.einsum("...nba,...nb->...an", R_tcp, D_b)  # columns R_tcp⁻¹ D_b
    rotation = solve_rotation(X, Y)
    return TwoStepSolution(
        rotation, solve_translation(R_tcp, T_tcp, q, rotation.R_sensor)
    )
