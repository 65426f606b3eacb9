"""From a user's scans to a sensor pose with its evidence: observations, joint solution, and what to tell the user."""

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from profilecal.geometry.noise import Noise
from profilecal.joint.observability import RANK
from profilecal.joint.problem import Problem, units_by_hand
from profilecal.joint.solution import Solution


def likeliest_noise(observed, noise: Noise, solution: Solution) -> Noise:
    """The noise with the profile and robot position errors that make the residuals of the poses kept most likely.

    A pose's position error moves all its points together, the scanner's noise each by itself. Where poses have a point
    or two only, the two cannot be told apart and the scanner's is kept. What fitting the unknowns took out of the
    residuals is allowed for: restricted maximum likelihood (Patterson and Thompson 1971).
    """
    problem = Problem(observed, noise)
    state = solution.state
    shared, lever, own, count, start = [], [], 0.0, 0, 6
    for term, placement, bad in zip(problem.terms, state.placements, solution.rejected, strict=True):
        z, present = term.linearise(state, placement, True, with_robot=True)
        z = term.in_units_of_noise(z, np.ones((1, 1, 1)))[0][..., ~bad].transpose(2, 1, 0)  # (P, K, columns)
        Jr = np.zeros((*z.shape[:2], problem.n + 1))
        Jr[..., np.r_[0:6, start : start + term.n, problem.n]] = z[..., : 7 + term.n]
        U, size, _ = np.linalg.svd(z[..., -6:-3], full_matrices=False)  # by the position of the flange
        along = np.einsum("pki,pkn->pin", U, Jr)
        shared.append(along.reshape(-1, problem.n + 1))
        lever.append(size.ravel())
        own += np.einsum("pkn,pkm->nm", Jr, Jr) - np.einsum("pin,pim->nm", along, along)
        count += Jr[..., 0].size - size.size - (0 if present is None else np.sum(~present[0][:, ~bad]))
        start += term.n
    shared, lever = np.concatenate(shared), np.concatenate(lever)
    many = count > len(lever)

    units = np.append(units_by_hand(problem), 1.0)
    own, shared = own * units[:, None] * units, shared * units
    values, vectors = np.linalg.eigh((own + shared.T @ shared)[:-1, :-1])
    known = vectors[:, values > RANK * values[-1]]

    def unlikely(levels):
        profile = np.exp(2 * levels[1]) if many else noise.profile_mm**2
        variance = profile + np.exp(2 * levels[0]) * lever**2
        M = own / profile + (shared.T / variance) @ shared
        A, b = known.T @ M[:-1, :-1] @ known, known.T @ M[:-1, -1]
        chi2 = M[-1, -1] - b @ np.linalg.solve(A, b)
        return chi2 + np.log(variance).sum() + count * np.log(profile) + np.linalg.slogdet(A)[1]

    start = np.log([np.sqrt(np.mean(shared[:, -1] ** 2) + 1e-12), noise.profile_mm])
    found = np.exp(minimize(unlikely, start if many else start[:1], method="Nelder-Mead", options={"xatol": 1e-3}).x)
    return replace(noise, profile_mm=float(found[1]) if many else noise.profile_mm, position_mm=float(found[0]))
