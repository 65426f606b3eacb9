"""The edge's place in raw profiles of three specimens."""

import numpy as np
import pytest

from profilecal.geometry.noise import Noise
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_profiles, edge_scenes
from profilecal.simulate.scanner import Scanner
from profilecal.targets.edge import FEATURES, SPECIMENS, corner, step_end, tip

PLAN = EdgePlan(spread_deg=20, frame="group", radius=15)
SHARP = Scanner(resolution=0.0, quantum=0.01, noise_mm=0.0)
BLANK = np.full((2, 980, 2), np.nan)


def errors(specimen, scanner, seed=1):
    rng = np.random.default_rng(seed)
    scene = edge_scenes(PLAN, Noise(), rng)
    found = FEATURES[specimen](edge_profiles(scene, specimen, scanner, Noise(), rng))
    return (found - scene.points).reshape(-1, 2)


SPACING = 2 * SHARP.half_width(90) / 979  # mm between rays
WITHIN = {"parallel bar": SPACING / 2, "straight scale": 2 * SPACING, "knife blade": 0.5}  # the last: tip()'s depth


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_a_perfect_scanner_shows_the_edge_within_its_sampling(specimen):
    assert np.abs(errors(specimen, SHARP)).max() < WITHIN[specimen]


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_every_edge_is_found_and_no_worse_than_the_scanner_resolves(specimen):
    error = errors(specimen, Scanner())
    assert np.isfinite(error).all()
    assert (error.std(axis=0) < 0.25 / 2).all()
    assert (np.abs(error.mean(axis=0)) < 0.1).all()  # one quantum


def test_the_corner_averages_noise_down():
    """Lines of about a hundred points each cross within a fraction of a point's noise."""
    assert (errors("parallel bar", Scanner()).std(axis=0) < 0.05).all()


@pytest.mark.parametrize("feature", [corner, step_end, tip])
def test_an_empty_profile_has_no_edge(feature):
    assert np.isnan(feature(BLANK)).all()


@pytest.mark.parametrize("feature", [step_end, tip])
def test_a_plane_has_no_edge(feature):
    x = np.linspace(-20, 20, 980)
    for slope in (0.0, 0.5):
        assert np.isnan(feature(np.stack([x, 80 + slope * x], axis=-1))).all()


def test_a_blade_at_the_end_of_the_profile_is_not_found():
    x = np.linspace(-20, 20, 980)
    assert np.isnan(tip(np.stack([x, np.where(x > 19.95, 80.0, 100.0)], axis=-1))).all()
