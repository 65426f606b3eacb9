"""The arcs of balls and rods in raw profiles: those of other sizes; sections."""

import numpy as np
import pytest
from finding import features_of, share_found
from numpy.random import default_rng
from numpy.testing import assert_allclose
from raw_profiles import balls, disks, rods

from profilecal.profiles.arcs import Section, find_balls


@pytest.mark.parametrize("radius", [15.0, 40.0])
def test_a_rod_or_ball_of_another_size_is_not_found(radius):
    """A circle up to a quarter larger may pass for a leaning rod, less its flanks."""
    rng = default_rng(4)
    profiles, _ = rods(rng, 50)
    assert share_found(features_of("rod", profiles, radius)) == 0
    profiles, circles = balls(rng, 50)
    other = np.abs(circles[:, 2] / radius - 1) > 0.25
    assert share_found(features_of("rod", profiles[other], radius)) == 0


def test_a_step_is_no_ball():
    """A circle as large as the step touches the faces before it and behind it."""
    profiles, _ = disks(default_rng(4), 60)
    assert share_found(features_of("ball", profiles)) == 0


@pytest.mark.parametrize(
    ("kind", "second"), [("ball", 22.0), ("ball", 21.0), ("rod", 22.0)]
)
def test_of_two_alike_none_is_taken_by_chance(kind, second):
    """Of 22 mm, beside a second, above a table."""
    x = np.linspace(-60, 60, 800)
    pair = [(-30, 22), (30, second)]
    heights = [np.sqrt(np.maximum(r**2 - (x - at) ** 2, 0)) for at, r in pair]
    z = np.where(np.any(heights, axis=0), 120 - np.sum(heights, axis=0), 140)
    noise = default_rng(0).normal(0, 0.03, (20, 800))
    profiles = [np.column_stack([x, z + error]) for error in noise]
    reasons = {feature.reason for feature in features_of(kind, profiles, 22)}
    assert reasons == {"two arcs of similar length"}


def test_spikes_do_not_make_up_the_points_of_an_arc():
    profile = np.c_[np.arange(20.0), np.full(20, 100.0)]
    profile[9, 1] += 5
    (feature,) = find_balls([profile], 25.0)
    assert feature.reason == "19 points; an arc needs 20"


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.0, 1.0), (-0.6, 0.3)])
def test_a_section_is_an_ellipse_from_which_points_are_as_far_as_they_are_moved(lean):
    radius = 10.0
    section = Section(np.array([1.0, 2.0]), np.array(lean), radius)
    size = np.hypot(1, np.hypot(*lean))
    # from the rod seen along its axis
    oblique = np.eye(2) + np.outer(lean, lean) / (1 + size)
    angles = np.linspace(-3, 3, 50)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points = section.centre + radius * around @ oblique

    off, normals = section.off_and_normals(points)
    assert_allclose(off, 0, atol=1e-12)
    outside, _ = section.off_and_normals(points + 1e-4 * normals)
    assert_allclose(outside, 1e-4, atol=1e-8)
