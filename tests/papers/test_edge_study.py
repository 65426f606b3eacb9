"""The edge paper's motions, scenes and measures of error."""

import numpy as np
import pytest

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between, directions, random_turns
from profilecal.simulation.robot import actual_poses
from profilecal.targets.ball import Ball
from profilecal_papers import edge_study as study
from profilecal_papers.edge_study import STANDOFF, EdgePlan, edge_scenes


def scene_of(seed=1, shape=(), **plan):
    return edge_scenes(EdgePlan(**plan), Noise(), np.random.default_rng(seed), shape)


def offsets_of(scene):
    return scene.poses.positions - scene.poses.positions[..., :1, :]


def test_arc_lies_on_its_circle_and_spans_its_angle():
    points = study.arc(11, 25.0, np.radians(90), 0.3)
    np.testing.assert_allclose(points[5], 0, atol=1e-14)
    centre = -25 * np.array([np.cos(0.3), np.sin(0.3), 0])
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1), 25)
    first, last = points[[0, -1]] - centre
    assert np.arccos(first @ last / 625) == pytest.approx(np.radians(90))


@pytest.mark.parametrize("tilt", [0.0, 30.0, 90.0])
def test_arc_planes_make_their_angle_with_the_edge(tilt):
    rng = np.random.default_rng(2)
    direction = directions(rng, (50,))
    planes = study.arc_planes(direction, np.radians(tilt), rng.uniform(0, 6, 50))
    np.testing.assert_allclose(
        planes @ np.swapaxes(planes, -1, -2),
        np.broadcast_to(np.eye(3), (50, 3, 3)),
        atol=1e-14,
    )
    np.testing.assert_allclose(np.linalg.det(planes), 1)
    np.testing.assert_allclose(
        (planes[..., 2] * direction).sum(-1), np.sin(np.radians(tilt)), atol=1e-14
    )
    np.testing.assert_allclose((planes[..., 1] * direction).sum(-1), 0, atol=1e-14)


def test_frames_of_motion():
    base, group, tool = (
        offsets_of(scene_of(frame=frame)) for frame in ("base", "group", "tool")
    )
    np.testing.assert_allclose(base, np.broadcast_to(base[0], base.shape), atol=1e-12)
    assert np.ptp(group, axis=0).max() > 10
    in_flange = tool @ scene_of(frame="tool").poses.rotations
    np.testing.assert_allclose(
        in_flange, np.broadcast_to(in_flange[0], in_flange.shape), atol=1e-12
    )


