"""What poses are predicted to be worth."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from planned import KINDS, model_for
from simulated import scan_of

import profilecal as pc
from profilecal.geometry.noise import Systematic
from profilecal.joint.solve import solve
from profilecal_tool.plan.candidates import draw
from profilecal_tool.plan.knowledge import model_of_scan, scanner_of
from profilecal_tool.plan.scan_model import each_alone, predict

MEASURED = [*((kind, "profiles") for kind in KINDS), ("ball", "arcs")]


@pytest.mark.parametrize(("kind", "measured"), MEASURED)
def test_what_is_predicted_is_what_a_calibration_states(kind, measured):
    """Where errors are of these sizes, calibrations scatter so; a plan does not count
    with bends of smooth errors.
    """
    model = model_for(kind, measured)
    R, T = draw(model, 15, default_rng(5))
    exact = replace(model, systematic=Systematic())
    found = solve([exact.observed(R, T)], exact.noise, robust=False)
    assert_allclose(found.rotation, model.R_sensor, atol=1e-6)
    sd = np.sqrt(np.diag(found.covariance))
    by_bends = found.model().by_bends(found.error_sizes.mean_v)[:6, :6]
    assert (np.diag(by_bends) > 0).all()
    off = predict(exact, R, T).covariance + by_bends - found.covariance
    assert np.abs(off / np.outer(sd, sd)).max() < 1e-4
    # and more, where something is wrong at every pose
    assert predict(model, R, T).mm > predict(exact, R, T).mm


def test_the_noise_of_arcs_is_what_a_calibration_finds_of_them():
    scan = replace(scan_of("ball", seed=2, groups=20), noise={})
    found = pc.calibrate(scan)
    predicted = model_for("ball", "arcs").noise
    assert predicted.profile_mm == pytest.approx(found.noise_mm, rel=0.1)
    # of the balls, the scanner saw what is before their centres
    assert model_of_scan(found).scanner.far < np.concatenate(scan.values)[:, 1].max()


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_the_information_of_poses_with_orientations_of_their_own_adds_up(kind):
    model = model_for(kind)
    R, T = draw(model, 12, default_rng(3))
    _, linear, variances = model.linear(R, T)
    together = linear.posterior(variances[None]).normal[0, :-1, :-1]
    added = each_alone(linear, variances).sum(axis=0)
    sd = np.sqrt(np.diag(together))
    assert np.abs((added - together) / np.outer(sd, sd)).max() < 1e-8


@pytest.mark.parametrize(
    ("kind", "least", "most"),
    # where a plane cuts a ball depends on the guess
    [("edge", 1, 1.3), ("ball", 1.3, np.inf)],
)
def test_a_prediction_says_how_far_it_depends_on_the_guess(kind, least, most):
    model = model_for(kind)
    rng = default_rng(1)
    R, T = draw(model, 15, rng)
    (smallest_mm, _), (largest_mm, _) = predict(model, R, T, rng).between
    assert least < largest_mm / smallest_mm < most
    assert predict(replace(model, guess=None), R, T, rng).between == ()
    places = np.array([model.elsewhere(rng).T_sensor for _ in range(50)])
    shifts = np.linalg.norm(places - model.T_sensor, axis=1)
    assert 4 < shifts.max() <= model.guess.mount_mm


def test_a_face_is_seen_from_one_side_of_the_view_to_the_other():
    model = model_for("plane")
    R, T = draw(model, 20, default_rng(5))
    x, z = np.moveaxis(model.points_seen(*model.planes(R, T), 9), -1, 0)
    share = x / model.scanner.half_width(z)
    assert_allclose(share, np.broadcast_to(np.linspace(-0.9, 0.9, 9), share.shape))


def test_a_scanner_is_believed_to_see_10_mm_more_to_each_side_than_it_did():
    """Its rays fan out; near by it sees less to the sides."""
    z = np.linspace(70, 150, 81)
    ends = np.concatenate([[z / 4, z], [-z / 4, z], [0 * z, z]], axis=1).T
    scan = scan_of("edge", measured="profiles")
    scan = replace(scan, values=(ends,) * len(scan.values))
    believed = scanner_of(scan, ends)
    assert (believed.near, believed.far) == (60, 160)
    assert_allclose(believed.half_width(z), z / 4 + 10)
