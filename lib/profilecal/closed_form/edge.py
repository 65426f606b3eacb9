"""The edge method: Section 2 of the edge paper (Xu et al. 2021), Eqs 5-35, with its
symbols.

`solve_edge` is for users. The equations take R_b (..., G, 3, 3) and T_b (..., G, N, 3)
mm, flange poses in the base frame, G rotation groups of one orientation and N positions
each, and p_s (..., G, N, 2) mm, sensed edge points, x and z in the sensor frame.
Leading axes are a batch. A group of fewer poses repeats its first one, whose vectors of
Eq. 5 are zero and add nothing; where a count matters, the mask `present` (G, N) tells.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.closed_form.groups import find_groups, group_members
from profilecal.closed_form.two_step import TwoStepSolution, check_orientations
from profilecal.geometry.checks import (
    UnobservableError,
    check_count,
    check_positions,
    check_readings,
    check_rotations,
)
from profilecal.geometry.fitting import affine_residuals, with_sign
from profilecal.geometry.poses import nearest_rotation

# strength of the rotation below which what points are off the edge may explain it: of
# 2,000 scenes that leave it open none has more than 1.1; below 10 a degree can be wrong
REFUSED = 1.25


@dataclass(frozen=True)
class EdgeRotation:
    """A_r r_s = b_r, Eqs 25-27."""

    A_r: ndarray  # (..., k, 9) mm²
    b_r: ndarray  # (..., k) mm²
    S: ndarray  # (..., 9) singular values of A_r, mm²
    V: ndarray  # (..., 9, 9) right singular vectors of A_r, in columns
    rank: ndarray  # (...) of A_r, up to rounding
    # (..., 9) the solution before its projection, vec(R_s) column by column
    r_s: ndarray
    R_sensor: ndarray  # (..., 3, 3)


@dataclass(frozen=True)
class EdgeTranslation:
    """A_t T_s = b_t, Eqs 28-35."""

    u_b: ndarray  # (..., 3) unit direction of the edge in the base frame
    rank: ndarray  # (...) of A_t, up to rounding
    T_sensor: ndarray  # (..., 3) mm
    # (..., G, N, 3) the edge points in the base frame, mm; of `solve_edge` (n, 3)
    p_b: ndarray


class EdgeSolution(TwoStepSolution):
    """The sensor pose on the flange, with every quantity on the way.

    The rotation, an `EdgeRotation`, comes first, then the `EdgeTranslation`.
    """

    @property
    def u_b(self) -> ndarray:
        """(..., 3) direction of the edge in the base frame."""
        return self.translation.u_b

    @property
    def p_b(self) -> ndarray:
        """(..., G, N, 3) the edge points in the base frame, mm; of `solve_edge`
        (n, 3).
        """
        return self.translation.p_b


def solve_edge(
    R_b: ArrayLike,
    T_b: ArrayLike,
    p_s: ArrayLike,
    *,
    group: ArrayLike | None = None,
    regression: bool = False,
) -> EdgeSolution:
    """The sensor pose from a straight edge, whose point in the scan n flange poses see.

    Section 2 of the edge paper (Xu et al. 2021): differences within groups of poses of
    one orientation fix the rotation (Eqs 5-27), differences between groups then the
    translation (Eqs 28-35). Groups may be of any size: those of three poses or more
    make up the rotation, all of them the translation.

    Rows may come in any order. As in the paper, Eq. 5 takes differences from a group's
    first row: with noise, another row in its place gives another answer, about as far
    away as the error that the noise makes.

    Parameters
    ----------
    R_b, T_b : array_like, (n, 3, 3) and (n, 3)
        Flange poses in the base frame, mm: at least three orientations.
    p_s : array_like, (n, 2)
        The edge's point in the sensor frame from each pose, x and z, mm.
    group : array_like, (n,), optional
        Labels that poses of one orientation share. Left out, orientations that agree
        within 0.05° form a group.
    regression : bool, optional
        Whether points are first smoothed inside their group: there the sensed point is
        an affine function of the flange position.

    Returns
    -------
    EdgeSolution
        `R_sensor` (3, 3), `T_sensor` (3,) mm, the edge's direction `u_b` (3,) and its
        points `p_b` (n, 3) mm in the base frame; `rotation` and `translation` have the
        linear systems.

    Raises
    ------
    ValueError
        For malformed input, with the argument, the index and the value.
    UnobservableError
        Where the poses leave the answer open, with the motion to add.

    See Also
    --------
    solve_disk : The same from a disk.
    solve_ball : The same from a ball.
    edge_equations : Batches of many scenes at once, without guards.

    Examples
    --------
    >>> import numpy as np
    >>> import profilecal as pc
    >>> scan, truth = pc.simulate("edge", seed=1, noise={"profile_mm": 0.01})
    >>> R, T = scan.R_base_flange, scan.p_base_flange
    >>> points = np.concatenate(scan.values)
    >>> found = pc.solve_edge(R, T, points)
    >>> bool(np.linalg.norm(found.T_sensor - truth.pose[:3, 3]) < 0.5)
    True
    """
    T_b = check_positions("T_b", T_b)
    n = len(T_b)
    R_b = check_rotations("R_b", R_b, n)
    p_s = check_readings("p_s", p_s, (n, 2))
    index, present = group_members(find_groups("R_b", R_b, group))
    why = "pairs of their differences fix the rotation"
    check_count("poses of an orientation", present.shape[1], 3, why)
    R, T, points = R_b[index[:, 0]], T_b[index], p_s[index]
    check_orientations(R)

    smooth = smoothed(T, points, present) if regression else points
    found = edge_equations(R, T, smooth, present)
    p_b = edge_translation(R, T, points, found.R_sensor, present).p_b[present]
    noise = scatter_about_line(p_b)
    strength = rotation_strength(noise, R, T, points, found.rotation, present)
    rank = found.translation.rank
    if not strength >= REFUSED or rank < 3:  # true for NaN
        raise UnobservableError(
            "the motions leave the pose open: the smallest singular value of A_r is "
            f"{strength:.2g} times what noise makes of a zero, {REFUSED:g} needed, as "
            f"points are {noise:.2g} mm off an edge, and A_t has rank {rank}, 3 "
            "needed; turn the flange more between groups, about several axes, and move "
            "within them in space, or in one plane of the base, tilted against the "
            "edge by 30° or more (are the poses those of the flange in the base, the "
            "readings theirs, row by row, and all in mm?)"
        )
    p_b = np.empty((n, 3))
    p_b[index] = found.p_b
    return replace(found, translation=replace(found.translation, p_b=p_b))


def smoothed(T_b: ndarray, p_s: ndarray, present: ndarray) -> ndarray:
    """Points less what an affine function of their group's positions leaves of them."""
    points = p_s - affine_residuals(T_b, p_s, present)
    return np.where(present[..., None], points, points[..., :1, :])


