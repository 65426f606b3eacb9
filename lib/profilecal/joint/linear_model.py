"""All that is known at a state, to first order, as one linear Gaussian model (a mixed
model; Henderson 1975):

    r + A x = Σ_j s_j E_j u_j + e      x ~ N(0, Π⁻¹)   u_j ~ N(0, 1)   e ~ N(0, s_0²)

r are the residuals and A their derivatives, both over the scanner's noise. x are steps
of the unknowns, which are the sensor pose and the targets, and of the systematic errors
considered, which Π knows to be about zero (Schmidt 1966). u_j are errors of size s_j
that the profiles of one visit, commanded pose or orientation share: of the flange, in
mm or degrees, or of time, in ms; or the coefficients of the robot's smooth errors
(`smooth`), which all profiles share. E_j says how they move the residuals. s_0 is the
scanner's noise over the assumed one. With the variances v = s², M_0 = 1 and
M_j = E_j E_jᵀ,

    C = Σ_j v_j M_j        H = Aᵀ C⁻¹ A + Π        V = H⁻¹        x̂ = -V Aᵀ C⁻¹ r
    P = C⁻¹ - C⁻¹ A V Aᵀ C⁻¹

V is the covariance of x and x̂ its mean. P is the precision of r where x is integrated
out, (C + A Π⁻¹ Aᵀ)⁻¹ by Woodbury's identity.

The model answers what is known of x (`posterior`), also where systematic errors may be
larger (`rescaled`) or smooth errors bend (`by_bends`); how far profiles are from what
the others say (`left_out`); and N = [A | r]ᵀ C⁻¹ [A | r], by which a further error is
looked at (`calibration.evidence`). `restricted_likelihood` says how likely the
variances are.

The rows of the `rest`, which no error of the flange moves, have C = v_0. The C of the
other rows is factored by its structure (`nested_errors`). Smooth errors are integrated
out last, all at once: their columns B stand before the others, Z = [B | A | r], with
the precision 1 / s² of their coefficients, and so come first in a Cholesky factor.

In shapes, p is how many columns A has: the n unknowns of `Problem`, the c errors
considered, the d errors tried, and the coefficients of smooth errors whose size is
known. m is how many columns B has (not points, as in `residuals`), k how many errors
there are beside the scanner's noise, S how many sets of variances are looked at
together, K how many residuals a profile has, q the most rows of a profile that speak of
the flange, and a how many directions errors have: 6 of the flange, and that of time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.linalg.lapack import dtrtri

from profilecal.geometry.noise import SMOOTH, by_unit, normalised_square
from profilecal.geometry.observability import HAND_PRECISION
from profilecal.joint.nested_errors import Factors, Rows, flat, squares
from profilecal.joint.nesting import (
    AT_ONCE,
    Nesting,
    in_parts,
    nesting,
    parts_of,
)
from profilecal.joint.pose_groups import PoseGroups
from profilecal.joint.smooth import SmoothErrors

ROUNDING = 1e-13  # of the largest entry of a matrix of products
MS = 1e-3  # s


@dataclass(frozen=True)
class Posterior:
    """What is known of x for S sets of variances.

    It follows from the products N = Zᵀ C⁻¹ Z, Z = [B | A | r], and log |C|, where C is
    without the smooth errors. With blocks for B, A and r, L is the Cholesky factor of

        diag(s, 1, 1) N diag(s, 1, 1) + diag(1, Π, large)

    where any large number will do. The last row of L, but for the corner, is y. With
    smooth errors integrated out, and L_x and y_x for L and y from place m on,

        rᵀ P r = N_rr - Σ y²        H = L_x L_xᵀ        x̂ = -L_x⁻ᵀ y_x

    The restricted log likelihood (Patterson and Thompson 1971) is, but for a constant,

        ℓ = -(rᵀ P r + log |C|) / 2 - Σ log L_ii
    """

    v: ndarray  # (S, 1 + k)
    m: int
    products: ndarray  # (m + p + 1, m + p + 1) N of the first set
    precision: ndarray  # (p, p) Π
    L: ndarray  # (S, m + p + 1, m + p + 1)
    square: ndarray  # (S,) rᵀ P r, the χ² of all residuals
    log_evidence: ndarray  # (S,) ℓ of the variances
    # C of the rows that speak of the flange, and b and β of Z (`nested_errors`). Only a
    # posterior of one set is asked for these: of many sets, which are looked at in
    # parts, they are those of the last part.
    factors: Factors
    b: ndarray  # (S, groups, a, m + p + 1)
    beta: ndarray  # (S, groups, a, m + p + 1)

    @cached_property
    def root(self) -> ndarray:
        """(S, p, p) L_x⁻¹."""
        return inverse_triangles(self.L[:, self.m : -1, self.m : -1])

    @cached_property
    def covariance(self) -> ndarray:
        """(S, p, p) V."""
        return self.root.mT @ self.root

    @cached_property
    def mean(self) -> ndarray:
        """(S, p) x̂."""
        y = self.L[:, -1, self.m : -1]
        return -np.vecmat(y, self.root)

    @property
    def normal(self) -> ndarray:
        """(S, p + 1, p + 1) N of [A | r], the smooth errors integrated out."""
        L = self.L[:, self.m :, self.m :]
        normal = L @ L.mT
        normal[:, :-1, :-1] -= self.precision
        normal[:, -1, -1] = self.square + np.sum(L[:, -1, :-1] ** 2, axis=1)
        return normal

    @cached_property
    def whole(self) -> tuple[ndarray, ndarray]:
        """The mean of the smooth errors' coefficients and of x, followed by a 1 for r,
        (m + p + 1,), and the covariance (m + p, m + p), for the first set of variances.
        """
        (root,) = inverse_triangles(self.L[:1, :-1, :-1])
        root[:, : self.m] *= np.sqrt(self.v[0, -1])
        return np.append(-self.L[0, -1, :-1] @ root, 1.0), root.T @ root

    def with_smooth(
        self, mean: ndarray, covariance: ndarray
    ) -> tuple[ndarray, ndarray]:
        """The mean (m + p,) and covariance (m + p, m + p) of the smooth errors'
        coefficients and of x, if x has another `mean` (p,) and `covariance` (p, p).

        For each step of x, all of these move by V_•x V_xx⁻¹, where V is their
        covariance and V_xx⁻¹ = H. What they vary by for a given x stays.
        """
        m, (z, V) = self.m, self.whole
        L = self.L[0, m:-1, m:-1]
        moves = V[:, m:] @ L @ L.T
        whole = V + moves @ (covariance - V[m:, m:]) @ moves.T
        return z[:-1] + moves @ (mean - z[m:-1]), whole


@dataclass(frozen=True)
class LinearModel:
    """Profiles are counted through, target by target.

    Of each, `E` and `Y` are rows that say all about the errors of the flange, two of a
    straight edge, three of a ball; `rest` are rows of what else the residuals say.
    """

    E: ndarray  # (profiles, q, a)
    Y: ndarray  # (profiles, q, p + 1)
    rest: ndarray  # (profiles, K, p + 1)
    ranks: ndarray  # (profiles,) rows that speak of the flange
    counts: ndarray  # (profiles,) residuals
    nesting: Nesting
    names: tuple[str, ...]  # (k,) of the errors, that of smooth ones last
    unit_variances: ndarray  # (1 + k, a) of E's errors for one unit of each of v
    precision: ndarray  # (p, p) Π
    kept: ndarray  # (profiles,) those that the model rests on
    of_mount: ndarray | float = 0.0  # (p + 1, p + 1) as normal equations
    may_be_poor: range = range(0)  # the columns of systematic errors
    smooth: SmoothErrors | None = None

    @property
    def p(self) -> int:
        """How many columns A has, and entries x."""
        return len(self.precision)

    @property
    def m(self) -> int:
        """How many coefficients smooth errors have."""
        return self.smooth.count if self.smooth else 0

    def keeping(self, kept: ndarray) -> "LinearModel":
        """The model of the profiles (profiles,) kept only. They say anew what is taken
        out of smooth errors (`SmoothErrors.keeping`).
        """
        if (kept == self.kept).all():
            return self
        smooth = self.smooth and self.smooth.keeping(kept)
        return replace(self, kept=kept, smooth=smooth)

    def without_fresh(self) -> "LinearModel":
        """The same of a robot whose errors are smooth alone, whatever the variances of
        its other errors are. Variances of zero would give the same, more slowly.

        The rows that speak of the flange count as rest, whose cached value is replaced.
        No profile is kept among those rows, and none share an error.
        """
        (rest, count), rows = self.rest_of_kept, self.rows
        none = np.zeros_like(self.kept)
        other = replace(self, kept=none, nesting=nesting(len(none), []))
        # rest_of_kept did not count the entries of these rows, padding included
        all_rest = rest + squares(rows.Z[None])[0]
        vars(other)["rest_of_kept"] = all_rest, count + rows.E[..., 0].size
        return other

    def Z(self, profiles: ndarray) -> ndarray:
        """[B | A | r] (..., q, m + p + 1) of the rows of some profiles (...), by
        number, that speak of the flange.
        """
        Y = self.Y[profiles]
        if not self.smooth:
            return Y
        B = self.smooth.columns(self.E[profiles, :, :6], profiles)
        return np.concatenate([B, Y], axis=2)

    @cached_property
    def rows(self) -> Rows:
        """Of the profiles kept."""
        q, columns = self.E.shape[1], self.m + self.p + 1
        most = max(1, AT_ONCE // (q * columns))
        groups, profiles = self.nesting.bundles(self.kept, most)
        E, Z = self.E[profiles], self.Z(profiles.ravel())
        Z = Z.reshape(*E.shape[:3], columns)
        E[profiles < 0] = Z[profiles < 0] = 0.0
        parts = [np.broadcast_to(np.eye(q), (*profiles.shape, q, q))]
        errors = [0]
        for error, alone in self.nesting.own:
            by_error = E * alone[profiles, None, None] * self.unit_variances[error]
            parts.append(by_error @ E.mT)
            errors.append(error)
        return Rows(
            groups,
            profiles,
            E,
            Z,
            np.array(parts),
            errors,
            self.nesting,
            self.unit_variances,
        )

    @cached_property
    def rest_of_kept(self) -> tuple[ndarray, int]:
        """The products (m + p + 1, m + p + 1) of the rows that no error of the flange
        moves, and their count: all residuals, less q rows for each place in `rows`.

        Places that are padding have log v_0 in log |C| for each of their q rows, too;
        the count is lower by these, and may be negative.
        """
        products = np.zeros((self.m + self.p + 1,) * 2)
        products[self.m :, self.m :] = squares(self.rest[None, self.kept])[0]
        return products, int(self.counts[self.kept].sum()) - self.rows.E[..., 0].size

    def posterior(self, v: ndarray) -> Posterior:
        """What is known of x for variances v (S, 1 + k), the scanner's first and that
        of smooth errors, if there are any, last.
        """
        m, v0 = self.m, v[:, 0]
        rest, count = self.rest_of_kept
        H = rest / v0[:, None, None]  # N at first
        H[:, m:, m:] += self.of_mount
        log_det = count * np.log(v0)
        for part in parts_of(len(v), self.rows.Z.size):
            factors = self.rows.factors(v[part])
            of_part, b, beta = factors.solve(self.rows.Z)
            H[part] += of_part
            log_det[part] += factors.log_det

        products = H[0].copy()
        # the size of smooth errors; without these, the slices :m below are empty
        s = np.sqrt(v[:, -1, None, None])
        H[:, :m] *= s
        H[:, :, :m] *= s
        H[:, m:-1, m:-1] += self.precision
        diagonal = np.einsum("sii->si", H)  # a view: what is written to it is H's
        diagonal[:, :m] += 1.0  # 1 / s² after the scaling by s
        diagonal *= 1 + ROUNDING  # or H may have eigenvalues a little below zero
        square = diagonal[:, -1].copy()  # N_rr, from which Σ y² is taken below
        # the corner is raised, so that the factor exists; the rest of L does not depend
        # on it
        diagonal[:, -1] += square + 1.0
        L = np.linalg.cholesky(H)
        square -= np.sum(L[:, -1, :-1] ** 2, axis=1)
        roots = np.einsum("sii->si", L)[:, :-1]
        log_evidence = -(square + log_det) / 2 - np.log(roots).sum(axis=1)
        return Posterior(
            v, m, products, self.precision, L, square, log_evidence, factors, b, beta
        )

    def rescaled(
        self, posterior: Posterior, times: ndarray
    ) -> tuple[ndarray, ndarray, ndarray]:
        """By how much the log evidence changes, (B, S), and x̂ (B, S, p) and V (B, S, p,
        p), where the systematic errors may be so many `times` (B, p) as large.

        Π, which is diagonal for these errors, becomes Π - D. By Woodbury's identity,
        with G = D (1 - V D)⁻¹,

            V' = V + V G V        x̂' = x̂ + V G x̂
            ℓ' = ℓ + (x̂ᵀ G x̂ - log |1 - V D| + log |Π - D| - log |Π|) / 2
        """
        poor = self.may_be_poor
        times = times[:, poor]
        D = (np.diag(self.precision)[poor] * (1 - times**-2.0))[:, None, :, None]
        x, V = posterior.mean, posterior.covariance
        x_s, V_s = x[:, poor, None], V[:, :, poor]
        less = np.eye(D.shape[2]) - V_s[:, poor] * D.mT  # 1 - V D
        G = D * np.linalg.inv(less)
        Gx = G @ x_s
        gain = (x_s * Gx).sum(axis=(2, 3)) - np.linalg.slogdet(less)[1]
        gain = gain / 2 - np.log(times).sum(axis=1)[:, None]
        return gain, x + (V_s @ Gx)[..., 0], V + V_s @ G @ V_s.mT

    def by_bends(self, v: ndarray) -> ndarray:
        """By how much bends of the smooth errors, which are considered (Schmidt 1966),
        enlarge the covariance (p, p) of x, for variances v (1 + k,).

        Bends, of columns B₂ and coefficients s u, u ~ N(0, 1), are no part of the
        model: the true residuals are r + s B₂ u where the model has r. With B among the
        columns of A, the mean of the model therefore moves by -s V Aᵀ C⁻¹ B₂ u, and its
        covariance should be larger by

            s² `moves` `moves`ᵀ        `moves` = V Aᵀ C⁻¹ B₂
        """
        if not self.smooth:
            return np.zeros_like(self.precision)
        posterior = self.posterior(v[None])
        X = self.precisions(posterior)[1]
        bent = replace(self.smooth, bends=True).keeping(self.kept)
        # Zᵀ C⁻¹ B₂, of which [B | A]ᵀ C⁻¹ B₂ is used below
        across = np.zeros((X.shape[-1], bent.count))
        for part in in_parts(X):
            some = self.rows.profiles[part].ravel()
            columns = bent.columns(self.E[some, :, :6], some)
            across += flat(X[part]).T @ flat(columns)
        moves = posterior.whole[1][self.m :] @ across[:-1]
        return v[-1] * moves @ moves.T

    def precisions(self, posterior: Posterior) -> tuple[ndarray, ndarray, ndarray]:
        """Of the rows of each profile kept, for one set of variances: P_ii (bundles,
        size, q, q), X = C⁻¹ Z (bundles, size, q, m + p + 1) and w = P r (bundles, size,
        q), in the order of `Rows`.
        """
        z, V = posterior.whole
        factors = posterior.factors
        root = factors.root[0]  # L_i⁻¹, of the one set of variances
        D_E = factors.D_E.reshape(self.rows.E.shape)
        Q = factors.covariances[self.rows.groups, None]
        P = root.mT @ root - D_E @ Q @ D_E.mT  # of C⁻¹
        X = np.empty_like(self.rows.Z)
        for part in in_parts(X):
            (W,) = factors.whitened(self.rows.Z, posterior.b, part)
            X[part] = root[part].mT @ W
            CA = X[part, ..., :-1]
            # a product of all rows is faster than one for each profile
            CAV = CA.reshape(-1, len(V)) @ V
            P[part] -= CAV.reshape(CA.shape) @ CA.mT
        return P, X, X @ z

    def own(self, v: ndarray) -> ndarray:
        """Covariances (profiles, q, q) of the rows of each profile by itself, for
        variances v (1 + k,), without smooth errors.
        """
        noise = v[0] * np.eye(self.E.shape[1])
        return noise + self.E * (v @ self.unit_variances) @ self.E.mT

    def left_out(self, posterior: Posterior) -> ndarray:
        """χ² (profiles,) of the rows of each profile that speak of the flange, by what
        all other profiles kept say of them, for one set of variances.

        For a profile i that is not kept, r_i + A_i x̂ has the covariance C_ii + A_i V
        A_iᵀ. For one that is kept, P_ii⁻¹ w_i has the covariance P_ii⁻¹, w = P r: the
        law of a part of a Gaussian of precision P, given the rest of it (Christensen,
        Pearson and Johnson 1992). So its χ² is w_iᵀ P_ii⁻¹ w_i.
        """
        z, V = posterior.whole
        out = np.flatnonzero(~self.kept)
        Z = self.Z(out)
        A = Z[..., :-1]
        covariances = self.own(posterior.v[0])[out] + A @ V @ A.mT
        chi2 = np.empty(len(self.kept))
        chi2[out] = normalised_square(covariances, Z @ z)
        P, _, w = self.precisions(posterior)
        real = self.rows.profiles >= 0
        chi2[self.rows.profiles[real]] = normalised_square(P[real], w[real])
        return chi2


def inverse_triangles(L: ndarray) -> ndarray:
    """The inverses of lower triangles L (S, columns, columns)."""
    return np.array([dtrtri(triangle, lower=1)[0] for triangle in L])


def linear_model(
    by_flange: ndarray,
    columns: ndarray,
    counts: ndarray,
    groups: PoseGroups,
    fresh: Sequence[str],
    precision: ndarray,
    clock: int | None = None,
    smooth: SmoothErrors | None = None,
    **beside: Any,
) -> LinearModel:
    """The model of all profiles. Of each, over the scanner's noise, with zeros where no
    residual is: the derivatives `by_flange` (profiles, K, 6), mm and rad, the `columns`
    [A | r] (profiles, K, p + 1), and how many residuals there are.

    `fresh`: the robot's errors, entries of `Noise`, without the `smooth` ones.
    `precision` (p, p): Π. `clock`: the column of A that is the derivative by the times
    of the profiles, if any has a time. Jitter of these times moves residuals along that
    column, which E therefore has, too. `beside`: other fields of `LinearModel`.
    """
    E, Y, rest, ranks = compressed(by_flange, columns)
    if clock is not None:
        E = np.concatenate([E, Y[:, :, [clock]]], axis=2)
    names = (*fresh, SMOOTH) if smooth else tuple(fresh)
    # none are of the scanner's noise, or smooth
    unit_variances = np.zeros((1 + len(names), E.shape[2]))
    for error, name in enumerate(fresh, 1):
        unit_variances[error, :6] = by_unit(name) ** 2
        unit_variances[error, 6:] = MS**2 * name.endswith("ms")
    return LinearModel(
        E,
        Y,
        rest,
        ranks,
        counts,
        nesting(len(counts), [groups.sharing(name) for name in fresh]),
        names,
        unit_variances,
        precision,
        kept=np.ones(len(counts), dtype=bool),
        smooth=smooth,
        **beside,
    )


def compressed(
    by_flange: ndarray, columns: ndarray
) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """E, Y and the rest of each profile, as `LinearModel` has them, and how many rows
    speak of the flange, (profiles,).

    An orthogonal change of a profile's K rows leaves the scanner's noise as it is. The
    derivatives by the flange, in units of HAND_PRECISION, are U σ Wᵀ with the singular
    values σ. Errors of the flange move the rows Uᵀ [A | r] whose σ is not zero, by E =
    σ Wᵀ, and none of the rest:

        Y = Uᵀ [A | r]        rest = [A | r] - U Y
    """
    U, sigma, Wt = np.linalg.svd(by_flange * HAND_PRECISION, full_matrices=False)
    nonzero = sigma**2 > ROUNDING * sigma.max() ** 2
    ranks = nonzero.sum(axis=1)
    q = max(1, ranks.max())
    sigma, U = sigma * nonzero, (U * nonzero[:, None])[..., :q]
    E = sigma[:, :q, None] * Wt[:, :q] / HAND_PRECISION
    Y = U.mT @ columns
    return E, Y, columns - U @ Y, ranks
