"""All that is known at a state, to first order, as one linear Gaussian model (a mixed
model; Henderson 1975):

    r + A x = Σ_k s_k Z_k u_k + e      x ~ N(0, Π⁻¹)   u_k ~ N(0, 1)   e ~ N(0, s_0²)

r are the residuals and A their derivatives, both over the scanner's noise. x are steps
of the unknowns: the sensor pose, the targets, and systematic errors, which Π knows to
be about zero (considered parameters; Schmidt 1966), as it knows the coefficients of the
robot's smooth errors (`smooth`) over their size, the last of the s_k. u_k are errors of
the flange, of size s_k in mm or degrees, that the profiles of one visit, commanded pose
or orientation share; s_0 is the scanner's noise over the assumed one. With the
variances v = s², M_0 = 1 and M_k = Z_k Z_kᵀ,

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

It leaves [W_E | W_Z] - W_E K [J | c] of their rows, whose sums with W_E are [J | c] of
the next coarser groups.

Down, from b = 0 above the coarsest: b is the mean of all errors that a group's members
share, for each column of Z, and Q their covariance, with T = 1 - K J,

    β = M⁻¹ s (c - J b_above)      b = b_above + s β      Q = K + T Q_above Tᵀ
    C⁻¹ Z = L⁻ᵀ (W_Z - W_E b)      (C⁻¹)_ii = L⁻ᵀ (1 - W_E Q W_Eᵀ) L⁻¹
    E_gᵀ C⁻¹ E_g = J - J Q J       E_gᵀ C⁻¹ Z = Σ E_iᵀ (C⁻¹ Z)_i
    Zᵀ C⁻¹ Z = Σ |W_Z - W_E b|² + Σ |β|²

The last line is a sum of squares: the shorter Σ Zᵀ D⁻¹ Z - Σ cᵀ K c loses digits.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray
from scipy.linalg import block_diag

from profilecal.geometry.noise import SMOOTH
from profilecal.geometry.observability import HAND_PRECISION
from profilecal.joint.nesting import Level, nesting
from profilecal.joint.smooth import SmoothErrors
from profilecal.targets.observations import PoseGroups

ROUNDING = 1e-13  # of the largest entry of a matrix of products
AT_ONCE = 25_000  # numbers of the rows of several sets: what a cache holds


@dataclass(frozen=True)
class Node:
    """All groups of a level, integrated out, for S sets of variances."""

    level: Level
    J: ndarray  # (S, G, 6, 6)
    s: ndarray  # (S, 1, 6)
    root: ndarray  # (S, G, 6, 6) L⁻¹ of M

    @cached_property
    def K(self) -> ndarray:
        """(S, G, 6, 6)."""
        scaled = self.root * self.s[:, :, None]
        return scaled.mT @ scaled


@dataclass(frozen=True)
class Factors:
    """C for S sets of variances, by its structure."""

    log_det: ndarray  # (S,) log |C|
    root: ndarray  # (S, profiles, q, q) L⁻¹ of D
    W_E: ndarray  # (S, profiles, q, 6)
    nodes: list[Node]  # from fine to coarse

    def solve(self, Z: ndarray) -> tuple[ndarray, ndarray]:
        """Zᵀ C⁻¹ Z (S, columns, columns) and Lᵀ C⁻¹ Z (S, profiles, q, columns) of rows
        Z (profiles, q, columns).
        """
        left = self.root @ Z
        sums_of: list[ndarray] = []
        rows = left
        for node in self.nodes:
            c = node.level.sums(self.W_E, rows)
            if node is not self.nodes[-1]:
                rows = node.level.without(self.W_E, node.K @ c, rows)
            sums_of.append(c)

        S, columns = len(left), Z.shape[-1]
        products = np.zeros((S, columns, columns))
        b = np.zeros((S, 1, self.W_E.shape[-1], columns))
        for node, c in zip(self.nodes[::-1], sums_of[::-1], strict=True):
            above = b[:, node.level.parents]
            scaled = node.s[..., None] * (c - node.J @ above)
            beta = node.root.mT @ (node.root @ scaled)
            products += squares(beta)
            moves = node.s[..., None] * beta
            left = node.level.without(self.W_E, moves, left)
            b = above + moves
        products += squares(left)
        return products, left


@dataclass(frozen=True)
class Posterior:
    """What is known of x for S sets of variances."""

    v: ndarray  # (S, 1 + k)
    # (S,) of the variances: the restricted log likelihood (Patterson and Thompson 1971)
    log_evidence: ndarray
    square: ndarray  # (S,) rᵀ P r, the χ² of the residuals
    products: ndarray  # (S, n + 1, n + 1) [A | r]ᵀ C⁻¹ [A | r]
    H: ndarray  # (S, n, n) in the units
    units: ndarray  # (S, n + 1) of x and r, in which Π is the precision
    log_det: ndarray  # (S,) log |C|
    # of the rows that speak of the flange, if there are any, for the last sets: C, and
    # Lᵀ C⁻¹ [A | r]
    last: list[tuple[Factors, ndarray]]

    @cached_property
    def covariance(self) -> ndarray:
        """(S, n, n) V."""
        s = self.units[:, :-1, None]
        return np.linalg.inv(self.H) * s * s.mT

    @cached_property
    def mean(self) -> ndarray:
        """(S, n) x̂ = -V N_Ar."""
        return -(self.covariance @ self.products[:, :-1, -1:])[..., 0]

    @property
    def normal(self) -> ndarray:
        """(S, n + 1, n + 1) the products in these units."""
        return self.products * self.units[:, :, None] * self.units[:, None]


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
        scanner: slice = slice(0),
        smooth: SmoothErrors | None = None,
        tried: int = 0,
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
        others, which are

            Y = Uᵀ [A | r]        rest = [A | r] - U Y
        """
        self.precision = precision
        self.of_mount = of_mount
        self.scanner = scanner
        self.n = len(precision)
        self.counts = counts
        self.names = tuple(names)
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
        # variances (1 + k, 6 or 7) of E's errors for one unit of each of v
        squares = {
            "mm": [1, 0, 0],
            "deg": [0, np.radians(1) ** 2, 0],
            "ms": [0, 0, 1e-6],
        }
        fresh = [name for name in names if name != SMOOTH]
        units = [[0, 0, 0], *(squares[name.rsplit("_")[-1]] for name in fresh)]
        units += [[0, 0, 0]] * (len(names) - len(fresh))
        self.units = np.repeat(units, (3, 3, 1), axis=1)[:, : self.axes]
        self.plain = np.arange(self.n + 1)  # the columns that residuals have
        self.smooth = smooth if len(fresh) < len(names) else None
        self.of_smooth = slice(self.n - tried, self.n - tried)  # their columns
        if self.smooth:
            self.add_smooth(self.smooth.left.shape[2])
        numbers = [groups.sharing(name) for name in fresh]
        self.order, self.own_errors, self.levels = nesting(len(counts), numbers)
        self.kept = np.ones(len(counts), dtype=bool)
        self.arrange()

    def add_smooth(self, count: int) -> None:
        """Make room for the columns of smooth errors, before those of errors tried."""
        n = self.of_smooth.start
        self.of_smooth = slice(n, n + count)
        self.Y = np.insert(self.Y, [n] * count, 0.0, axis=2)
        self.n += count
        self.plain = np.delete(np.arange(self.n + 1), self.of_smooth)
        of_mount = np.zeros((self.n + 1, self.n + 1))
        of_mount[np.ix_(self.plain, self.plain)] = self.of_mount
        self.of_mount = of_mount
        known = self.precision
        self.precision = block_diag(known[:n, :n], np.eye(count), known[n:, n:])

    def arrange(self) -> None:
        """Put the rows of the profiles kept, [E | Y], in the order of the groups, with
        zeros for the others; and write out the errors that are a profile's own, parts
        of its D.
        """
        if self.smooth:
            self.Y = self.Y.copy()
            self.Y[..., self.of_smooth] = self.E[..., :6] @ self.smooth.left
        kept = self.kept[self.order][:, None, None]
        self.rows = np.concatenate([self.E, self.Y], axis=2)[self.order] * kept
        E = self.rows[..., : self.axes]
        # which of v they are
        self.of_own = [0]
        parts = [np.broadcast_to(np.eye(self.q), (len(E), self.q, self.q))]
        for errors, alone in self.own_errors:
            E_alone = E * alone[:, None, None]
            for error in errors:
                self.of_own.append(error)
                parts.append(E_alone * self.units[error] @ E_alone.mT)
        self.own_parts = np.array(parts)  # (errors, profiles, q, q)
        self.sum_rest()

    def keeping(self, kept: ndarray) -> "LinearModel":
        """The model of some of its profiles (profiles,) only."""
        other = copy(self)
        other.kept = kept
        if self.smooth:
            other.smooth = self.smooth.keeping(kept)
        other.arrange()
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
        rest = np.zeros((*self.rest.shape[:2], self.n + 1))
        rest[..., self.plain] = self.rest
        other.rest = np.concatenate([rest, self.Y], axis=1)
        other.plain = np.arange(self.n + 1)
        other.rows, other.own_parts = self.rows[:0], self.own_parts[:, :0]
        other.levels = []
        other.sum_rest()
        return other

    def sum_rest(self) -> None:
        """Sum up the products (n + 1, n + 1) of all that no error of the flange moves,
        and how many residuals it is. Rows of zeros were counted among the others and
        are taken off here.
        """
        count = int(self.counts[self.kept].sum()) - len(self.rows) * self.q
        products = np.zeros((self.n + 1, self.n + 1))
        plain = np.ix_(self.plain, self.plain)
        products[plain] = squares(self.rest[None, self.kept])[0]
        self.rest_of_kept = products, count

    def factors(self, v: ndarray) -> Factors:
        """C of the rows, in the order of the groups, for variances v (S, 1 + k)."""
        one = np.eye(self.axes)
        root, log_det = inverse_root(np.tensordot(v[:, self.of_own], self.own_parts, 1))
        W_E = root @ self.rows[..., : self.axes]
        nodes: list[Node] = []
        rows = W_E
        for level in self.levels[::-1]:
            J = level.sums(W_E, rows)
            s = np.sqrt(v[:, level.errors] @ self.units[level.errors])[:, None]
            M_root, of_groups = inverse_root(one + s[..., None] * J * s[:, :, None])
            log_det += of_groups
            node = Node(level, J, s, M_root)
            nodes.append(node)
            if level is not self.levels[0]:
                rows = level.without(W_E, node.K @ J, rows)
        return Factors(log_det, root, W_E, nodes)

    def posterior(self, v: ndarray) -> Posterior:
        """What is known of x for variances v (S, 1 + k), the scanner's first."""
        v0 = v[:, 0]
        rest, count = self.rest_of_kept
        N = rest / v0[:, None, None] + self.of_mount
        log_det = count * np.log(v0)
        some = max(1, AT_ONCE // max(1, self.rows.size))
        last = []
        for start in range(0, len(v) * bool(len(self.rows)), some):
            part = slice(start, start + some)
            factors = self.factors(v[part])
            products, left = factors.solve(self.rows[..., self.axes :])
            N[part] += products
            log_det[part] += factors.log_det
            last = [(factors, left)]
        return self.by_products(v, N, log_det, last)

    def by_products(
        self, v: ndarray, N: ndarray, log_det: ndarray, last: list
    ) -> Posterior:
        """All follows from the products N = [A | r]ᵀ C⁻¹ [A | r] (S, n + 1, n + 1) and
        log |C| (S,). With N's parts N_AA, N_Ar and N_rr,

            H = N_AA + Π = L Lᵀ      y = L⁻¹ N_Ar      rᵀ P r = N_rr - yᵀ y

        and the restricted log likelihood is, but for a constant,

            -(rᵀ P r + log |C| + log |H|) / 2

        Both L and y are parts of the Cholesky factor of H bordered by N_Ar, whatever
        large number stands in its corner.
        """
        n = self.n
        units = self.units_of(v)
        H = N * units[:, :, None] * units[:, None]
        H[:, :n, :n] += self.precision
        H *= 1 + ROUNDING * np.eye(n + 1)
        square = H[:, n, n].copy()
        H[:, n, n] = 2 * square + 1.0
        L = np.linalg.cholesky(H)
        square -= np.sum(L[:, n, :n] ** 2, axis=1)
        of_H = 2 * np.log(np.einsum("sii->si", L)[:, :n]).sum(axis=1)
        log_evidence = -(square + log_det + of_H) / 2
        return Posterior(v, log_evidence, square, N, H[:, :n, :n], units, log_det, last)

    def rescaled(
        self, posterior: Posterior, times: ndarray
    ) -> tuple[ndarray, ndarray, ndarray]:
        """By how much the log evidence changes, (B, S), and x̂ (B, S, n) and V (B, S, n,
        n), where the systematic errors may be so many `times` (B, n) as large.

        Π, diagonal there, becomes Π - D. By Woodbury's identity, G = D (1 - V D)⁻¹,

            V' = V + V G V        x̂' = x̂ + V G x̂
            L' = L + (x̂ᵀ G x̂ - log |1 - V D| + log |Π - D| - log |Π|) / 2
        """
        s = self.scanner
        times = times[:, s]
        D = (np.diag(self.precision)[s] * (1 - times**-2.0))[:, None, :, None]
        x, V = posterior.mean, posterior.covariance
        x_s, V_s = x[:, s, None], V[:, :, s]
        A = np.eye(D.shape[2]) - V_s[:, s] * D.mT
        G = D * np.linalg.inv(A)
        Gx = G @ x_s
        gain = (x_s * Gx).sum(axis=(2, 3)) - np.linalg.slogdet(A)[1]
        gain = gain / 2 - np.log(times).sum(axis=1)[:, None]
        return gain, x + (V_s @ Gx)[..., 0], V + V_s @ G @ V_s.mT

    def gradient(self, posterior: Posterior) -> tuple[ndarray, ndarray]:
        """The derivative (1 + k,) of the log evidence L by the variances, for one set
        of them, and its average information I (Gilmour, Thompson and Cullis 1995).

        As ∂C/∂v_k = M_k, with w = P r = C⁻¹ (r + A x̂) and F the columns M_k w,

            ∂L/∂v_k = -(tr P M_k - wᵀ M_k w) / 2
            I = Fᵀ P F / 2 = (Fᵀ C⁻¹ F - (Aᵀ C⁻¹ F)ᵀ V (Aᵀ C⁻¹ F)) / 2
        """
        n, v = self.n, posterior.v
        V = posterior.covariance[0]
        x = np.append(posterior.mean[0], 1.0)
        k = v.shape[1]
        rest, count = self.rest_of_kept
        square = x @ rest @ x
        slope = np.zeros(k)  # tr P M_k - wᵀ M_k w
        slope[0] = count / v[0, 0] - (square + np.sum(V * rest[:n, :n])) / v[0, 0] ** 2
        within = np.zeros((k, k))  # Fᵀ C⁻¹ F
        within[0, 0] = square / v[0, 0] ** 3
        across = np.zeros((n, k))  # Aᵀ C⁻¹ F
        across[:, 0] = rest[:n] @ x / v[0, 0] ** 2
        if posterior.last:
            self.add_rows(posterior, slope, within, across)
        if self.smooth:
            N = posterior.products[0]
            N_A, f = N[self.of_smooth, :n], N[self.of_smooth] @ x
            slope[-1] = np.trace(N_A[:, self.of_smooth] - N_A @ V @ N_A.T) - f @ f
            across[:, -1] = N_A.T @ f
            within[-1] = within[:, -1] = f @ across[self.of_smooth]
        return -slope / 2, (within - across.T @ V @ across) / 2

    def add_rows(
        self, posterior: Posterior, slope: ndarray, within: ndarray, across: ndarray
    ) -> None:
        """Add what the rows that speak of the flange say, as in `gradient`."""
        n, V, k = self.n, posterior.covariance[0], len(slope)
        ((factors, _),) = posterior.last
        P, CA, w = self.precisions(posterior)
        less = P - w[:, :, None] * w[:, None]
        slope[self.of_own] += np.tensordot(self.own_parts, less, 3)
        F = np.zeros((*w.shape, k))  # M_k w
        F[..., self.of_own] = np.moveaxis(
            (self.own_parts @ w[..., None])[..., 0], 0, -1
        )
        E = self.rows[..., : self.axes]
        by_profile = np.concatenate([CA, w[..., None]], axis=2)
        for node, Q in self.covariances_of_shared(factors):
            level, J = node.level, node.J[0]
            units = self.units[level.errors]
            (sums,) = level.sums(E[None], by_profile[None])
            EA, f = sums[..., :n], sums[..., n]
            EPE = J - J @ Q @ J - EA @ V @ EA.mT
            diagonal = np.einsum("gjj->j", EPE) - np.sum(f**2, axis=0)
            slope[level.errors] += units @ diagonal
            by_flange = np.zeros((len(E), self.axes))
            by_flange[level.members] = f[level.number]
            F[..., level.errors] += E @ (by_flange[:, None] * units).mT
        within += factors.solve(F)[0][0]
        across += CA.reshape(-1, n).T @ F.reshape(-1, k)

    def precisions(self, posterior: Posterior) -> tuple[ndarray, ndarray, ndarray]:
        """P_ii (profiles, q, q), C⁻¹ A (profiles, q, n) and w = P r (profiles, q) of
        the rows of each profile, in the order of the groups, for one set of variances.
        """
        ((factors, left),) = posterior.last
        root, W_E = factors.root[0], factors.W_E[0]
        Q = np.zeros((len(root), self.axes, self.axes))
        for node, of_groups in self.covariances_of_shared(factors):
            Q[node.level.members] = of_groups[node.level.number]
        inverse = root.mT @ (np.eye(self.q) - W_E @ Q @ W_E.mT) @ root
        X = root.mT @ left[0]
        CA = X[..., :-1]
        P = inverse - CA @ posterior.covariance[0] @ CA.mT
        return P, CA, X @ np.append(posterior.mean[0], 1.0)

    def covariances_of_shared(self, factors: Factors) -> list[tuple[Node, ndarray]]:
        """Each node, from coarse to fine, with Q (G, 6, 6), for one set of
        variances.
        """
        Q = np.zeros((1, self.axes, self.axes))
        of_nodes = []
        for node in factors.nodes[::-1]:
            T = np.eye(self.axes) - node.K[0] @ node.J[0]
            Q = node.K[0] + T @ Q[node.level.parents] @ T.mT
            of_nodes.append((node, Q))
        return of_nodes

    def own(self, v: ndarray) -> ndarray:
        """Covariances (profiles, q, q) of the rows of each profile by itself, for
        variances v (1 + k,).
        """
        return v[0] * np.eye(self.q) + self.E * (v @ self.units) @ self.E.mT

    def alone(self, v: ndarray) -> ndarray:
        """What each profile by itself says of the unknowns, (profiles, n + 1, n + 1):
        [A | r]ᵀ C⁻¹ [A | r], in the posterior's units.
        """
        whole = self.Y.mT @ np.linalg.solve(self.own(v), self.Y)
        plain = np.ix_(range(len(whole)), self.plain, self.plain)
        whole[plain] += self.rest.mT @ self.rest / v[0]
        units = self.units_of(v[None])[0]
        return whole * units[:, None] * units

    def units_of(self, v: ndarray) -> ndarray:
        """(S, n + 1) in which Π is the precision of x, for variances v (S, 1 + k)."""
        units = np.ones((len(v), self.n + 1))
        if self.smooth:
            units[:, self.of_smooth] = np.sqrt(v[:, -1:])
        return units

    def left_out(self, posterior: Posterior) -> tuple[ndarray, ndarray]:
        """How far the rows of each profile (profiles, q) are from what all other
        profiles kept say of them, and the covariance (profiles, q, q) of that.

        Of a profile b that is not kept, r_b + A_b x̂ with covariance C_bb + A_b V A_bᵀ.
        Of one that is kept, P_bb⁻¹ (P r)_b with covariance P_bb⁻¹, the law of a part of
        a Gaussian of precision P, given the rest of it (Christensen, Pearson and
        Johnson 1992).
        """
        A = self.Y[:, :, : self.n]
        errors = self.Y @ np.append(posterior.mean[0], 1.0)
        covariances = self.own(posterior.v[0]) + A @ posterior.covariance[0] @ A.mT
        if posterior.last:
            P, _, w = self.precisions(posterior)
            kept = self.kept[self.order]
            profiles = self.order[kept]
            covariance = np.linalg.pinv(P[kept], hermitian=True)
            errors[profiles] = (covariance @ w[kept][..., None])[..., 0]
            covariances[profiles] = covariance
        return errors, covariances


def inverse_root(C: ndarray) -> tuple[ndarray, ndarray]:
    """L⁻¹ of matrices C = L Lᵀ (S, G, m, m), and the sums (S,) of their log |C|.

    Elimination takes [C | 1] to [Lᵀ | L⁻¹]; of all matrices at once, whose numbers
    stand last.
    """
    m = C.shape[-1]
    A = np.zeros((m, 2 * m, *C.shape[:2]))
    A[:, :m] = C.transpose(2, 3, 0, 1)
    diagonal, ones = (np.einsum("ii...->i...", A[:, k : k + m]) for k in (0, m))
    ones[:] = 1.0
    for j in range(m):
        part = slice(j, m + j + 1)
        A[j, part] /= np.sqrt(A[j, j])
        A[j + 1 :, part] -= A[j, j + 1 : m, None] * A[j, part]
    root = np.ascontiguousarray(A[:, m:].transpose(2, 3, 0, 1))
    return root, 2 * np.log(diagonal).sum(axis=(0, 2))


def squares(rows: ndarray) -> ndarray:
    """Σ rowsᵀ rows (S, columns, columns) of rows (S, ..., columns)."""
    flat = rows.reshape(len(rows), -1, rows.shape[-1])
    return flat.mT @ flat
