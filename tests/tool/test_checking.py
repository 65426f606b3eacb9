"""What a scan holds, before any calibration."""

from dataclasses import replace

import numpy as np
from scipy.stats import binom
from simulated import scan_of

from profilecal.calibration.calibration import calibrate
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.poses import rotations
from profilecal.simulation.scene import random_scene
from profilecal.simulation.spec import Spec, simulate_scan
from profilecal_tool.checking import affine_noise, affine_outliers, check


def test_planted_outliers_are_named_by_check_and_rejected_by_calibrate():
    scan = simulate_scan(Spec(seed=7))
    bad = [3, 77, 200]
    scan = replace(
        scan, values=tuple(v + 0.7 * (i in bad) for i, v in enumerate(scan.values))
    )
    labels = [scan.labels[i] for i in bad]
    assert calibrate([scan]).poses_rejected == labels
    said = "\n".join(check(scan))
    for label in labels:
        assert f"pose {label} does not fit its group" in said


def test_one_of_a_group_is_doubted_where_nothing_tells_which():
    """Five positions in space leave one degree of freedom: every one of them fits
    equally badly.
    """
    scan = simulate_scan(Spec(seed=7, groups=12, positions=5))
    group, values = (
        ", ".join(scan.labels[15:20]),
        (v + 3.0 * (i == 17) for i, v in enumerate(scan.values)),
    )
    said = "\n".join(check(replace(scan, values=tuple(values))))
    assert f"one of the poses {group} does not fit: one more would tell which" in said
    assert "does not fit its group" not in said


def test_check_says_about_which_axis_the_flange_turns():
    scan = simulate_scan(Spec(seed=7, groups=5, positions=5))
    about_x = rotations(
        np.radians([-20.0, -10, 0, 10, 20])[:, None] * np.array([1.0, 0, 0])
    )
    lines = check(
        replace(scan, R_base_flange=scan.R_base_flange[0] @ about_x.repeat(5, axis=0))
    )
    (said,) = (line for line in lines if line.startswith("turns"))
    assert (
        said.split(maxsplit=1)[1]
        == "14.1, 0.0, 0.0° rms about three axes, most about the flange's x"
    )
    assert any(
        "add poses tilted by 15° or more about two axes" in line for line in lines
    )


def test_check_says_what_tells_the_noise():
    for kind, said in (
        ("disk", "what a disk shows does not tell it"),
        ("point", "mm inside groups, from 48"),
    ):
        assert any(
            said in line
            for line in check(simulate_scan(Spec(kind=kind, groups=12, positions=5)))
        )


def test_check_rarely_doubts_a_good_scan():
    scans = (scan_of(Spec(seed=seed)) for seed in range(60))
    doubted = sum(
        bool(affine_outliers(as_observations(scan, observe(scan)))) for scan in scans
    )
    assert doubted <= binom.ppf(0.9999, 60, 0.02)


def test_the_noise_inside_groups_is_that_of_the_scanner():
    rng, sigma_mm = np.random.default_rng(18), 0.05
    level_mm, freedom = affine_noise(random_scene("edge", rng).noisy(sigma_mm, rng))
    assert freedom == 25 * (10 - 4) * 2
    of_median = np.sqrt(0.5 / freedom) * np.sqrt(np.pi / 2)  # over the groups
    assert abs(level_mm / sigma_mm - 1) < 4 * of_median
