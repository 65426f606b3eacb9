"""Errors that residuals share, integrated out of the normal equations.

Errors of the flange (`joint.sharing`) and of what all poses have in common (`joint.systematic`) are random effects of
known variance. One level after the other is removed, as in Henderson's mixed-model equations (1975): with an effect's
covariance S, its information A = EᵀE and B = Eᵀz, z the columns (derivatives, residual) and E those of the effect, both
over the noise, what remains is

    A' = (1 + A S)⁻¹ A        B' = (1 + A S)⁻¹ B        zᵀz - Bᵀ S B'

and the determinant of the residuals' covariance grows by |1 + A S|.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from profilecal.joint.observability import POSE_UNITS

LEAST_EIGENVALUE = 1e-12  # of the largest eigenvalue over all profiles; smaller ones are rounding
ROUNDING = 1e-14  # of the largest entry: added to a diagonal whose ones it may have swallowed


@dataclass(frozen=True)
class Information:
    """What measurements say of K flange errors, of the unknowns, and of both together; leading axes are a batch."""

    of_errors: np.ndarray | None  # (..., K, 6, 6) A; None where none is left
    crossed: np.ndarray | None  # (..., K, 6, n) B
    normal: np.ndarray  # (..., n, n) zᵀz
    log_determinant: np.ndarray | None = None  # (...) of the residuals' covariance; None where nobody asks for it


@dataclass(frozen=True)
class Rows:
    """`Information` in factors. A profile says of its flange error what r independent residuals would, two for a
    straight edge; many variances are then tried at little cost."""

    by_errors: np.ndarray  # (K, r, 6) E, with EᵀE = A
    by_unknowns: np.ndarray  # (K, r, n) z, with Eᵀz = B
    rest: np.ndarray  # (n, n) what of the normal equations the rows z do not make up

    @cached_property
    def products(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the rows i, j of a profile: E_ic E_jc (6, r r K), z_i z_j (r r K, n n), and E_i [E z]_j (K, r r, .)."""
        E, z = self.by_errors, self.by_unknowns
        K, r, n = z.shape
        both = np.concatenate([E, z], axis=-1)
        return (
            np.einsum("kic,kjc->cijk", E, E).reshape(6, -1),
            np.einsum("kim,kjn->ijkmn", z, z).reshape(r * r * K, n * n),
            (E[:, :, None, :, None] * both[:, None, :, None]).reshape(K, r * r, -1),
        )

    def without_errors(self, variances, member, factor) -> Information:
        """What `remove` leaves where the noise has variances 1 / factor, for S sets: variances (S, 6), factor (S,)."""
        (K, r, n), S = self.by_unknowns.shape, len(factor)
        by_errors, by_unknowns, crossed = self.products
        grown = ((factor[:, None] * variances) @ by_errors).reshape(S, r, r, K)
        inverse, determinant = inverse_of(np.eye(r)[..., None] + grown)
        weight = factor[:, None] * inverse.reshape(S, -1)
        normal = factor[:, None, None] * self.rest + (weight @ by_unknowns).reshape(S, n, n)
        log_determinant = np.log(determinant).sum(axis=-1)
        if member is None:
            return Information(None, None, normal, log_determinant)
        left = summed(weight.reshape(S, -1, K).transpose(2, 0, 1) @ crossed, member)
        left = left.reshape(-1, S, 6, 6 + n).swapaxes(0, 1)
        return Information(left[..., :6], left[..., 6:], normal, log_determinant)


def inverse_of(matrices) -> tuple[np.ndarray, np.ndarray]:
    """Inverses, and determinants (S, K), of positive definite matrices (S, r, r, K): by Gauss-Jordan elimination, each
    step for all of them at once, as they are many and small."""
    ridge = ROUNDING * np.abs(matrices).max(axis=(1, 2), keepdims=True)
    left, determinant = matrices + ridge * np.eye(matrices.shape[1])[..., None], 1.0
    for k in range(matrices.shape[1]):
        pivot = left[:, k, k].copy()
        row, column = left[:, k] / pivot[:, None], left[:, :, k].copy()
        left -= column[:, :, None] * row[:, None]
        left[:, k], left[:, :, k], left[:, k, k] = row, -column / pivot[:, None], 1 / pivot
        determinant = determinant * pivot
    return left, determinant


