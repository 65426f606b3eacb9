"""From scans to an answer that can be believed."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from raw_profiles import disks
from scipy.stats import chi2
from simulated import (
    SCANNER,
    few,
    scan_of,
    squared_error,
    with_values,
)

import profilecal as pc
from profilecal.calibration.answer import MOST_PRINTS, are_the_same
from profilecal.calibration.observe import observe, observe_all
from profilecal.calibration.several_scans import agreed, check_different


def test_poses_without_a_measurement_are_left_out_and_named_by_scan():
    edge = scan_of("edge", seed=9, title="edge")
    disk = scan_of("disk", seed=9, title="disk", measured="profiles", scanner=SCANNER)
    unseen_point = with_values(edge, lambda rows: rows[:0], [4])
    unseen_disk = with_values(disk, lambda rows: np.full((9, 2), np.nan), [0])
    found = pc.calibrate([unseen_point, unseen_disk])
    assert found.messages[0] == "edge: 1 pose left out, no point: g1p5"
    assert found.messages[1].startswith(
        "disk: 1 pose left out, nothing in this profile"
    )
    assert "edge: g1p5" not in found.poses_used


def test_features_of_different_precision_are_weighed():
    plan = {"seed": 6, "groups": 8, "positions": 4, "scanner": SCANNER}
    scans = [
        scan_of(kind, measured="profiles", title=kind, **plan)
        for kind in ("edge", "ball")
    ]
    together = pc.calibrate(scans)
    corners, arcs = (observe(scan).covariance for scan in scans)
    unit = np.median(np.sqrt(np.trace(corners, axis1=1, axis2=2) / 2))
    for observed, covariance in zip(together.observed, (corners, arcs), strict=True):
        assert_allclose(observed.covariance[0], covariance / unit**2)
    for alone in map(pc.calibrate, scans):
        assert (together.translation_sd_mm < alone.translation_sd_mm).all()
    assert squared_error(together) < chi2.ppf(0.9999, 6)
    assert together.poses_used[0] == "edge: g1p1"
    kinds = [target["kind"] for target in together.to_json()["target"]]
    assert kinds == ["edge", "ball"]


def test_the_noise_of_short_arcs_is_that_of_their_points():
    scan = scan_of("ball", seed=1, measured="profiles", scanner={"points": 70})
    assert observe(scan).typical_mm == pytest.approx(0.06, rel=0.2)


def test_where_the_view_ends_few_profiles_know_by_another_scan():
    """Of disks before nothing, the tips of eight chords outline all that is seen."""
    profiles, tips = disks(default_rng(2), 28, None)
    poses = np.tile(np.eye(4), (28, 1, 1))
    poses[:, 0, 3] = range(28)
    many, few = (
        pc.Scan.of("disk", poses[part], profiles=profiles[part], radius=25)
        for part in (slice(20), slice(20, None))
    )
    assert len(observe(few).poses) < 3
    (_, seen), _, _ = observe_all([many, few])
    assert np.abs(seen.points - tips[20:]).max() < 0.25  # mm, what is resolved
    assert seen.covariance[:, :2, 2:].all()  # tips of one chord err together


def test_scans_that_do_not_belong_together_are_refused():
    scan = scan_of("edge", motion={"sweeps": 3, "profiles": 5})
    guessed = replace(scan, guess=np.diag([1.0, -1, -1, 1]))
    for entries, sentence in (
        ({"mount": "eye-to-hand"}, "mount is eye-in-hand in one scan and eye-to-hand"),
        (
            {"noise": {"profile_mm": 0.1}},
            r"profile_mm is 0\.05 in one scan and 0",
        ),
        ({"delay_ms": 3.0}, "delay_ms is None in one scan"),
        ({"guess": np.eye(4)}, r"guess is \[.* in one scan and \["),
    ):
        with pytest.raises(pc.ScanError, match=sentence):
            pc.calibrate([guessed, replace(guessed, **entries)])
    arcs = scan_of("ball", noise={"profile_mm": 0.5})  # theirs is to be estimated
    assert agreed([arcs, scan]) == {"mount": "eye-in-hand", "delay_ms": None}


def test_what_is_unknown_is_null_and_a_delay_at_rest_is_none():
    printed = pc.calibrate(scan_of("edge", seed=1, spread_deg=0.0)).to_json()
    names = "T_flange_sensor", "target", "delay_ms", "delay_sd_ms", "delay_source"
    assert [printed[name] for name in names] == [None] * 5
    moving = scan_of("edge", seed=1, motion={"sweeps": 8, "profiles": 20})
    still = replace(scan_of("ball", seed=1), delay_ms=5.0)
    printed = pc.calibrate([moving, still]).to_json()
    assert printed["delay_source"] == "estimated"
    assert abs(printed["delay_ms"] - 30) < 5 * printed["delay_sd_ms"]
    printed = pc.calibrate(replace(moving, delay_ms=30.0)).to_json()
    assert printed["delay_source"] == "given"


UNSEEN = (
    r"0 of 250 poses show the target \(edge\); expected 3 or more; "
    "250 poses left out, no point: g1p1"
)
RAW = {"measured": "profiles", "groups": 9, "positions": 2}


@pytest.mark.parametrize(
    ("entries", "change", "sentence"),
    [
        ({}, np.zeros_like, UNSEEN),
        ({}, lambda rows: rows * [1, np.nan], UNSEEN),
        (RAW, lambda rows: rows[:, ::-1], "are their columns swapped"),
    ],
)
def test_a_scan_that_shows_nothing_is_refused(entries, change, sentence):
    blind = with_values(scan_of("edge", seed=1, **entries), change)
    with pytest.raises(pc.ScanError, match=sentence):
        pc.calibrate(blind)


def test_measurements_given_twice_are_refused_and_what_coincides_by_chance_is_not(
    tmp_path,
):
    for scan in (
        scan_of("ball", title="first"),
        scan_of("edge", title="first", motion={"sweeps": 8, "profiles": 20}),
    ):
        digits = scan.p_base_flange + 1e-9  # as another convention's digits have it
        copy = replace(scan, title="a copy", delay_ms=30.0, p_base_flange=digits)
        part = few(copy, [*range(0, len(scan.labels), 3)])
        pc.write_scan(scan, tmp_path / scan.kind)
        files = pc.read_scan(tmp_path / scan.kind)
        for again, title in ((scan, "first"), (part, "a copy"), (files, "first")):
            same = rf"scan 2 \({title}\) holds the same measurements as scan 1;"
            with pytest.raises(pc.ScanError, match=same):
                check_different([scan, again])
        with pytest.raises(pc.ScanError, match="the same measurements"):
            pc.calibrate([scan, scan])
    once = scan_of("ball")
    poses, arcs = (
        np.tile(once.T_base_flange, (2, 1, 1)),
        np.concatenate(once.values * 2),
    )
    with pytest.raises(pc.ScanError, match="scan 1 holds measurements twice"):
        pc.calibrate(pc.Scan.of("ball", poses, arcs=arcs, radius=25))
    scans = [scan_of("edge", seed=1, scan=number, repeats=3) for number in (1, 2)]
    check_different([with_values(scan, lambda rows: rows.round(2)) for scan in scans])


def test_a_part_of_a_large_scan_is_known_by_its_sample():
    large = [f"{number:012x}" for number in range(0, 10_000 * 7, 7)]
    part, other = large[::100], [f"{number:012x}" for number in range(1, 7_000, 70)]
    sample = large[:MOST_PRINTS]
    assert are_the_same(sample, part)
    assert are_the_same(part, sample)
    assert not are_the_same(sample, other)


def test_too_small_a_statement_is_no_excuse_for_a_bad_pose():
    """What is stated of a robot may be far too small; a pose that is 1 mm off is none
    the less more likely wrong.
    """
    noise = {"position_mm": 0.02, "orientation_deg": 0.005}
    plan = {"groups": 14, "positions": 1, "noise": noise, "scanner": SCANNER}
    told = 0
    for seed in range(8):
        scan = scan_of("plane", seed=seed, **plan)
        off = default_rng(seed).normal(size=3)
        positions = scan.p_base_flange.copy()
        positions[5] += off / np.linalg.norm(off)
        found = pc.calibrate(replace(scan, p_base_flange=positions))
        told += scan.labels[5] in found.poses_rejected
    assert told > 4
