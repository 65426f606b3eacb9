"""What finders make of raw profiles: how often a target is found, and how well."""

import numpy as np
from raw_profiles import RADIUS
from scipy.stats import chi2
from simulated import state_of

import profilecal as pc
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.noise import Noise, normalised_square
from profilecal.joint.problem import Problem
from profilecal.targets import TARGETS


def features_of(kind, profiles, radius=RADIUS):
    """What a target's finder makes of profiles (P, n, 2)."""
    target = TARGETS[kind]
    return target.find(profiles, *(radius for _ in target.lengths))


def share_found(features):
    return np.mean([feature.found for feature in features])


def shapes_found(features):
    return {feature.shape for feature in features if feature.found}


def normalised(features, truth):
    """Mean of eᵀ C⁻¹ e / 2 over all points found, 1 where the stated covariance is
    right; and their number.

    The mean of n squared errors, each over its variance, has a standard deviation of
    1 / √n.
    """
    pairs = zip(features, truth, strict=True)
    error = np.concatenate([f.points - true for f, true in pairs if f.found])
    covariance = np.concatenate([f.covariance for f in features if f.found])
    return normalised_square(covariance, error).mean() / 2, len(error)


def assert_features_are_as_exact_as_stated(kind, seeds=range(4)):
    """Of a target in simulated profiles: the residuals at the true poses, over what its
    finder states, are as large as chance makes them. An answer would not show it, which
    finds the size of the noise itself.
    """
    residuals = []
    for seed in seeds:
        scan, truth = pc.simulate(
            kind, seed, measured="profiles", groups=8, positions=3
        )
        seen = observe(scan)
        unit = seen.typical_mm
        problem = Problem([as_observations(scan, seen, unit)], Noise(unit))
        (columns,) = problem.linear(state_of(truth))
        residuals.append(columns[0, -1].ravel())
    r = np.concatenate(residuals)
    count = np.count_nonzero(r)
    assert count > 100
    assert chi2.ppf(1e-4, count) < r @ r < chi2.isf(1e-4, count)
