"""The papers' methods on scans as users bring them: exact without noise, honest with it, refused where they fail."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

from profilecal.calibrate.calibration import calibrate
from profilecal.calibrate.observe import three_points
from profilecal.closed_form.solve import circles_alike, solve_in_closed_form
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.noise import Noise
from profilecal.joint.state import normalised_square, pose_error
from profilecal.scan.scan import ScanError
from profilecal.simulate.spec import Spec, simulate_scan

KINDS = ["edge", "disk", "ball"]


def error_of(found):
    truth = np.array(found.scans[0].truth["T_flange_sensor"])
    return pose_error(found.solution.rotation, found.solution.translation, truth[:3, :3], truth[:3, 3])


def without(scan, poses):
    """A scan with the measurements of some poses missing."""
    return replace(scan, values=tuple(v[:0] if k in poses else v for k, v in enumerate(scan.values)))


@pytest.mark.parametrize("kind", KINDS)
def test_the_papers_methods_are_exact_on_scans_without_noise(kind):
    rng = np.random.default_rng(4)
    for seed in range(2):
        scan = simulate_scan(Spec(kind, seed=seed, noise=Noise()))
        found = calibrate([scan], method="closed-form", rng=rng)
        assert found.to_json()["method"] == "closed-form"
        assert np.abs(error_of(found)).max() < 1e-7


def test_groups_of_different_sizes_are_exact_too():
    rng = np.random.default_rng(4)
    scan = simulate_scan(Spec("edge", seed=3, noise=Noise()))
    found = calibrate([without(scan, {0, 1, 2, 13, 14, *range(20, 28)})], method="closed-form", rng=rng)
    assert np.abs(error_of(found)).max() < 1e-7
    assert "2 poses are in no group of 3 or more" in " ".join(found.messages)


@pytest.mark.parametrize("kind", ["disk", "ball"])
def test_sides_are_decided_from_the_data_where_the_scan_leaves_them_out(kind):
    rng = np.random.default_rng(4)
    scan = simulate_scan(Spec(kind, seed=6, noise=Noise(profile_mm=0.05)))
    if kind == "ball":  # on one side only
        scan = without(scan, set(np.flatnonzero(scan.side < 0)))
    found = calibrate([replace(scan, side=np.zeros(len(scan.labels)))], method="closed-form", rng=rng)
    assert normalised_square(found.solution.covariance, error_of(found)) < chi2.isf(1e-4, 6)
    assert "side" in " ".join(found.messages)


SMALLER = {"edge": {"groups": 12, "positions": 5}, "disk": {"groups": 4, "positions": 15}, "ball": {}}


@pytest.mark.parametrize("kind", KINDS)
def test_the_covariance_covers_the_truth(kind):
    """95 % regions; each of 12 scans is a draw, and the binomial law bounds how many may miss."""
    rng, inside = np.random.default_rng(5), 0
    for seed in range(12):
        found = calibrate([simulate_scan(Spec(kind, seed=seed, **SMALLER[kind]))], method="closed-form", rng=rng)
        inside += normalised_square(found.solution.covariance, error_of(found)) < chi2.isf(0.05, 6)
    assert inside >= binom.ppf(1e-3, 12, 0.93)  # a covariance of 200 draws is itself uncertain by some percent


def test_x_z_and_r_of_a_fitted_circle_are_drawn_alike():
    circles = np.tile([3.0, 5.0, 20.0], (20000, 1))
    points = three_points(circles)
    errors = circles_alike(points, np.random.default_rng(6).normal(size=points.shape))
    found = (fit_circle(points + 1e-5 * errors) - circles) / 1e-5
    np.testing.assert_allclose(np.cov(found.T), np.eye(3) / 2, atol=5 * np.sqrt(0.5 / 20000))


def test_what_the_papers_methods_cannot_take_is_refused_in_words():
    rng = np.random.default_rng(4)
    edge, plane = simulate_scan(Spec("edge")), simulate_scan(Spec("plane"))
    with pytest.raises(ScanError, match="method is 'closed'; expected joint or closed-form"):
        calibrate([edge], method="closed")
    with pytest.raises(ScanError, match="the closed form takes one scan"):
        calibrate([edge, edge], method="closed-form", rng=rng)
    with pytest.raises(ValueError, match="the papers have no closed form for a plane"):
        calibrate([plane], method="closed-form", rng=rng)
    few = without(edge, set(range(20, 250)))
    found = calibrate([few], method="closed-form")
    assert (found.status, found.solution) == ("unobservable", None)
    assert "2 of the flange orientations have 3 positions or more; the closed form needs 3" in found.messages[-1]
    ball = simulate_scan(Spec("ball", groups=20, positions=1))
    found = calibrate([ball], method="closed-form", rng=rng)
    assert "the closed form takes the rotation from motions without a turn, and there are 0" in found.messages[-1]


def test_a_disk_scan_that_leaves_its_line_is_refused():
    scan = simulate_scan(Spec("disk", seed=2, noise=Noise()))
    T = scan.T_base_flange.copy()
    T[5] += [3, 0, 0]
    (observed,) = calibrate([scan]).observed
    observed = replace(observed, T_flange=T[None])
    with pytest.raises(UnobservableError, match="leave equal steps on a line by 3 mm"):
        solve_in_closed_form(observed, Noise(), scan.side, np.random.default_rng(1))