def test_turns_stay_within_the_spread_and_about_one_axis_when_asked():
    rotations = scene_of(groups=200, spread_deg=30).poses.rotations
    assert 30 < np.degrees(angle_between(rotations[:1], rotations)).max() <= 60
    one = random_turns(np.random.default_rng(3), (20,), 0.5, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(one[:, 2], np.broadcast_to([0, 0, 1], (20, 3)))


def test_each_group_starts_with_the_edge_in_the_middle_of_the_scan():
    scene = scene_of(shape=(3,), positions=11)
    np.testing.assert_allclose(
        scene.points[:, :, 5], np.broadcast_to([0, STANDOFF], (3, 25, 2)), atol=1e-10
    )


def test_numbers_may_differ_from_scene_to_scene():
    """Two scenes at once are as each with its own numbers; turns and offsets come from
    one stream of random numbers.
    """
    radius, spread = np.array([[10.0], [40.0]]), np.array([[10.0], [60.0]])
    both = scene_of(
        shape=(2,), radius=radius, spread_deg=spread, span_deg=np.full((2, 1), 90.0)
    )
    for k, (r, turn) in enumerate([(10.0, 10.0), (40.0, 60.0)]):
        one = scene_of(shape=(2,), radius=r, spread_deg=turn)
        np.testing.assert_allclose(both.poses.positions[k], one.poses.positions[k])
        np.testing.assert_allclose(both.points[k], one.points[k])


@pytest.mark.parametrize(("name", "value"), [("motion", "spiral"), ("frame", "world")])
def test_unknown_words_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is '{value}'; expected one of"):
        EdgePlan(**{name: value})


def test_pose_errors_have_their_sizes_and_groups_share_theirs():
    """Each standard deviation within four of its own standard errors."""
    poses = edge_scenes(
        EdgePlan(groups=2000, positions=10), Noise(), np.random.default_rng(2)
    ).poses
    noise = Noise(
        position_mm=0.3,
        group_position_mm=0.4,
        orientation_deg=0.2,
        group_orientation_deg=0.1,
    )
    rotations, positions = actual_poses(poses, noise, np.random.default_rng(3))
    error = positions - poses.positions
    within = error - error.mean(axis=1, keepdims=True)
    assert np.sqrt((within**2).sum() / (2000 * 9 * 3)) == pytest.approx(
        0.3, rel=4 / np.sqrt(2 * 2000 * 9 * 3)
    )
    expected = np.hypot(0.4, 0.3 / np.sqrt(10))
    assert error.mean(axis=1).std() == pytest.approx(
        expected, rel=4 / np.sqrt(2 * 6000)
    )
    turn = rotations @ np.swapaxes(poses.rotations, -1, -2)[:, None]
    angles = np.degrees(
        np.stack([turn[..., 2, 1], turn[..., 0, 2], turn[..., 1, 0]], axis=-1)
    )
    assert angles.mean(axis=1).std() == pytest.approx(
        np.hypot(0.1, 0.2 / np.sqrt(10)), rel=4 / np.sqrt(2 * 6000)
    )


def test_ball_points_lie_on_the_ball_when_carried_to_the_base():
    scene = edge_scenes(EdgePlan(), Noise(), np.random.default_rng(6), (3,))
    mount, ball = (scene.R_sensor, scene.T_sensor), Ball(scene.edge.point, 20.0)
    poses = study.plan_ball(ball.centre, 20.0, *mount, np.random.default_rng(7))
    points = study.ball_points(ball, *mount, poses, Noise(), np.random.default_rng(8))
    assert points.shape == (3, 10, 6, 40, 2)
    distance = np.linalg.norm(
        poses.carry(points, *mount) - ball.centre[:, None, None, None], axis=-1
    )
    np.testing.assert_allclose(distance, 20, atol=1e-10)
    assert (points[..., 1] < STANDOFF + 20).all()  # the side that the scanner sees


@pytest.mark.parametrize("about_mean", [False, True])
def test_criteria_vanish_without_noise(about_mean):
    """Arcs of 25 mm keep vectors longer than a micrometre, which rounding turns by less
    than 1e-6.
    """
    scene = edge_scenes(EdgePlan(motion="space"), Noise(), np.random.default_rng(1))
    solution = edge_equations(
        scene.poses.rotations, scene.poses.positions, scene.points
    )
    assert np.abs(study.angle_deviations(solution, about_mean)).max() < 1e-6
    assert study.line_distances(solution).max() < 1e-9


def test_angles_are_signed_and_turn_with_a_group():
    """A group turned about the edge's normal by a small angle deviates by that much
    more, to one side.
    """
    scene = edge_scenes(
        EdgePlan(motion="space"), Noise(0.1), np.random.default_rng(1), (3,)
    )
    found = edge_equations(
        scene.poses.rotations, scene.poses.positions, scene.points
    ).translation
    angles = study.angle_deviations(found)
    assert angles.shape == (3, 25)
    assert (angles < 0).any()
    assert (angles > 0).any()
    u = found.u_b[0]
    aside = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    aside /= np.linalg.norm(aside)
    found.p_b[0, 0] += (
        0.01 * ((found.p_b[0, 0] - found.p_b[0, 0].mean(axis=0)) @ u)[:, None] * aside
    )
    assert study.angle_deviations(found)[0, 0] - angles[0, 0] == pytest.approx(
        0.01, rel=0.05
    )


def test_criteria_of_many_scenes_are_those_of_each():
    scene = edge_scenes(EdgePlan(), Noise(0.1), np.random.default_rng(2), (4,))
    poses = scene.poses.first(10)
    all_found = edge_equations(poses.rotations, poses.positions, scene.points[:, :10])
    angles, distances = (
        study.angle_deviations(all_found),
        study.line_distances(all_found),
    )
    for k in range(4):
        R, T, points = (
            scene.poses.rotations[k, :10],
            scene.poses.positions[k, :10],
            scene.points[k, :10],
        )
        found = edge_equations(R, T, points)
        assert angles[k] == pytest.approx(study.angle_deviations(found))
        assert distances[k] == pytest.approx(study.line_distances(found))
