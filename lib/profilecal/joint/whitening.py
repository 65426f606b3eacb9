"""Robot errors seen through measurements: residuals made independent and of unit variance.

Indices: b a batch, p poses, k the residuals of a pose, n columns (derivatives, residual), e and f the six components of
a flange pose's error, g rotation groups.
"""

import numpy as np


class Whitening:
    """Robot errors at one state: they enlarge and correlate the residuals of one term.

    With the errors' derivatives E in units of the scanner noise, residuals have the covariance 1 + E Eᵀ; their
    multiplication with its inverse square root is whitening. Poses come first, then rotation groups.
    """

    def __init__(self, errors, of_pose, of_group, group):
        def prepare(variances):
            E = errors * np.sqrt(variances)[:, None, None]
            A = _halving(np.einsum("bekp,bfkp->bpef", E, E))
            return E, np.einsum("bpef,bfkp->bekp", A, E)

        self._pose = prepare(of_pose) if of_pose.any() else None
        self._marginal = prepare(of_pose + of_group)
        self._shared = errors * np.sqrt(of_group)[:, None, None] if of_group.any() else None
        if self._shared is not None and self._pose:
            self._shared = _remove(self._shared, *self._pose)
        self._member = (group[:, None] == np.arange(group.max() + 1)).astype(float)  # (P, G)

    def each_pose_alone(self, residual) -> np.ndarray:
        """Residuals (B, K, P), whitened by all errors of their own pose."""
        return _remove(residual[:, None], *self._marginal)[:, 0]

    def poses(self, z) -> np.ndarray:
        """Columns z (B, N, K, P), whitened by what is fresh at each pose."""
        return _remove(z, *self._pose) if self._pose else z

    def groups(self, z, root_weight) -> np.ndarray:
        """Columns z (B, N, K, P), whitened pose by pose and weighted, with what the groups share whitened too."""
        if self._shared is None:
            return z
        E = self._shared * root_weight
        gram = np.swapaxes(np.einsum("bekp,bfkp->befp", E, E) @ self._member, 1, 3)  # (B, G, 6, 6)
        inner = np.einsum("bekp,bnkp->bnep", E, z) @ self._member  # (B, N, 6, G)
        inner = np.einsum("bgef,bnfg->bneg", _halving(gram), inner) @ self._member.T
        return z - np.einsum("bekp,bnep->bnkp", E, inner)


def _halving(gram):
    """A (..., 6, 6) with (1 - E A Eᵀ)² = (1 + E Eᵀ)⁻¹, from the Gram matrices EᵀE (..., 6, 6) of errors E."""
    values, vectors = np.linalg.eigh(gram)
    values = np.maximum(values, 1e-300)
    root = np.sqrt(1 + values)
    return (vectors / (root * (1 + root))[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def _remove(z, E, EA):
    """z (B, N, K, P) times (1 - E A Eᵀ), pose by pose; E and E A are (B, 6, K, P)."""
    inner = np.einsum("bekp,bnkp->bnep", E, z)
    return z - np.einsum("bekp,bnep->bnkp", EA, inner)
