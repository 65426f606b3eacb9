"""What poses are predicted to be worth, against calibrations of simulated scans."""

import numpy as np
import pytest
from planned import KINDS, errors, setup_for

from profilecal.plan.candidates import Limits, draw
from profilecal.plan.setup import blocks, information, predict


@pytest.mark.parametrize("kind", KINDS)
def test_predicted_deviations_are_those_of_simulated_calibrations(kind):
    setup, rng = setup_for(kind), np.random.default_rng(5)
    R, T = draw(setup, Limits(), 15, rng)
    found = errors(setup, R, T, 300, rng)
    ratio = np.sqrt(np.mean(found**2, axis=0) / np.diag(predict([(setup, R, T)]).covariance))
    assert np.abs(np.sqrt(np.mean(ratio**2)) - 1) < 0.1
    assert np.abs(ratio - 1).max() < 0.2  # of six, each known to 4 %


def test_poses_of_one_orientation_share_its_error_in_a_prediction_as_in_a_simulation():
    setup, rng = setup_for("edge"), np.random.default_rng(6)
    R, T = draw(setup, Limits(extent_mm=10, tilt_deg=20), 6, rng)
    R, T = np.repeat(R, 4, axis=0), np.repeat(T, 4, axis=0) + rng.uniform(-15, 15, (24, 3))
    found = errors(setup, R, T, 300, rng)
    ratio = np.sqrt(np.mean(found**2, axis=0) / np.diag(predict([(setup, R, T)]).covariance))
    assert np.abs(np.sqrt(np.mean(ratio**2)) - 1) < 0.1


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_blocks_of_poses_with_orientations_of_their_own_add_up(kind):
    setup = setup_for(kind)
    R, T = draw(setup, Limits(), 12, np.random.default_rng(3))
    together = information([(setup, R, T)])
    scale = np.sqrt(np.outer(np.diag(together), np.diag(together)))
    assert np.abs((blocks([(setup, R, T)]).sum(axis=0) - together) / scale).max() < 1e-8


def test_two_targets_of_one_scanner_are_worth_more_than_either():
    edge, ball = setup_for("edge"), setup_for("ball")
    parts = [(s, *draw(s, Limits(), 12, np.random.default_rng(4))) for s in (edge, ball)]
    alone = [np.linalg.inv(predict([part]).covariance) for part in parts]
    both = np.linalg.inv(predict(parts).covariance)
    for one in alone:
        assert np.linalg.eigvalsh(both - one).min() > -1e-6 * np.linalg.norm(both)
