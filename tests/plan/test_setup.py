"""What poses are predicted to be worth, against calibrations of simulated scans."""

from dataclasses import replace

import numpy as np
import pytest
from planned import KINDS, errors, setup_for

from profilecal.geometry.poses import angle_between
from profilecal.plan.candidates import Limits, draw
from profilecal.plan.setup import blocks, displaced, information, predict
from profilecal.simulate.guess import Margins


@pytest.mark.parametrize(("kind", "measured"), [*((kind, "profiles") for kind in KINDS), ("ball", "arcs")])
def test_predicted_deviations_are_those_of_simulated_calibrations(kind, measured):
    setup, rng = setup_for(kind, measured), np.random.default_rng(5)
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


def test_targets_without_poses_change_no_prediction():
    edge, ball = setup_for("edge"), setup_for("ball")
    part = edge, *draw(edge, Limits(), 12, np.random.default_rng(4))
    alone, q = information([part]), 6 + 4
    for parts in ([part, (ball, part[1][:0], part[2][:0])], [(ball, part[1][:0], part[2][:0]), part]):
        assert np.allclose(predict(parts).covariance, predict([part]).covariance, rtol=1e-9, atol=0)
        own = np.flatnonzero(np.diag(information(parts)))
        assert np.allclose(information(parts)[np.ix_(own, own)], alone)
        assert np.allclose(blocks(parts).sum(axis=0), information(parts), atol=1e-8 * np.abs(alone).max())
    assert len(alone) == q + 4  # two scales, shear and bend; no radius


def test_a_prediction_says_how_far_it_depends_on_the_guess():
    spread = {}
    for kind in ("edge", "ball"):
        setup, rng = setup_for(kind), np.random.default_rng(1)
        part = setup, *draw(setup, Limits(), 15, rng)
        found = predict([part], rng)
        exact = predict([(replace(setup, margins=Margins(0, 0, 0, 0)), *part[1:])], rng)
        assert exact.between == ()
        assert exact.mm == found.mm
        (low, high), _ = found.between
        spread[kind] = high / low
        assert low < high
    assert spread["edge"] < 1.3 < spread["ball"]  # where a plane cuts a ball depends on the guess


def test_a_wrong_guess_is_wrong_within_its_margins_and_alike_for_all_targets():
    edge, ball = setup_for("edge"), setup_for("ball")
    part = draw(edge, Limits(), 2, np.random.default_rng(4))
    largest = 0
    for seed in range(50):
        (one, *_), (other, *_) = displaced([(edge, *part), (ball, *part)], np.random.default_rng(seed))
        assert (one.T_sensor == other.T_sensor).all()
        assert (one.R_sensor == other.R_sensor).all()
        off = np.linalg.norm(one.T_sensor - edge.T_sensor)
        assert off <= 5
        assert np.linalg.norm(other.target.centre - ball.target.centre) <= 5
        assert np.degrees(angle_between(one.R_sensor, edge.R_sensor)) <= 3 + 1e-6
        largest = max(largest, off)
    assert largest > 4
