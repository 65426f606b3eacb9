"""What finders make of raw profiles: how often a target is found, and how well."""

import numpy as np
import pytest
from raw_profiles import RADIUS
from scipy.stats import chi2

import profilecal as pc
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.noise import Noise
from profilecal.joint.problem import Problem
from profilecal.targets import TARGETS
from profilecal.targets.observations import State

ALONG = (4, 20, 35)  # of an arc's 40 points: near its steep ends and in its middle


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
    squares = np.einsum("na,nab,nb->n", error, np.linalg.inv(covariance), error)
    return squares.mean() / 2, len(error)


def off_circle(points, circle):
    return np.hypot(*(points - circle[:2]).T) - circle[2]


def off_ellipse(points, ellipse, radius):
    """How far points (m, 2) are outside an ellipse (4,) that a plane cuts from a rod,
    mm, to first order: the distance from the rod's axis, over how fast it grows across
    the ellipse.
    """
    centre, axis = ellipse[:2], ellipse[2:]
    w = points - centre
    along = w @ axis
    distance = np.sqrt((w**2).sum(axis=1) - along**2)
    slope = np.linalg.norm(w - np.outer(along, axis), axis=1) / distance
    return (distance - radius) / slope


def off_face(points, ends):
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    return (points - ends[0]) @ [-along[1], along[0]]


def assert_means_are_as_exact_as_stated(features, truth, distance):
    """For features of curves, from which `distance(points, true)` says how far points
    are.

    No mean is drawn inwards by the bend of its block: their own mean is zero to within
    its standard error.
    """
    assert share_found(features) >= 0.99
    pairs = [pair for pair in zip(features, truth, strict=True) if pair[0].found]
    off = np.array([distance(feature.points, true) for feature, true in pairs])
    variance = np.array([feature.covariance[:, 0, 0] for feature, _ in pairs])
    for k in ALONG:
        squares = off[:, k] ** 2 / variance[:, k]
        assert np.mean(squares) == pytest.approx(1, abs=4 * np.sqrt(2 / len(squares)))
    means = off.mean(axis=1)
    assert abs(means.mean()) < 4 * means.std() / np.sqrt(len(means))


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
        pose, placement = truth.pose[None], tuple(p[None] for p in truth.target.frame)
        state = State(pose[:, :3, :3], pose[:, :3, 3], (placement,))
        (columns,) = problem.linear(state)
        residuals.append(columns[0, -1].ravel())
    r = np.concatenate(residuals)
    count = np.count_nonzero(r)
    assert count > 100
    assert chi2.ppf(1e-4, count) < r @ r < chi2.isf(1e-4, count)
