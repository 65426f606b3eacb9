"""Methods that see one point.

Two-step ball (refs [11]-[14] of the disk paper), tetra-ball (its ref. [15]), and
fixed-point (its ref. [16]), where the laser line is steered through a marked point.
"""

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.closed_form.groups import find_groups
from profilecal.closed_form.two_step import (
    TwoStepSolution,
    check_fit,
    check_line,
    check_orientations,
    check_spread,
    solve_rotation,
    solve_translation,
)
from profilecal.geometry.checks import (
    check_array,
    check_count,
    check_positions,
    check_readings,
    check_rotations,
)
from profilecal.geometry.poses import unit


def solve_ball(R_tcp: ArrayLike, T_tcp: ArrayLike, q: ArrayLike) -> TwoStepSolution:
    """The sensor pose from a ball's centre, seen in a scan from n flange poses.

    The largest group of poses of one orientation (within 0.05°), which translate, fixes
    the rotation by differences from its first, R_sensor (q¹ - qʲ) = R_tcp⁻¹ (Tʲ - T¹).
    The others turn, about two axes or more, and fix the translation, Eqs 17-19 of the
    disk paper (Chen et al. 2018). Its Section V-D describes this two-step method
    without its equations. With noise, the answer depends on which pose comes first, and
    on the order of those that turn.

    Parameters
    ----------
    R_tcp, T_tcp : array_like, (n, 3, 3) and (n, 3)
        Flange poses in the base frame, mm, in any order.
    q : array_like, (n, 3)
        The ball's centre, x, y and z in the sensor frame, from each pose, mm; of an arc
        x, z, r, `Ball.centre_from_circle` gives it.

    Returns
    -------
    TwoStepSolution
        `R_sensor` (3, 3) and `T_sensor` (3,) mm; `translation` also has the centre in
        the base frame, from each pose that turns in their order, and its scatter.

    Raises
    ------
    ValueError
        For malformed input, with the argument, the index and the value; for centres
        that no sensor pose explains.
    UnobservableError
        Where the poses leave the answer open, with the motion to add.

    See Also
    --------
    solve_tetra_ball : From centres that are known in the flange frame too.
    solve_fixed_point : From a marked point that is steered into the scan plane.

    Examples
    --------
    >>> import numpy as np
    >>> import profilecal as pc
    >>> scan, truth = pc.simulate("ball", seed=1, noise={"profile_mm": 0.0})
    >>> R, T = scan.R_base_flange, scan.p_base_flange
    >>> ball = pc.Ball(np.zeros(3), radius=25.0)  # wherever it stands
    >>> q = ball.centre_from_circle(np.concatenate(scan.values), scan.side)
    >>> found = pc.solve_ball(R, T, q)
    >>> bool(np.linalg.norm(found.T_sensor - truth.pose[:3, 3]) < 1e-6)
    True
    """
    T_tcp = check_positions("T_tcp", T_tcp)
    n = len(T_tcp)
    R_tcp = check_rotations("R_tcp", R_tcp, n)
    q = check_readings("q", q, (n, 3))
    number = find_groups("R_tcp", R_tcp, None)
    is_still = number == np.bincount(number).argmax()
    still, turning = np.flatnonzero(is_still), np.flatnonzero(~is_still)
    check_count(
        "translating poses",
        len(still),
        3,
        "two differences that are not parallel fix the rotation",
    )
    lines = q[still[0]] - q[still[1:]]
    moved = (T_tcp[still[1:]] - T_tcp[still[0]]) @ R_tcp[still[0]]
    lines, moved = unit(lines), unit(moved)
    for frame, vectors in (("sensor", lines), ("flange", moved)):
        check_line(
            vectors,
            f"all {len(vectors)} translations are parallel in the {frame} frame",
            "the rotation about them cannot be known; translate along another line",
        )
    check_orientations(R_tcp[turning], "turning poses")

    rotation = solve_rotation(lines.T, moved.T)
    given = R_tcp[turning], T_tcp[turning], q[turning]
    translation = solve_translation(*given, rotation.R_sensor)
    check_fit(**vars(rotation), accuracy=translation.accuracy)
    return TwoStepSolution(rotation, translation)


