"""All that is known at a state, to first order, as one linear Gaussian model (a mixed
model; Henderson 1975):

    r + A x = Σ_k s_k Z_k u_k + e        x ~ N(0, Π⁻¹)    u_k ~ N(0, 1)    e ~ N(0,
    s_0²)

r are the residuals and A their derivatives, both over the scanner's noise. x are steps
of the unknowns: the sensor pose, the targets, and systematic errors, which Π knows to
be about zero (considered parameters; Schmidt 1966). u_k are errors of the flange, of
size s_k in mm or degrees, that the profiles of one visit, commanded pose or orientation
share; s_0 is the scanner's noise over the assumed one. With the variances v = s², M_0 =
1 and M_k = Z_k Z_kᵀ,

    C = Σ_k v_k M_k    H = Aᵀ C⁻¹ A + Π    V = H⁻¹    x̂ = -V Aᵀ C⁻¹ r    P = C⁻¹ - C⁻¹
    A V Aᵀ C⁻¹

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

import numpy as np

from profilecal.geometry.observability import HAND_PRECISION
from profilecal.targets.observations import PoseGroups

ROUNDING = 1e-13  # of the largest entry of a matrix of products


@dataclass(frozen=True)
class Block:
    """B orientations with Q profiles of q rows each, m = Q q in all."""

    profiles: np.ndarray  # (B, Q) which profiles they are
    M: np.ndarray  # (1 + k, B, m, m) the scanner's first
    Y: np.ndarray  # (B, m, n + 1) [A | r]


@dataclass(frozen=True)
class Posterior:
    """What is known of x for S sets of variances."""

    v: np.ndarray  # (S, 1 + k)
    mean: np.ndarray  # (S, n) x̂
    covariance: np.ndarray  # (S, n, n) V
    # (S,) of the variances: the restricted log likelihood (Patterson and Thompson 1971)
    log_evidence: np.ndarray
    square: np.ndarray  # (S,) rᵀ P r, the χ² of the residuals
    normal: np.ndarray  # (S, n + 1, n + 1) [A | r]ᵀ C⁻¹ [A | r]
    solved: list  # for each block C⁻¹ (S, B, m, m) and C⁻¹ [A | r] (S, B, m, n + 1)


class LinearModel:
    """Profiles are counted through, target by target.

    Of each, `E` (profiles, q, 6) and `Y` (profiles, q, n + 1) are rows that say all
    about the errors of the flange, two of a straight edge, three of a ball; `rest`
    (profiles, n + 1, n + 1) are products of what else the residuals say.
    """

    def __init__(
        self,
        by_flange,
        columns,
        counts,
        groups: PoseGroups,
        names: Sequence[str],
        precision,
    ):
        """Of each profile, over the scanner's noise, with zeros where no residual is:
        the derivatives `by_flange` (profiles, K, 6), mm and rad, the `columns` [A | r]
        (profiles, K, n + 1), and how many residuals there are. `names` (k): the robot's
        errors, entries of `Noise`. `precision` (n, n): Π.
        """
        self.precision, self.n, self.counts, self.names = (
            precision,
            len(precision),
            counts,
            tuple(names),
        )
        left, singular, right = np.linalg.svd(
            by_flange * HAND_PRECISION, full_matrices=False
        )
        there = singular**2 > ROUNDING * singular.max() ** 2
        self.ranks = there.sum(axis=1)  # (profiles,) how many rows speak of the flange
        self.q = q = max(1, self.ranks.max())
        self.E = (singular * there)[:, :q, None] * right[:, :q] / HAND_PRECISION
        self.Y = (left * there[:, None])[:, :, :q].mT @ columns
        self.rest = columns.mT @ columns - self.Y.mT @ self.Y
        # variances (k, 6) of E's errors for one unit of each of v
        units = [
            [1.0, 0.0] if name.endswith("mm") else [0.0, np.radians(1) ** 2]
            for name in names
        ]
        self.units = np.repeat(np.reshape(units, (-1, 2)), 3, axis=1)
        coarsest = min(
            map(groups.sharing, names), key=np.max, default=np.arange(len(counts))
        )
        self.blocks = [
            self.block(profiles, groups) for profiles in of_equal_size(coarsest)
        ]
        self.kept = np.ones(len(counts), dtype=bool)

    def block(self, profiles, groups: PoseGroups) -> Block:
        """The block of some profiles (B, Q)."""
        B, Q = profiles.shape
        e, y = (rows[profiles].reshape(B, Q * self.q, -1) for rows in (self.E, self.Y))
        M = np.tile(np.eye(Q * self.q), (1 + len(self.names), B, 1, 1))
        for name, unit, out in zip(self.names, self.units, M[1:], strict=True):
            number = groups.sharing(name)[profiles]
            shared = (
                (number[:, :, None] == number[:, None])
                .repeat(self.q, axis=1)
                .repeat(self.q, axis=2)
            )
            out[:] = e * unit @ e.mT * shared
        return Block(profiles, M, y)

    def keeping(self, kept) -> "LinearModel":
        """The model of some of its profiles (profiles,) only: zeros stand in place of
        the other rows.
        """
        other = copy(self)
        other.kept, other.blocks = kept, []
        for b in self.blocks:
            there = other.kept[b.profiles].repeat(self.q, axis=1)[:, :, None]
            M = np.concatenate([b.M[:1], b.M[1:] * there * there.mT])
            other.blocks.append(Block(b.profiles, M, b.Y * there))
        return other

    def without_robot(self) -> "LinearModel":
        """The same of a robot that does not err, whose variances do not count: no
        residuals share anything.
        """
        other = copy(self)
        other.rest, other.blocks = self.rest + self.Y.mT @ self.Y, []
        return other

    @property
    def rest_of_kept(self) -> tuple[np.ndarray, int]:
        """Products (n + 1, n + 1) of all that no error of the flange moves, and how
        many residuals it is. Rows of zeros were counted in the blocks and are taken off
        here.
        """
        rows = sum(b.Y.shape[0] * b.Y.shape[1] for b in self.blocks)
        return self.rest[self.kept].sum(axis=0), int(
            self.counts[self.kept].sum()
        ) - rows

    def posterior(self, v) -> Posterior:
        """What is known of x for variances v (S, 1 + k), the scanner's first."""
        (rest, count), n, v0 = self.rest_of_kept, self.n, v[:, 0]
        N, log_det_C, solved = rest / v0[:, None, None], count * np.log(v0), []
        for b in self.blocks:
            C = np.tensordot(v, b.M, 1)
            log_det_C = log_det_C + np.linalg.slogdet(C)[1].sum(axis=1)
            inverse = np.linalg.inv(C)
            X = inverse @ b.Y
            N = N + b.Y.reshape(-1, n + 1).T @ X.reshape(len(v), -1, n + 1)
            solved.append((inverse, X))
        H, g = (
            (N[:, :n, :n] + self.precision) * (1 + ROUNDING * np.eye(n)),
            N[:, :n, n:],
        )
        V = np.linalg.inv(H)
        mean = -(V @ g)
        square = N[:, n, n] + (g * mean).sum(axis=(1, 2))
        log_evidence = -(square + log_det_C + np.linalg.slogdet(H)[1]) / 2
        return Posterior(v, mean[..., 0], V, log_evidence, square, N, solved)

    def gradient(self, found: Posterior) -> tuple[np.ndarray, np.ndarray]:
        """The derivative (1 + k,) of the log evidence by the variances, for one set of
        them, and its average information (Gilmour, Thompson and Cullis 1995); with w =
        P r,

        ∂/∂v_k = -(tr P M_k - wᵀ M_k w) / 2        I_kl = wᵀ M_k P M_l w / 2
        """
        (rest, count), n, v0 = self.rest_of_kept, self.n, found.v[0, 0]
        V, x = found.covariance[0], np.append(found.mean[0], 1.0)
        k = found.v.shape[1]
        # tr P M - wᵀ M w; FᵀC⁻¹F; AᵀC⁻¹F
        slope, within, across = np.zeros(k), np.zeros((k, k)), np.zeros((n, k))
        slope[0] = count / v0 - (x @ rest @ x + np.sum(V * rest[:n, :n])) / v0**2
        within[0, 0], across[:, 0] = x @ rest @ x / v0**3, rest[:n] @ x / v0**2
        for b, (inverse, X) in zip(self.blocks, found.solved, strict=True):
            CA, w = X[0, :, :, :n], X[0] @ x
            less = inverse[0] - CA @ V @ CA.mT - w[:, :, None] * w[:, None]
            slope += np.tensordot(b.M, less, 3)
            F = np.moveaxis((b.M @ w[:, :, None])[..., 0], 0, -1)  # M_k w
            within += (F.mT @ inverse[0] @ F).sum(axis=0)
            across += (CA.mT @ F).sum(axis=0)
        return -slope / 2, (within - across.T @ V @ across) / 2

    def own(self, v) -> np.ndarray:
        """Covariances (profiles, q, q) of the rows of each profile by itself, for
        variances v (1 + k,).
        """
        return v[0] * np.eye(self.q) + self.E * (v[1:] @ self.units) @ self.E.mT

    def alone(self, v) -> np.ndarray:
        """What each profile by itself says of the unknowns, (profiles, n + 1, n + 1):
        [A | r]ᵀ C⁻¹ [A | r].
        """
        return self.Y.mT @ np.linalg.solve(self.own(v), self.Y) + self.rest / v[0]

    def left_out(self, found: Posterior) -> tuple[np.ndarray, np.ndarray]:
        """How far the rows of each profile (profiles, q) are from what all other
        profiles kept say of them, and the covariance (profiles, q, q) of that.

        Of a profile b that is not kept, r_b + A_b x̂ with covariance C_bb + A_b V A_bᵀ;
        of one that is kept, P_bb⁻¹ (P r)_b with covariance P_bb⁻¹ (Christensen, Pearson
        and Johnson 1992).
        """
        x, V, n, q = np.append(found.mean[0], 1.0), found.covariance[0], self.n, self.q
        A = self.Y[:, :, :n]
        errors, covariances = self.Y @ x, self.own(found.v[0]) + A @ V @ A.mT
        for b, (inverse, X) in zip(self.blocks, found.solved, strict=True):
            B, Q = b.profiles.shape
            CA = X[0, :, :, :n]
            P = (inverse[0] - CA @ V @ CA.mT).reshape(B, Q, q, Q, q)
            # P_bb⁻¹
            covariance = np.linalg.pinv(np.einsum("bqiqj->bqij", P), hermitian=True)
            error = covariance @ (X[0] @ x).reshape(B, Q, q, 1)
            kept = self.kept[b.profiles]
            errors[b.profiles[kept]], covariances[b.profiles[kept]] = (
                error[kept][..., 0],
                covariance[kept],
            )
        return errors, covariances


def score(normal, n: int, precision) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rao's score test (1948) of d further directions D, each alone: the size that the
    residuals ask for, its standard deviation (d,), and by how much one unit of it moves
    x (n, d). `normal`: [A | D | r]ᵀ C⁻¹ [A | D | r]; `precision` (n, n): Π.
    """
    A, D, r = slice(n), slice(n, -1), -1
    moves = -np.linalg.solve(normal[A, A] + precision, normal[A, D])
    # what x cannot imitate
    own = np.diag(normal)[D] + np.sum(normal[A, D] * moves, axis=0)
    return -(normal[D, r] + moves.T @ normal[A, r]) / own, own**-0.5, moves


def of_equal_size(orientation) -> list[np.ndarray]:
    """The profiles of each orientation, from the orientations' numbers (profiles,):
    arrays (B, Q), one for all orientations that have as many.
    """
    order, sizes = np.argsort(orientation, kind="stable"), np.bincount(orientation)
    among = sizes.repeat(sizes)
    return [order[among == size].reshape(-1, size) for size in np.unique(sizes)]
