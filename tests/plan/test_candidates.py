"""Planned poses are possible, however wrong the guess is."""

from dataclasses import replace

import numpy as np
import pytest
from planned import GUESS, KINDS, setup_for, spec_of

from profilecal.geometry.poses import carry, inverse
from profilecal.plan.candidates import AT_LIMIT, Limits, draw, inverse_mount, random_views, refused, turned
from profilecal.plan.entries import setup_of
from profilecal.plan.plan import Wishes, design
from profilecal.scan.scan import ScanError
from profilecal.simulate.guess import off_by, read_guess

BOX = Limits(low=(700, -200, 250), high=(1100, 250, 700), avoid=((850.0, 0.0, 500.0, 60.0),))


@pytest.mark.parametrize("kind", [*KINDS, "point"])
def test_planned_poses_keep_the_target_in_view_for_any_guess_as_wrong_as_stated(kind):
    setup, rng = setup_for(kind), np.random.default_rng(1)
    plan = design(setup, Wishes(poses=12), rng, polishes=1)
    guess, scanner = read_guess(GUESS), setup.scanner
    for _ in range(1000):
        R_sensor, T_sensor, target, _ = off_by(guess, kind, setup.sizes, rng)
        points = setup.seen(target, (plan.R @ R_sensor, carry(plan.R, plan.T, T_sensor)), 9)
        x, z = np.moveaxis(points, -1, 0)
        assert np.isfinite(points).all()
        assert (z > scanner.near).all()
        assert (z < scanner.far).all()
        assert (np.abs(x) < scanner.half_width(z)).all()


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_poses_stay_in_the_box_out_of_the_zones_and_within_the_tilt(mount):
    limits, guess = BOX, GUESS
    if mount == "eye-to-hand":  # the scanner stands in the base, the target is on the flange
        guess = {"mount": [900, 0, 700, 180, 0, 0], "target": [20, 0, 150]}
        limits = replace(BOX, high=(1100, 250, 800), avoid=((900.0, 0.0, 350.0, 20.0),))
    setup = setup_of(spec_of("edge", guess=guess, mount=mount, measured="points"), {}, np.random.default_rng(1))
    R, T = draw(setup, limits, 300, np.random.default_rng(2), AT_LIMIT)
    flange = inverse(R, T)[1] if mount == "eye-to-hand" else T
    assert (flange >= limits.low).all()
    assert (flange <= limits.high).all()
    *centre, radius = limits.avoid[0]
    assert np.linalg.norm(flange - centre, axis=1).min() >= radius
    tilt, spin = turned(setup, R)
    assert 25 < tilt.max() <= 30 + 1e-6
    assert 35 < np.abs(spin).max() <= 45 + 1e-6


def test_larger_margins_leave_fewer_poses():
    setup = setup_for("edge")
    R, T = inverse_mount(setup, *random_views(setup, Limits(), 500, np.random.default_rng(3)))
    counts = []
    for size in (0.0, 5.0, 10.0):
        wrong = replace(setup, margins=replace(setup.margins, mount_mm=size, target_mm=size))
        counts.append((refused(wrong, Limits(), R, T) == "").sum())
    assert counts[0] > counts[1] > counts[2] > 0


@pytest.mark.parametrize(
    ("limits", "sentence"),
    [
        (Limits(low=(0, 0, 0), high=(100, 100, 100)), "100% are outside the box"),
        (Limits(avoid=((900.0, 50.0, 300.0, 1000.0),)), "100% are in a zone to avoid"),
    ],
)
def test_limits_that_leave_no_pose_are_refused_in_words(limits, sentence):
    with pytest.raises(ScanError, match="only 0 of") as error:
        draw(setup_for("edge"), limits, 10, np.random.default_rng(4))
    assert sentence in str(error.value)


def test_a_guess_too_wrong_for_the_field_of_view_is_refused_in_words():
    setup = replace(setup_for("edge"), margins=replace(setup_for("edge").margins, mount_mm=80.0))
    with pytest.raises(ScanError, match="may lose the target from view if the guess is as wrong as stated"):
        draw(setup, Limits(), 10, np.random.default_rng(5))
