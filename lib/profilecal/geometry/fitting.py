"""Spheres, circles and ellipses through points, in batches; what affine functions leave
of values.

Circle and ellipse minimise an algebraic distance under a quadratic constraint.
Eliminating the linear coefficients leaves a symmetric 3×3 problem, whose eigenvalue
solves one scalar equation (`_secular`): no `eig`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement as pairs_of

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

ROUNDS = 60  # Newton's steps at most; four or five are usual
# a step this small, as a fraction of the eigenvalue's scale, is rounding: the next
# would be its square
SETTLED = 1e-14
# what points spread across their line, over what they spread in all, both squared,
# that is rounding
ON_LINE = 1e-12
GIVING_NAN = np.errstate(divide="ignore", invalid="ignore")  # not warnings
# of x and z; their products have the moments of the fourth order and less
MONOMIALS = (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)


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


@GIVING_NAN
def fit_ellipse(points: ndarray) -> Ellipse:
    """The ellipse-specific direct fit to points (..., k, 2), k ≥ 5.

    It is that of Pilu, Fitzgibbon and Fisher (disk paper's ref. [21]). No affine map
    changes the fit, so the points are first given zero mean and unit spread. Repeated
    points give NaN.
    """
    middle = middle_of(points)
    spread = points.std(axis=-2, keepdims=True)
    x, z = np.moveaxis((points - middle) / spread, -1, 0)
    ellipse = ellipse_from_moments(moments(x, z))
    return transformed(ellipse, spread * np.eye(2), middle[..., 0, :])


def moments(x: ndarray, z: ndarray) -> ndarray:
    """The means (6, 6, ...) of products of `MONOMIALS`, over x and z (..., k)."""
    rows = np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=-2)
    return np.moveaxis(rows @ rows.mT, (-2, -1), (0, 1)) / x.shape[-1]


def transformed(ellipse: Ellipse, map_: ndarray, shift: ndarray) -> Ellipse:
    """The ellipse after p ↦ map_ p + shift: map_ (..., 2, 2) and shift (..., 2)."""
    centre = np.matvec(map_, ellipse.centre) + shift
    return Ellipse(centre, map_ @ ellipse.shape @ map_.mT)


@GIVING_NAN
def ellipse_from_moments(mean: ndarray) -> Ellipse:
    """The ellipse-specific direct fit from `moments` (6, 6, ...).

    Minimises ⟨(A x² + B xz + C z² + D x + E z + F)²⟩ with 4AC - B² = 4. The linear
    coefficients follow from the quadratic ones; these are a multiple of A, C = 1 ± β
    and B = 2γ, for which the constraint holds 1 - β² - γ² fixed.

    With the conic as (p - c)ᵀ Q (p - c) = level, Q has the rows (A, B / 2) and
    (B / 2, C), its determinant is 1 - β² - γ², the centre c is -Q⁻¹ (D, E) / 2, and the
    level is -F - c·(D, E) / 2.
    """
    # Gauss and Jordan's elimination of F, D and E
    mean = mean.copy()
    for k in range(3):
        pivot = mean[k] / mean[k, k]
        mean -= mean[:, k, None] * pivot
        mean[k] = pivot
    linear, ((aa, ab, ac), (_, bb, bc), (_, _, cc)) = mean[:3, 3:], mean[3:, 3:]
    of_one = aa + 2 * ac + cc, aa - cc, 2 * (ab + bc)
    beta, gamma = _secular((*of_one, aa - 2 * ac + cc, 2 * (ab - bc), 4 * bb), 1)
    conic = np.stack([1 + beta, 2 * gamma, 1 - beta])
    F, D, E = -(linear * conic).sum(axis=1)
    inverse = np.array([[1 - beta, -gamma], [-gamma, 1 + beta]])
    inverse /= 1 - beta**2 - gamma**2
    x, z = -(inverse * [D, E]).sum(axis=1) / 2
    shape = inverse * (-F - (D * x + E * z) / 2)
    return Ellipse(from_components(x, z), np.moveaxis(shape, (0, 1), (-2, -1)))


def _secular(M: Sequence[ndarray], sign: int) -> ndarray:
    """The v₁, v₂ (2, ...) that minimise vᵀ M v with v₀² - sign (v₁² + v₂²) fixed and
    v₀ = 1; symmetric M as 00, 01, 02, 11, 12, 22.

    The eigenvalue λ is the positive root, the only one, for sign = 1, and the smallest
    for -1, of the characteristic polynomial g(λ) D(λ), where

        D = |M₁₁ + sign λ 1|        g = M₀₀ - λ - mᵀ (M₁₁ + sign λ 1)⁻¹ m

    All its roots are real. Newton's steps from beyond the outermost of them go to it
    and not past it: from λ = M₀₀, where g ≤ 0, down; for -1 from λ = 0 up.

    The inverse times -m is v, so that g = M₀₀ - λ + m·v and g' = sign v·v - 1; and D' /
    D = sign (a + c) / D, where a and c are the diagonal of M₁₁ + sign λ 1.
    """
    m00, m01, m02, m11, m12, m22 = M
    value, rounding = m00 * (sign > 0), SETTLED * (m00 + m11 + m22)
    for _ in range(ROUNDS):
        a, c = m11 + sign * value, m22 + sign * value
        det = a * c - m12**2
        v1 = (m12 * m02 - c * m01) / det
        v2 = (m12 * m01 - a * m02) / det
        g = m00 - value + m01 * v1 + m02 * v2
        step = g / (1 - sign * (v1**2 + v2**2 + g * (a + c) / det))
        value = value + step
        if not (np.abs(step) > rounding).any():
            break
    return np.stack([v1, v2])


def fit_circle(points: ndarray) -> ndarray:
    """Circles (..., 3) as x, z, r through points (..., k, 2), k ≥ 3, by Taubin's fit.

    It minimises ⟨d²⟩/⟨|∇d|²⟩ of the algebraic distance d; ⟨d²⟩ alone makes circles too
    small on noisy arcs. Points on one line or repeated give NaN.
    """
    middle = middle_of(points)
    x, z = np.moveaxis(points - middle, -1, 0)
    pairs = pairs_of((x * x + z * z, x, z), 2)
    circle = circle_from_moments([np.vecdot(*pair) / x.shape[-1] for pair in pairs])
    circle[..., :2] += middle[..., 0, :]
    return circle


@GIVING_NAN
def circle_from_moments(means: Sequence[ndarray] | ndarray) -> ndarray:
    """As `fit_circle`, from the means of ww, wx, wz, xx, xz and zz about the centroid,
    where w = x² + z².

    The distance is (w - ⟨w⟩) + B x + C z, with 4⟨w⟩ + B² + C² fixed: all weights are 1
    once the first term is divided by 2√⟨w⟩. The centre is -(B, C) / 2, and r² is ⟨w⟩
    and the square of the centre.
    """
    ww, wx, wz, xx, xz, zz = means
    w = xx + zz
    w = np.where(xx * zz - xz**2 > ON_LINE * w**2, w, np.nan)
    size = 2 * np.sqrt(w)
    M = (ww - w**2) / size**2, wx / size, wz / size, xx, xz, zz
    x, z = -size / 2 * _secular(M, -1)
    return from_components(x, z, np.sqrt(w + x**2 + z**2))


def fit_sphere(points: ndarray) -> tuple[ndarray, ndarray]:
    """Centres (..., d) and radii (...) of the spheres, or circles, algebraically
    nearest to points (..., n, d).

    |p|² = 2 c·p + k by linear least squares (edge paper's ref. [36]). Where the points
    leave the centre open, as those on one circle in space do, it is the nearest to
    their middle.

    From the middle, where Σ p = 0, the normal equations are 2 Σ p pᵀ c = Σ |p|² p and
    k = ⟨|p|²⟩, which is r² - |c|².
    """
    middle = middle_of(points)
    p = points - middle
    square = np.vecdot(p, p)
    # an eigenvalue that is a smaller share of the largest is rounding
    inverse = np.linalg.pinv(p.mT @ p, rcond=1e-13, hermitian=True)
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
    axes = np.linalg.eigh(offsets.mT @ offsets)[1]  # in columns, least first
    return with_sign(axes[..., ::-1].mT)


def with_sign(axes: ndarray) -> ndarray:
    """Vectors (..., n) or their opposites, whichever has its largest component
    positive: the sign that a decomposition gives them differs between processors.
    """
    high, low = axes.max(axis=-1, keepdims=True), axes.min(axis=-1, keepdims=True)
    return np.where(high < -low, -axes, axes)


def affine_residuals(
    positions: ndarray, values: ndarray, present: ArrayLike = True
) -> ndarray:
    """What an affine function of positions (..., n, 3) leaves of values (..., n, k).

    Inside a rotation group the sensed point of a straight edge, or a marked point, is
    such a function of the flange position, whatever the calibration: what is left is
    noise. Values that are not `present` (..., n), NaN or not, are left out: zero is
    left of them.
    """
    weight = np.broadcast_to(present, values.shape[:-1])[..., None]
    values = np.where(weight, values, 0)
    share = (weight / weight.sum(axis=-2, keepdims=True)).mT
    offsets = weight * (positions - share @ positions)
    offsets *= np.abs(offsets) > 1e-9  # mm: what is less is rounding
    residuals = weight * (values - share @ values)
    # it has no slope along less than a thousandth of the positions' largest extent
    slopes = np.linalg.pinv(offsets, rcond=1e-3) @ residuals
    return residuals - offsets @ slopes
