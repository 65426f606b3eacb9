"""From raw profiles of a disk or ball to the papers' methods, at the resolution of the scanner."""

import numpy as np
import pytest
from scipy.stats import chi2

from profilecal.closed_form.disk import solve_disk_from_chords
from profilecal.geometry.fitting import fit_circle
from profilecal.papers.settings import fig15_scans, fig17_scans
from profilecal.targets import TARGETS
from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.target import find_features

STEP = 0.1  # mm between points of a profile
X = np.arange(-90, 90, STEP)


def as_profiles(z):
    """Profiles (n, points, 2) of depths (n, points)."""
    return np.stack([np.broadcast_to(X, z.shape), z], axis=-1)


def depth_of_disk(disk, rotation, origin, x, step: float | None):
    """z (n, k) at x (k,) of what scan planes (…, 3, 3), (n, 3) see, looking along -z, where it is on the disk. A plane
    lies `step` mm behind it, as when it is the top of a cylinder; None: black paper, NaN."""
    c = ((disk.centre - origin)[:, None, :] @ rotation)[:, 0]
    n = (disk.normal @ rotation)[..., None, :]
    z = c[:, 2:] + (n[..., 0] * (c[:, :1] - x) + n[..., 1] * c[:, 1:2]) / n[..., 2]
    inside = (x - c[:, :1]) ** 2 + c[:, 1:2] ** 2 + (z - c[:, 2:]) ** 2 <= disk.radius**2
    return np.where(inside, z, np.nan if step is None else z - step / np.abs(n[..., 2]))


def depth_of_ball(ball, rotation, origin, x):
    """z (n, k) at x (k,) of what scan planes (n, 3, 3), (n, 3) see of a ball, looking along -z; NaN beside it."""
    circle = ball.meet(rotation, origin)
    with np.errstate(invalid="ignore"):
        return circle[:, 1:2] + np.sqrt(circle[:, 2:] ** 2 - (x - circle[:, :1]) ** 2)


@pytest.mark.parametrize("step", [8.0, None], ids=["on a cylinder", "on black paper"])
def test_chords_are_found_to_the_resolution(step):
    scans, m = fig15_scans((-0.9, 0.8)), 40
    way, rng = np.linspace(0, 1, m)[:, None], np.random.default_rng(2)
    tips = np.empty((4, m, 2, 2))
    covariance = np.empty((4, m, 2, 2, 2))
    for i in range(4):
        T_tcp = (1 - way) * scans.T_start[i] + way * scans.T_end[i]
        rotation = scans.R_tcp[i] @ scans.R_sensor
        z = depth_of_disk(scans.disk, rotation, T_tcp + scans.R_tcp[i] @ scans.T_sensor, X, step)
        found = find_features(Disk, as_profiles(z + rng.normal(0, 0.02, z.shape)), (scans.disk.radius,))
        tips[i] = [feature.points for feature in found]
        covariance[i] = [feature.covariance for feature in found]
    off = tips - scans.tips(m)
    square = np.einsum("imta,imta->imt", off, np.linalg.solve(covariance, off[..., None])[..., 0])
    # the stated covariance explains both tips: χ² of two coordinates each
    assert square.mean() < 2 + 4 * np.sqrt(4 / square.size)
    assert square.max() < chi2.isf(1e-6, 2)
    found = solve_disk_from_chords(scans.R_tcp, scans.T_start, scans.T_end, tips, scans.s, scans.disk.radius)
    assert np.linalg.norm(found.solution.translation.q_b - scans.disk.centre) < STEP


def test_arcs_are_found_among_background_and_outliers():
    scans, rng = fig17_scans(), np.random.default_rng(3)
    rotation = scans.R_tcp @ scans.R_sensor
    z = depth_of_ball(scans.ball, rotation, scans.T_tcp + scans.R_tcp @ scans.T_sensor, X)
    circles = scans.circles(1)[:, 0]
    z = np.where(np.abs(X - circles[:, :1]) < 0.9 * circles[:, 2:], z, circles[:, 1:2] - 60)  # a table behind
    z += rng.normal(0, 0.02, z.shape)
    for row in z:
        row[rng.choice(len(X), 20, replace=False)] += rng.uniform(-1.5, 1.5, 20)
    for feature, circle in zip(find_features(Ball, as_profiles(z), (scans.ball.radius,)), circles, strict=True):
        np.testing.assert_allclose(fit_circle(feature.points), circle, rtol=0, atol=0.05)


@pytest.mark.parametrize("kind", ["disk", "ball"])
def test_an_empty_profile_has_no_feature(kind):
    (feature,) = find_features(TARGETS[kind], as_profiles(np.full((1, len(X)), np.nan)), (50.0,))
    assert not feature.found
