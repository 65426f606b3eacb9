"""How well a measured point is known: what a calibration is made for."""

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.checks import check_rigid
from profilecal.geometry.noise import SMOOTH, by_unit
from profilecal.geometry.poses import carry
from profilecal.joint.smooth import shifting
from profilecal.joint.solution import Solution


def point_sd(
    solution: Solution, x: ArrayLike, z: ArrayLike, T: ArrayLike | None = None
) -> ndarray:
    """What `Calibration.point_sd_mm` gives.

    A point p of the scan plane is q = R p + t by the sensor pose. The true one is
    T · exp(δ), δ = (ρ, φ) of covariance C, so that q moves by R (ρ + φ × p):

        R L(p) C L(p)ᵀ Rᵀ        L(p) = [1, -[p]×]

    Most of C is usually an error of the robot that all poses share, at the size that is
    believed of it, as no residual shows it. It counts once.

    At a pose of the flange the robot errs by a shift s and a turn ψ about the flange's
    origin, of variances S. A point q in the flange's frame moves by s + ψ × q, which
    adds L(q) S L(q)ᵀ.
    """
    p = np.stack(np.broadcast_arrays(x, 0.0, z), axis=-1)
    R, L = solution.rotation, shifting(p)[..., :3, :]
    C = R @ L @ solution.covariance_total @ L.mT @ R.T
    if T is not None:
        T = np.asarray(T, float)
        check_rigid("T_base_flange", T.reshape(-1, *T.shape[-2:]))
        R_flange, T_flange = T[..., :3, :3], T[..., :3, 3]
        q = carry(R, solution.translation, p)
        to_hand = solution.problem.to_hand
        if to_hand:
            q = carry(R_flange.mT, np.zeros(3), q - T_flange)
            C = R_flange.mT @ C @ R_flange
        L = shifting(q)[..., :3, :]
        # the total covariance has smooth errors
        sizes = solution.error_sizes.of_robot | {SMOOTH: 0.0}
        S = sum((by_unit(name) * size) ** 2 for name, size in sizes.items())
        C = C + L * S @ L.mT
        if not to_hand:
            C = R_flange @ C @ R_flange.mT
    return np.sqrt(np.diagonal(C, axis1=-2, axis2=-1))


def points_seen(solution: Solution) -> ndarray:
    """x and z (2, n), mm, of all that was seen; of circles, two points of each arc."""
    points = [
        observed.points[0, :, int(observed.are_circles) :].reshape(-1, 2)
        for observed in solution.problem.observations
    ]
    every = np.concatenate(points)
    return every[np.isfinite(every).all(axis=1)].T


def over_all_seen(solution: Solution) -> list[ndarray]:
    """x and z (3, 3), mm, from corner to corner of what was seen."""
    points = points_seen(solution)
    return [*np.meshgrid(*np.linspace(points.min(axis=1), points.max(axis=1), 3).T)]
