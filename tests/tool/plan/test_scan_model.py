"""What poses are predicted to be worth, against calibrations of simulated scans."""

from dataclasses import replace

import numpy as np
import pytest
from planned import KINDS, errors, model_for

from profilecal.geometry.noise import Systematic
from profilecal_tool.plan.candidates import Limits, draw
from profilecal_tool.plan.scan_model import information, predict


def assert_predicted(model, R, T, rng, most):
    """Errors of simulated calibrations scatter as is predicted, but for what is wrong
    at every pose.
    """
    model = replace(model, systematic=Systematic())
    found = errors(model, R, T, 300, rng)
    ratio = np.sqrt(
        np.mean(found**2, axis=0) / np.diag(predict(model, R, T).covariance)
    )
    assert np.abs(np.sqrt(np.mean(ratio**2)) - 1) < 0.1
    assert np.abs(ratio - 1).max() < most  # of six, each known to 4 %


@pytest.mark.parametrize(
    ("kind", "measured"), [*((kind, "profiles") for kind in KINDS), ("ball", "arcs")]
)
def test_predicted_deviations_are_those_of_simulated_calibrations(kind, measured):
    model, rng = model_for(kind, measured), np.random.default_rng(5)
    assert_predicted(model, *draw(model, Limits(), 15, rng), rng, 0.2)


def test_poses_of_one_orientation_share_its_error_in_a_prediction_as_in_a_simulation():
    model, rng = model_for("edge"), np.random.default_rng(6)
    R, T = draw(model, Limits(extent_mm=10, tilt_deg=20), 6, rng)
    R, T = (
        np.repeat(R, 4, axis=0),
        np.repeat(T, 4, axis=0) + rng.uniform(-15, 15, (24, 3)),
    )
    assert_predicted(model, R, T, rng, 0.3)


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_the_information_of_poses_with_orientations_of_their_own_adds_up(kind):
    model = model_for(kind)
    poses = draw(model, Limits(), 12, np.random.default_rng(3))
    together = information(model, *poses)
    scale = np.sqrt(np.outer(np.diag(together), np.diag(together)))
    assert (
        np.abs(
            (information(model, *poses, each=True).sum(axis=0) - together) / scale
        ).max()
        < 1e-8
    )


def test_a_prediction_says_how_far_it_depends_on_the_guess():
    spread = {}
    for kind in ("edge", "ball"):
        model, rng = model_for(kind), np.random.default_rng(1)
        poses = draw(model, Limits(), 15, rng)
        found, exact = (
            predict(model, *poses, rng),
            predict(replace(model, guess=None), *poses, rng),
        )
        assert exact.between == ()
        assert (
            exact.mm
            == found.mm
            > predict(replace(model, systematic=Systematic()), *poses).mm
        )
        (low, _), (high, _) = found.between
        spread[kind] = high / low
    assert (
        1 < spread["edge"] < 1.3 < spread["ball"]
    )  # where a plane cuts a ball depends on the guess
    shifts = [
        np.linalg.norm(model.elsewhere(rng).T_sensor - model.T_sensor)
        for _ in range(50)
    ]
    assert 4 < max(shifts) <= model.guess.mount_mm


def test_a_face_is_seen_from_one_side_of_the_view_to_the_other():
    model = model_for("plane")
    frames = model.planes(*draw(model, Limits(), 20, np.random.default_rng(5)))
    x, z = np.moveaxis(model.points_seen(*frames, 9), -1, 0)
    assert np.allclose(
        np.abs(x[:, [0, -1]]), 0.9 * model.scanner.half_width(z[:, [0, -1]])
    )
    flat = (
        np.stack([x, 0 * x, z], axis=-1) @ np.swapaxes(frames[0], 1, 2)
        + frames[1][:, None]
    )
    assert np.abs(model.target.distance(flat.reshape(-1, 3))).max() < 1e-9
