"""Each target's residuals vanish on what its own `meet` gives, and their derivatives are the derivatives."""

import numpy as np
import pytest
from scipy.differentiate import jacobian

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import directions, rotations
from profilecal.joint.observations import TARGETS
from profilecal.joint.problem import Problem
from profilecal.simulate.scene import RADIUS, random_scene
from profilecal.targets.plane import Plane
from profilecal.targets.point import Point

KINDS = list(TARGETS)


def sensor_view(kind, rng):
    """A target's point and direction in the sensor frame, near where they can be seen, and a sensed profile (m, 2)."""
    point = np.array([rng.uniform(-10, 10), rng.uniform(-8, 8), rng.uniform(80, 120)])
    direction = np.array([0.3, 1.0, 0.2]) if kind == "edge" else np.array([0.3, 0.2, 1.0])
    direction = direction + 0.1 * rng.normal(size=3)
    m = {"edge": 1, "point": 1, "disk": 2}.get(kind, 5)
    seen = point[[0, 2]] + rng.normal(size=(m, 2)) * [20, 3] - [0, 15]
    return point, direction / np.linalg.norm(direction), seen


@pytest.mark.parametrize("in_plane", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_agree_with_numerical_ones(kind, in_plane):
    rng = np.random.default_rng(5)
    module, size = TARGETS[kind], RADIUS.get(kind, 0.3)
    for _ in range(20):
        point, direction, seen = sensor_view(kind, rng)

        def residual(x, seen=seen):
            spread = seen.reshape(*seen.shape, *[1] * (x.ndim - 1)) + 0 * x[0]
            return np.stack(module.residual(x[:3], x[3:], spread, size, in_plane)[0])

        x = np.concatenate([point, direction])
        numerical = jacobian(residual, x, initial_step=0.1 * np.r_[[1.0] * 3, [0.1] * 3])
        r, by_point, by_direction = module.residual(point, direction, seen, size, in_plane)
        ours = np.concatenate([np.reshape(by_point, (-1, 3)), np.zeros((len(r), 3))], axis=1)
        if module.TURNS:
            ours[:, 3:] = np.reshape(by_direction, (-1, 3))
        scale = np.abs(numerical.df).max(axis=0)
        np.testing.assert_allclose(ours / scale.clip(1e-3), numerical.df / scale.clip(1e-3), atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_whole_problem_agree_with_numerical_ones(kind):
    rng = np.random.default_rng(6)
    scene = random_scene(kind, rng, groups=3, positions=3, count=4)
    problem = Problem([scene.observations], Noise(0.05))
    term = problem.terms[0]
    state = problem.move(scene.truth, 0.02 * rng.normal(size=(1, problem.n)))

    def residual(step):
        steps = step.reshape(problem.n, -1).T
        moved = problem.move(state[np.zeros(len(steps), dtype=int)], steps)
        r = term.linearise(moved, moved.placements[0], True)[0][:, -1]
        return np.moveaxis(r.reshape(len(steps), -1), 0, 1).reshape(-1, *step.shape[1:])

    numerical = jacobian(residual, np.zeros(problem.n), initial_step=0.01).df
    ours = term.linearise(state, state.placements[0], True)[0][0, :-1].reshape(problem.n, -1).T
    np.testing.assert_allclose(ours, numerical, atol=1e-7 * np.abs(numerical).max())


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_vanish_where_the_target_meets_the_scan_plane(kind):
    scene = random_scene(kind, np.random.default_rng(7))
    problem = Problem([scene.observations], Noise(0.05))
    for in_plane in (True, False):
        r = problem.terms[0].linearise(scene.truth, scene.truth.placements[0], in_plane)[0][0, -1]
        assert np.abs(r).max() < 1e-9


def test_a_plane_meets_the_scan_plane_in_a_line_on_both():
    rng = np.random.default_rng(8)
    rotation, origin = rotations(rng.normal(size=(100, 3))), rng.uniform(-50, 50, (100, 3))
    plane = Plane(rng.uniform(-50, 50, 3), directions(rng, ()))
    nearest, along = np.moveaxis(plane.meet(rotation, origin), 1, 0)
    for s in (-30, 0, 40):
        x, z = (nearest + s * along).T
        p = origin + x[:, None] * rotation[:, :, 0] + z[:, None] * rotation[:, :, 2]
        scale = 1 + np.linalg.norm(p - plane.point, axis=1)
        assert np.abs((p - plane.point) @ plane.normal / scale).max() < 1e-12


def test_a_point_is_seen_at_its_coordinates():
    rng = np.random.default_rng(9)
    rotation, origin = rotations(rng.normal(size=(50, 3))), rng.uniform(-50, 50, (50, 3))
    point = Point(rng.uniform(-50, 50, 3))
    seen = point.meet(rotation, origin)
    y = ((point.point - origin)[:, None] @ rotation)[:, 0, 1]
    back = origin + (rotation @ np.column_stack([seen[:, 0], y, seen[:, 1]])[..., None])[..., 0]
    np.testing.assert_allclose(back, np.broadcast_to(point.point, back.shape), atol=1e-12 * 200)
