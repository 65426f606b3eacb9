"""Lines, spheres, circles and ellipses through points, in batches.

The fits of circle and ellipse minimise an algebraic distance under a quadratic constraint. Eliminating the linear
coefficients leaves a symmetric 3×3 problem, whose eigenvalue solves one scalar equation: no iteration over the points,
no `eig`.
"""

from dataclasses import dataclass

import numpy as np

ROUNDS = 60  # Newton's steps at most; four or five are usual
SETTLED = 1e-14  # a step this small, as a fraction of the eigenvalue's scale, is rounding: the next would be its square
LEAST_WIDTH = 1e-3  # of the positions' length: an arc leaves its plane, and a line its direction, by rounding only


def from_components(*components) -> np.ndarray:
    """Vectors (..., k) from k arrays (...), each component contiguous in memory: NumPy is fast along long axes only."""
    return np.moveaxis(np.stack(components), 0, -1)


@dataclass(frozen=True)
class Ellipse:
    """The points p with (p - centre)ᵀ shape⁻¹ (p - centre) = 1; an affine map A takes shape to A shape Aᵀ."""

    centre: np.ndarray  # (..., 2)
    shape: np.ndarray  # (..., 2, 2), its eigenvalues are the squares of the semi-axes


def fit_ellipse(points) -> Ellipse:
    """The ellipse-specific direct fit of Pilu, Fitzgibbon and Fisher (ref. [21] of the disk paper).

    Points (..., k, 2), k ≥ 5. The fit is invariant under affine maps, so the points are first given unit covariance.
    """
    points = np.asarray(points, dtype=float)
    mean = points.mean(axis=-2)
    x, z = np.moveaxis(points - mean[..., None, :], -1, 0)
    xx, xz, zz = (np.einsum("...i,...i->...", a, b) / x.shape[-1] for a, b in ((x, x), (x, z), (z, z)))
    with np.errstate(divide="ignore", invalid="ignore"):  # points on one line or repeated: NaN
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
    return Ellipse(centre, np.einsum("...ab,...bc,...dc->...ad", map_, ellipse.shape, map_))


def moments(u, v, work=(None, None, None)) -> dict:
    """Means over the last axis of u^a v^b for 1 ≤ a + b ≤ 4: {(a, b): (...)}. `work`: memory for u², uv and v²."""
    count = u.shape[-1]
    uu, uv, vv = (np.multiply(*pair, out=out) for pair, out in zip(((u, u), (u, v), (v, v)), work, strict=True))
    low = {(1, 0): u, (0, 1): v, (2, 0): uu, (1, 1): uv, (0, 2): vv}
    mean = {power: values @ np.full(count, 1 / count) for power, values in low.items()}
    for a, b in [(3, 0), (2, 1), (1, 2), (0, 3), (4, 0), (3, 1), (2, 2), (1, 3), (0, 4)]:
        square = (2, 0) if a >= 2 else (0, 2)
        mean[a, b] = np.vecdot(low[square], low[a - square[0], b - square[1]]) / count
    return mean


def ellipse_from_moments(mean: dict) -> Ellipse:
    """The ellipse-specific direct fit from the means of x^a z^b, {(a, b): (...)}, as `moments` gives them.

    Minimises ⟨(A x² + B xz + C z² + D x + E z + F)²⟩ with 4AC - B² fixed. With p = x² + z², q = x² - z² and t = 2xz the
    polynomial is a multiple of p + β q + γ t + D x + E z + F, and the constraint holds 1 - β² - γ² fixed.
    """
    x, z, xx, xz, zz = (mean[power] for power in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2)))
    means = {"x": x, "z": z, "p": xx + zz, "q": xx - zz, "t": 2 * xz} | {"xx": xx, "xz": xz, "zz": zz}
    means |= {"px": mean[3, 0] + mean[1, 2], "qx": mean[3, 0] - mean[1, 2], "tx": 2 * mean[2, 1]}
    means |= {"pz": mean[2, 1] + mean[0, 3], "qz": mean[2, 1] - mean[0, 3], "tz": 2 * mean[1, 2]}
    means |= {"pt": 2 * (mean[3, 1] + mean[1, 3]), "qt": 2 * (mean[3, 1] - mean[1, 3]), "tt": 4 * mean[2, 2]}
    ends = mean[4, 0] + mean[0, 4]
    means |= {"pp": ends + 2 * mean[2, 2], "pq": mean[4, 0] - mean[0, 4], "qq": ends - 2 * mean[2, 2]}

    def covariance(f, g):
        return means[f + g] - means[f] * means[g]

    xx, xz, zz = covariance("x", "x"), covariance("x", "z"), covariance("z", "z")
    determinant = xx * zz - xz * xz
    with_x, with_z = ({f: covariance(f, g) for f in "pqt"} for g in "xz")
    D = {f: (zz * with_x[f] - xz * with_z[f]) / determinant for f in "pqt"}
    E = {f: (xx * with_z[f] - xz * with_x[f]) / determinant for f in "pqt"}

    def unexplained(f, g):  # by the linear terms
        return covariance(f, g) - with_x[f] * D[g] - with_z[f] * E[g]

    beta, gamma = _secular([unexplained(*pair) for pair in ("pp", "pq", "pt", "qq", "qt", "tt")], sign=1)
    D, E = (-(of["p"] + of["q"] * beta + of["t"] * gamma) for of in (D, E))
    F = -(means["p"] + beta * means["q"] + gamma * means["t"] + D * x + E * z)

    A, C = 1 + beta, 1 - beta
    area = A * C - gamma * gamma
    centre_x, centre_z = (gamma * E - C * D) / (2 * area), (gamma * D - A * E) / (2 * area)
    scale = -(F + (D * centre_x + E * centre_z) / 2) / area
    shape = from_components(scale * C, -scale * gamma, -scale * gamma, scale * A)
    return Ellipse(from_components(centre_x, centre_z), shape.reshape(*shape.shape[:-1], 2, 2))


