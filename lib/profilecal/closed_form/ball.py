"""Methods that see one point: two-step ball (refs [11]-[14] of the disk paper),
tetra-ball (its ref [15]), fixed-point (its ref. [16]), where the laser line is steered
through a marked point.
"""

import numpy as np

from profilecal.closed_form.two_step import (
    LEAST_SPREAD_DEG,
    TwoStepSolution,
    check_line,
    check_orientations,
    check_spread,
    solve_rotation,
    solve_translation,
)
from profilecal.geometry.checks import check_array, check_count, check_rotations
from profilecal.geometry.poses import angle_between


def solve_ball(R_tcp, T_tcp, q, translating: int) -> TwoStepSolution:
    """Sensor pose from ball centres q (n, 3) in the sensor frame, seen from n flange
    poses, mm.

    The first `translating` poses (at least 3) share one orientation and fix the
    rotation: R_sensor (q¹ - qʲ) = R_tcp⁻¹ (Tʲ - T¹). The others (at least 3) turn about
    two axes or more and fix the translation, Eqs 17-19 of the disk paper. Section V-D
    describes the method without its equations.

    Raises ValueError for malformed input, UnobservableError for poses that leave the
    answer open.
    """
    T_tcp = check_array("T_tcp", T_tcp, (None, 3))
    n = len(T_tcp)
    check_count(
        "translating poses",
        translating,
        3,
        "two differences that are not parallel fix the rotation",
    )
    check_count(
        "turning poses",
        n - translating,
        3,
        "two turns about different axes fix the translation",
    )
    R_tcp = check_rotations("R_tcp", R_tcp, n)
    q = check_array("q", q, (n, 3))
    apart = np.degrees(angle_between(R_tcp[0], R_tcp[:translating])).max()
    if apart > LEAST_SPREAD_DEG:
        raise ValueError(
            f"the {translating} translating poses differ in orientation by {apart:.2g}°; expected one orientation"
        )
    lines = q[0] - q[1:translating]
    lengths = np.linalg.norm(lines, axis=1)
    if not lengths.all():
        raise ValueError(
            f"q[{lengths.argmin() + 1}] is q[0], {q[0]}; expected ball centres apart from the first"
        )
    what = f"all {translating - 1} differences of ball centres are parallel in the sensor frame"
    check_line(
        lines / lengths[:, None],
        what,
        "the rotation about them cannot be known; translate along another line",
    )
    check_orientations(R_tcp[translating:])
    return ball_equations(R_tcp, T_tcp, q, translating)


def ball_equations(R_tcp, T_tcp, q, translating: int) -> TwoStepSolution:
    """`solve_ball` without its guards, with any leading batch axes: (..., n, 3, 3) and
    (..., n, 3).
    """
    others, turning = slice(1, translating), slice(translating, None)
    X = (q[..., :1, :] - q[..., others, :]).mT
    Y = np.einsum(
        "...ba,...nb->...an",
        R_tcp[..., 0, :, :],
        T_tcp[..., others, :] - T_tcp[..., :1, :],
    )
    X = X / np.linalg.norm(X, axis=-2, keepdims=True)
    Y = Y / np.linalg.norm(Y, axis=-2, keepdims=True)
    rotation = solve_rotation(X, Y)
    translation = solve_translation(
        R_tcp[..., turning, :, :],
        T_tcp[..., turning, :],
        q[..., turning, :],
        rotation.R_sensor,
    )
    return TwoStepSolution(rotation, translation)


