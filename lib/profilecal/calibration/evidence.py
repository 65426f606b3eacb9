"""What do residuals say of something that may be wrong, under a model of all else?

Of residuals r the model says how they change with its unknowns x ~ N(0, Π⁻¹), by A, and
how they err, C. It predicts r ~ N(0, S), S = C + A Π⁻¹ Aᵀ. Of steps y, which change r
by B and of which nothing is known beforehand, r then says

    g = Bᵀ S⁻¹ r        I = Bᵀ S⁻¹ B        χ² = rᵀ S⁻¹ r

By Woodbury's identity these are what is left of N = [A | B | r]ᵀ C⁻¹ [A | B | r] where
x is integrated out (a Schur complement):

    [I  g ]
    [gᵀ χ²] = N_bb - N_bA (N_AA + Π)⁻¹ N_Ab,  b = (B, r)

Three questions are asked so: what may be wrong at all poses, whether the sensor has
moved meanwhile (both `plausibility`), and whether a later scan is as predicted
(`check_mount`).
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray


@dataclass(frozen=True)
class Evidence:
    """What residuals say of steps y (k,)."""

    information: ndarray  # (k, k) I
    slope: ndarray  # (k,) g
    chi2: float
    x_per_step: ndarray  # (n, k) by how much one unit of each step moves x

    def of(self, part: slice) -> "Evidence":
        """What they say of some of the steps, if there are no others."""
        information, x_per_step = self.information[part, part], self.x_per_step[:, part]
        return Evidence(information, self.slope[part], self.chi2, x_per_step)

    def each(self) -> ndarray:
        """Each step that makes the residuals smallest, if there is no other, and its
        standard deviation, (2, k) (Rao's score test, 1948).
        """
        information = np.diag(self.information)
        return np.array([-self.slope / information, information**-0.5])

    @property
    def known(self) -> ndarray:
        """(k, k) the information, if each has a standard deviation of 1 beforehand."""
        return self.information + np.eye(len(self.slope))

    @property
    def likeliest(self) -> ndarray:
        """The steps (k,) then."""
        return -np.linalg.solve(self.known, self.slope)

    @property
    def explained(self) -> float:
        """By how much these make χ² smaller."""
        return float(-self.slope @ self.likeliest)

    @property
    def log_odds(self) -> float:
        """The logarithm of how many times as likely they make the residuals."""
        return self.explained / 2 - np.linalg.slogdet(self.known)[1] / 2


def evidence(normal: ndarray, precision: ndarray) -> Evidence:
    """What residuals say of the columns B of `normal`, N (n + k + 1, n + k + 1).
    `precision` (n, n): Π.
    """
    n = len(precision)
    across = normal[:n, n:]
    X = -np.linalg.solve(normal[:n, :n] + precision, across)
    left = normal[n:, n:] + across.T @ X
    return Evidence(
        information=left[:-1, :-1],
        slope=left[:-1, -1],
        chi2=left[-1, -1],
        x_per_step=X[:, :-1],
    )
