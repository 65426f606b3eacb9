"""Planned poses are possible, however wrong the guess is."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from planned import KINDS, model_for

from profilecal.geometry.poses import inverse
from profilecal.scan.tables import ScanError
from profilecal_tool.plan.candidates import (
    BEYOND,
    draw,
    off_square,
)
from profilecal_tool.plan.design import design
from profilecal_tool.plan.scan_model import Limits

ZONE = (850.0, 0.0, 500.0, 60.0)
ZONE_TO_HAND = (900.0, 0.0, 350.0, 20.0)
BOX = Limits(low=(700, -200, 250), high=(1100, 250, 800))


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_planned_poses_keep_the_target_in_view_for_any_guess_as_wrong_as_stated(kind):
    model = model_for(kind)
    rng = default_rng(1)
    plan = design(model, rng, poses=12, candidates=300)
    near, far = model.scanner.near, model.scanner.far
    for _ in range(300):
        truth = model.elsewhere(rng)
        points = truth.points_seen(*truth.planes(plan.R, plan.T), 9)
        x, z = np.moveaxis(points, -1, 0)  # NaN where the target is missed
        assert (np.abs(2 * z - near - far) < far - near).all()
        assert (np.abs(x) < model.scanner.half_width(z)).all()


@pytest.mark.parametrize(
    ("mount", "zone"), [("eye-in-hand", ZONE), ("eye-to-hand", ZONE_TO_HAND)]
)
def test_poses_stay_in_the_box_out_of_the_zones_and_within_the_tilt(mount, zone):
    limits = replace(BOX, avoid=(zone,))
    model = replace(model_for("edge", "points", mount), limits=limits)
    R, T = draw(model, 300, default_rng(2), BEYOND)
    flange = inverse(R, T)[1] if mount == "eye-to-hand" else T
    assert (flange >= limits.low).all()
    assert (flange <= limits.high).all()
    assert np.linalg.norm(flange - zone[:3], axis=1).min() >= zone[3]
    tilt, spin, _ = off_square(model, R, T)
    assert 25 < tilt.max() <= 30
    assert 35 < np.abs(spin).max() <= 45


def test_limits_and_guesses_that_leave_no_pose_are_refused_in_words():
    around_the_scanner = Limits(avoid=((900, 0, 700, 20),))
    to_hand = model_for("edge", "points", "eye-to-hand")
    with pytest.raises(ScanError, match=r"only 0 of .* 100% are in a zone to avoid"):
        draw(replace(to_hand, limits=around_the_scanner), 10, default_rng(4))
    in_hand = model_for("edge", "points")
    wide = replace(in_hand.guess, mount_mm=80)
    lost = "may lose the target from view if the guess is as wrong as stated"
    with pytest.raises(ScanError, match=lost):
        draw(replace(in_hand, guess=wide), 10, default_rng(4))