def edge_equations(
    R_b: ndarray, T_b: ndarray, p_s: ndarray, present: ArrayLike = True
) -> EdgeSolution:
    """Both phases, without the guards of `solve_edge`."""
    rotation = edge_rotation(R_b, T_b, p_s)
    translation = edge_translation(R_b, T_b, p_s, rotation.R_sensor, present)
    return EdgeSolution(rotation, translation)


def difference_vectors(T_b: ndarray, p_s: ndarray) -> tuple[ndarray, ndarray]:
    """u_s and u_t of Eq. 5, both (..., G, N - 1, 3): from a group's first point and
    position to its others.
    """
    u_s = np.insert(p_s[..., 1:, :] - p_s[..., :1, :], 1, 0, axis=-1)
    u_t = T_b[..., 1:, :] - T_b[..., :1, :]
    return u_s, u_t


def fewer_vectors(u_s: ndarray, u_t: ndarray) -> tuple[ndarray, ndarray]:
    """At most five vectors a group, whose pairs make up the same sum of squares as all
    pairs of the given ones.

    Eq. 8 holds 2×2 minors of the rows (u_s, u_t), five numbers each. By Cauchy and
    Binet, sums of products of these minors over all pairs of rows follow from the rows'
    5×5 moment matrix alone, which their QR factor shares.
    """
    rows = np.concatenate([u_s[..., ::2], u_t], axis=-1)
    factor = np.asarray(np.linalg.qr(rows, mode="r"))
    return np.insert(factor[..., :2], 1, 0, axis=-1), factor[..., 2:]


def transposed_skew(a: ndarray) -> ndarray:
    """[a]ₓᵀ of Eq. 17, (..., 3, 3): [a]ₓᵀ v = v × a. Its rows are a × e_k, of the unit
    vectors e_k.
    """
    return np.cross(a[..., None, :], np.eye(3))


