"""The fixed-point method (ref. [16] of the disk paper): a marked point, through which the laser line is steered.

The disk paper describes it in words only (Section I): the point stands still, and the flange is moved until the line
passes through it. The sensor then reads q^i = (x, 0, z), so that Eq. 1 keeps two columns of R_sensor,

    q^b = R_tcp,i (x r_1 + z r_3 + T_sensor) + T_tcp,i,

and is linear in r_1, r_3, T_sensor and q^b together: no pose need share another's orientation.
"""

import numpy as np

from profilecal.closed_form.two_step import (
    LEAST_SPREAD_DEG,
    TwoStepSolution,
    check_orientations,
    solve_rotation,
    solve_translation,
)
from profilecal.geometry.checks import UnobservableError, check_count, check_rotations, check_vectors


def solve_fixed_point(R_tcp, T_tcp, q) -> TwoStepSolution:
    """Sensor pose from a marked point, read as q (n, 3), mm, with y = 0, from n ≥ 4 flange poses.

    R_tcp (n, 3, 3) and T_tcp (n, 3), mm: the flange in the base frame. Where some poses share an orientation,
    `solve_ball` takes the readings as well.

    Raises ValueError for malformed input, UnobservableError for poses that cannot determine the answer.
    """
    T_tcp = check_vectors("T_tcp", T_tcp)
    n = len(T_tcp)
    check_count("readings of the point", n, 4, "three equations each, twelve unknowns")
    R_tcp = check_rotations("R_tcp", R_tcp, n)
    q = check_vectors("q", q, n)
    off = np.flatnonzero(q[:, 1])
    if off.size:
        raise ValueError(f"q[{off[0]}] is {q[off[0]]}; expected y = 0, as the laser line passes through the point")
    check_orientations(R_tcp)
    _check_readings(R_tcp, q)

    return fixed_point_equations(R_tcp, T_tcp, q)


def fixed_point_equations(R_tcp, T_tcp, q) -> TwoStepSolution:
    """`solve_fixed_point` without its guards, with any leading batch axes: (..., n, 3, 3) and (..., n, 3).

    The least-squares columns r_1 and r_3 are not orthonormal: the nearest rotation is taken, then Eq. 19 once more.
    """
    M = linear_equations(R_tcp, q)
    N = T_tcp.mean(axis=-2, keepdims=True) - T_tcp
    columns = (np.linalg.pinv(M) @ N.reshape(*N.shape[:-2], -1, 1))[..., :6, 0]
    Y = np.swapaxes(columns.reshape(*columns.shape[:-1], 2, 3), -1, -2)
    rotation = solve_rotation(np.eye(3)[:, [0, 2]], Y)
    return TwoStepSolution(rotation, solve_translation(R_tcp, T_tcp, q, rotation.R_sensor))


def linear_equations(R_tcp, q) -> np.ndarray:
    """The matrix (..., 3n, 9) of Eq. 1 for r_1, r_3 and T_sensor, less its mean over the poses, so that q^b is gone."""
    factors = np.stack([q[..., 0], q[..., 2], np.ones_like(q[..., 0])], axis=-1)
    M = np.einsum("...nab,...nk->...nakb", R_tcp, factors)
    M = M - M.mean(axis=-4, keepdims=True)
    return M.reshape(*M.shape[:-4], -1, 9)


def _check_readings(R_tcp, q) -> None:
    """Refuse readings on one line of the scan, and poses that only together with them leave something open."""
    offsets = q - q.mean(axis=0)
    singular = np.linalg.svd(offsets, compute_uv=False)
    least = np.radians(LEAST_SPREAD_DEG)
    if not singular[1] > least * singular[0]:
        raise UnobservableError(
            f"q: all {len(q)} readings lie on one line of the scan plane (within {singular[1]:.3f} mm), so the "
            "rotation cannot be known; see the point at left and right, near and far"
        )
    unit = np.repeat([singular[0], singular[0], np.sqrt(len(q))], 3)  # then each unknown moves the points alike
    weakest = np.linalg.svd(linear_equations(R_tcp, offsets) / unit, compute_uv=False)[-1]
    if not weakest > least:
        raise UnobservableError(
            f"the {len(q)} orientations and readings together leave a combination of rotation and translation open "
            f"(within {np.degrees(weakest):.2g}°, at least {LEAST_SPREAD_DEG:g}° needed); add poses, turned about "
            "other axes while the point is read elsewhere in the scan"
        )
