"""All that is known at a state, to first order, as one linear Gaussian model (a mixed
model; Henderson 1975):

    r + A x = Σ_k s_k Z_k u_k + e      x ~ N(0, Π⁻¹)   u_k ~ N(0, 1)   e ~ N(0, s_0²)

r are the residuals and A their derivatives, both over the scanner's noise. x are steps
of the unknowns: the sensor pose, the targets, and systematic errors, which Π knows to
be about zero (considered parameters; Schmidt 1966). u_k are errors of the flange, of
size s_k in mm or degrees, that the profiles of one visit, commanded pose or orientation
share; s_0 is the scanner's noise over the assumed one. With the variances v = s², M_0 =
1 and M_k = Z_k Z_kᵀ,

    C = Σ_k v_k M_k        H = Aᵀ C⁻¹ A + Π        V = H⁻¹        x̂ = -V Aᵀ C⁻¹ r
    P = C⁻¹ - C⁻¹ A V Aᵀ C⁻¹

V is the covariance of x and x̂ its mean. P is the precision of r where x is integrated
out, (C + A Π⁻¹ Aᵀ)⁻¹ by Woodbury's identity.

Three answers: `posterior`, what is known of x; `left_out`, how far profiles are from
what the others say; `score`, what a further error would have to be.

Profiles of different orientations share no error. Orientations (or poses, or profiles,
if only these share errors) with equally many profiles are one batch, a `Block`. What
residuals say beside the errors of their flange needs no C: it is kept as products,
`rest`.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy import ndarray

from profilecal.geometry.observability import HAND_PRECISION
from profilecal.targets.observations import PoseGroups

ROUNDING = 1e-13  # of the largest entry of a matrix of products


@dataclass(frozen=True)
class Block:
    """B orientations with Q profiles of q rows each, m = Q q in all."""

    profiles: ndarray  # (B, Q) which profiles they are
    M: ndarray  # (1 + k, B, m, m) the scanner's first
    Y: ndarray  # (B, m, n + 1) [A | r]


@dataclass(frozen=True)
class Posterior:
    """What is known of x for S sets of variances."""

    v: ndarray  # (S, 1 + k)
    mean: ndarray  # (S, n) x̂
    covariance: ndarray  # (S, n, n) V
    # (S,) of the variances: the restricted log likelihood (Patterson and Thompson 1971)
    log_evidence: ndarray
    square: ndarray  # (S,) rᵀ P r, the χ² of the residuals
    normal: ndarray  # (S, n + 1, n + 1) [A | r]ᵀ C⁻¹ [A | r]
    last: list  # C (B, m, m) of each block, of the last set


class LinearModel:
    """Profiles are counted through, target by target.

    Of each, `E` (profiles, q, 6; 7 in motion) and `Y` (profiles, q, n + 1) are rows
    that say all about the errors of the flange, two of a straight edge, three of a
    ball; `rest` (profiles, n + 1, n + 1) are products of what else the residuals say.
    """

    def __init__(
        self,
        by_flange: ndarray,
        columns: ndarray,
        counts: ndarray,
        groups: PoseGroups,
        names: Sequence[str],
        precision: ndarray,
        clock: int | None = None,
        of_mount: ndarray | float = 0.0,
        scanner: slice = slice(0),
    ) -> None:
        """Of each profile, over the scanner's noise, with zeros where no residual is:
        the derivatives `by_flange` (profiles, K, 6), mm and rad, the `columns` [A | r]
        (profiles, K, n + 1), and how many residuals there are. `names` (k): the robot's
        errors, entries of `Noise`. `precision` (n, n): Π. `clock`: the column of A that
        is the derivative by the time of a profile, if any has one: its jitter acts
        along it, as errors of the flange along E's other columns. `of_mount`, normal
        equations (n + 1, n + 1): what is known of the sensor pose, beside the
        residuals. `scanner`: the columns of its and the targets' systematic errors.

        An orthogonal change of a profile's K rows leaves the scanner's noise as it is.
        With the singular values s of the derivatives by the flange, F = U s Wᵀ, errors
        of the flange move the rows Uᵀ [A | r] whose s is not zero, by E = s Wᵀ, and no
        others, of which the products are enough:

            Y = Uᵀ [A | r]        rest = [A | r]ᵀ [A | r] - Yᵀ Y
        """
        self.precision = precision
        self.of_mount = of_mount
        self.scanner = scanner
        self.n = len(precision)
        self.poor = np.zeros(self.n)
        self.counts = counts
        self.names = tuple(names)
        F = by_flange * HAND_PRECISION
        U, s, Wt = np.linalg.svd(F, full_matrices=False)
        nonzero = s**2 > ROUNDING * s.max() ** 2
        self.ranks = nonzero.sum(axis=1)  # (profiles,) rows that speak of the flange
        self.q = q = max(1, self.ranks.max())
        self.E = (s * nonzero)[:, :q, None] * Wt[:, :q] / HAND_PRECISION
        self.Y = (U * nonzero[:, None])[:, :, :q].mT @ columns
        if clock is not None:
            self.E = np.concatenate([self.E, self.Y[:, :, [clock]]], axis=2)
        self.rest = columns.mT @ columns
        self.rest -= self.Y.mT @ self.Y
        # variances (k, 6 or 7) of E's errors for one unit of each of v
        squares = {
            "mm": [1, 0, 0],
            "deg": [0, np.radians(1) ** 2, 0],
            "ms": [0, 0, 1e-6],
        }
        units = [squares[name.rsplit("_")[-1]] for name in names]
        of_axes = np.repeat(np.reshape(units, (-1, 3)), (3, 3, 1), axis=1)
        self.units = of_axes[:, : self.E.shape[2]]
        self.kept = np.ones(len(counts), dtype=bool)
        self.arrange(groups)

    def arrange(self, groups: PoseGroups) -> None:
        """Write out what the profiles of an orientation share, in `blocks`."""
        each = np.arange(len(self.counts))
        coarsest = min(map(groups.sharing, self.names), key=np.max, default=each)
        self.blocks = [self.block(own, groups) for own in of_equal_size(coarsest)]

    def block(self, profiles: ndarray, groups: PoseGroups) -> Block:
        """The block of some profiles (B, Q)."""
        B, Q = profiles.shape
        m = Q * self.q
        E = self.E[profiles].reshape(B, m, -1)
        M = np.tile(np.eye(m), (1 + len(self.names), B, 1, 1))
        for name, unit, M_k in zip(self.names, self.units, M[1:], strict=True):
            number = groups.sharing(name)[profiles].repeat(self.q, axis=1)
            shared = number[:, :, None] == number[:, None]
            M_k[:] = E * unit @ E.mT * shared
        return Block(profiles, M, self.Y[profiles].reshape(B, m, -1))

    def keeping(self, kept: ndarray) -> "LinearModel":
        """The model of some of its profiles (profiles,) only: zeros stand in place of
        the other rows.
        """
        other = self.to_change()
        other.kept = kept
        other.blocks = []
        for block in self.blocks:
            rows = kept[block.profiles].repeat(self.q, axis=1)[:, :, None]
            M = np.concatenate([block.M[:1], block.M[1:] * rows * rows.mT])
            other.blocks.append(Block(block.profiles, M, block.Y * rows))
        return other

    def with_poor_scanner(self, times: float, poor: ndarray) -> "LinearModel":
        """The same where errors, those that are 1 in `poor` (n,) and not 0, may be so
        many times as large.
        """
        other = copy(self)
        other.poor = poor
        other.precision = self.precision / times ** (poor[:, None] + poor)
        return other

    def without_robot(self) -> "LinearModel":
        """The same of a robot that does not err, whose variances do not count: no
        residuals share anything.
        """
        other = self.to_change()
        other.rest = self.rest + self.Y.mT @ self.Y
        other.blocks = []
        return other

    def to_change(self) -> Self:
        """A copy whose rest is not summed up yet."""
        other = copy(self)
        vars(other).pop("rest_of_kept", None)
        return other

    @cached_property
    def rest_of_kept(self) -> tuple[ndarray, int]:
        """Products (n + 1, n + 1) of all that no error of the flange moves, and how
        many residuals it is. Rows of zeros were counted in the blocks and are taken off
        here.
        """
        count = int(self.counts[self.kept].sum()) - self.row_count
        return self.rest[self.kept].sum(axis=0), count

    @property
    def row_count(self) -> int:
        """How many rows speak of the flange, those of zeros too."""
        return sum(block.Y.shape[0] * block.Y.shape[1] for block in self.blocks)

    def posterior(self, v: ndarray) -> Posterior:
        """What is known of x for variances v (S, 1 + k), the scanner's first.

        All follows from the products N = [A | r]ᵀ C⁻¹ [A | r], sums over the blocks and
        the rest. With its parts N_AA, N_Ar and N_rr,

            H = N_AA + Π        x̂ = -V N_Ar        rᵀ P r = N_rr + N_Arᵀ x̂

        and the restricted log likelihood is, but for a constant,

            L = -(rᵀ P r + log |C| + log |H|) / 2
        """
        n, v0 = self.n, v[:, 0]
        rest, count = self.rest_of_kept
        N = rest / v0[:, None, None] + self.of_mount
        log_det_C = count * np.log(v0)
        last = self.add_products(v, N, log_det_C)
        H = (N[:, :n, :n] + self.precision) * (1 + ROUNDING * np.eye(n))
        V = np.linalg.inv(H)
        N_Ar = N[:, :n, n:]
        mean = -(V @ N_Ar)
        square = N[:, n, n] + (N_Ar * mean).sum(axis=(1, 2))
        log_evidence = -(square + log_det_C + np.linalg.slogdet(H)[1]) / 2
        return Posterior(v, mean[..., 0], V, log_evidence, square, N, last)

    def add_products(self, v: ndarray, N: ndarray, log_det_C: ndarray) -> list:
        """Add [A | r]ᵀ C⁻¹ [A | r] of the rows that speak of the flange to N (S, n + 1,
        n + 1), and log |C| to that (S,). Returns C of each block, of the last set.
        """
        last = []
        for block in self.blocks:
            C = np.tensordot(v, block.M, 1)
            L = np.linalg.cholesky(C)
            W = forward(L, block.Y).reshape(len(v), -1, self.n + 1)
            N += W.mT @ W
            log_det_C += 2 * np.log(np.einsum("sbii->sbi", L)).sum(axis=(1, 2))
            last.append(C[-1])
        return last

    def solved(self, posterior: Posterior) -> list[tuple[ndarray, ndarray]]:
        """C⁻¹ (B, m, m) and C⁻¹ [A | r] (B, m, n + 1) of each block."""
        inverses = [np.linalg.inv(C) for C in posterior.last]
        blocks = zip(inverses, self.blocks, strict=True)
        return [(inverse, inverse @ block.Y) for inverse, block in blocks]

    def gradient(self, posterior: Posterior) -> tuple[ndarray, ndarray]:
        """The derivative (1 + k,) of the log evidence L by the variances, for one set
        of them, and its average information I (Gilmour, Thompson and Cullis 1995).

        As ∂C/∂v_k = M_k, with w = P r = C⁻¹ (r + A x̂) and F the columns M_k w,

            ∂L/∂v_k = -(tr P M_k - wᵀ M_k w) / 2
            I = Fᵀ P F / 2 = (Fᵀ C⁻¹ F - (Aᵀ C⁻¹ F)ᵀ V (Aᵀ C⁻¹ F)) / 2
        """
        n, v0 = self.n, posterior.v[0, 0]
        V = posterior.covariance[0]
        x = np.append(posterior.mean[0], 1.0)
        k = posterior.v.shape[1]
        rest, count = self.rest_of_kept
        square = x @ rest @ x
        slope = np.zeros(k)  # tr P M_k - wᵀ M_k w
        slope[0] = count / v0 - (square + np.sum(V * rest[:n, :n])) / v0**2
        within = np.zeros((k, k))  # Fᵀ C⁻¹ F
        within[0, 0] = square / v0**3
        across = np.zeros((n, k))  # Aᵀ C⁻¹ F
        across[:, 0] = rest[:n] @ x / v0**2
        self.add_to_gradient(posterior, slope, within, across)
        return -slope / 2, (within - across.T @ V @ across) / 2

    def add_to_gradient(
        self,
        posterior: Posterior,
        slope: ndarray,
        within: ndarray,
        across: ndarray,
    ) -> None:
        """Add what the rows that speak of the flange say, as in `gradient`."""
        n, V = self.n, posterior.covariance[0]
        x = np.append(posterior.mean[0], 1.0)
        solved = self.solved(posterior)
        for block, (inverse, X) in zip(self.blocks, solved, strict=True):
            CA = X[..., :n]
            w = X @ x
            P = inverse - CA @ V @ CA.mT
            slope += np.tensordot(block.M, P - w[:, :, None] * w[:, None], 3)
            F = np.moveaxis((block.M @ w[:, :, None])[..., 0], 0, -1)
            within += (F.mT @ inverse @ F).sum(axis=0)
            across += (CA.mT @ F).sum(axis=0)

    def own(self, v: ndarray) -> ndarray:
        """Covariances (profiles, q, q) of the rows of each profile by itself, for
        variances v (1 + k,).
        """
        return v[0] * np.eye(self.q) + self.E * (v[1:] @ self.units) @ self.E.mT

    def alone(self, v: ndarray) -> ndarray:
        """What each profile by itself says of the unknowns, (profiles, n + 1, n + 1):
        [A | r]ᵀ C⁻¹ [A | r].
        """
        return self.Y.mT @ np.linalg.solve(self.own(v), self.Y) + self.rest / v[0]

    def left_out(self, posterior: Posterior) -> tuple[ndarray, ndarray]:
        """How far the rows of each profile (profiles, q) are from what all other
        profiles kept say of them, and the covariance (profiles, q, q) of that.

        Of a profile b that is not kept, r_b + A_b x̂ with covariance C_bb + A_b V A_bᵀ.
        Of one that is kept, P_bb⁻¹ (P r)_b with covariance P_bb⁻¹, the law of a part of
        a Gaussian of precision P, given the rest of it (Christensen, Pearson and
        Johnson 1992).
        """
        n = self.n
        V = posterior.covariance[0]
        x = np.append(posterior.mean[0], 1.0)
        A = self.Y[:, :, :n]
        errors = self.Y @ x
        covariances = self.own(posterior.v[0]) + A @ V @ A.mT
        for profiles, inverse, X in self.parts_kept(posterior):
            CA = X[..., :n]
            P_bb = inverse - CA @ V @ CA.mT
            covariance = np.linalg.pinv(P_bb, hermitian=True)
            errors[profiles] = (covariance @ (X @ x)[..., None])[..., 0]
            covariances[profiles] = covariance
        return errors, covariances

    def parts_kept(
        self, posterior: Posterior
    ) -> list[tuple[ndarray, ndarray, ndarray]]:
        """Profiles kept (p,), with (C⁻¹)_bb (p, q, q) and C⁻¹ [A | r] (p, q, n + 1) of
        each, block by block.
        """
        q = self.q
        parts = []
        solved = self.solved(posterior)
        for block, (inverse, X) in zip(self.blocks, solved, strict=True):
            B, Q = block.profiles.shape
            kept = self.kept[block.profiles]
            squares = inverse.reshape(B, Q, q, Q, q)
            own = np.einsum("bqiqj->bqij", squares)
            rows = X.reshape(B, Q, q, -1)
            parts.append((block.profiles[kept], own[kept], rows[kept]))
        return parts


def forward(L: ndarray, Y: ndarray) -> ndarray:
    """L⁻¹ Y of lower triangles L (..., m, m), by forward substitution, a row of all at
    a time.
    """
    W = np.empty((*L.shape[:-1], Y.shape[-1]))
    for j in range(L.shape[-1]):
        known = L[..., j : j + 1, :j] @ W[..., :j, :]
        W[..., j, :] = (Y[..., j, :] - known[..., 0, :]) / L[..., j, j, None]
    return W


def score(
    normal: ndarray, n: int, precision: ndarray
) -> tuple[ndarray, ndarray, ndarray]:
    """Rao's score test (1948) of d further directions D, each alone: the size that the
    residuals ask for, its standard deviation (d,), and by how much one unit of it moves
    x (n, d). `normal`: N = [A | D | r]ᵀ C⁻¹ [A | D | r]; `precision` (n, n): Π.

    A direction of size z moves x by z X, X = -(N_AA + Π)⁻¹ N_AD. What x cannot imitate
    of it has the information I = N_DD + N_ADᵀ X, its diagonal, and

        z = -(N_Dr + Xᵀ N_Ar) / I,  of standard deviation I^(-1/2)
    """
    A, D, r = slice(n), slice(n, -1), -1
    X = -np.linalg.solve(normal[A, A] + precision, normal[A, D])
    information = np.diag(normal)[D] + np.sum(normal[A, D] * X, axis=0)
    size = -(normal[D, r] + X.T @ normal[A, r]) / information
    return size, information**-0.5, X


def of_equal_size(orientation: ndarray) -> list[ndarray]:
    """The profiles of each orientation, from the orientations' numbers (profiles,):
    arrays (B, Q), one for all orientations that have as many.
    """
    order = np.argsort(orientation, kind="stable")
    sizes = np.bincount(orientation)
    among = sizes.repeat(sizes)
    return [order[among == size].reshape(-1, size) for size in np.unique(sizes)]
