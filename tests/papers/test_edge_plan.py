import numpy as np
import pytest

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between, directions, random_turns
from profilecal.papers.edge_study import STANDOFF, EdgePlan, arc, arc_planes, edge_scenes, plan_edge


def scene_of(seed=1, shape=(), **plan):
    return edge_scenes(EdgePlan(**plan), Noise(), np.random.default_rng(seed), shape)


def offsets_of(scene):
    return scene.poses.positions - scene.poses.positions[..., :1, :]


def test_arc_lies_on_its_circle_and_spans_its_angle():
    points = arc(11, 25.0, np.radians(90), 0.3)
    np.testing.assert_allclose(points[5], 0, atol=1e-14)
    centre = -25 * np.array([np.cos(0.3), np.sin(0.3), 0])
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1), 25)
    first, last = points[[0, -1]] - centre
    assert np.arccos(first @ last / 625) == pytest.approx(np.radians(90))


@pytest.mark.parametrize("tilt", [0.0, 30.0, 90.0])
def test_arc_planes_make_their_angle_with_the_edge(tilt):
    rng = np.random.default_rng(2)
    direction = directions(rng, (50,))
    planes = arc_planes(direction, np.radians(tilt), rng.uniform(0, 6, 50))
    np.testing.assert_allclose(planes @ np.swapaxes(planes, -1, -2), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(planes), 1)
    np.testing.assert_allclose((planes[..., 2] * direction).sum(-1), np.sin(np.radians(tilt)), atol=1e-14)
    np.testing.assert_allclose((planes[..., 1] * direction).sum(-1), 0, atol=1e-14)


def test_frames_of_motion():
    base, group, tool = (offsets_of(scene_of(frame=frame)) for frame in ("base", "group", "tool"))
    np.testing.assert_allclose(base, np.broadcast_to(base[0], base.shape), atol=1e-12)
    assert np.ptp(group, axis=0).max() > 10
    in_flange = tool @ scene_of(frame="tool").poses.rotations
    np.testing.assert_allclose(in_flange, np.broadcast_to(in_flange[0], in_flange.shape), atol=1e-12)


def test_motion_fills_a_line_a_plane_or_space():
    dimensions = {
        motion: np.linalg.matrix_rank(offsets_of(scene_of(motion=motion))[0], tol=1e-9)
        for motion in ("line", "arc", "space")
    }
    assert dimensions == {"line": 1, "arc": 2, "space": 3}


def test_turns_stay_within_the_spread_and_about_one_axis_when_asked():
    rotations = scene_of(groups=200, spread_deg=30).poses.rotations
    assert 30 < np.degrees(angle_between(rotations[:1], rotations)).max() <= 60
    one = random_turns(np.random.default_rng(3), (20,), 0.5, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(one[:, 2], np.broadcast_to([0, 0, 1], (20, 3)))


def test_each_group_starts_with_the_edge_in_the_middle_of_the_scan():
    scene = scene_of(shape=(3,), positions=11)
    np.testing.assert_allclose(scene.points[:, :, 5], np.broadcast_to([0, STANDOFF], (3, 25, 2)), atol=1e-10)


def test_numbers_may_differ_from_scene_to_scene():
    """Two scenes at once are as each with its own numbers; turns and offsets come from one stream of random numbers."""
    radius, spread = np.array([[10.0], [40.0]]), np.array([[10.0], [60.0]])
    both = scene_of(shape=(2,), radius=radius, spread_deg=spread, span_deg=np.full((2, 1), 90.0))
    for k, (r, turn) in enumerate([(10.0, 10.0), (40.0, 60.0)]):
        one = scene_of(shape=(2,), radius=r, spread_deg=turn)
        np.testing.assert_allclose(both.poses.positions[k], one.poses.positions[k])
        np.testing.assert_allclose(both.points[k], one.points[k])


def test_first_groups_are_the_first():
    poses = scene_of().poses
    np.testing.assert_array_equal(poses.first(10).rotations, poses.rotations[:10])
    np.testing.assert_array_equal(poses.first(10).positions, poses.positions[:10])


def test_same_seed_same_plan():
    scene = scene_of()
    plans = [
        plan_edge(EdgePlan(), scene.edge, scene.R_sensor, scene.T_sensor, np.random.default_rng(5)) for _ in range(2)
    ]
    np.testing.assert_array_equal(plans[0].positions, plans[1].positions)


@pytest.mark.parametrize(("name", "value"), [("motion", "spiral"), ("frame", "world")])
def test_unknown_words_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is '{value}'; expected one of"):
        EdgePlan(**{name: value})