def solve_tetra_ball(q_b: ArrayLike, q_i: ArrayLike) -> tuple[ndarray, ndarray]:
    """The rigid transform that takes points q_i to q_b, in the least-squares sense.

    Section V-D1 of the disk paper states its ref. [15] as a Lagrangian whose four
    constraints (unit rows; second and third column perpendicular) leave non-rotations
    in. On SO(3) the same sum of squares has one minimum in closed form: centre both
    sets, then project their covariance.

    Parameters
    ----------
    q_b, q_i : array_like, (n, 3)
        At least 3 points, such as centres of balls, in the frame to go to and in the
        frame to come from, mm.

    Returns
    -------
    R, T : numpy.ndarray, (3, 3) and (3,)
        q_b = R q_i + T, mm.

    Raises
    ------
    ValueError
        For malformed input, with the argument, the index and the value; for points
        that no such transform fits.
    UnobservableError
        For points on one line.

    See Also
    --------
    solve_ball : From one ball, seen from several flange poses.

    Examples
    --------
    >>> import profilecal as pc
    >>> q_i = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    >>> R, T = pc.solve_tetra_ball([[1, 2, 3], [1, 3, 3], [0, 2, 3]], q_i)
    >>> T.round(6)
    array([1., 2., 3.])
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
        check_line(
            offsets,
            f"{name}: all {len(offsets)} points lie on one line",
            "the rotation about it cannot be known; add a point off the line",
        )

    rotation = solve_rotation((q_i - centre_i).T, (q_b - centre_b).T)
    check_fit(**vars(rotation))
    R = rotation.R_sensor
    return R, centre_b - R @ centre_i


def solve_fixed_point(
    R_tcp: ArrayLike, T_tcp: ArrayLike, q: ArrayLike
) -> TwoStepSolution:
    """The sensor pose from a marked point that lies in the scan plane of every pose.

    Section I of the disk paper has the method of its ref. [16] in words: the flange is
    moved until the laser line passes through the point, so that the sensor reads
    q^i = (x, 0, z). Eq. 1 then keeps two columns of R_sensor,

        q^b = R_tcp,i (x r_1 + z r_3 + T_sensor) + T_tcp,i,

    and is linear in r_1, r_3, T_sensor and q^b together: no pose need share another's
    orientation. The least-squares r_1 and r_3 are not orthonormal: the nearest rotation
    is taken, then Eq. 19 once more.

    Parameters
    ----------
    R_tcp, T_tcp : array_like, (n, 3, 3) and (n, 3)
        At least 4 flange poses in the base frame, mm.
    q : array_like, (n, 2)
        The point in the sensor frame from each pose, x and z, mm.

    Returns
    -------
    TwoStepSolution
        `R_sensor` (3, 3) and `T_sensor` (3,) mm; `translation` also has the point in
        the base frame, from each pose, and its scatter.

    Raises
    ------
    ValueError
        For malformed input, with the argument, the index and the value; for readings
        that no sensor pose explains.
    UnobservableError
        Where the poses leave the answer open, with the motion to add.

    See Also
    --------
    solve_ball : From a ball, whose centre need not be in the scan plane.

    Examples
    --------
    >>> import numpy as np
    >>> import profilecal as pc
    >>> scan, truth = pc.simulate("point", seed=1, noise={"profile_mm": 0.01})
    >>> R, T = scan.R_base_flange, scan.p_base_flange
    >>> found = pc.solve_fixed_point(R, T, np.concatenate(scan.values))
    >>> bool(np.linalg.norm(found.T_sensor - truth.pose[:3, 3]) < 0.5)
    True
    """
    T_tcp = check_positions("T_tcp", T_tcp)
    n = len(T_tcp)
    check_count("readings of the point", n, 4, "three equations each, twelve unknowns")
    R_tcp = check_rotations("R_tcp", R_tcp, n)
    q = np.insert(check_readings("q", q, (n, 2)), 1, 0, axis=1)
    check_orientations(R_tcp)
    offsets = q - q.mean(axis=0)
    check_line(
        offsets,
        f"q: all {n} readings lie on one line of the scan plane",
        "the rotation cannot be known; see the point at left and right, near and far",
    )
    largest = np.linalg.norm(offsets, 2)
    # in these units each unknown moves the points alike
    units = np.repeat([largest, largest, np.sqrt(n)], 3)
    singular = np.linalg.svd(linear_equations(R_tcp, offsets) / units, compute_uv=False)
    check_spread(
        np.degrees(singular[-1]),
        f"the {n} orientations and readings together leave a combination of rotation "
        "and translation open",
        "add poses, turned about other axes while the point is read elsewhere in the "
        "scan",
    )

    M = linear_equations(R_tcp, q)
    unknowns = np.linalg.pinv(M) @ (T_tcp.mean(axis=0) - T_tcp).ravel()
    r_1_and_r_3 = unknowns[:6].reshape(2, 3).T
    rotation = solve_rotation(np.eye(3)[:, [0, 2]], r_1_and_r_3)
    translation = solve_translation(R_tcp, T_tcp, q, rotation.R_sensor)
    check_fit(**vars(rotation), accuracy=translation.accuracy)
    return TwoStepSolution(rotation, translation)


def linear_equations(R_tcp: ndarray, q: ndarray) -> ndarray:
    """The matrix (3n, 9) of Eq. 1 for r_1, r_3 and T_sensor, of poses (n, 3, 3) and
    readings (n, 3).

    Its mean over the poses is taken off, so that q^b is gone.
    """
    factors = np.column_stack([q[:, 0], q[:, 2], np.ones(len(q))])
    M = np.einsum("nab,nk->nakb", R_tcp, factors)
    return (M - M.mean(axis=0)).reshape(-1, 9)
