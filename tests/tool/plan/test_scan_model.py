"""What poses are predicted to be worth, against calibrations of simulated scans."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from planned import KINDS, errors, model_for

from profilecal.geometry.noise import Systematic
from profilecal.geometry.poses import carry
from profilecal_tool.plan.candidates import draw
from profilecal_tool.plan.scan_model import Limits, information, predict

MEASURED = [*((kind, "profiles") for kind in KINDS), ("ball", "arcs")]


def assert_predicted(model, R, T, rng, most):
    """Errors of simulated calibrations scatter as is predicted.

    What is wrong at every pose is left out. Each of six ratios is known to 4 %.
    """
    model = replace(model, systematic=Systematic())
    actual = np.mean(errors(model, R, T, 300, rng) ** 2, axis=0)
    predicted = np.diag(predict(model, R, T).covariance)
    ratio = np.sqrt(actual / predicted)
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1, abs=0.1)
    assert np.abs(ratio - 1).max() < most


@pytest.mark.parametrize(("kind", "measured"), MEASURED)
def test_predicted_deviations_are_those_of_simulated_calibrations(kind, measured):
    model = model_for(kind, measured)
    rng = default_rng(5)
    R, T = draw(model, 15, rng)
    assert_predicted(model, R, T, rng, 0.2)


def test_poses_of_one_orientation_share_its_error_in_a_prediction_as_in_a_simulation():
    model = model_for("edge")
    rng = default_rng(6)
    narrow = replace(model, limits=Limits(extent_mm=10, tilt_deg=20))
    R, T = draw(narrow, 6, rng)
    R = np.repeat(R, 4, axis=0)
    T = np.repeat(T, 4, axis=0) + rng.uniform(-15, 15, (24, 3))
    assert_predicted(model, R, T, rng, 0.3)


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_the_information_of_poses_with_orientations_of_their_own_adds_up(kind):
    model = model_for(kind)
    R, T = draw(model, 12, default_rng(3))
    together = information(model, R, T)
    added = information(model, R, T, each=True).sum(axis=0)
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
    exact = predict(replace(model, guess=None), R, T, rng)
    assert exact.between == ()


def test_a_prediction_counts_with_what_is_wrong_at_every_pose():
    model = model_for("ball")
    R, T = draw(model, 15, default_rng(1))
    without = predict(replace(model, systematic=Systematic()), R, T)
    assert predict(model, R, T).mm > without.mm


def test_a_guess_is_wrong_by_up_to_its_margins():
    model = model_for("ball")
    rng = default_rng(1)
    places = np.array([model.elsewhere(rng).T_sensor for _ in range(50)])
    shifts = np.linalg.norm(places - model.T_sensor, axis=1)
    assert 4 < shifts.max() <= model.guess.mount_mm
    exact = replace(model, guess=None)
    assert exact.elsewhere(rng) is exact


def test_a_face_is_seen_from_one_side_of_the_view_to_the_other():
    model = model_for("plane")
    R, T = draw(model, 20, default_rng(5))
    R_view, T_view = model.planes(R, T)
    x, z = np.moveaxis(model.points_seen(R_view, T_view, 9), -1, 0)
    ends = [0, -1]
    half_width = model.scanner.half_width(z[:, ends])
    assert_allclose(np.abs(x[:, ends]), 0.9 * half_width)
    in_sensor = np.stack([x, np.zeros_like(x), z], axis=-1)
    in_base = carry(R_view[:, None], T_view[:, None], in_sensor)
    assert np.abs(model.target.distance(in_base.reshape(-1, 3))).max() < 1e-9
