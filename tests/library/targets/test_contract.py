"""What the library asks of every target: residuals with their derivatives, a fit,
distances, outlines, lines.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.differentiate import jacobian

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import carry, directions, rotations
from profilecal.joint.prior import of_scanner
from profilecal.joint.problem import Problem
from profilecal.simulation.scene import random_scene
from profilecal.targets import TARGETS
from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.edge import SPECIMENS

KINDS = list(TARGETS)


@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_agree_with_numerical_ones(kind, in_space):
    """By the sensor's pose, which moves the target in every way, and by its own place."""
    rng = np.random.default_rng(6)
    scene = random_scene(kind, rng, groups=3, positions=3, count=4)
    problem = Problem([scene.observations], Noise(0.05), in_space=in_space)
    term = problem.terms[0]
    state = problem.move(scene.truth, 0.02 * rng.normal(size=(1, problem.n)))

    def residual(step):
        steps = step.reshape(problem.n, -1).T
        moved = problem.move(state[np.zeros(len(steps), dtype=int)], steps)
        r = term.linearise(moved, moved.placements[0])[:, -1]
        return np.moveaxis(r.reshape(len(steps), -1), 0, 1).reshape(-1, *step.shape[1:])

    numerical = jacobian(residual, np.zeros(problem.n), initial_step=0.01).df
    ours = term.linearise(state, state.placements[0])[0, :-1].reshape(problem.n, -1).T
    np.testing.assert_allclose(ours, numerical, atol=1e-7 * np.abs(numerical).max())


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_vanish_where_the_target_meets_the_scan_plane(kind):
    scene = random_scene(kind, np.random.default_rng(7))
    for in_space in (False, True):
        (z,) = Problem([scene.observations], Noise(1.0), in_space=in_space).linear(
            scene.truth
        )
        assert np.abs(z[:, -1]).max() < 1e-9


@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_point_has_no_part_in_anything(kind, in_space):
    scene = random_scene(kind, np.random.default_rng(8))
    seen = scene.noisy(0.05, np.random.default_rng(9))
    points = seen.points.copy()
    points[0, 1, 0] = np.nan
    whole, part = (
        Problem([o], Noise(0.05), in_space=in_space)
        for o in (seen, replace(seen, points=points))
    )
    (full,), (some,) = (problem.linear(scene.truth) for problem in (whole, part))
    present = np.ones(full.shape[2:])
    present[: full.shape[2] // points.shape[2], 1] = 0
    np.testing.assert_array_equal(some, full * present)
    (full,), (some_too,) = (
        problem.columns_in_mm(scene.truth, of_scanner()) for problem in (whole, part)
    )
    np.testing.assert_array_equal(some_too, full * present)


def in_base(scene):
    """The points seen, (n, 3), in the base frame."""
    seen, (R_sensor,), (T_sensor,) = (
        scene.observations,
        scene.truth.rotation,
        scene.truth.translation,
    )
    x, z = np.moveaxis(seen.points[0], -1, 0)
    in_flange = np.stack([x, np.zeros_like(x), z], axis=-1) @ R_sensor.T + T_sensor
    return carry(
        seen.R_flange[0][:, None], seen.T_flange[0][:, None], in_flange
    ).reshape(-1, 3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_fit_to_its_points_is_the_target(kind):
    """Its distances from them are zero, and its lengths those that it has; points off
    by noise are as far from it.
    """
    rng = np.random.default_rng(10)
    scene = random_scene(kind, rng)
    points, target = in_base(scene), TARGETS[kind]
    assert np.abs(scene.target.distance(points)).max() < 1e-9
    origin, axes, sizes = target.fit(points)
    fitted = target.at(origin, axes, sizes)
    assert np.abs(fitted.distance(points)).max() < 1e-4
    np.testing.assert_allclose(sizes, target.sizes, atol=1e-3)
    np.testing.assert_allclose(np.linalg.det(axes), 1)
    noisy = points + 0.05 * rng.normal(size=points.shape)
    origin, axes, sizes = target.fit(noisy)
    assert (
        np.sqrt(np.mean(target.at(origin, axes, sizes).distance(noisy) ** 2))
        < 0.05 * np.sqrt(3) * 1.1
    )
    both = target.fit(np.stack([points, noisy]))
    np.testing.assert_allclose(both[0][1], origin)


@pytest.mark.parametrize("kind", KINDS)
def test_its_lines_lie_on_it(kind):
    """A point's cross reaches 10 mm from it."""
    scene = random_scene(kind, np.random.default_rng(12))
    lines = scene.target.lines(in_base(scene))
    assert lines
    for line in lines:
        assert line.shape[1] == 3
        assert (
            np.abs(scene.target.distance(line)).max()
            < (10 if kind == "point" else 0) + 1e-9
        )
    if kind == "rod":  # on all sides
        np.testing.assert_allclose(
            scene.target.distance(np.mean(lines, axis=0)), -scene.target.radius
        )


def test_a_knife_blade_is_the_same_from_both_sides():
    blade = SPECIMENS["knife blade"]
    assert blade == [(-aside, up) for aside, up in blade[::-1]]


def test_a_face_shows_on_both_sides_of_what_lies_on_it():
    arc = np.array([[[-5.0, 80], [0, 75], [5, 80]]])
    (outline,) = TARGETS["plane"](np.zeros(3), np.r_[0, 0, 1.0]).behind(
        arc, np.eye(3)[None], np.array([[0, 0, -100]])
    )
    assert outline.tolist() == [
        [-500, 100],
        [-5, 100],
        *arc[0].tolist(),
        [5, 100],
        [500, 100],
    ]


@pytest.mark.parametrize("kind", ["edge", "rod"])
def test_what_has_no_ends_is_drawn_as_long_as_it_was_seen(kind):
    scene = random_scene(kind, np.random.default_rng(12))
    along = (in_base(scene) - scene.target.point) @ scene.target.direction
    drawn = (
        scene.target.lines(in_base(scene))[0] - scene.target.point
    ) @ scene.target.direction
    assert np.ptp(along) < np.ptp(drawn) < 1.3 * np.ptp(along)
    assert abs(drawn.mean() - (along.min() + along.max()) / 2) < 0.1 * np.ptp(along)


def test_a_missed_disk_has_no_chord_and_a_circle_gives_the_ball_back_on_its_side():
    rng = np.random.default_rng(3)
    rotation, origin = (
        rotations(rng.normal(size=(200, 3))),
        rng.uniform(-20, 20, (200, 3)),
    )
    tips = Disk(np.zeros(3), directions(rng, ()), 25.0).meet(rotation, origin)
    hit = np.isfinite(tips).all(axis=(1, 2))
    assert 100 < hit.sum() < 200
    assert (tips[hit, 0, 0] <= tips[hit, 1, 0]).all()
    assert not Disk.offsets(
        (2, 3), "space", np.array([[0, 0.6, 0.8]] * 2), (25.0,), 0.0, rng
    )[..., 0].any()
    ball = Ball(np.array([5.0, 0.0, -4.0]), 40.0)
    in_sensor = ((ball.centre - origin)[:, None] @ rotation)[:, 0]
    found = ball.centre_from_circle(
        ball.meet(rotation, origin), ball.sides(rotation, origin)
    )
    np.testing.assert_allclose(found, in_sensor, atol=1e-11)
