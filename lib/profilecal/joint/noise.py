"""The noise that a solution rests on, decided once, before it; and robot errors, estimated from its residuals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2 as chi2_law

from profilecal.geometry.fitting import affine_residuals
from profilecal.geometry.noise import Noise
from profilecal.joint.observability import RANK
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.state import State

FROM_PROFILES = "from the profiles themselves"
LEAST_FREEDOM = 10  # degrees of freedom that a scatter inside rotation groups must have to be trusted
WORTH_A_WORD = 0.1  # of the scanner's noise: an estimated robot error that is larger


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of a solution, and where it is from."""

    noise: Noise
    source: str  # given; groups: scatter inside rotation groups; residuals: still to be found; profiles: raw profiles
    how: str  # in words
    features_mm: float = 0.0  # what raw profiles say of their features; > 0: the robot's position error is estimated

    @property
    def unknown(self) -> bool:
        """Whether the residuals have to tell it."""
        return self.source == "residuals"


def decide(
    observations: Sequence[Observations],
    stated: Noise,
    features_mm: float = 0.0,
    shared_mm: float = 0.0,
    *,
    estimating: bool = True,
) -> NoiseLevel:
    """The noise to begin with: from raw profiles, as stated, from rotation groups, or 1 mm until the residuals tell.

    `features_mm`: the noise of features that raw profiles themselves show, 0 where there are none. What it does not
    explain is the robot's, whose position error is then to be estimated (not `estimating`: it is not) unless some error
    of the robot is stated. `shared_mm`: what features of one orientation err together; it counts as the robot's.

    Raises ValueError for a noise that is none.
    """
    estimating = estimating and not stated.of_robot
    stated = replace(stated, group_position_mm=float(np.hypot(stated.group_position_mm, shared_mm)))
    if features_mm and not estimating:
        return NoiseLevel(replace(stated, profile_mm=features_mm), "profiles", FROM_PROFILES)
    if stated.profile_mm and not features_mm:
        if not stated.profile_mm > 0:
            raise ValueError(f"profile_mm is {stated.profile_mm}; expected a standard deviation, 0 if unknown")
        return NoiseLevel(stated, "given", "as given")
    found = [affine_noise(o) for o in observations if o.target.affine and o.group is not None]
    freedom = sum(f for _, f in found)
    if freedom >= LEAST_FREEDOM:
        level = max(float(np.sqrt(sum(f * s**2 for s, f in found) / freedom)), 1e-12)
        how = f"from the scatter inside rotation groups, {freedom} degrees of freedom"
        return NoiseLevel(replace(stated, profile_mm=level), "groups", how, features_mm)
    return NoiseLevel(replace(stated, profile_mm=1.0), "residuals", "from the residuals", features_mm)


def with_robot_error(level: NoiseLevel, noise: Noise) -> NoiseLevel:
    """The level of a solution whose noise and robot error were estimated together."""
    how = FROM_PROFILES
    if noise.position_mm > WORTH_A_WORD * noise.profile_mm:
        how += f", and a robot position error of {noise.position_mm:.2g} mm at each pose, from the residuals"
    return NoiseLevel(noise, "profiles", how, level.features_mm)


def affine_noise(observations: Observations) -> tuple[float, int]:
    """Scanner noise from an edge or a marked point before anything is calibrated, mm, and its degrees of freedom.

    Inside a rotation group the sensed point is an affine function of the flange position, whatever the calibration:
    what is left of a regression is noise. The median over the groups keeps a bad point from counting.
    """
    P, m = observations.points.shape[-3:-1]
    points, weight = np.asarray(observations.points)[0].reshape(P, 2 * m), np.ones(P)
    if observations.covariance is not None:
        weight = 2 * m / np.trace(observations.covariance[0], axis1=1, axis2=2)
    variances, freedoms = [], []
    for label in np.unique(observations.group):
        rows = (observations.group == label) & np.isfinite(points).all(axis=1)
        if rows.sum() < 3:
            continue
        left, _, freedom = affine_residuals(observations.T_flange[0, rows], points[rows], weight[rows])
        if freedom > 0:
            variances.append(np.sum(left**2) / chi2_law.median(2 * m * freedom))
            freedoms.append(2 * m * freedom)
    return (float(np.sqrt(np.median(variances))), sum(freedoms)) if variances else (0.0, 0)


def likeliest_noise(observations: Sequence[Observations], noise: Noise, state: State, kept) -> Noise:
    """The noise with the profile and robot position errors that make the residuals of the poses kept most likely.

    A pose's position error moves all its points together, the scanner's noise each by itself. Where poses have a point
    or two only, the two cannot be told apart and the scanner's is kept. What fitting the unknowns took out of the
    residuals is allowed for: restricted maximum likelihood (Patterson and Thompson 1971).
    """
    problem = Problem(observations, noise)
    shared, lever, own, count = [], [], 0.0, 0
    for index, (linear, good) in enumerate(zip(problem.linear(state, with_flange=True), kept, strict=True)):
        # one row for each residual, by pose: (P, K, columns), mm
        rows, by_position = (
            noise.profile_mm * z[0][..., good].transpose(2, 1, 0)
            for z in (linear.with_residual, linear.by_flange[:, :3])
        )
        Jr = np.zeros((*rows.shape[:2], problem.n + 1))
        Jr[..., problem.columns(index)] = rows
        U, size, _ = np.linalg.svd(by_position, full_matrices=False)
        along = np.einsum("pki,pkn->pin", U, Jr)  # i: the combinations of a pose's residuals that its position moves
        shared.append(along.reshape(-1, problem.n + 1))
        lever.append(size.ravel())
        own += np.einsum("pkn,pkm->nm", Jr, Jr) - np.einsum("pin,pim->nm", along, along)
        count += Jr[..., 0].size - size.size
        count -= 0 if linear.present is None else int(np.sum(~linear.present[0][:, good]))
    shared, lever = np.concatenate(shared), np.concatenate(lever)
    many = count > len(lever)

    units = np.append(problem.units, 1.0)
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