def rotation_system(
    R_b: ndarray, T_b: ndarray, p_s: ndarray
) -> tuple[ndarray, ndarray]:
    """A_r (..., k, 9) and b_r (..., k) of Eq. 25, from `fewer_vectors` with the
    least-squares problem of all pairs.
    """
    return pair_equations(R_b, *fewer_vectors(*difference_vectors(T_b, p_s)))


def pair_equations(R_b: ndarray, u_s: ndarray, u_t: ndarray) -> tuple[ndarray, ndarray]:
    """A_r and b_r, stacked over all pairs, within each group, of vectors u_s and u_t
    (..., G, n, 3).

    With R_b R_s u_s + u_t along the edge for every vector, the cross product of those
    of a pair (i, j) vanishes (Eq. 8). Since u_s = (x, 0, z), it is linear in the
    columns r_1, r_2 and r_3 of R_s (Eqs 13-15 and 21-24): with C = [u_t]ₓᵀ R_b,

        (x_i C_j - x_j C_i) r_1 + (z_i x_j - z_j x_i) R_b r_2 + (z_i C_j - z_j C_i) r_3
            = -u_t,i × u_t,j.
    """
    i, j = np.triu_indices(u_s.shape[-2], 1)
    R_b = R_b[..., None, :, :]
    C = transposed_skew(u_t) @ R_b
    C_i, C_j = C[..., i, :, None, :], C[..., j, :, None, :]
    s_i, s_j = u_s[..., i, None, ::2, None], u_s[..., j, None, ::2, None]  # x and z
    minor = s_i[..., 1, :] * s_j[..., 0, :] - s_j[..., 1, :] * s_i[..., 0, :]
    A_r = np.insert(s_i * C_j - s_j * C_i, 1, minor * R_b, axis=-2)
    b_r = -np.cross(u_t[..., i, :], u_t[..., j, :])  # Eq. 16
    batch = A_r.shape[:-5]
    return A_r.reshape(*batch, -1, 9), b_r.reshape(*batch, -1)


def least_squares(
    A: ndarray, b: ndarray, zero: ndarray | float
) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """The solution V S⁺ Uᵀ b of least norm, S, V and the rank, for A (..., k, n) and b
    (..., k).

    Singular values up to `zero` (..., 1) count as zero. The text after Eq. 26 prints S
    where S⁺ is meant.
    """
    U, S, Vt = np.linalg.svd(A, full_matrices=False)
    significant = zero < S
    inverse = significant / np.where(significant, S, 1)
    V = Vt.mT
    x = np.matvec(V, inverse * np.vecmat(b, U))
    return x, S, V, significant.sum(axis=-1)


def unvec(r: ndarray) -> ndarray:
    """The matrices (..., 3, 3) whose columns r (..., 9) lists one after the other."""
    return r.reshape(*r.shape[:-1], 3, 3).mT


def edge_rotation(R_b: ndarray, T_b: ndarray, p_s: ndarray) -> EdgeRotation:
    """Phase one, Eqs 25-27."""
    A_r, b_r = rotation_system(R_b, T_b, p_s)
    # not a share of A_r, which is rounding alone where points lie along a line
    u_s, u_t = difference_vectors(T_b, p_s)
    rounding = 1e-11 * (u_s**2 + u_t**2).sum(axis=(-3, -2, -1))[..., None]
    r_s, S, V, rank = least_squares(A_r, b_r, rounding)
    return EdgeRotation(A_r, b_r, S, V, rank, r_s, nearest_rotation(unvec(r_s)))


def noise_gain(
    v: ndarray,
    R_b: ndarray,
    T_b: ndarray,
    p_s: ndarray,
    present: ArrayLike = True,
) -> ndarray:
    """Root mean square of |A_r v| (...), mm², where noise of 1 mm in the sensed points
    is all that makes it up, for v (..., 9) of unit length.

    To first order the row block of pair (i, j) changes by g_j when u_s[i] does, by -g_i
    when u_s[j] does, and by their difference when the common first point does. Over all
    pairs of a group of m vectors, the squares sum to (2 m - 1) Σ|g|² - |Σ g|².
    """
    u_s, u_t = difference_vectors(T_b, p_s)
    W = R_b @ unvec(v)[..., None, :, :]  # (..., G, 3, 3)
    m = np.broadcast_to(present, p_s.shape[-3:-1]).sum(axis=-1) - 1
    total = np.zeros(u_t.shape[:-3])
    for axis in np.eye(3)[::2]:  # x and z, the coordinates that carry noise
        g = np.cross(axis, u_s) @ W.mT + np.cross((W @ axis)[..., None, :], u_t)
        squares = (g**2).sum(axis=(-2, -1))
        square_of_sum = (g.sum(axis=-2) ** 2).sum(axis=-1)
        total = total + ((2 * m - 1) * squares - square_of_sum).sum(axis=-1)
    return np.sqrt(total)


