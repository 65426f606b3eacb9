"""The edge paper's motions, scenes and measures of error."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between, directions
from profilecal.simulation.robot import actual_poses
from profilecal.targets.ball import Ball
from profilecal_papers import edge_study as study
from profilecal_papers.edge_study import (
    STANDOFF,
    EdgePlan,
    edge_scenes,
    random_turns,
)


def scene_of(seed=1, shape=(), **plan):
    return edge_scenes(EdgePlan(**plan), Noise(), default_rng(seed), shape)


def offsets_of(scene):
    return scene.poses.positions - scene.poses.positions[..., :1, :]


def test_arc_lies_on_its_circle_and_spans_its_angle():
    points = study.arc(11, 25.0, np.radians(90), 0.3)
    assert_allclose(points[5], 0, atol=1e-14)
    centre = -25 * np.array([np.cos(0.3), np.sin(0.3), 0])
    assert_allclose(np.linalg.norm(points - centre, axis=1), 25)
    first, last = points[[0, -1]] - centre
    assert np.arccos(first @ last / 625) == pytest.approx(np.radians(90))


@pytest.mark.parametrize("tilt", [0.0, 30.0, 90.0])
def test_arc_planes_make_their_angle_with_the_edge(tilt):
    rng = default_rng(2)
    tilt = np.radians(tilt)
    direction = directions(rng, (50,))
    planes = study.arc_planes(direction, tilt, rng.uniform(0, 6, 50))
    products = planes @ planes.mT
    assert_allclose(products - np.eye(3), 0, atol=1e-14)
    assert_allclose(np.linalg.det(planes), 1)
    _, y, normal = np.moveaxis(planes, -1, 0)
    assert_allclose(np.vecdot(normal, direction), np.sin(tilt), atol=1e-14)
    assert_allclose(np.vecdot(y, direction), 0, atol=1e-14)


def test_frames_of_motion():
    in_base = offsets_of(scene_of(frame="base"))
    assert_allclose(in_base - in_base[0], 0, atol=1e-12)
    own = offsets_of(scene_of(frame="group"))
    assert np.ptp(own, axis=0).max() > 10
    scene = scene_of(frame="tool")
    in_flange = offsets_of(scene) @ scene.poses.rotations
    assert_allclose(in_flange - in_flange[0], 0, atol=1e-12)


def test_turns_stay_within_the_spread_and_about_one_axis_when_asked():
    rotations = scene_of(groups=200, spread_deg=30).poses.rotations
    assert 30 < np.degrees(angle_between(rotations[:1], rotations)).max() <= 60
    z = np.array([0.0, 0.0, 1.0])
    about_z = random_turns(default_rng(3), (20,), 0.5, z)
    assert_allclose(about_z[:, 2] - z, 0, atol=1e-14)


def test_each_group_starts_with_the_edge_in_the_middle_of_the_scan():
    scene = scene_of(shape=(3,), positions=11)
    assert_allclose(scene.points[:, :, 5] - [0, STANDOFF], 0, atol=1e-10)


def test_numbers_may_differ_from_scene_to_scene():
    """Two scenes at once are as each with its own numbers; turns and offsets come from
    one stream of random numbers.
    """
    first = {"radius": 10.0, "spread_deg": 10.0, "span_deg": 90.0}
    second = {"radius": 40.0, "spread_deg": 60.0, "span_deg": 90.0}
    plans = {name: np.array([[first[name]], [second[name]]]) for name in first}
    both = scene_of(shape=(2,), **plans)
    for k, plan in enumerate([first, second]):
        one = scene_of(shape=(2,), **plan)
        assert_allclose(both.poses.positions[k], one.poses.positions[k])
        assert_allclose(both.points[k], one.points[k])


@pytest.mark.parametrize(("name", "value"), [("motion", "spiral"), ("frame", "world")])
def test_unknown_words_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is '{value}'; expected one of"):
        EdgePlan(**{name: value})


def test_pose_errors_have_their_sizes_and_groups_share_theirs():
    """Each standard deviation within four of its own standard errors."""
    groups, positions = 2000, 10
    poses = scene_of(2, groups=groups, positions=positions).poses
    noise = Noise(
        position_mm=0.3,
        group_position_mm=0.4,
        orientation_deg=0.2,
        group_orientation_deg=0.1,
    )
    R, T = actual_poses(poses, noise, default_rng(3))

    error = T - poses.positions
    within = error - error.mean(axis=1, keepdims=True)
    freedom = groups * (positions - 1) * 3
    own = np.sqrt((within**2).sum() / freedom)
    assert own == pytest.approx(0.3, rel=4 / np.sqrt(2 * freedom))
    four_errors = 4 / np.sqrt(2 * 3 * groups)
    of_mean = np.hypot(0.4, 0.3 / np.sqrt(positions))
    assert error.mean(axis=1).std() == pytest.approx(of_mean, rel=four_errors)

    turn = R @ poses.rotations.mT[:, None]
    angles = np.stack([turn[..., 2, 1], turn[..., 0, 2], turn[..., 1, 0]], axis=-1)
    of_mean = np.hypot(0.1, 0.2 / np.sqrt(positions))
    found = np.degrees(angles).mean(axis=1).std()
    assert found == pytest.approx(of_mean, rel=four_errors)


def test_ball_points_lie_on_the_ball_when_carried_to_the_base():
    scene = edge_scenes(EdgePlan(), Noise(), default_rng(6), (3,))
    mount, ball = (scene.R_sensor, scene.T_sensor), Ball(scene.edge.point, 20.0)
    poses = study.plan_ball(ball.centre, 20.0, *mount, default_rng(7))
    points = study.ball_points(ball, *mount, poses, Noise(), default_rng(8))
    assert points.shape == (3, 10, 6, 40, 2)
    from_centre = poses.carry(points, *mount) - ball.centre[:, None, None, None]
    distance = np.linalg.norm(from_centre, axis=-1)
    assert_allclose(distance, 20, atol=1e-10)
    assert (points[..., 1] < STANDOFF + 20).all()  # the side that the scanner sees


def solution_of(scene):
    return edge_equations(scene.poses.rotations, scene.poses.positions, scene.points)


@pytest.mark.parametrize("about_mean", [False, True])
def test_criteria_vanish_without_noise(about_mean):
    """Arcs of 25 mm keep vectors longer than a micrometre, which rounding turns by less
    than 1e-6.
    """
    solution = solution_of(scene_of(motion="space"))
    assert np.abs(study.angle_deviations(solution, about_mean)).max() < 1e-6
    assert study.line_distances(solution).max() < 1e-9


def test_angles_are_signed_and_turn_with_a_group():
    """A group turned about the edge's normal by a small angle deviates by that much
    more, to one side.
    """
    rng = default_rng(1)
    scene = edge_scenes(EdgePlan(motion="space"), Noise(0.1), rng, (3,))
    solution = solution_of(scene)
    angles = study.angle_deviations(solution)
    assert angles.shape == (3, 25)
    assert (angles < 0).any()
    assert (angles > 0).any()
    u = solution.u_b[0]
    aside = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    aside /= np.linalg.norm(aside)
    group = solution.p_b[0, 0]
    along = (group - group.mean(axis=0)) @ u
    group += 0.01 * along[:, None] * aside
    turned = study.angle_deviations(solution)[0, 0] - angles[0, 0]
    assert turned == pytest.approx(0.01, rel=0.05)


def test_criteria_of_many_scenes_are_those_of_each():
    plan = EdgePlan(groups=10)
    scene = edge_scenes(plan, Noise(0.1), default_rng(2), (4,))
    of_all = solution_of(scene)
    angles = study.angle_deviations(of_all)
    distances = study.line_distances(of_all)
    R, T = scene.poses.rotations, scene.poses.positions
    for k in range(4):
        solution = edge_equations(R[k], T[k], scene.points[k])
        assert angles[k] == pytest.approx(study.angle_deviations(solution))
        assert distances[k] == pytest.approx(study.line_distances(solution))