def rows_of(information: Information) -> Rows:
    """The factors of what measurements say (without a batch)."""
    values, vectors = np.linalg.eigh(information.of_errors * POSE_UNITS[:, None] * POSE_UNITS)
    there = values > LEAST_EIGENVALUE * values.max()
    first = 6 - int(there.sum(axis=1).max(initial=1))
    root = np.sqrt(np.where(there, values, 0.0))[:, first:, None]
    across = np.swapaxes(vectors[..., first:], 1, 2)
    z = across @ (POSE_UNITS[:, None] * information.crossed) / np.where(root > 0, root, np.inf)
    return Rows(root * across / POSE_UNITS, z, information.normal - (np.swapaxes(z, 1, 2) @ z).sum(axis=0))


def remove(information: Information, variances, member=None) -> Information:
    """What is left once independent errors of some variances (..., 6) are integrated out; those that are a `member`
    (K,) of the same error of the next level are one from there on. Without it, what is left of the unknowns alone."""
    A, B = information.of_errors, information.crossed
    whole = B if member is None else np.concatenate([A, B], axis=-1)
    M, log_determinant = information.normal, information.log_determinant
    if np.any(variances):
        inflated = inflation(A, variances)
        whole = np.linalg.solve(inflated, whole)
        weighed = variances[..., None, :, None] * whole[..., -B.shape[-1] :]
        stacked, weighed = (part.reshape(*part.shape[:-3], -1, part.shape[-1]) for part in (B, weighed))
        M = M - np.swapaxes(stacked, -1, -2) @ weighed  # summed over the K errors
        if log_determinant is not None:
            log_determinant = log_determinant + np.log(np.abs(np.linalg.det(inflated))).sum(axis=-1)
    if member is None:
        return Information(None, None, M, log_determinant)
    whole = np.moveaxis(summed(np.moveaxis(whole, -3, 0), member), 0, -3)
    return Information(whole[..., :6], whole[..., 6:], M, log_determinant)


def remove_each(information: Information, levels) -> np.ndarray:
    """The normal equations (..., n, n) of the unknowns without the errors of some levels, finest first
    (`Sharing.levels`)."""
    *finer, (coarsest, _) = levels
    for variances, member in finer:
        information = remove(information, variances, member)
    return remove(information, coarsest).normal


def summed(parts, member) -> np.ndarray:
    """Of parts (K, ...), those of each member together."""
    if np.array_equal(member, np.arange(len(member))):
        return parts
    belongs = (np.arange(member.max() + 1)[:, None] == member).astype(float)
    return (belongs @ parts.reshape(len(parts), -1)).reshape(-1, *parts.shape[1:])


def inflation(of_errors, variances) -> np.ndarray:
    """1 + A S (..., 6, 6), from A (..., 6, 6) and the diagonal of S (..., 6)."""
    inflated = np.eye(6) + of_errors * variances[..., None, None, :]
    return inflated + ROUNDING * np.abs(inflated).max(axis=(-2, -1), keepdims=True) * np.eye(6)


def remove_common(normal, first: int, precision) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations (..., n, n) without the unknowns from `first` up to the residual, of which one knows beforehand
    that they are zero to a precision (c,), and those unknowns (..., c) where the others do not change."""
    c = slice(first, first + len(precision))
    keep = np.r_[0:first, first + len(precision) : normal.shape[-1]]
    inner = normal[..., c, c] + np.diag(precision)
    across = normal[..., c, keep]
    found = np.linalg.solve(inner, across)
    return normal[..., keep[:, None], keep] - np.swapaxes(across, -1, -2) @ found, -found[..., -1]