def solve_tetra_ball(q_b, q_i) -> tuple[np.ndarray, np.ndarray]:
    """R (3, 3) and T (3,), mm, that take the points q_i (n, 3) to q_b (n, 3), n ≥ 3, in
    the least-squares sense.

    Section V-D1 of the disk paper states ref. [15] as a Lagrangian whose four
    constraints (unit rows; second and third column perpendicular) leave non-rotations
    in. On SO(3) the same sum of squares has one minimum in closed form: centre both
    sets, then project their covariance.

    Raises ValueError for malformed input, UnobservableError for points on one line.
    """
    q_b = check_array("q_b", q_b, (None, 3))
    check_count(
        "conjugate pairs",
        len(q_b),
        3,
        "three points that are not on one line fix a rigid transform",
    )
    q_i = check_array("q_i", q_i, (len(q_b), 3))
    centre_b, centre_i = q_b.mean(axis=0), q_i.mean(axis=0)
    for name, offsets in (("q_b", q_b - centre_b), ("q_i", q_i - centre_i)):
        what = f"{name}: all {len(offsets)} points lie on one line"
        check_line(
            offsets,
            what,
            "the rotation about it cannot be known; add a point off the line",
        )
    R = solve_rotation((q_i - centre_i).T, (q_b - centre_b).T).R_sensor
    return R, centre_b - R @ centre_i


def solve_fixed_point(R_tcp, T_tcp, q) -> TwoStepSolution:
    """Sensor pose from a marked point, read as q (n, 3), mm, with y = 0, from n ≥ 4
    flange poses.

    Section I of the disk paper has the method in words: the flange is moved until the
    laser line passes through the point, so that the sensor reads q^i = (x, 0, z). Eq. 1
    then keeps two columns of R_sensor,

        q^b = R_tcp,i (x r_1 + z r_3 + T_sensor) + T_tcp,i,

    and is linear in r_1, r_3, T_sensor and q^b together: no pose need share another's
    orientation. The least-squares r_1 and r_3 are not orthonormal: the nearest rotation
    is taken, then Eq. 19 once more. R_tcp (n, 3, 3) and T_tcp (n, 3), mm: the flange in
    the base frame.

    Raises ValueError for malformed input, UnobservableError for poses that leave the
    answer open.
    """
    T_tcp = check_array("T_tcp", T_tcp, (None, 3))
    n = len(T_tcp)
    check_count("readings of the point", n, 4, "three equations each, twelve unknowns")
    R_tcp = check_rotations("R_tcp", R_tcp, n)
    q = check_array("q", q, (n, 3))
    off = np.flatnonzero(q[:, 1])
    if off.size:
        raise ValueError(
            f"q[{off[0]}] is {q[off[0]]}; expected y = 0, as the laser line passes through the point"
        )
    check_orientations(R_tcp)
    what = f"q: all {n} readings lie on one line of the scan plane"
    offsets = q - q.mean(axis=0)
    check_line(
        offsets,
        what,
        "the rotation cannot be known; see the point at left and right, near and far",
    )
    largest = np.linalg.norm(offsets, 2)
    # then each unknown moves the points alike
    unit = np.repeat([largest, largest, np.sqrt(n)], 3)
    weakest = np.linalg.svd(linear_equations(R_tcp, offsets) / unit, compute_uv=False)[
        -1
    ]
    what = f"the {n} orientations and readings together leave a combination of rotation and translation open"
    so = "add poses, turned about other axes while the point is read elsewhere in the scan"
    check_spread(np.degrees(weakest), what, so)
    M = linear_equations(R_tcp, q)
    columns = (np.linalg.pinv(M) @ (T_tcp.mean(axis=0) - T_tcp).ravel())[:6]
    rotation = solve_rotation(np.eye(3)[:, [0, 2]], columns.reshape(2, 3).T)
    return TwoStepSolution(
        rotation, solve_translation(R_tcp, T_tcp, q, rotation.R_sensor)
    )


def linear_equations(R_tcp, q) -> np.ndarray:
    """The matrix (..., 3n, 9) of Eq. 1 for r_1, r_3 and T_sensor, less its mean over
    the poses, so that q^b is gone.
    """
    factors = np.stack([q[..., 0], q[..., 2], np.ones_like(q[..., 0])], axis=-1)
    M = np.einsum("...nab,...nk->...nakb", R_tcp, factors)
    M = M - M.mean(axis=-4, keepdims=True)
    return M.reshape(*M.shape[:-4], -1, 9)
