"""The chord of a disk in raw profiles: both its tips, and where it is none."""

import numpy as np
import pytest
from finding import features_of
from numpy.random import default_rng
from raw_profiles import above_table, disks, turned

from profilecal.calibration.observe import marked_points
from profilecal.simulation.robot import Scanner


def test_both_tips_of_a_chord_together_are_as_exact_as_stated():
    """They lie on one fitted line, so that they err across it together: the mean of n
    squared errors in four dimensions has the standard deviation √(8 / n), and those of
    the tips' difference and sum in depth, over their variances, differ by √(4 / n).
    """
    profiles, truth = disks(default_rng(2), 500)
    features = features_of("disk", profiles)
    shown = [pair for pair in zip(features, truth, strict=True) if pair[0].found]
    error = np.array([(feature.points - tips).ravel() for feature, tips in shown])
    _, covariance = marked_points([feature for feature, _ in shown], 2)
    over_covariance = np.linalg.solve(covariance, error[..., None])[..., 0]
    squares = np.sum(error * over_covariance, axis=1)
    assert abs(squares.mean() - 4) < 4 * np.sqrt(8 / len(squares))
    apart, together = (
        np.mean((error @ way) ** 2 / (covariance @ way @ way))
        for way in np.array([[0, 1, 0, -1], [0, 1, 0, 1]])
    )
    assert abs(apart - together) < 4 * np.sqrt(4 / len(squares))


@pytest.mark.parametrize(("bevel_deg", "wide"), [(10, 3), (15, 2.5), (20, 2)])
def test_a_bevel_is_no_side_wall(bevel_deg, wide):
    x = np.linspace(-40, 40, 801)
    beyond = np.maximum(np.abs(x) - 25 + wide, 0)
    face = 100 + np.tan(np.radians(bevel_deg)) * beyond
    z = np.where(np.abs(x) < 25, face, 120)
    noise = [0.02 * default_rng(seed).normal(size=801) for seed in range(6)]
    profiles = [np.stack([x, z + error], axis=-1) for error in noise]
    for feature in features_of("disk", profiles):
        if feature.found:
            assert np.abs(np.abs(feature.points[:, 0]) - 25).max() < 0.5


@pytest.mark.parametrize("above", [10, -20], ids=["bolt", "hole"])
def test_what_parts_a_disk_is_not_its_end(above):
    """Nor is it a smaller disk."""
    profiles, tips = disks(default_rng(3), 40)
    x = profiles[..., 0]
    profiles[..., 1] -= above * ((x > 3) & (x < 7))
    found = [feature.points for feature in features_of("disk", profiles)]
    assert np.abs(np.array(found) - tips).max() < 0.5


@pytest.mark.parametrize("tilt_deg", [20, 50])
@pytest.mark.parametrize("width", [40.0, 160.0])
def test_a_side_wall_is_a_step_however_fine_the_points(width, tilt_deg):
    """Of disks 3 mm thick above a table, by scanners 40 and 160 mm wide."""
    fine, radius = width / 1000, 0.28 * width
    scanner = Scanner(150.0, 300.0, width, width, 980, fine, 0.001, fine / 5)
    rng = default_rng(1)
    profiles, tips = [], []
    for half in radius * rng.uniform(0.6, 1, 12):
        body = [[-half, 3], [-half, 0], [half, 0], [half, 3]]
        chain = above_table(turned(body, np.radians(tilt_deg), [0, 200]), 220 + radius)
        profiles.append(scanner.profile(chain, rng))
        tips.append(chain[3:5])
    found = [feature.points for feature in features_of("disk", profiles, radius)]
    assert np.abs(np.array(found) - tips).max() < 5 * fine


def lined_up(apart_mm):
    """Features of disks before nothing; their near tips are so close to a limit."""
    rng = default_rng(7)
    profiles = []
    for half in rng.uniform(12, 20, 16):
        tips = turned([[0, 0], [2 * half, 0]], rng.uniform(0, 0.3), [-half, 180])
        tips += [rng.uniform(-10, 10), rng.uniform(0, apart_mm)]
        profiles.append(Scanner().profile(above_table(tips, 500), rng))
    return features_of("disk", profiles)


def test_a_limit_at_which_a_plan_lines_up_tips_is_no_border():
    assert all(feature.found for feature in lined_up(apart_mm=2))


def test_tips_that_all_lie_on_a_limit_may_be_cut_there():
    reasons = [feature.reason for feature in lined_up(apart_mm=0.01)]
    assert any("cut by the field of view" in reason for reason in reasons)
