"""The edge method: Section 2 of the edge paper (Xu et al. 2021), Eqs 5-35, with its
symbols.

R_b (..., G, 3, 3) and T_b (..., G, N, 3) mm: flange poses in the base frame, G rotation
groups of one orientation and N positions each. p_s (..., G, N, 2) mm: sensed edge
points, x and z in the sensor frame. Leading axes are a batch.
"""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.fitting import affine_residuals
from profilecal.geometry.poses import nearest_rotation

# strength of the rotation below which noise alone would explain it; below 10 a degree
# can be wrong
REFUSED = 2.0


@dataclass(frozen=True)
class EdgeRotation:
    """A_r r_s = b_r, Eqs 25-27."""

    A_r: np.ndarray  # (..., k, 9) mm²
    b_r: np.ndarray  # (..., k) mm²
    S: np.ndarray  # (..., 9) singular values of A_r, mm²
    V: np.ndarray  # (..., 9, 9) right singular vectors of A_r, in columns
    rank: np.ndarray  # (...) of A_r, up to rounding
    # (..., 9) the solution before its projection, vec(R_s) column by column
    r_s: np.ndarray
    R_sensor: np.ndarray  # (..., 3, 3)


@dataclass(frozen=True)
class EdgeTranslation:
    """A_t T_s = b_t, Eqs 28-35."""

    u_b: np.ndarray  # (..., 3) unit direction of the edge in the base frame
    rank: np.ndarray  # (...) of A_t, up to rounding
    T_sensor: np.ndarray  # (..., 3) mm
    p_b: np.ndarray  # (..., G, N, 3) the edge points in the base frame, mm


@dataclass(frozen=True)
class EdgeSolution:
    """The sensor pose on the flange: rotation first, then translation, with every
    quantity on the way.
    """

    rotation: EdgeRotation
    translation: EdgeTranslation

    @property
    def R_sensor(self) -> np.ndarray:
        """(..., 3, 3) from sensor to flange."""
        return self.rotation.R_sensor

    @property
    def T_sensor(self) -> np.ndarray:
        """(..., 3) mm, the sensor's origin in the flange frame."""
        return self.translation.T_sensor

    @property
    def u_b(self) -> np.ndarray:
        """(..., 3) direction of the edge in the base frame."""
        return self.translation.u_b

    @property
    def p_b(self) -> np.ndarray:
        """(..., G, N, 3) the edge points in the base frame, mm."""
        return self.translation.p_b


def edge_equations(R_b, T_b, p_s) -> EdgeSolution:
    """Both phases, without guards: `closed_form` has them."""
    rotation = solve_rotation(R_b, T_b, p_s)
    return EdgeSolution(rotation, solve_translation(R_b, T_b, p_s, rotation.R_sensor))


def difference_vectors(T_b, p_s) -> tuple[np.ndarray, np.ndarray]:
    """u_s and u_t of Eq. 5, both (..., G, N - 1, 3): from a group's first point and
    position to its others.
    """
    x, z = np.moveaxis(p_s[..., 1:, :] - p_s[..., :1, :], -1, 0)
    return np.stack([x, np.zeros_like(x), z], axis=-1), T_b[..., 1:, :] - T_b[
        ..., :1, :
    ]


def fewer_vectors(u_s, u_t) -> tuple[np.ndarray, np.ndarray]:
    """At most five vectors a group, whose pairs make up the same sum of squares as all
    pairs of the given ones.

    Eq. 8 holds 2×2 minors of the rows (u_s, u_t), five numbers each. By Cauchy and
    Binet, sums of products of these minors over all pairs of rows follow from the rows'
    5×5 moment matrix alone, which their QR factor shares.
    """
    factor = np.linalg.qr(np.concatenate([u_s[..., ::2], u_t], axis=-1), mode="r")
    x, z = factor[..., 0], factor[..., 1]
    return np.stack([x, np.zeros_like(x), z], axis=-1), factor[..., 2:]


