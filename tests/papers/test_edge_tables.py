"""Simulated Tables 1 to 3: the fast path against the equations, one scene at a time."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal_papers import edge_study as study
from profilecal_papers import edge_tables as tables

NOISE = Noise(profile_mm=0.1, group_position_mm=0.1)


def scene_of(count, **plan):
    plan = study.EdgePlan(**plan)
    return study.edge_scenes(plan, NOISE, default_rng(1), (count,))


@pytest.mark.parametrize("frame", ["base", "group"])
def test_a_calibration_is_that_of_the_equations(frame):
    """With u_b as the page has it: of vectors about their mean, or as they are."""
    scene = scene_of(3, frame=frame)
    both = tables.calibrations(scene, (True, False))
    for count, pair in zip(tables.ROTATIONS, both, strict=True):
        poses = scene.poses.first(count)
        solution = edge_equations(
            poses.rotations, poses.positions, scene.points[:, :count]
        )
        for found in pair:
            assert_allclose(found.R_sensor, solution.R_sensor, atol=1e-9)
        assert_allclose(np.cross(found.u_b, solution.u_b), 0, atol=1e-9)
        assert_allclose(found.T_sensor, solution.T_sensor, atol=1e-6)
        alpha = np.degrees(study.angle_deviations(solution, about_mean=False))
        assert_allclose(np.abs(found.delta_alpha), np.abs(alpha), atol=1e-6)
        assert_allclose(found.delta_d, study.line_distances(solution), atol=1e-6)


def test_about_the_mean_a_direction_is_that_of_the_points():
    scene = scene_of(2)
    *_, (found,) = tables.calibrations(scene)
    along = study.principal(found.p_b)
    assert np.abs(np.vecdot(along, found.directions)) == pytest.approx(1)
    vectors = (found.p_b[:, :, 1:] - found.p_b[:, :, :1]).reshape(2, -1, 3)
    assert np.abs(np.vecdot(study.principal(vectors), found.u_b)) == pytest.approx(1)


def test_without_errors_the_tables_are_zero_and_the_radius_is_right():
    """And three specimens that share their motions differ by their errors alone."""
    rng = default_rng(2)
    (exact,) = tables.columns(study.EdgePlan(), Noise(), 3, rng, share=True)
    assert np.abs(exact[..., :4]).max() < 1e-6
    assert np.abs(exact[..., 4] - tables.BALL_MM).max() < 1e-6
    scene = study.edge_scenes(study.EdgePlan(), NOISE, rng, (6,), alike=3)
    R = scene.poses.rotations
    assert (R[0] == R[2]).all()
    assert (R[2] != R[3]).any()
    assert (scene.points[0] != scene.points[1]).any()
