"""Spheres, circles and ellipses through points, in batches; what affine functions leave
of values.

Circle and ellipse minimise an algebraic distance under a quadratic constraint.
Eliminating the linear coefficients leaves a symmetric 3×3 problem, whose eigenvalue
solves one scalar equation (`_secular`): no `eig`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

ROUNDS = 60  # Newton's steps at most; four or five are usual
# a step this small, as a fraction of the eigenvalue's scale, is rounding: the next
# would be its square
SETTLED = 1e-14


def from_components(*components) -> np.ndarray:
    """Vectors (..., k) from k arrays (...), each component contiguous in memory: NumPy
    is fast along long axes only.
    """
    return np.moveaxis(np.stack(components), 0, -1)


@dataclass(frozen=True)
class Ellipse:
    """The points p with (p - centre)ᵀ shape⁻¹ (p - centre) = 1; an affine map A takes
    shape to A shape Aᵀ.
    """

    centre: np.ndarray  # (..., 2)
    shape: np.ndarray  # (..., 2, 2), its eigenvalues are the squares of the semi-axes


def fit_ellipse(points) -> Ellipse:
    """The ellipse-specific direct fit of Pilu, Fitzgibbon and Fisher (disk paper's ref.
    [21]) to points (..., k, 2), k ≥ 5. No affine map changes the fit, so the points are
    first given unit covariance.
    """
    points = np.asarray(points, dtype=float)
    mean = points.mean(axis=-2)
    x, z = np.moveaxis(points - mean[..., None, :], -1, 0)
    xx, xz, zz = (
        np.einsum("...i,...i->...", a, b) / x.shape[-1]
        for a, b in ((x, x), (x, z), (z, z))
    )
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # points on one line or repeated: NaN
        tilt = xz / xx
        width, height = np.sqrt(xx), np.sqrt(zz - xz * tilt)
        u, v = x / width[..., None], (z - tilt[..., None] * x) / height[..., None]
        unit = ellipse_from_moments(moments(u, v))
    map_ = np.zeros((*mean.shape, 2))
    map_[..., 0, 0], map_[..., 1, 0], map_[..., 1, 1] = width, tilt * width, height
    return transformed(unit, map_, mean)


def transformed(ellipse: Ellipse, map_, shift) -> Ellipse:
    """The ellipse after p ↦ map_ p + shift, with map_ (..., 2, 2) and shift (..., 2)."""
    centre = np.einsum("...ab,...b->...a", map_, ellipse.centre) + shift
    return Ellipse(
        centre, np.einsum("...ab,...bc,...dc->...ad", map_, ellipse.shape, map_)
    )


def moments(u, v, work=(None, None, None)) -> dict:
    """Means over the last axis of u^a v^b for 1 ≤ a + b ≤ 4: {(a, b): (...)}. `work`:
    memory for u², uv and v².
    """
    count = u.shape[-1]
    uu, uv, vv = (
        np.multiply(*pair, out=out)
        for pair, out in zip(((u, u), (u, v), (v, v)), work, strict=True)
    )
    low = {(1, 0): u, (0, 1): v, (2, 0): uu, (1, 1): uv, (0, 2): vv}
    mean = {power: values @ np.full(count, 1 / count) for power, values in low.items()}
    for a, b in [
        (3, 0),
        (2, 1),
        (1, 2),
        (0, 3),
        (4, 0),
        (3, 1),
        (2, 2),
        (1, 3),
        (0, 4),
    ]:
        square = (2, 0) if a >= 2 else (0, 2)
        mean[a, b] = np.vecdot(low[square], low[a - square[0], b - square[1]]) / count
    return mean


def ellipse_from_moments(mean: dict) -> Ellipse:
    """The ellipse-specific direct fit from the means of x^a z^b, {(a, b): (...)}, as
    `moments` gives them.

    Minimises ⟨(A x² + B xz + C z² + D x + E z + F)²⟩ with 4AC - B² = 4. The linear
    coefficients follow from the quadratic ones; these are a multiple of A, C = 1 ± β
    and B = 2γ, for which the constraint holds 1 - β² - γ² fixed.
    """
    linear, quadratic = [(1, 0), (0, 1)], [(2, 0), (1, 1), (0, 2)]
    mean = dict(zip(mean, np.broadcast_arrays(*mean.values()), strict=True))

    def covariances(first, second):
        return np.array(
            [
                [mean[a + c, b + d] - mean[a, b] * mean[c, d] for c, d in second]
                for a, b in first
            ]
        )

    (xx, xz), (_, zz) = covariances(linear, linear)
    crossed = covariances(linear, quadratic)
    inverse = np.array([[zz, -xz], [-xz, xx]]) / (xx * zz - xz * xz)
    # D and E take these multiples of -A, -B and -C
    slopes = np.einsum("ij...,jk...->ik...", inverse, crossed)
    unexplained = covariances(quadratic, quadratic) - np.einsum(
        "ij...,ik...->jk...", crossed, slopes
    )
    # A, B and C by 1, β and γ
    basis = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, -1.0, 0.0]])
    half = np.tensordot(basis.T, unexplained, 1)
    reduced = np.tensordot(basis.T, np.swapaxes(half, 0, 1), 1)
    beta, gamma = _secular(reduced[np.triu_indices(3)], sign=1)
    A, B, C = 1 + beta, 2 * gamma, 1 - beta
    D, E = -np.einsum("ij...,j...->i...", slopes, np.array([A, B, C]))
    determinant = 4 * A * C - B * B
    x, z = (B * E - 2 * C * D) / determinant, (B * D - 2 * A * E) / determinant
    at_mean = (
        A * mean[2, 0]
        + B * mean[1, 1]
        + C * mean[0, 2]
        + D * mean[1, 0]
        + E * mean[0, 1]
    )  # it is -F
    scale = 2 * (at_mean - (D * x + E * z) / 2) / determinant
    shape = from_components(2 * scale * C, -scale * B, -scale * B, 2 * scale * A)
    return Ellipse(from_components(x, z), shape.reshape(*shape.shape[:-1], 2, 2))


def _secular(entries, sign: int):
    """The v₁, v₂ that minimise vᵀ M v with v₀² - sign (v₁² + v₂²) fixed, v₀ = 1;
    symmetric M as 00, 01, 02, 11, 12, 22.

    The eigenvalue λ is a root of g(λ) = M₀₀ - λ - mᵀ (M₁₁ + sign λ I)⁻¹ m, which is
    concave and falls. For sign = 1 Newton's steps from λ = M₀₀, where g ≤ 0, descend to
    the positive root; for -1 from λ = 0 to the smallest.
    """
    pp, pq, pt, qq, qt, tt = entries
    value = pp if sign > 0 else np.zeros_like(pp)
    for _ in range(ROUNDS):
        first, second = qq + sign * value, tt + sign * value
        determinant = first * second - qt * qt
        q, t = (
            (qt * pt - second * pq) / determinant,
            (qt * pq - first * pt) / determinant,
        )
        step = (pp - value + pq * q + pt * t) / (1 - sign * (q * q + t * t))
        value = value + step
        if not (np.abs(step) > SETTLED * pp).any():
            break
    return q, t


def fit_circle(points) -> np.ndarray:
    """Circles (..., 3) as x, z, r through points (..., k, 2), k ≥ 3, by Taubin's fit,
    which minimises ⟨d²⟩/⟨|∇d|²⟩ of the algebraic distance d; ⟨d²⟩ alone makes circles
    too small on noisy arcs.
    """
    points = np.asarray(points, dtype=float)
    mean = points.mean(axis=-2)
    x, z = np.moveaxis(points - mean[..., None, :], -1, 0)
    w = x * x + z * z
    pairs = {
        "xx": (x, x),
        "xz": (x, z),
        "zz": (z, z),
        "wx": (w, x),
        "wz": (w, z),
        "ww": (w, w),
    }
    sums = {
        name: np.einsum("...i,...i->...", *pair) / x.shape[-1]
        for name, pair in pairs.items()
    }
    circle = circle_from_moments(sums)
    circle[..., :2] += mean
    return circle


def circle_from_moments(mean: dict) -> np.ndarray:
    """As `fit_circle`, from the means of xx, xz, zz, wx, wz and ww about the centroid,
    where w = x² + z².
    """
    xx, xz, zz, wx, wz = (mean[name] for name in ("xx", "xz", "zz", "wx", "wz"))
    w = xx + zz
    # (w - ⟨w⟩) + B x + C z, with 4⟨w⟩ + B² + C² fixed: unit weights once the first
    # column is divided by 2√⟨w⟩
    unit = 2 * np.sqrt(w)
    B, C = _secular(
        ((mean["ww"] - w * w) / unit**2, wx / unit, wz / unit, xx, xz, zz), sign=-1
    )
    B, C = unit * B, unit * C
    return np.stack([-B / 2, -C / 2, np.sqrt(w + (B * B + C * C) / 4)], axis=-1)


def fit_sphere(points) -> tuple[np.ndarray, np.ndarray]:
    """Centres (..., d) and radii (...) of the spheres, or circles, algebraically
    nearest to points (..., n, d): |p|² = 2 c·p + k by linear least squares (edge
    paper's ref. [36]). Where the points leave the centre open, as those on one circle
    in space do, it is the nearest to their middle.
    """
    middle = points.mean(axis=-2, keepdims=True)
    p = points - middle
    square = np.sum(p**2, axis=-1, keepdims=True)
    mean_square = square.mean(axis=-2, keepdims=True)
    pt = p.mT
    H = pt @ p
    ridge = (
        1e-13
        * np.trace(H, axis1=-2, axis2=-1)[..., None, None]
        * np.eye(points.shape[-1])
    )  # rounding is less
    centre = np.linalg.solve(H + ridge, pt @ (square - mean_square))[..., 0] / 2
    radius = np.sqrt(mean_square[..., 0, 0] + np.sum(centre**2, axis=-1))
    return middle[..., 0, :] + centre, radius


def principal_axes(points) -> np.ndarray:
    """Unit vectors, rows of (..., 3, 3), along which points (..., n, 3) spread about
    their mean, most first.
    """
    return np.linalg.svd(
        points - points.mean(axis=-2, keepdims=True), full_matrices=False
    )[2]


def affine_residuals(
    positions: np.ndarray, values: np.ndarray, weights: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What an affine function of positions (..., n, 3) leaves of values (..., n, k).

    Inside a rotation group the sensed point of a straight edge, or a marked point, is
    such a function of the flange position, whatever the calibration: what is left is
    noise. `weights` (..., n): 1 / standard deviation of a value, 0 of one to leave out.

    Returns the weighted residuals (..., n, k); the orthonormal basis (..., n, 4) of
    what is taken out, its columns zero for directions in which the positions do not
    extend; and the number of weights less that of the other columns, (...).
    """
    n = positions.shape[-2]
    weight = np.ones((n, 1)) if weights is None else np.asarray(weights)[..., None]
    constant = weight / np.linalg.norm(weight, axis=-2, keepdims=True)
    mean = (constant**2 * positions).sum(axis=-2, keepdims=True)
    U, S, _ = np.linalg.svd(weight * (positions - mean), full_matrices=False)
    farthest = np.abs(weight * positions).max(axis=(-2, -1))[..., None]
    rounding = n * np.finfo(float).eps * farthest
    # an arc leaves its plane, a line itself, by less
    extends = np.maximum(1e-3 * S[..., :1], rounding) < S
    constant = np.broadcast_to(constant, (*U.shape[:-1], 1))
    basis = np.concatenate([constant, U * extends[..., None, :]], axis=-1)
    residuals = weight * values
    residuals = residuals - basis @ (basis.mT @ residuals)
    count = np.count_nonzero(weight, axis=(-2, -1))
    return residuals, basis, count - 1 - extends.sum(axis=-1)
