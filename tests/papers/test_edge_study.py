"""The edge paper's motions, scenes and measures of error; its simulated Tables 1 to 3,
the fast path against the equations, one scene at a time.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal_papers import edge_study as study
from profilecal_papers import edge_tables as tables
from profilecal_papers.edge_study import STANDOFF, EdgePlan


def scene_of(shape=(), sigma=0.0, **plan):
    return study.edge_scenes(EdgePlan(**plan), Noise(sigma), default_rng(1), shape)


@pytest.mark.parametrize("tilt", [0, 30, 90])
def test_an_arc_has_its_radius_its_span_and_its_angle_with_the_edge(tilt):
    plan = {"groups": 1, "positions": 11, "radius": 25, "span_deg": 60}
    scene = scene_of((50,), tilt_deg=tilt, **plan)
    T = scene.poses.positions[:, 0]
    for apart in (1, 2, 10):  # positions, 6° each
        chords = np.linalg.norm(T[:, apart:] - T[:, :-apart], axis=-1)
        assert_allclose(chords, 50 * np.sin(np.radians(3 * apart)))
    normal = np.cross(T[:, 5] - T[:, 0], T[:, 10] - T[:, 0])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    assert_allclose(np.vecdot(T - T[:, :1], normal[:, None]), 0, atol=1e-9)
    sine = np.abs(np.vecdot(normal, scene.edge.direction))
    assert_allclose(sine, np.sin(np.radians(tilt)), atol=1e-12)


def test_an_arc_is_held_by_its_frame_and_begins_with_the_edge_in_the_middle():
    def offsets(frame):
        scene = scene_of(frame=frame, positions=11)
        assert_allclose(scene.points[:, 5] - [0, STANDOFF], 0, atol=1e-10)
        T = scene.poses.positions
        return T - T[:, :1], scene.poses.rotations

    in_base, _ = offsets("base")
    in_tool, R = offsets("tool")
    for same in (in_base, in_tool @ R):
        assert_allclose(same - same[0], 0, atol=1e-12)
    assert np.ptp(offsets("group")[0], axis=0).max() > 10


def test_a_line_has_the_length_of_its_diameter():
    T = scene_of(motion="line", radius=25).poses.positions
    assert_allclose(np.linalg.norm(T[:, -1] - T[:, 0], axis=1), 50)


def test_angles_are_signed_and_turn_with_a_group():
    """A group turned about the edge's normal by a small angle deviates by that much
    more, to one side; the second of three scenes.
    """
    scene = scene_of((3,), 0.1, motion="space")
    poses = scene.poses
    solution = edge_equations(poses.rotations, poses.positions, scene.points)
    angles = study.angle_deviations(solution)
    assert angles.shape == (3, 25)
    assert angles.min() < 0 < angles.max()
    u, group = solution.u_b[1], solution.p_b[1, 0]
    aside = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    along = (group - group.mean(axis=0)) @ u
    group += 0.01 * along[:, None] * aside / np.linalg.norm(aside)
    turned = study.angle_deviations(solution) - angles
    assert turned[1, 0] == pytest.approx(0.01, rel=0.05)
    turned[1, 0] = 0
    assert not turned.any()


@pytest.mark.parametrize("frame", ["base", "group"])
def test_a_calibration_is_that_of_the_equations(frame):
    """With u_b as the page has it, of vectors as they are. About their mean, directions
    are those of the points.
    """
    scene = scene_of((3,), 0.1, frame=frame)
    both = tables.calibrations(scene, (True, False))
    for count, (about_mean, found) in zip(tables.ROTATIONS, both, strict=True):
        poses = scene.poses.first(count)
        solution = edge_equations(
            poses.rotations, poses.positions, scene.points[:, :count]
        )
        for either in (about_mean, found):
            assert_allclose(either.R_sensor, solution.R_sensor, atol=1e-9)
        assert_allclose(np.cross(found.u_b, solution.u_b), 0, atol=1e-9)
        assert_allclose(found.T_sensor, solution.T_sensor, atol=1e-6)
        alpha = np.degrees(study.angle_deviations(solution, about_mean=False))
        assert_allclose(np.abs(found.delta_alpha), np.abs(alpha), atol=1e-6)
        assert_allclose(found.delta_d, study.line_distances(solution), atol=1e-6)
        p_b = about_mean.p_b
        along = np.cross(study.principal(p_b), about_mean.directions)
        assert_allclose(along, 0, atol=1e-6)
        vectors = (p_b[:, :, 1:] - p_b[:, :, :1]).reshape(3, -1, 3)
        assert_allclose(
            np.cross(study.principal(vectors), about_mean.u_b), 0, atol=1e-6
        )


def test_without_errors_the_tables_are_zero_and_the_radius_is_right():
    """And three specimens that share their motions differ by their errors alone."""
    rng = default_rng(2)
    (exact,) = tables.columns(EdgePlan(), Noise(), 3, rng, share=True)
    assert np.abs(exact[..., :4]).max() < 1e-6
    assert np.abs(exact[..., 4] - tables.BALL_MM).max() < 1e-6
    scene = study.edge_scenes(EdgePlan(), Noise(0.1), rng, (6,), alike=3)
    R = scene.poses.rotations
    assert (R[0] == R[2]).all()
    assert (R[2] != R[3]).any()
    assert (scene.points[0] != scene.points[1]).any()
