"""What finders make of raw profiles: how often a target is found, and how well."""

import numpy as np
from raw_profiles import RADIUS

from profilecal.geometry.noise import normalised_square
from profilecal.targets import TARGETS


def features_of(kind, profiles, radius=RADIUS):
    """What a target's finder makes of profiles (P, n, 2)."""
    target = TARGETS[kind]
    return target.find(profiles, *(radius for _ in target.size_names))


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