def _secular(entries, sign: int):
    """Minimise vᵀ M v with v₀² - sign (v₁² + v₂²) fixed, for symmetric M given as 00, 01, 02, 11, 12, 22; v₀ = 1.

    Returns v₁, v₂. The eigenvalue λ is a root of g(λ) = M₀₀ - λ - mᵀ (M₁₁ + sign λ I)⁻¹ m, which is concave and
    falls. For sign = 1 Newton's steps from λ = M₀₀, where g ≤ 0, descend to the positive root without fail.
    For sign = -1 the smallest root is sought, from λ = 0, where g ≥ 0.
    """
    pp, pq, pt, qq, qt, tt = entries
    value = pp if sign > 0 else np.zeros_like(pp)
    for _ in range(ROUNDS):
        first, second = qq + sign * value, tt + sign * value
        determinant = first * second - qt * qt
        q, t = (qt * pt - second * pq) / determinant, (qt * pq - first * pt) / determinant
        step = (pp - value + pq * q + pt * t) / (1 - sign * (q * q + t * t))
        value = value + step
        if not (np.abs(step) > SETTLED * pp).any():
            break
    return q, t


def fit_circle(points, method: str = "taubin") -> np.ndarray:
    """Circles (..., 3) as x, z, r through points (..., k, 2), k ≥ 3.

    "taubin" minimises ⟨d²⟩/⟨|∇d|²⟩ of the algebraic distance d, "kasa" ⟨d²⟩ alone, whose circles are too small on noisy
    arcs.
    """
    points = np.asarray(points, dtype=float)
    mean = points.mean(axis=-2)
    x, z = np.moveaxis(points - mean[..., None, :], -1, 0)
    w = x * x + z * z
    pairs = {"xx": (x, x), "xz": (x, z), "zz": (z, z), "wx": (w, x), "wz": (w, z), "ww": (w, w)}
    sums = {name: np.einsum("...i,...i->...", *pair) / x.shape[-1] for name, pair in pairs.items()}
    circle = circle_from_moments(sums, method)
    circle[..., :2] += mean
    return circle


def circle_from_moments(mean: dict, method: str = "taubin") -> np.ndarray:
    """As `fit_circle`, from the means of xx, xz, zz, wx, wz and ww about the centroid, where w = x² + z²."""
    if method not in ("taubin", "kasa"):
        raise ValueError(f"method is {method!r}; expected 'taubin' or 'kasa'")
    xx, xz, zz, wx, wz = (mean[name] for name in ("xx", "xz", "zz", "wx", "wz"))
    w = xx + zz
    if method == "kasa":
        determinant = xx * zz - xz * xz
        B, C = (xz * wz - zz * wx) / determinant, (xz * wx - xx * wz) / determinant
    else:
        # (w - ⟨w⟩) + B x + C z, with 4⟨w⟩ + B² + C² fixed: unit weights once the first column is divided by 2√⟨w⟩
        unit = 2 * np.sqrt(w)
        B, C = _secular(((mean["ww"] - w * w) / unit**2, wx / unit, wz / unit, xx, xz, zz), sign=-1)
        B, C = unit * B, unit * C
    return np.stack([-B / 2, -C / 2, np.sqrt(w + (B * B + C * C) / 4)], axis=-1)


