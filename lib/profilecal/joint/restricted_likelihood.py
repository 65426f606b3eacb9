"""How the restricted likelihood of a linear model changes with the variances of errors:
what the search for the likeliest sizes goes by.
"""

import numpy as np
from numpy import ndarray

from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.joint.nested_errors import flat


def gradient(model: LinearModel, posterior: Posterior) -> tuple[ndarray, ndarray]:
    """The derivative (1 + k,) of the log evidence ℓ by the variances, and its average
    information I (Gilmour, Thompson and Cullis 1995). The posterior has to be of one
    set of variances.

    As ∂C/∂v_j = M_j, with w = P r = C⁻¹ (r + A x̂) and F the columns M_j w,

        ∂ℓ/∂v_j = -(tr P M_j - wᵀ M_j w) / 2
        I = Fᵀ P F / 2 = (Fᵀ C⁻¹ F - (Aᵀ C⁻¹ F)ᵀ V (Aᵀ C⁻¹ F)) / 2

    P is the same where the smooth errors' coefficients count as unknowns: here they do,
    and C is without them. For the variance of smooth errors, where M = B Bᵀ, I has the
    curvature itself on its diagonal, wᵀ M P M w - tr(P M P M) / 2.
    """
    m, v0, rows = model.m, posterior.v[0, 0], model.rows
    z, V = posterior.whole  # z = [x̂; 1], with the smooth errors' coefficients first
    # of the rows that speak of the flange
    P, X, w = model.precisions(posterior)
    # the slope is tr P M_j at first, and wᵀ M_j w is taken off below
    slope, moves = of_groups(posterior)
    F = rows.E @ moves[rows.groups, None]  # of the errors that profiles share,
    own = np.matvec(rows.parts, w)  # and of those that are one profile's
    F[..., rows.errors] += np.moveaxis(own, 0, -1)
    slope[rows.errors] += rows.parts.reshape(len(rows.errors), -1) @ P.ravel()
    slope -= w.ravel() @ flat(F)
    within = posterior.factors.solve(F)[0][0]  # Fᵀ C⁻¹ F
    across = (flat(X).T @ flat(F))[:-1]  # Aᵀ C⁻¹ F
    # of the rows of the rest, which the scanner's noise alone moves
    rest, count = model.rest_of_kept
    square = z @ rest @ z
    slope[0] += count / v0 - (square + np.sum(V * rest[:-1, :-1])) / v0**2
    within[0, 0] += square / v0**3
    across[:, 0] += rest[:-1] @ z / v0**2
    if model.smooth:
        # their variance is the last; N are the rows of B
        N = posterior.products[:m]
        Bw = N @ z  # Bᵀ w
        BPB = N[:, :m] - N[:, :-1] @ V @ N[:, :-1].T  # Bᵀ P B
        # M = B Bᵀ, so the last column of F is B Bᵀ w
        slope[-1] = np.trace(BPB) - Bw @ Bw
        across[:, -1] = Bw @ N[:, :-1]
        within[-1] = within[:, -1] = Bw @ across[:m]
    information = (within - across.T @ V @ across) / 2
    if model.smooth:
        # from average information, wᵀ M P M w / 2, to the curvature itself
        information[-1, -1] += Bw @ BPB @ Bw / 2 - np.sum(BPB**2) / 2
    return -slope / 2, information


def of_groups(posterior: Posterior) -> tuple[ndarray, ndarray]:
    """Of the errors that groups share: tr P M_j (1 + k,), and motions of the flange
    (groups, a, 1 + k) by which M_j w moves the members of a group. A group has the
    motions of the groups that hold it, too.
    """
    factors, (z, V) = posterior.factors, posterior.whole
    Q, unit_variances = factors.covariances, factors.rows.unit_variances
    traces = np.zeros(len(unit_variances))
    moves = np.zeros((*Q.shape[:2], len(traces)))
    for node in factors.nodes:
        level, J = node.level, node.J[0]
        units = unit_variances[level.errors]
        EZ = posterior.beta[0, level.groups] / node.s[0]  # E_gᵀ C⁻¹ Z
        EA, Ew = EZ[..., :-1], EZ @ z
        EPE = J - J @ Q[level.groups] @ J - EA @ V @ EA.mT
        traces[level.errors] = units @ np.einsum("gjj->j", EPE)
        moves[level.groups] = moves[level.parents]
        moves[level.groups, :, level.errors] = Ew[..., None] * units.T
    return traces, moves
