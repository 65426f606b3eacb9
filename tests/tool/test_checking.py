"""What a scan holds, before any calibration."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.stats import binom
from simulated import scan_of, with_values

import profilecal as pc
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.poses import rotations
from profilecal.simulation.scene import random_scene
from profilecal_tool.checking import affine_noise, affine_outliers, check


def said_of(scan):
    return "\n".join(check(scan))


def test_planted_outliers_are_named_by_check_and_rejected_by_calibrate():
    bad = [3, 77, 200]
    scan = with_values(scan_of("edge", seed=7), bad, lambda rows: rows + 0.7)
    labels = [scan.labels[k] for k in bad]
    assert pc.calibrate(scan).poses_rejected == labels
    said = said_of(scan)
    for label in labels:
        assert f"pose {label} does not fit its group" in said


def test_one_of_a_group_is_doubted_where_nothing_tells_which():
    """Five positions in space leave one degree of freedom: every one of them fits
    equally badly.
    """
    good = scan_of("edge", seed=7, groups=12, positions=5)
    said = said_of(with_values(good, [17], lambda rows: rows + 3.0))
    group = ", ".join(good.labels[15:20])
    assert f"one of the poses {group} does not fit: one more would tell which" in said
    assert "does not fit its group" not in said


def test_check_says_about_which_axis_the_flange_turns():
    scan = scan_of("edge", seed=7, groups=5, positions=5)
    degrees = np.repeat([-20.0, -10, 0, 10, 20], 5)
    about_x = rotations(np.outer(np.radians(degrees), [1.0, 0, 0]))
    turned = replace(scan, R_base_flange=scan.R_base_flange[0] @ about_x)
    said = said_of(turned)
    turns = "14.1, 0.0, 0.0° rms about three axes, most about the flange's x"
    assert f"\nturns          {turns}\n" in said
    assert "add poses tilted by 15° or more about two axes" in said


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("disk", "what a disk shows does not tell it"),
        ("point", "mm inside groups, from 48"),
    ],
)
def test_check_says_what_tells_the_noise(kind, sentence):
    assert sentence in said_of(scan_of(kind, groups=12, positions=5))


def test_check_rarely_doubts_a_good_scan():
    doubted = 0
    for seed in range(60):
        scan = scan_of("edge", seed=seed)
        doubted += bool(affine_outliers(as_observations(scan, observe(scan))))
    assert doubted <= binom.ppf(0.9999, 60, 0.02)


def test_the_noise_inside_groups_is_that_of_the_scanner():
    rng = default_rng(18)
    sigma_mm = 0.05
    level_mm, freedom = affine_noise(random_scene("edge", rng).noisy(sigma_mm, rng))
    assert freedom == 25 * (10 - 4) * 2
    of_median = np.sqrt(0.5 / freedom) * np.sqrt(np.pi / 2)  # over the groups
    assert abs(level_mm / sigma_mm - 1) < 4 * of_median


@pytest.mark.parametrize(
    ("motion", "sentence"),
    [
        ({"pattern": "both ways"}, "these motions determine it"),
        ({"pattern": "one way", "stops": 3}, "these motions determine it"),
        ({"pattern": "one way"}, "leave it open, and the sensor's pose with it"),
        ({"pattern": "one way in the base"}, "shifts the target, not the sensor"),
    ],
)
@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_check_says_whether_motions_tell_the_delay(motion, sentence, mount):
    small = {"sweeps": 8, "profiles": 20} | motion
    scan = scan_of("edge", mount=mount, motion=small)
    said = said_of(scan)
    assert "motion         160 profiles in 8 sweeps, up to 100 mm/s" in said
    assert sentence in said
    refused = pc.calibrate(scan).status == "unobservable"
    assert refused == ("with it" in sentence)
