"""All that is known at a state, to first order, as one linear Gaussian model (a mixed
model; Henderson 1975):

    r + A x = Σ_k s_k Z_k u_k + e      x ~ N(0, Π⁻¹)   u_k ~ N(0, 1)   e ~ N(0, s_0²)

r are the residuals and A their derivatives, both over the scanner's noise. x are steps
of the unknowns: the sensor pose, the targets, and systematic errors, which Π knows to
be about zero (considered parameters; Schmidt 1966). u_k are errors of the flange, of
size s_k in mm or degrees, that the profiles of one visit, commanded pose or orientation
share, or the coefficients of the robot's smooth errors (`smooth`), which all share; s_0
is the scanner's noise over the assumed one. With the variances v = s², M_0 = 1 and
M_k = Z_k Z_kᵀ,

    C = Σ_k v_k M_k        H = Aᵀ C⁻¹ A + Π        V = H⁻¹        x̂ = -V Aᵀ C⁻¹ r
    P = C⁻¹ - C⁻¹ A V Aᵀ C⁻¹

V is the covariance of x and x̂ its mean. P is the precision of r where x is integrated
out, (C + A Π⁻¹ Aᵀ)⁻¹ by Woodbury's identity.

Three answers: `posterior`, what is known of x; `left_out`, how far profiles are from
what the others say; and N = [A | r]ᵀ C⁻¹ [A | r], by which a further error is looked
at (`calibration.evidence`).

C never is written out: what residuals say beside the errors of their flange, the
`rest`, needs none. For the other rows, errors of the flange nest: visits in commanded
poses, poses in orientations. With E_i the rows by which an error moves profile i, and S
the variances (6) of the error that a group shares, one error after the other is
integrated out, from the profiles up, and its mean is carried down again.

Leaves, with the errors that no other profile shares, of variances S_own:

    D_i = v_0 + E_i S_own E_iᵀ = L Lᵀ      W_E, W_Z = L⁻¹ E_i, L⁻¹ Z_i
    [J | c] of a group = Σ W_Eᵀ [W_E | W_Z]

Up, for a group with the sum [J | c] of its members, s = √S:

    M = 1 + s J s = L Lᵀ   K = s M⁻¹ s      log |C| = Σ log |D_i| + Σ log |M|

Of what it says, K [J | c] takes its part, and the next coarser group has the sum of

    [J | c] - J K [J | c] = s⁻¹ M⁻¹ s [J | c]

over its members, of which the right side loses no digits.

Down, from b = 0 above the coarsest: b is the mean of all errors that a group's members
share, for each column of Z, and Q their covariance, with T = 1 - K J,

    β = M⁻¹ s (c - J b_above)      b = b_above + s β      Q = K + T Q_above Tᵀ
    C⁻¹ Z = L⁻ᵀ (W_Z - W_E b)      (C⁻¹)_ii = L⁻ᵀ (1 - W_E Q W_Eᵀ) L⁻¹
    E_gᵀ C⁻¹ E_g = J - J Q J       E_gᵀ C⁻¹ Z = s⁻¹ β
    Zᵀ C⁻¹ Z = Σ |W_Z - W_E b|² + Σ |β|²

The last line is a sum of squares: the shorter Σ Zᵀ D⁻¹ Z - Σ cᵀ K c loses digits.

Smooth errors, by columns B, are the last to be integrated out, all at once: they stand
among the columns, Z = [B | A | r], with the precision 1 / s² of their coefficients, and
so before the others in a Cholesky factor.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy import ndarray
from scipy.linalg.lapack import dtrtri

from profilecal.geometry.noise import by_unit
from profilecal.geometry.observability import HAND_PRECISION
from profilecal.joint.nesting import AT_ONCE, Level, add_up, in_parts, nesting, parts_of
from profilecal.joint.smooth import SmoothErrors
from profilecal.targets.observations import PoseGroups

ROUNDING = 1e-13  # of the largest entry of a matrix of products


@dataclass(frozen=True)
class Rows:
    """The rows that speak of the flange, of b bundles of Q profiles at most, zeros
    where there are fewer, and the parts of their D: by the scanner's noise, and by each
    error that no other profile shares.
    """

    groups: ndarray  # (b,)
    profiles: ndarray  # (b, Q); -1: none
    E: ndarray  # (b, Q, q, 6)
    Z: ndarray  # (b, Q, q, m + n + 1)
    parts: ndarray  # (errors, b, Q, q, q)
    errors: list[int]  # their numbers: 0 is the scanner's noise


@dataclass(frozen=True)
class Node:
    """All groups of a level, integrated out, for S sets of variances."""

    level: Level
    J: ndarray  # (S, G, 6, 6)
    s: ndarray  # (S, 1, 6, 1)
    Ms: ndarray  # (S, G, 6, 6) M⁻¹ s


@dataclass(frozen=True)
class Factors:
    """C for S sets of variances, by its structure: of each profile, and of each level
    of groups.
    """

    rows: Rows
    count: int  # of groups
    root: ndarray  # (S, b, Q, q, q) L⁻¹ of D
    W_E: ndarray  # (S, b, Q q, 6)
    nodes: list[Node]  # from coarse to fine
    log_det: ndarray  # (S,) log |C|

    def solve(self, Z: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """For rows Z (b, Q, q, columns): Zᵀ C⁻¹ Z (S, columns, columns), W_Z - W_E b
        (S, b, Q q, columns), and β (S, groups, 6, columns).
        """
        *rows, axes = self.W_E.shape
        columns = Z.shape[-1]
        W = np.empty((*rows, columns))
        of_profiles = W.reshape(*self.root.shape[:-1], columns)
        c = np.zeros((len(W), self.count, axes, columns))
        for part in in_parts(Z):
            np.matmul(self.root[:, part], Z[part], out=of_profiles[:, part])
            add_up(c, self.rows.groups[part], self.W_E[:, part].mT @ W[:, part])
        for node in self.nodes[:0:-1]:
            add_up(c, node.level.parents, node.Ms @ c[:, node.level.groups] / node.s)

        b, beta = np.zeros_like(c), c  # which it takes the place of
        beta[:, 0] = 0.0
        for node in self.nodes:
            groups, above = node.level.groups, np.zeros(1)
            if node is not self.nodes[0]:
                above = b[:, node.level.parents]
                c[:, groups] -= node.J @ above
            beta[:, groups] = node.Ms @ c[:, groups]
            b[:, groups] = above + node.s * beta[:, groups]
        products = squares(beta)
        for part in in_parts(Z):
            W[:, part] -= self.W_E[:, part] @ b[:, self.rows.groups[part]]
            products += squares(W[:, part])
        return products, W, beta

    @cached_property
    def covariances(self) -> ndarray:
        """Q (groups, 6, 6), for the first set of variances."""
        axes = self.W_E.shape[-1]
        Q = np.zeros((self.count, axes, axes))
        for node in self.nodes:
            K = (node.s * node.Ms)[0]
            T = np.eye(axes) - K @ node.J[0]
            Q[node.level.groups] = K + T @ Q[node.level.parents] @ T.mT
        return Q


@dataclass(frozen=True)
class Posterior:
    """What is known of x for S sets of variances.

    It follows from the products N = Zᵀ C⁻¹ Z, Z = [B | A | r] with m smooth errors, and
    log |C|, these errors left out. L is the Cholesky factor of N, with the precisions
    1 / s² and Π of both kinds of unknowns, B's columns times s. Its last row is y,
    whatever large number stands in the corner. Of the rest of L and y, from m on,

        H = L Lᵀ    x̂ = -L⁻ᵀ y    rᵀ P r = N_rr - Σ y²

    and the restricted log likelihood (Patterson and Thompson 1971) is, but for a
    constant, with all of L's diagonal,

        -(rᵀ P r + log |C|) / 2 - Σ log L_ii
    """

    v: ndarray  # (S, 1 + k)
    m: int
    products: ndarray  # (m + n + 1, m + n + 1) N of the first set
    precision: ndarray  # (n, n) Π
    L: ndarray  # (S, m + n + 1, m + n + 1)
    square: ndarray  # (S,) rᵀ P r, the χ² of the residuals
    log_evidence: ndarray  # (S,) of the variances
    # C of the rows that speak of the flange, if there are any: of one set of variances,
    # or of the last of several
    factors: Factors | None

    @cached_property
    def root(self) -> ndarray:
        """(S, n, n) L⁻¹ of x alone."""
        return inverse(self.L[:, self.m : -1, self.m : -1])

    @cached_property
    def covariance(self) -> ndarray:
        """(S, n, n) V."""
        return self.root.mT @ self.root

    @cached_property
    def mean(self) -> ndarray:
        """(S, n) x̂."""
        y = self.L[:, -1, self.m : -1, None]
        return -(self.root.mT @ y)[..., 0]

    @property
    def normal(self) -> ndarray:
        """(S, n + 1, n + 1) N of [A | r], the smooth errors integrated out."""
        L = self.L[:, self.m :, self.m :]
        normal = L @ L.mT
        normal[:, :-1, :-1] -= self.precision
        normal[:, -1, -1] = self.square + np.sum(L[:, -1, :-1] ** 2, axis=1)
        return normal

    @cached_property
    def whole(self) -> tuple[ndarray, ndarray]:
        """Of the smooth errors' coefficients and x, for the first set of variances: the
        mean and a 1 for r (m + n + 1), and the covariance.
        """
        (root,) = inverse(self.L[:1, :-1, :-1])
        root[:, : self.m] *= np.sqrt(self.v[0, -1])
        return np.append(-self.L[0, -1, :-1] @ root, 1.0), root.T @ root

    def with_smooth(
        self, mean: ndarray, covariance: ndarray
    ) -> tuple[ndarray, ndarray]:
        """Mean and covariance where others say what they are of x.

        Where x moves by one, all unknowns move by V_•x V_xx⁻¹, as likely as they were;
        V_xx⁻¹ = H.
        """
        m, (z, V) = self.m, self.whole
        L = self.L[0, m:-1, m:-1]
        moves = V[:, m:] @ L @ L.T
        whole = V + moves @ (covariance - V[m:, m:]) @ moves.T
        return z[:-1] + moves @ (mean - z[m:-1]), whole


class LinearModel:
    """Profiles are counted through, target by target.

    Of each, `E` (profiles, q, 6; 7 in motion) and `Y` (profiles, q, n + 1) are rows
    that say all about the errors of the flange, two of a straight edge, three of a
    ball; `rest` (profiles, K, n + 1) are rows of what else the residuals say.
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
        may_be_poor: slice = slice(0),
        smooth: SmoothErrors | None = None,
    ) -> None:
        """Of each profile, over the scanner's noise, with zeros where no residual is:
        the derivatives `by_flange` (profiles, K, 6), mm and rad, the `columns` [A | r]
        (profiles, K, n + 1), and how many residuals there are. `names` (k): the robot's
        errors, entries of `Noise`; the last one is that of `smooth` errors, if these
        are given. `precision` (n, n): Π. `clock`: the column of A that is the
        derivative by the time of a profile, if any has one: its jitter acts along it,
        as errors of the flange along E's other columns. `of_mount`, normal equations
        (n + 1, n + 1): what is known of the sensor pose, beside the residuals.
        `may_be_poor`: the columns of the scanner's and the targets' systematic errors.

        An orthogonal change of a profile's K rows leaves the scanner's noise as it is.
        With the singular values s of the derivatives by the flange, F = U s Wᵀ, errors
        of the flange move the rows Uᵀ [A | r] whose s is not zero, by E = s Wᵀ, and no
        others, which are

            Y = Uᵀ [A | r]        rest = [A | r] - U Y
        """
        self.precision = precision
        self.of_mount = of_mount
        self.may_be_poor = may_be_poor
        self.n = len(precision)
        self.counts = counts
        self.names = tuple(names)
        self.smooth = smooth
        self.m = smooth.count if smooth else 0
        F = by_flange * HAND_PRECISION
        U, s, Wt = np.linalg.svd(F, full_matrices=False)
        nonzero = s**2 > ROUNDING * s.max() ** 2
        self.ranks = nonzero.sum(axis=1)  # (profiles,) rows that speak of the flange
        self.q = q = max(1, self.ranks.max())
        self.E = (s * nonzero)[:, :q, None] * Wt[:, :q] / HAND_PRECISION
        U = (U * nonzero[:, None])[:, :, :q]
        self.Y = U.mT @ columns
        self.rest = columns - U @ self.Y
        if clock is not None:
            self.E = np.concatenate([self.E, self.Y[:, :, [clock]]], axis=2)
        # how many directions errors of the flange have
        self.axes = self.E.shape[2]
        # variances (1 + k, 6 or 7) of E's errors for one unit of each of v; none are of
        # the scanner's noise, or smooth
        fresh = names[:-1] if smooth else names
        self.units = np.zeros((1 + len(names), self.axes))
        for error, name in enumerate(fresh, 1):
            self.units[error, :6] = by_unit(name) ** 2
            self.units[error, 6:] = 1e-6 * name.endswith("ms")
        numbers = [groups.sharing(name) for name in fresh]
        self.nesting = nesting(len(counts), numbers)
        self.kept = np.ones(len(counts), dtype=bool)
        self.flange_errs = True  # by errors that profiles share, or their own

    def keeping(self, kept: ndarray) -> "LinearModel":
        """The model of some of its profiles (profiles,) only."""
        other = copy(self)
        other.kept = kept
        if self.smooth and (kept != self.kept).any():
            other.smooth = self.smooth.keeping(kept)
        for name in ("rows", "rest_of_kept"):
            vars(other).pop(name, None)
        return other

    def with_errors(self, times: ndarray) -> "LinearModel":
        """The same where errors may be so many times (n,) as large."""
        other = copy(self)
        other.precision = self.precision / (times[:, None] * times)
        return other

    def without_robot(self) -> "LinearModel":
        """The same of a robot that errs smoothly or not at all, whose other variances
        do not count: no residuals share anything.
        """
        other = copy(self)
        other.flange_errs = False
        vars(other).pop("rest_of_kept", None)
        return other

    def Z(self, profiles: ndarray) -> ndarray:
        """[B | A | r] (k, q, m + n + 1) of the rows of some profiles, by number, that
        speak of the flange.
        """
        Y = self.Y[profiles]
        if not self.smooth:
            return Y
        B = self.smooth.columns(self.E[profiles, :, :6], profiles)
        return np.concatenate([B, Y], axis=2)

    @cached_property
    def rows(self) -> Rows:
        """Of the profiles kept."""
        most = max(1, AT_ONCE // (self.q * (self.m + self.n + 1)))
        groups, profiles = self.nesting.bundles(self.kept, most)
        E, Z = self.E[profiles], self.Z(profiles.ravel())
        Z = Z.reshape(*E.shape[:3], -1)
        E[profiles < 0] = Z[profiles < 0] = 0.0
        parts = [np.broadcast_to(np.eye(self.q), (*profiles.shape, self.q, self.q))]
        errors = [0]
        for error, alone in self.nesting.own:
            by_error = E * alone[profiles, None, None] * self.units[error]
            parts.append(by_error @ E.mT)
            errors.append(error)
        return Rows(groups, profiles, E, Z, np.array(parts), errors)

    @cached_property
    def rest_of_kept(self) -> tuple[ndarray, int]:
        """The products (m + n + 1, m + n + 1) of all that no error of the flange moves,
        and how many residuals it is. Rows of zeros count among the others and are taken
        off here.
        """
        products = np.zeros((self.m + self.n + 1,) * 2)
        products[self.m :, self.m :] = squares(self.rest[None, self.kept])[0]
        count = int(self.counts[self.kept].sum())
        if not self.flange_errs:
            return products + squares(self.rows.Z[None])[0], count
        return products, count - self.q * self.rows.profiles.size

    def factors(self, v: ndarray) -> Factors:
        """C of the rows for variances v (S, 1 + k), without smooth errors."""
        rows, S, a = self.rows, len(v), self.axes
        D = v[:, rows.errors] @ rows.parts.reshape(len(rows.errors), -1)
        root, log_det = inverse_root(D.reshape(S, -1, self.q, self.q))
        root = root.reshape(S, *rows.parts.shape[1:])
        W_E = (root @ rows.E).reshape(S, len(rows.groups), -1, a)
        sums = np.zeros((S, self.nesting.count, a, a))
        add_up(sums, rows.groups, W_E.mT @ W_E)
        nodes = []
        for level in self.nesting.levels[::-1]:
            J = sums[:, level.groups]
            # above zero: what is shared is divided by it
            s = np.sqrt(v[:, level.errors] @ self.units[level.errors]) + 1e-100
            s = s[:, None, :, None]
            M_root, of_groups = inverse_root(np.eye(a) + s * J * s.mT)
            log_det += of_groups
            Ms = M_root.mT @ M_root * s.mT
            nodes.append(Node(level, J, s, Ms))
            add_up(sums, level.parents, Ms @ J / s)
        return Factors(rows, self.nesting.count, root, W_E, nodes[::-1], log_det)

    def posterior(self, v: ndarray) -> Posterior:
        """What is known of x for variances v (S, 1 + k), the scanner's first."""
        m, v0 = self.m, v[:, 0]
        rest, count = self.rest_of_kept
        N = rest / v0[:, None, None]
        N[:, m:, m:] += self.of_mount
        log_det = count * np.log(v0)
        factors = None
        if self.flange_errs:
            for part in parts_of(len(v), self.rows.Z.size):
                factors = self.factors(v[part])
                N[part] += factors.solve(self.rows.Z)[0]
                log_det[part] += factors.log_det

        products = N[0].copy()
        H = N  # which is no longer needed
        s = np.sqrt(v[:, -1, None, None])
        H[:, :m] *= s
        H[:, :, :m] *= s
        H[:, m:-1, m:-1] += self.precision
        diagonal = np.einsum("sii->si", H)  # a view: what is written to it is H's
        diagonal[:, :m] += 1.0
        diagonal *= 1 + ROUNDING
        square = diagonal[:, -1].copy()
        # the corner is raised, so that the factor exists; the rest of L does not depend
        # on it
        diagonal[:, -1] += square + 1.0
        L = np.linalg.cholesky(H)
        square -= np.sum(L[:, -1, :-1] ** 2, axis=1)
        roots = np.einsum("sii->si", L)[:, :-1]
        log_evidence = -(square + log_det) / 2 - np.log(roots).sum(axis=1)
        known = products, self.precision, L
        return Posterior(v, m, *known, square, log_evidence, factors)

    def rescaled(
        self, posterior: Posterior, times: ndarray
    ) -> tuple[ndarray, ndarray, ndarray]:
        """By how much the log evidence changes, (B, S), and x̂ (B, S, n) and V (B, S, n,
        n), where the systematic errors may be so many `times` (B, n) as large.

        Π, diagonal there, becomes Π - D. By Woodbury's identity, G = D (1 - V D)⁻¹,

            V' = V + V G V        x̂' = x̂ + V G x̂
            L' = L + (x̂ᵀ G x̂ - log |1 - V D| + log |Π - D| - log |Π|) / 2
        """
        poor = self.may_be_poor
        times = times[:, poor]
        D = np.diag(self.precision)[poor] * (1 - times**-2.0)
        D = D[:, None, :, None]
        x, V = posterior.mean, posterior.covariance
        x_s, V_s = x[:, poor, None], V[:, :, poor]
        A = np.eye(D.shape[2]) - V_s[:, poor] * D.mT
        G = D * np.linalg.inv(A)
        Gx = G @ x_s
        gain = (x_s * Gx).sum(axis=(2, 3)) - np.linalg.slogdet(A)[1]
        gain = gain / 2 - np.log(times).sum(axis=1)[:, None]
        return gain, x + (V_s @ Gx)[..., 0], V + V_s @ G @ V_s.mT

    def gradient(self, posterior: Posterior) -> tuple[ndarray, ndarray]:
        """The derivative (1 + k,) of the log evidence L by the variances, and its
        average information I (Gilmour, Thompson and Cullis 1995). The posterior has to
        be of one set of variances.

        As ∂C/∂v_k = M_k, with w = P r = C⁻¹ (r + A x̂) and F the columns M_k w,

            ∂L/∂v_k = -(tr P M_k - wᵀ M_k w) / 2
            I = Fᵀ P F / 2 = (Fᵀ C⁻¹ F - (Aᵀ C⁻¹ F)ᵀ V (Aᵀ C⁻¹ F)) / 2

        P is the same where the smooth errors' coefficients count as unknowns: here they
        do, and C is without them. For their size, I_kk is the curvature itself,
        wᵀ M P M w - tr(P M P M) / 2.
        """
        m, v0, k = self.m, posterior.v[0, 0], posterior.v.shape[1]
        z, V = posterior.whole
        rest, count = self.rest_of_kept
        square = z @ rest @ z
        # tr P M_k - wᵀ M_k w, Fᵀ C⁻¹ F and Aᵀ C⁻¹ F
        slope, within, across = np.zeros(k), np.zeros((k, k)), np.zeros((len(V), k))
        if posterior.factors:
            slope, within, across = self.of_rows(posterior.factors, posterior.whole)
        slope[0] += count / v0 - (square + np.sum(V * rest[:-1, :-1])) / v0**2
        within[0, 0] += square / v0**3
        across[:, 0] += rest[:-1] @ z / v0**2
        if self.smooth:
            N = posterior.products[:m]
            f = N @ z
            P = N[:, :m] - N[:, :-1] @ V @ N[:, :-1].T
            slope[-1] = np.trace(P) - f @ f
            across[:, -1] = f @ N[:, :-1]
            within[-1] = within[:, -1] = f @ across[:m]
        information = (within - across.T @ V @ across) / 2
        if self.smooth:
            information[-1, -1] += f @ P @ f / 2 - np.sum(P**2) / 2
        return -slope / 2, information

    def of_rows(
        self, factors: Factors, known: tuple[ndarray, ndarray]
    ) -> tuple[ndarray, ndarray, ndarray]:
        """What the rows that speak of the flange add to the sums of `gradient`: to tr P
        M_k - wᵀ M_k w (1 + k,), Fᵀ C⁻¹ F (1 + k, 1 + k) and Aᵀ C⁻¹ F (m + n, 1 + k).
        `known`: `Posterior.whole`.
        """
        rows = self.rows
        P, X, w, beta = self.precisions(factors, known)
        slope, moves = self.of_groups(factors, known, beta)
        F = rows.E @ moves[rows.groups, None]  # M_k w of what profiles share,
        own = rows.parts @ w[..., None]  # and of what is one profile's
        F[..., rows.errors] += np.moveaxis(own[..., 0], 0, -1)
        slope[rows.errors] += rows.parts.reshape(-1, P.size) @ P.ravel()
        slope -= w.ravel() @ flat(F)
        across = flat(X).T @ flat(F)
        return slope, factors.solve(F)[0][0], across[:-1]

    def by_bends(self, v: ndarray) -> ndarray:
        """What the covariance (n, n) of x owes, for variances v (1 + k,), to bends of
        the smooth errors, which are considered (Schmidt 1966).

        Bends B₂ with coefficients c ~ N(0, s²) are no part of the model: r + B₂ c
        stands where it has r. So its mean moves by -V Aᵀ C⁻¹ B₂ c, with B among the
        columns of A, and its covariance should be larger by

            s² G Gᵀ,    G = V Aᵀ C⁻¹ B₂
        """
        if not self.smooth:
            return np.zeros_like(self.precision)
        posterior = self.posterior(v[None])
        assert posterior.factors  # the flange of a robot that bends may err
        _, X, _, _ = self.precisions(posterior.factors, posterior.whole)
        bent = replace(self.smooth, bends=True).keeping(self.kept)
        across = np.zeros((X.shape[-1], bent.count))  # of [B | A | r] and [B | B₂]
        for part in in_parts(X):
            some = self.rows.profiles[part].ravel()
            columns = bent.columns(self.E[some, :, :6], some)
            across += flat(X[part]).T @ flat(columns)
        moves = posterior.whole[1][self.m :] @ across[:-1, self.m :]
        return v[-1] * moves @ moves.T

    def precisions(
        self, factors: Factors, known: tuple[ndarray, ndarray]
    ) -> tuple[ndarray, ndarray, ndarray, ndarray]:
        """Of the rows of each profile, for one set of variances: P_ii (b, Q, q, q),
        X = C⁻¹ [B | A | r] (b, Q, q, m + n + 1) and w = P r (b, Q, q); and β of Z,
        of the groups.
        """
        z, V = known
        _, (W,), (beta,) = factors.solve(self.rows.Z)
        root = factors.root[0]  # L⁻¹
        W_E = factors.W_E[0].reshape(*root.shape[:-1], -1)
        Q = factors.covariances[self.rows.groups, None]
        P = root.mT @ (np.eye(self.q) - W_E @ Q @ W_E.mT) @ root  # of C⁻¹
        X = W.reshape(*root.shape[:-1], -1)  # in its place: it is as large as all rows
        for part in in_parts(X):
            X[part] = root[part].mT @ X[part]
            CA = X[part, ..., :-1]
            P[part] -= CA @ V @ CA.mT
        return P, X, X @ z, beta

    def of_groups(
        self, factors: Factors, known: tuple[ndarray, ndarray], beta: ndarray
    ) -> tuple[ndarray, ndarray]:
        """Of the errors that groups share, with β (groups, 6, columns) of Z: tr P M_k
        (1 + k,); and M_k w as motions of the flange (groups, 6, 1 + k), which a group
        has from all that hold it, too.
        """
        Q, k = factors.covariances, len(self.units)
        z, V = known
        traces, moves = np.zeros(k), np.zeros((len(Q), self.axes, k))
        for node in factors.nodes:
            level, J = node.level, node.J[0]
            units = self.units[level.errors]
            EZ = beta[level.groups] / node.s[0]  # E_gᵀ C⁻¹ Z
            EA, Ew = EZ[..., :-1], EZ @ z
            EPE = J - J @ Q[level.groups] @ J - EA @ V @ EA.mT
            traces[level.errors] = units @ np.einsum("gjj->j", EPE)
            moves[level.groups] = moves[level.parents]
            moves[level.groups, :, level.errors] = Ew[..., None] * units.T
        return traces, moves

    def own(self, v: ndarray) -> ndarray:
        """Covariances (profiles, q, q) of the rows of each profile by itself, for
        variances v (1 + k,).
        """
        return v[0] * np.eye(self.q) + self.E * (v @ self.units) @ self.E.mT

    def alone(self, v: ndarray) -> ndarray:
        """What each profile by itself says of the unknowns, (profiles, n + 1, n + 1):
        [A | r]ᵀ C⁻¹ [A | r], of a robot without smooth errors of unknown size.
        """
        by_rows = self.Y.mT @ np.linalg.solve(self.own(v), self.Y)
        return by_rows + self.rest.mT @ self.rest / v[0]

    def left_out(self, posterior: Posterior) -> tuple[ndarray, ndarray]:
        """How far the rows of each profile (profiles, q) are from what all other
        profiles kept say of them, and the covariance (profiles, q, q) of that.

        Of a profile b that is not kept, r_b + A_b x̂ with covariance C_bb + A_b V A_bᵀ.
        Of one that is kept, P_bb⁻¹ (P r)_b with covariance P_bb⁻¹, the law of a part of
        a Gaussian of precision P, given the rest of it (Christensen, Pearson and
        Johnson 1992).
        """
        z, V = posterior.whole
        out = np.flatnonzero(~self.kept)
        Z = self.Z(out)
        A = Z[..., :-1]
        errors, covariances = np.zeros(self.E.shape[:2]), self.own(posterior.v[0])
        errors[out] = Z @ z
        covariances[out] += A @ V @ A.mT
        assert posterior.factors  # poses are left out where the flange may err
        P, _, w, _ = self.precisions(posterior.factors, posterior.whole)
        real = self.rows.profiles >= 0
        covariance = np.linalg.pinv(P[real], hermitian=True)
        profiles = self.rows.profiles[real]
        covariances[profiles] = covariance
        errors[profiles] = (covariance @ w[real][..., None])[..., 0]
        return errors, covariances


def inverse(L: ndarray) -> ndarray:
    """Of lower triangles (S, m, m)."""
    return np.array([dtrtri(triangle, lower=1)[0] for triangle in L])


def inverse_root(C: ndarray) -> tuple[ndarray, ndarray]:
    """L⁻¹ of matrices C = L Lᵀ (S, G, m, m), and the sums (S,) of their log |C|.

    Elimination takes [C | 1] to [Lᵀ | L⁻¹]; of all matrices at once, whose numbers
    stand last.
    """
    m = C.shape[-1]
    A = np.zeros((m, 2 * m, *C.shape[:2]))
    A[:, :m] = C.transpose(2, 3, 0, 1)
    A[range(m), range(m, 2 * m)] = 1.0
    for j in range(m):
        part = slice(j, m + j + 1)
        A[j, part] /= np.sqrt(A[j, j])
        A[j + 1 :, part] -= A[j, j + 1 : m, None] * A[j, part]
    root = np.ascontiguousarray(A[:, m:].transpose(2, 3, 0, 1))
    diagonal = np.einsum("jj...->j...", A[:, :m])
    return root, 2 * np.log(diagonal).sum(axis=(0, 2))


def flat(rows: ndarray) -> ndarray:
    """Rows (..., columns) of profiles, one after the other: (rows, columns)."""
    return rows.reshape(-1, rows.shape[-1])


def squares(rows: ndarray) -> ndarray:
    """Σ rowsᵀ rows (S, columns, columns) of rows (S, ..., columns)."""
    of_set = rows.reshape(len(rows), -1, rows.shape[-1])
    return of_set.mT @ of_set