def transposed_skew(a) -> np.ndarray:
    """[a]ₓᵀ of Eq. 17, (..., 3, 3): [a]ₓᵀ v = v × a."""
    zero = np.zeros_like(a[..., 0])
    a1, a2, a3 = np.moveaxis(a, -1, 0)
    rows = [[zero, a3, -a2], [-a3, zero, a1], [a2, -a1, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_system(R_b, T_b, p_s) -> tuple[np.ndarray, np.ndarray]:
    """A_r (..., k, 9) and b_r (..., k) of Eq. 25, from `fewer_vectors` with the
    least-squares problem of all pairs.
    """
    return pair_equations(R_b, *fewer_vectors(*difference_vectors(T_b, p_s)))


def pair_equations(R_b, u_s, u_t) -> tuple[np.ndarray, np.ndarray]:
    """A_r and b_r, stacked over all pairs, within each group, of vectors u_s and u_t
    (..., G, n, 3).
    """
    i, j = np.triu_indices(u_s.shape[-2], 1)
    C = transposed_skew(u_t) @ R_b[..., None, :, :]
    x, z = u_s[..., 0, None, None], u_s[..., 2, None, None]
    x_i, z_i, C_i, x_j, z_j, C_j = (a[..., k, :, :] for k in (i, j) for a in (x, z, C))
    # Eqs 13-15 and 21-24, a column of R_s at a time: u_s has no y, and u_s[i] × u_s[j]
    # has nothing else
    columns = (
        x_i * C_j - x_j * C_i,
        (z_i * x_j - z_j * x_i) * R_b[..., None, :, :],
        z_i * C_j - z_j * C_i,
    )
    A_r = np.concatenate(columns, axis=-1)
    b_r = -np.cross(u_t[..., i, :], u_t[..., j, :])  # Eq. 16
    batch = A_r.shape[:-4]
    return A_r.reshape(*batch, -1, 9), b_r.reshape(*batch, -1)


def least_squares(A, b, zero) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The solution V S⁺ Uᵀ b of least norm, S, V and the rank, for A (..., k, n) and b
    (..., k). Singular values up to `zero` (...) count as zero. The text after Eq. 26
    prints S where S⁺ is meant.
    """
    U, S, Vt = np.linalg.svd(A, full_matrices=False)
    significant = np.asarray(zero)[..., None] < S
    c = (U.mT @ b[..., None])[..., 0]
    c = np.divide(c, S, out=np.zeros_like(c), where=significant)
    V = Vt.mT
    return (V @ c[..., None])[..., 0], S, V, significant.sum(axis=-1)


def unvec(r) -> np.ndarray:
    """The matrices (..., 3, 3) whose columns r (..., 9) lists one after the other."""
    return r.reshape(*r.shape[:-1], 3, 3).mT


def solve_rotation(R_b, T_b, p_s) -> EdgeRotation:
    """Phase one, Eqs 25-27."""
    A_r, b_r = rotation_system(R_b, T_b, p_s)
    r_s, S, V, rank = least_squares(A_r, b_r, rounding_of_rotation(T_b, p_s))
    return EdgeRotation(A_r, b_r, S, V, rank, r_s, nearest_rotation(unvec(r_s)))


def rounding_of_rotation(T_b, p_s) -> np.ndarray:
    """What rounding can add to a singular value of A_r, (...), mm². It moves each
    vector u by up to δ and the row block of a pair by δ (|u_i| + |u_j|); over all pairs
    of m vectors a group, the squares sum to at most 2 m δ² Σ|u|².
    """
    u_s, u_t = difference_vectors(T_b, p_s)
    delta = 4 * np.finfo(float).eps * np.abs(T_b).max(axis=(-3, -2, -1))
    return delta * np.sqrt(2 * u_s.shape[-2] * (u_s**2 + u_t**2).sum(axis=(-3, -2, -1)))


def noise_gain(v, R_b, T_b, p_s) -> np.ndarray:
    """Root mean square of |A_r v| (...), mm², where noise of 1 mm in the sensed points
    is all that makes it up.

    For v (..., 9) of unit length, to first order: the row block of pair (i, j) changes
    by g_j when u_s[i] does, by -g_i when u_s[j] does, and by their difference when the
    common first point does.
    """
    u_s, u_t = difference_vectors(T_b, p_s)
    W = R_b @ unvec(v)[..., None, :, :]  # (..., G, 3, 3)
    count, total = u_s.shape[-2], 0
    for axis in np.eye(3)[::2]:  # x and z, the coordinates that carry noise
        g = np.cross(axis, u_s) @ W.mT + np.cross((W @ axis)[..., None, :], u_t)
        squares = (g**2).sum(axis=(-3, -2, -1))
        total = (
            total + (2 * count - 1) * squares - (g.sum(axis=-2) ** 2).sum(axis=(-2, -1))
        )
    return np.sqrt(total)


def principal_direction(vectors) -> np.ndarray:
    """Unit vector (..., 3) along which vectors (..., n, 3) extend most; its largest
    component is positive.
    """
    direction = np.linalg.svd(vectors, full_matrices=False)[2][..., 0, :]
    largest = np.take_along_axis(
        direction, np.abs(direction).argmax(axis=-1)[..., None], axis=-1
    )
    return direction * np.sign(largest)


def translation_system(R_b, p, u_b) -> tuple[np.ndarray, np.ndarray]:
    """A_t (..., 3 G, 3) and b_t (..., 3 G) of Eq. 34 from p = R_b R_s p_s + T_b (...,
    G, N, 3), mm: each group's difference from the mean of all, scaled to the sum of
    squares of all pairs between groups (Eqs 30-33).
    """
    G, N = p.shape[-3:-1]
    weight = N * np.sqrt(G)
    C = weight * (R_b - R_b.mean(axis=-3, keepdims=True))
    d = weight * (p.mean(axis=-2) - p.mean(axis=(-3, -2))[..., None, :])
    A_t = transposed_skew(u_b)[..., None, :, :] @ C  # Eq. 33
    b_t = -np.cross(d, u_b[..., None, :])  # Eq. 31
    return A_t.reshape(*A_t.shape[:-3], -1, 3), b_t.reshape(*b_t.shape[:-2], -1)


def solve_translation(R_b, T_b, p_s, R_sensor) -> EdgeTranslation:
    """Phase two, Eqs 28-35, with the rotation R_sensor (..., 3, 3) of phase one."""
    in_flange = p_s @ R_sensor[..., ::2].mT[..., None, :, :]
    p = in_flange @ R_b.mT + T_b
    vectors = p[..., 1:, :] - p[..., :1, :]  # Eq. 5
    u_b = principal_direction(vectors.reshape(*vectors.shape[:-3], -1, 3))
    A_t, b_t = translation_system(R_b, p, u_b)
    # of nine entries of R_b, in each of G N equations
    rounding = 12 * np.finfo(float).eps * p.shape[-3] * p.shape[-2]
    T_sensor, _, _, rank = least_squares(A_t, b_t, rounding)
    p_b = p + (R_b @ T_sensor[..., None, :, None])[..., None, :, 0]
    return EdgeTranslation(u_b, rank, T_sensor, p_b)


def estimate_noise(T_b, p_s) -> np.ndarray:
    """Standard deviation (...) of the sensed points, mm, from the groups'
    `affine_residuals`; NaN without any.
    """
    residuals, _, freedom = affine_residuals(T_b, p_s)
    squares, freedom = (residuals**2).sum(axis=(-3, -2, -1)), 2 * freedom.sum(axis=-1)
    return np.sqrt(
        np.divide(
            squares, freedom, out=np.full_like(squares, np.nan), where=freedom > 0
        )
    )


def rotation_strength(R_b, T_b, p_s, rotation: EdgeRotation) -> np.ndarray:
    """Smallest singular value of A_r over what noise, estimated from the data, makes of
    a zero, (...): 0 where A_r lacks rank, else NaN where the noise cannot be estimated.
    """
    from_noise = estimate_noise(T_b, p_s) * noise_gain(
        rotation.V[..., -1], R_b, T_b, p_s
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(rotation.rank < 9, 0, rotation.S[..., -1] / from_noise)