@dataclass(frozen=True)
class Line:
    """Lines in any dimension, through `point` along the unit vector `direction`."""

    point: np.ndarray  # (..., d)
    direction: np.ndarray  # (..., d)
    rms: np.ndarray  # (...) of the distances of the points that it was fitted to


def fit_line(points, kept=None) -> Line:
    """The lines with the least sum of squared distances from points (..., n, d), or from those `kept` (..., n).

    NaN where fewer than two are.
    """
    kept = np.ones(points.shape[:-1], dtype=bool) if kept is None else kept
    count = kept.sum(axis=-1)
    share = kept / np.where(count < 2, np.nan, count)[..., None]
    centre = (share[..., None] * points).sum(axis=-2)
    offsets = kept[..., None] * (points - centre[..., None, :])
    direction = np.linalg.eigh(np.nan_to_num(np.swapaxes(offsets, -1, -2) @ offsets))[1][..., -1]
    along = (offsets @ direction[..., None])[..., 0]
    off_line = offsets - along[..., None] * direction[..., None, :]
    return Line(centre, direction, np.sqrt((share * (off_line**2).sum(axis=-1)).sum(axis=-1)))


@dataclass(frozen=True)
class Sphere:
    """Spheres with `centre` and `radius`, mm."""

    centre: np.ndarray  # (..., 3)
    radius: np.ndarray  # (...)
    rms: np.ndarray  # (...) of the distances of the points from the sphere that was fitted to them


def fit_sphere(points) -> Sphere:
    """Spheres through points (..., n, 3), n ≥ 4, not all in one plane.

    The linear least-squares fit of |p|² = 2 c·p + k that the edge paper takes (its ref. [36]), about the points' mean.
    """
    mean = points.mean(axis=-2, keepdims=True)
    p = points - mean
    squares = (p**2).sum(axis=-1)
    A = np.concatenate([2 * p, np.ones_like(p[..., :1])], axis=-1)
    AtA, Atb = np.swapaxes(A, -1, -2) @ A, (np.swapaxes(A, -1, -2) @ squares[..., None])
    solution = np.linalg.solve(AtA, Atb)[..., 0]
    c = solution[..., :3]
    radius = np.sqrt(solution[..., 3] + (c**2).sum(axis=-1))
    residuals = np.linalg.norm(p - c[..., None, :], axis=-1) - radius[..., None]
    return Sphere(c + mean[..., 0, :], radius, np.sqrt((residuals**2).mean(axis=-1)))


def algebraic_centre(points) -> np.ndarray:
    """The centre (..., d) of the sphere or circle nearest to points (..., n, d) algebraically: |p|² = 2 p·c + constant.

    Where the points leave it open, as those on one circle do, it is the nearest to their middle.
    """
    middle = points.mean(axis=-2, keepdims=True)
    p = points - middle
    square = np.sum(p**2, axis=-1, keepdims=True)
    square = square - square.mean(axis=-2, keepdims=True)
    H = np.swapaxes(p, -1, -2) @ p
    ridge = 1e-9 * np.trace(H, axis1=-2, axis2=-1)[..., None, None] * np.eye(points.shape[-1])
    return middle[..., 0, :] + 0.5 * np.linalg.solve(H + ridge, np.swapaxes(p, -1, -2) @ square)[..., 0]


def principal_axes(points) -> np.ndarray:
    """Unit vectors, rows of (..., 3, 3), along which points (..., n, 3) spread about their mean, most first."""
    return np.linalg.svd(points - points.mean(axis=-2, keepdims=True), full_matrices=False)[2]


def affine_residuals(positions, values, weight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a weighted affine regression of values (..., n, k) on positions (..., n, 3) leaves, (..., n, k), times the
    roots of the weights (..., n); the orthonormal basis (..., n, 4) of what it can explain, with zeros for directions
    in which the positions do not extend; and the degrees of freedom that remain, (...)."""
    root = np.sqrt(weight)[..., None]
    constant = root / np.linalg.norm(root, axis=-2, keepdims=True)
    offsets = root * (positions - (constant**2 * positions).sum(axis=-2, keepdims=True))
    U, size, _ = np.linalg.svd(offsets, full_matrices=False)
    n = positions.shape[-2]
    rounding = n * np.finfo(float).eps * np.abs(root * positions).max(axis=(-2, -1))[..., None]
    extends = np.maximum(LEAST_WIDTH * size[..., :1], rounding) < size
    basis = np.concatenate([constant, U * extends[..., None, :]], axis=-1)
    left = root * values
    return left - basis @ (np.swapaxes(basis, -1, -2) @ left), basis, n - 1 - extends.sum(axis=-1)
