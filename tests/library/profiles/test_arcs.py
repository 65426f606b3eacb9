"""The arcs of balls and rods in raw profiles: how often and how well they are found."""

import numpy as np
import pytest
from finding import assert_means_are_as_exact_as_stated, features_of, share_found
from numpy.random import default_rng
from numpy.testing import assert_allclose
from raw_profiles import balls, rods, spoil
from scipy.differentiate import jacobian

from profilecal.profiles.arcs import Section


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


@pytest.mark.parametrize("spoiled", [False, True], ids=["clean", "spoiled"])
def test_a_ball_is_found_and_as_exact_as_stated(spoiled):
    rng = default_rng(3)
    profiles, circles = balls(rng)
    if spoiled:
        profiles = spoil(profiles, circles[:, None, :2], rng)
    features = features_of("ball", profiles)
    assert_means_are_as_exact_as_stated(features, circles, off_circle)


@pytest.mark.parametrize("spoiled", [False, True], ids=["clean", "spoiled"])
@pytest.mark.parametrize(
    ("radius", "background"), [(5.0, 30.0), (5.0, None), (25.0, None), (60.0, 30.0)]
)
def test_a_rod_is_found_and_as_exact_as_stated(radius, background, spoiled):
    rng = default_rng(3)
    profiles, ellipses = rods(rng, radius=radius, background=background)
    if spoiled:
        profiles = spoil(profiles, ellipses[:, None, :2], rng)
    features = features_of("rod", profiles, radius)

    def distance(points, ellipse):
        return off_ellipse(points, ellipse, radius)

    assert_means_are_as_exact_as_stated(features, ellipses, distance)


@pytest.mark.parametrize("radius", [15.0, 40.0])
def test_a_rod_or_ball_of_another_size_is_not_found(radius):
    """A circle up to a quarter larger may pass for a leaning rod, less its flanks."""
    rng = default_rng(4)
    profiles, _ = rods(rng, 100)
    assert share_found(features_of("rod", profiles, radius)) < 0.01
    profiles, circles = balls(rng, 100)
    other = np.abs(circles[:, 2] / radius - 1) > 0.25
    assert share_found(features_of("rod", profiles[other], radius)) == 0


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.0, 1.0), (-0.6, 0.3)])
def test_a_section_is_an_ellipse_and_its_distances_have_their_derivatives(lean):
    radius = 10.0
    section = Section(np.array([1.0, 2.0]), np.array(lean), radius)
    size = np.hypot(1, np.hypot(*lean))
    # from the rod seen along its axis
    oblique = np.eye(2) + np.outer(lean, lean) / (1 + size)
    angles = np.linspace(-3, 3, 50)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    forward = np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
    points = section.centre + radius * around @ oblique
    tangents = forward @ oblique

    ellipse = np.append(section.centre, section.lean / size)
    assert_allclose(off_ellipse(points, ellipse, radius), 0, atol=1e-12)
    off, normals = section.off_and_normals(points)
    assert_allclose(off, 0, atol=1e-12)
    assert_allclose(np.linalg.norm(normals, axis=1), 1)
    assert_allclose((normals * tangents).sum(axis=1), 0, atol=1e-12)
    outside, _ = section.off_and_normals(points + 1e-4 * normals)
    assert_allclose(outside, 1e-4, atol=1e-8)
    at_centre, _ = section.off_and_normals(section.centre[None])
    assert np.isnan(at_centre)  # nowhere is outwards

    def off_by(states):
        """How far the points are outside sections (4, ...), (50, ...)."""
        flat = states.reshape(4, -1).T
        sections = [Section(state[:2], state[2:], radius) for state in flat]
        off = [section.off_and_normals(points)[0] for section in sections]
        return np.stack(off, axis=-1).reshape(50, *states.shape[1:])

    numerical = jacobian(off_by, np.concatenate([section.centre, section.lean])).df
    assert_allclose(section.derivatives(points), numerical, atol=1e-8)
