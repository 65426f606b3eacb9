"""Scans of different targets that are alike in all but the target."""

from dataclasses import replace

import numpy as np
import pytest

from profilecal.geometry.noise import Noise
from profilecal.joint.problem import Problem
from profilecal.papers.compared_targets import (
    bent,
    errors_in_closed_form,
    in_closed_form,
    misstated,
    perfect_case,
    with_errors,
)

PLAN = {"groups": 8, "positions": 5, "spread_deg": 30.0}
SD = np.array([0.01, 0.02])


def case_of(kind, **options):
    return perfect_case(kind, SD, 1, 3, **PLAN, **options)


def residuals(case):
    return np.abs(np.concatenate([r.ravel() for r in Problem(case.seen, Noise(1.0)).residuals(case.truth)]))


def test_the_same_robot_sees_every_target_and_sees_it_perfectly():
    first, *others = (case_of(kind) for kind in ("edge", "disk", "ball", "plane", "rod"))
    for case in (first, *others, case_of("ball", tetra=True)):
        assert residuals(case).max() < 1e-6  # mm
        assert np.allclose(case.truth.rotation, first.truth.rotation)
    assert all(np.allclose(case.seen[0].R_flange, first.seen[0].R_flange) for case in others)


def test_errors_are_as_large_as_asked_for():
    case, rng = case_of("edge"), np.random.default_rng(2)
    noisy = with_errors(case, 200, rng, scanner=2.0, position_mm=0.0, orientation_deg=0.0)
    points = noisy.seen[0].points - np.repeat(case.seen[0].points, 200, axis=0)
    assert points.std(axis=(0, 1, 2)) == pytest.approx(2 * SD, rel=0.05)
    moved = with_errors(case, 200, rng, scanner=0.0, position_mm=0.3, orientation_deg=0.0).seen[0]
    assert (moved.points == np.repeat(case.seen[0].points, 200, axis=0)).all()
    assert (moved.T_flange - np.repeat(case.seen[0].T_flange, 200, axis=0)).std() == pytest.approx(0.3, rel=0.05)


def test_a_bent_rod_and_a_wrong_radius_are_seen():
    assert residuals(bent(case_of("rod"), 0.0, 100.0)).max() < 1e-6
    assert residuals(bent(case_of("rod"), 0.1, 100.0)).max() > 0.05
    assert residuals(misstated(case_of("ball"), 0.1)).max() > 0.05


@pytest.mark.parametrize(("kind", "tetra"), [("edge", False), ("disk", False), ("ball", False), ("ball", True)])
def test_closed_forms_find_a_perfect_scans_mount(kind, tetra):
    case = case_of(kind, tetra=tetra)
    errors = errors_in_closed_form(case, 0.0, np.random.default_rng(3))
    assert np.abs(errors).max() < 1e-6
    R, T = in_closed_form(case, 0, 0.0, np.random.default_rng(3))
    assert np.allclose(R, case.truth.rotation[0])
    assert np.allclose(T, case.truth.translation[0])


def test_a_refused_scan_has_no_answer():
    case = case_of("disk")
    flat = replace(case, seen=[replace(case.seen[0], points=np.zeros_like(case.seen[0].points))])
    assert np.isinf(errors_in_closed_form(flat, 0.0, np.random.default_rng(3))).all()
