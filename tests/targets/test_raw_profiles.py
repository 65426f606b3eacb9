"""Chords and arcs found in raw profiles."""

import numpy as np
import pytest

from profilecal.closed_form.disk import solve_disk_from_chords
from profilecal.published_scenes import fig15_scans, fig17_scans
from profilecal.targets.ball import arc_from_profile
from profilecal.targets.disk import chord_from_profile, split_and_merge

STEP = 0.1  # mm between points of a profile


def test_split_and_merge_finds_corners_and_steps():
    x = np.arange(0, 30, STEP)
    z = np.select([x < 10, x < 20], [0.5 * x, 8 + 0 * x], 20 - 0.5 * x)
    z = z + np.random.default_rng(1).normal(0, 0.02, len(x))
    pieces = split_and_merge(x, z, 0.1)
    assert [x[piece][0] for piece in pieces] == pytest.approx([0, 10, 20], abs=STEP)
    assert pieces[-1].stop == len(x)


@pytest.mark.parametrize("step", [8.0, None], ids=["on a cylinder", "on black paper"])
def test_chords_are_found_to_the_resolution(step):
    scans, m = fig15_scans((-0.9, 0.8)), 40
    x, rng = np.arange(-90, 90, STEP), np.random.default_rng(2)
    way = np.linspace(0, 1, m)[:, None]
    tips = np.empty((4, m, 2, 2))
    for i in range(4):
        T_tcp = (1 - way) * scans.T_start[i] + way * scans.T_end[i]
        rotation = scans.R_tcp[i] @ scans.R_sensor
        profiles = scans.disk.profile(rotation, T_tcp + scans.R_tcp[i] @ scans.T_sensor, x, step)
        noise = rng.normal(0, 0.02, profiles.shape)
        tips[i] = [chord_from_profile(x, z, tolerance=0.1) for z in profiles + noise]
    off = tips - scans.tips(m)
    # a step lies anywhere within its interval of x: at most half a step off; z follows the line, and its noise
    assert np.abs(off[..., 0]).max() <= STEP / 2 + 1e-9
    assert np.abs(off[..., 0].mean()) < 4 * STEP / np.sqrt(12 * off[..., 0].size)
    assert np.abs(off[..., 1]).max() < 0.05
    found = solve_disk_from_chords(scans.R_tcp, scans.T_start, scans.T_end, tips, scans.s, scans.disk.radius)
    assert np.linalg.norm(found.solution.translation.q_b - scans.disk.centre) < STEP


def test_a_profile_without_a_chord_is_nan():
    assert np.isnan(chord_from_profile(np.arange(100) * STEP, np.full(100, np.nan), 0.1)).all()


def test_arcs_are_found_among_background_and_outliers():
    scans, rng = fig17_scans(), np.random.default_rng(3)
    x = np.arange(-90, 90, STEP)
    rotation = scans.R_tcp @ scans.R_sensor
    profiles = scans.ball.profile(rotation, scans.T_tcp + scans.R_tcp @ scans.T_sensor, x)
    for expected, z in zip(scans.circles(1)[:, 0], profiles, strict=True):
        z = np.where(np.abs(x - expected[0]) < 0.9 * expected[2], z, expected[1] - 60)  # a table behind
        z = z + rng.normal(0, 0.02, len(x))
        z[rng.choice(len(x), 20, replace=False)] += rng.uniform(-1.5, 1.5, 20)
        found = arc_from_profile(x, z, jump=5.0)
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.05)


def test_a_profile_without_an_arc_is_nan():
    assert np.isnan(arc_from_profile(np.arange(100) * STEP, np.full(100, np.nan), 1.0)).all()
