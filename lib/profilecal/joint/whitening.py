"""Robot errors seen through measurements: residuals made independent and of unit variance."""

import numpy as np


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


class Whitening:
    """Robot errors seen through one term's measurements at one state: they enlarge and correlate the residuals.

    With the errors' derivatives E in units of the scanner noise, residuals have the covariance 1 + E Eᵀ; their
    multiplication with its inverse square root is whitening. Poses come first, then rotation groups.
    """

    def __init__(self, errors, of_pose, of_group, group):
        def prepare(variances):
            E = errors * np.sqrt(variances)[:, None, None]
            A = _halving(np.einsum("bekp,bfkp->bpef", E, E))
            return E, np.einsum("bpef,bfkp->bekp", A, E)

        self.pose = prepare(of_pose) if of_pose.any() else None
        self.marginal = prepare(of_pose + of_group)
        self.shared = errors * np.sqrt(of_group)[:, None, None] if of_group.any() else None
        if self.shared is not None and self.pose:
            self.shared = _remove(self.shared, *self.pose)
        self.member = (group[:, None] == np.arange(group.max() + 1)).astype(float)  # (P, G)

    def groups(self, z, root_weight):
        """z (B, N, K, P), whitened pose by pose and weighted, with what the groups share whitened too."""
        E = self.shared * root_weight
        gram = np.swapaxes(np.einsum("bekp,bfkp->befp", E, E) @ self.member, 1, 3)  # (B, G, 6, 6)
        inner = np.einsum("bekp,bnkp->bnep", E, z) @ self.member  # (B, N, 6, G)
        inner = np.einsum("bgef,bnfg->bneg", _halving(gram), inner) @ self.member.T
        return z - np.einsum("bekp,bnep->bnkp", E, inner)
