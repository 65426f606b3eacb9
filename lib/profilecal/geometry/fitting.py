"""Spheres, circles and ellipses through points, in batches; what affine functions leave
of values.

Circle and ellipse minimise an algebraic distance under a quadratic constraint.
Eliminating the linear coefficients leaves a symmetric 3×3 problem, whose eigenvalue
solves one scalar equation (`_secular`): no `eig`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.poses import carry

ROUNDS = 60  # Newton's steps at most; four or five are usual
# a step this small, as a fraction of the eigenvalue's scale, is rounding: the next
# would be its square
SETTLED = 1e-14


def from_components(*components: ndarray) -> ndarray:
    """Vectors (..., k) from k arrays (...), each component contiguous in memory.

    NumPy is fast along long axes only.
    """
    return np.moveaxis(np.stack(components), 0, -1)


@dataclass(frozen=True)
class Ellipse:
    """The points p with (p - centre)ᵀ shape⁻¹ (p - centre) = 1.

    An affine map A takes shape to A shape Aᵀ.
    """

    centre: ndarray  # (..., 2)
    shape: ndarray  # (..., 2, 2), its eigenvalues are the squares of the semi-axes


def fit_ellipse(points: ndarray) -> Ellipse:
    """The ellipse-specific direct fit to points (..., k, 2), k ≥ 5.

    It is that of Pilu, Fitzgibbon and Fisher (disk paper's ref. [21]). No affine map
    changes the fit, so the points are first given zero mean and unit spread. Repeated
    points give NaN.
    """
    mean = points.mean(axis=-2, keepdims=True)
    spread = points.std(axis=-2, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, z = np.moveaxis((points - mean) / spread, -1, 0)
        unit = ellipse_from_moments(moments(x, z))
    return transformed(unit, spread * np.eye(2), mean[..., 0, :])


# of x and z; their products have the moments of the fourth order and less
MONOMIALS = (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)


def moments(x: ndarray, z: ndarray) -> ndarray:
    """The means (6, 6, ...) of products of `MONOMIALS`, over x and z (..., k)."""
    values = np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=-2)
    return np.moveaxis(values @ values.mT, (-2, -1), (0, 1)) / x.shape[-1]


def transformed(ellipse: Ellipse, map_: ndarray, shift: ndarray) -> Ellipse:
    """The ellipse after p ↦ map_ p + shift: map_ (..., 2, 2) and shift (..., 2)."""
    centre = carry(map_, shift, ellipse.centre)
    return Ellipse(centre, map_ @ ellipse.shape @ map_.mT)


def ellipse_from_moments(mean: ndarray) -> Ellipse:
    """The ellipse-specific direct fit from `moments` (6, 6, ...).

    Minimises ⟨(A x² + B xz + C z² + D x + E z + F)²⟩ with 4AC - B² = 4. The linear
    coefficients follow from the quadratic ones; these are a multiple of A, C = 1 ± β
    and B = 2γ, for which the constraint holds 1 - β² - γ² fixed.
    """
    first = mean[0, 1:]
    covariance = mean[1:, 1:] - first[:, None] * first
    (xx, xz), (_, zz) = covariance[:2, :2]
    crossed = covariance[:2, 2:]
    inverse = np.array([[zz, -xz], [-xz, xx]]) / (xx * zz - xz * xz)
    # D and E take these multiples of -A, -B and -C
    slopes = np.einsum("ij...,jk...->ik...", inverse, crossed)
    explained = np.einsum("ij...,ik...->jk...", crossed, slopes)
    unexplained = covariance[2:, 2:] - explained
    # A, B and C by 1, β and γ
    basis = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, -1.0, 0.0]])
    half = np.tensordot(basis.T, unexplained, 1)
    reduced = np.tensordot(basis.T, np.swapaxes(half, 0, 1), 1)
    beta, gamma = _secular(reduced[np.triu_indices(3)], sign=1)

    A = 1 + beta
    B = 2 * gamma
    C = 1 - beta
    D, E = -np.einsum("ij...,j...->i...", slopes, np.array([A, B, C]))
    determinant = 4 * A * C - B * B
    x = (B * E - 2 * C * D) / determinant
    z = (B * D - 2 * A * E) / determinant
    minus_F = np.einsum("i...,i...", np.array([D, E, A, B, C]), first)
    scale = 2 * (minus_F - (D * x + E * z) / 2) / determinant
    shape = from_components(2 * scale * C, -scale * B, -scale * B, 2 * scale * A)
    return Ellipse(from_components(x, z), shape.reshape(*shape.shape[:-1], 2, 2))


def _secular(
    entries: Sequence[ndarray] | ndarray, sign: int
) -> tuple[ndarray, ndarray]:
    """The v₁, v₂ that minimise vᵀ M v with v₀² - sign (v₁² + v₂²) fixed, v₀ = 1;
    symmetric M as 00, 01, 02, 11, 12, 22.

    The eigenvalue λ is a root of g(λ) = M₀₀ - λ - mᵀ (M₁₁ + sign λ I)⁻¹ m, which is
    concave and falls. For sign = 1 Newton's steps from λ = M₀₀, where g ≤ 0, descend to
    the positive root; for -1 from λ = 0 to the smallest.
    """
    pp, pq, pt, qq, qt, tt = entries
    value = pp if sign > 0 else np.zeros_like(pp)
    for _ in range(ROUNDS):
        first = qq + sign * value
        second = tt + sign * value
        determinant = first * second - qt * qt
        q = (qt * pt - second * pq) / determinant
        t = (qt * pq - first * pt) / determinant
        step = (pp - value + pq * q + pt * t) / (1 - sign * (q * q + t * t))
        value = value + step
        if not (np.abs(step) > SETTLED * pp).any():
            break
    return q, t


def fit_circle(points: ndarray) -> ndarray:
    """Circles (..., 3) as x, z, r through points (..., k, 2), k ≥ 3, by Taubin's fit.

    It minimises ⟨d²⟩/⟨|∇d|²⟩ of the algebraic distance d; ⟨d²⟩ alone makes circles too
    small on noisy arcs. Points on one line or repeated give NaN.
    """
    mean = points.mean(axis=-2)
    x, z = np.moveaxis(points - mean[..., None, :], -1, 0)
    w = x * x + z * z
    pairs = (x, x), (x, z), (z, z), (w, x), (w, z), (w, w)
    means = [np.vecdot(*pair) / x.shape[-1] for pair in pairs]
    with np.errstate(divide="ignore", invalid="ignore"):
        circle = circle_from_moments(means)
    circle[..., :2] += mean
    return circle


def circle_from_moments(means: Sequence[ndarray] | ndarray) -> ndarray:
    """As `fit_circle`, from the means of xx, xz, zz, wx, wz and ww about the centroid,
    where w = x² + z².

    The distance is (w - ⟨w⟩) + B x + C z, with 4⟨w⟩ + B² + C² fixed: all weights are 1
    once the first term is divided by 2√⟨w⟩.
    """
    xx, xz, zz, wx, wz, ww = means
    w = xx + zz
    unit = 2 * np.sqrt(w)
    entries = (ww - w * w) / unit**2, wx / unit, wz / unit, xx, xz, zz
    beta, gamma = _secular(entries, sign=-1)
    B = unit * beta
    C = unit * gamma
    return np.stack([-B / 2, -C / 2, np.sqrt(w + (B * B + C * C) / 4)], axis=-1)


def fit_sphere(points: ndarray) -> tuple[ndarray, ndarray]:
    """Centres (..., d) and radii (...) of the spheres, or circles, algebraically
    nearest to points (..., n, d).

    |p|² = 2 c·p + k by linear least squares (edge paper's ref. [36]). Where the points
    leave the centre open, as those on one circle in space do, it is the nearest to
    their middle.
    """
    middle = middle_of(points)
    p = points - middle
    square = np.vecdot(p, p)
    inverse = np.linalg.pinv(p.mT @ p, 1e-13, hermitian=True)  # rounding is less
    centre = np.matvec(inverse, np.vecmat(square, p)) / 2
    radius = np.sqrt(square.mean(axis=-1) + np.vecdot(centre, centre))
    return middle[..., 0, :] + centre, radius


def middle_of(points: ndarray) -> ndarray:
    """The mean (..., 1, d) of points (..., n, d), in a fifth of `mean`'s time."""
    n = points.shape[-2]
    return np.full((1, n), 1 / n) @ points


def principal_axes(points: ndarray) -> ndarray:
    """Unit vectors, rows of (..., 3, 3), along which points (..., n, 3) spread about
    their mean, most first.
    """
    offsets = points - middle_of(points)
    return with_sign(np.linalg.svd(offsets, full_matrices=False)[2])


def with_sign(axes: ndarray) -> ndarray:
    """Vectors (..., n) or their opposites, whichever has its largest component
    positive: the sign that a decomposition gives them differs between processors.
    """
    highest, lowest = axes.max(axis=-1), axes.min(axis=-1)
    return np.where((highest < -lowest)[..., None], -axes, axes)


def affine_residuals(
    positions: ndarray, values: ndarray, present: ArrayLike = True
) -> ndarray:
    """What an affine function of positions (..., n, 3) leaves of values (..., n, k).

    Inside a rotation group the sensed point of a straight edge, or a marked point, is
    such a function of the flange position, whatever the calibration: what is left is
    noise. Values that are not `present` (..., n) are left out: zero is left of them.
    """
    weight = np.broadcast_to(present, positions.shape[:-1])[..., None]
    share = weight / weight.sum(axis=-2, keepdims=True)
    offsets, residuals = (
        weight * (x - (share * x).sum(axis=-2, keepdims=True))
        for x in (positions, values)
    )
    offsets[np.abs(offsets) < 1e-9] = 0  # mm: rounding
    # an arc leaves its plane, a line itself, by less than a thousandth
    slopes = np.linalg.pinv(offsets, rcond=1e-3) @ residuals
    return residuals - offsets @ slopes