def translation_system(
    R_b: ndarray, p: ndarray, u_b: ndarray, present: ArrayLike = True
) -> tuple[ndarray, ndarray]:
    """A_t (..., 3 G, 3) and b_t (..., 3 G) of Eq. 34 from p = R_b R_s p_s + T_b (...,
    G, N, 3), mm.

    Eqs 30-33 take all pairs of points of different groups: of groups g and h, with n_g
    and n_h points, there are n_g n_h, which differ by p alone. For a residual that is
    linear in (R_b, p), their squares sum, but for a constant, to n_g n_h times that of
    the groups' means (R_g, p̄_g) and (R_h, p̄_h), and over all pairs of groups, with
    n = Σ n_g,

        Σ_g<h n_g n_h |x_g - x_h|² = n Σ_g n_g |x_g - x̄|²,   x̄ = Σ_g n_g x_g / n:

    each group's difference from the mean of all points, times √(n n_g).
    """
    present = np.broadcast_to(present, p.shape[-3:-1])
    count = present.sum(axis=-1)
    weight = np.sqrt(count.sum() * count)[:, None]
    R_mean = np.average(R_b, axis=-3, weights=count, keepdims=True)
    p_group = (present[..., None] * p).sum(axis=-2) / count[:, None]
    p_mean = np.average(p_group, axis=-2, weights=count, keepdims=True)
    C = weight[:, None] * (R_b - R_mean)
    d = weight * (p_group - p_mean)
    A_t = transposed_skew(u_b)[..., None, :, :] @ C  # Eq. 33
    b_t = -np.cross(d, u_b[..., None, :])  # Eq. 31
    return A_t.reshape(*A_t.shape[:-3], -1, 3), b_t.reshape(*b_t.shape[:-2], -1)


def edge_translation(
    R_b: ndarray,
    T_b: ndarray,
    p_s: ndarray,
    R_sensor: ndarray,
    present: ArrayLike = True,
) -> EdgeTranslation:
    """Phase two, Eqs 28-35, with the rotation R_sensor (..., 3, 3) of phase one."""
    in_flange = p_s @ R_sensor[..., ::2].mT[..., None, :, :]
    p = in_flange @ R_b.mT + T_b
    vectors = p[..., 1:, :] - p[..., :1, :]  # Eq. 5
    vectors = vectors.reshape(*vectors.shape[:-3], -1, 3)
    # along which they extend most
    u_b = with_sign(np.linalg.svd(vectors, full_matrices=False)[2][..., 0, :])
    A_t, b_t = translation_system(R_b, p, u_b, present)
    # of nine entries of R_b, in each of G N equations
    rounding = 12 * np.finfo(float).eps * p.shape[-3] * p.shape[-2]
    T_sensor, _, _, rank = least_squares(A_t, b_t, rounding)
    p_b = p + np.matvec(R_b, T_sensor[..., None, :])[..., None, :]
    return EdgeTranslation(u_b, rank, T_sensor, p_b)


def scatter_about_line(p_b: ndarray) -> ndarray:
    """Standard deviation (...) of the edge's points (..., n, 3) in the base frame about
    a line, mm, across it. It and the pose have ten unknowns; NaN for five points or
    fewer.

    It is the noise of the sensed points, or what a wrong pose adds to it.
    """
    freedom = 2 * p_b.shape[-2] - 10
    offsets = p_b - p_b.mean(axis=-2, keepdims=True)
    across = np.linalg.svd(offsets, compute_uv=False)[..., 1:]
    return np.linalg.norm(across, axis=-1) / np.sqrt(freedom if freedom > 0 else np.nan)


def rotation_strength(
    noise: ArrayLike,
    R_b: ndarray,
    T_b: ndarray,
    p_s: ndarray,
    rotation: EdgeRotation,
    present: ArrayLike = True,
) -> ndarray:
    """Smallest singular value of A_r over what noise (...), mm, makes of a zero, (...):
    0 where A_r lacks rank.
    """
    gain = noise_gain(rotation.V[..., -1], R_b, T_b, p_s, present)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(rotation.rank < 9, 0, rotation.S[..., -1] / (noise * gain))
