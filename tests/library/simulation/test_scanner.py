"""A scanner's profiles are as its data sheet says."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.simulation.robot import Scanner

NOISELESS = Scanner(resolution=0.0, quantum=0.01, noise_mm=0.0)
WALL = np.array([[-60.0, 80.0], [60.0, 80.0]])


def profile_of(scanner, outline):
    return scanner.profile(outline, default_rng(1))


def test_a_wall_fills_the_field_of_view_and_lies_at_its_depth():
    profile = profile_of(NOISELESS, 0.3 * WALL)  # at 24 mm: too near
    assert np.isnan(profile).all()
    # half-way from 60 to 350 mm
    profile = profile_of(NOISELESS, np.add(WALL, [0, 125]))
    assert_allclose(profile[:, 1], 205, atol=0.005)
    assert_allclose(profile[[0, -1], 0], [-50, 50], atol=0.005)


def test_the_nearer_of_two_surfaces_hides_the_other():
    outline = np.array([[-10.0, 100], [5, 100], [0, 80], [10, 80]])
    profile = profile_of(NOISELESS, outline)
    x, z = profile[np.isfinite(profile[:, 0])].T
    assert_allclose(z[x > 0.1], 80, atol=0.01)
    assert_allclose(z[x < -0.1], 100, atol=0.01)


def test_a_profile_is_of_whole_quanta_and_its_noise_has_its_size():
    profile = profile_of(Scanner(quantum=0.02, noise_mm=0.05), WALL)
    counts = profile / 0.02
    assert_allclose(counts, counts.round(), atol=1e-9)
    within = 4 / np.sqrt(2 * len(profile))
    assert profile[:, 1].std() == pytest.approx(0.05, rel=within)
    assert profile[:, 1].mean() == pytest.approx(80, abs=0.01)
