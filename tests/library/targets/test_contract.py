"""What the library asks of every target: residuals with their derivatives, a fit,
distances, outlines, lines, and of those in raw profiles how exactly they are found.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import IN_PROFILES, KINDS
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.differentiate import jacobian
from scipy.stats import chi2
from simulated import state_of

import profilecal as pc
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import homogeneous, in_base
from profilecal.joint.prior import OF_SCANNER
from profilecal.joint.problem import Problem
from profilecal.simulation.scene import random_scene
from profilecal.targets import TARGETS

Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_residuals_vanish_at_the_truth_and_have_their_derivatives(kind, in_space):
    """By the sensor's pose, which moves the target in every way, and by its own."""
    rng = default_rng(6)
    scene = random_scene(kind, rng, groups=3, positions=3, count=4)
    problem = Problem([scene.observations], Noise(0.05), in_space=in_space)
    term = problem.terms[0]
    exact = term.linearise(scene.truth, *scene.truth.placements)
    assert np.abs(exact[:, -1]).max() < 5e-10
    state = problem.move(scene.truth, 0.02 * rng.normal(size=(1, problem.n)))

    def residual(step):
        """All residuals, (k, ...), after steps (n, ...)."""
        steps = step.reshape(problem.n, -1).T
        copies = state[np.zeros(len(steps), dtype=int)]
        moved = problem.move(copies, steps)
        r = term.linearise(moved, *moved.placements)[:, -1]
        return r.reshape(len(steps), -1).T.reshape(-1, *step.shape[1:])

    numerical = jacobian(residual, np.zeros(problem.n), initial_step=0.01).df
    (columns,) = term.linearise(state, *state.placements)
    ours = columns[:-1].reshape(problem.n, -1).T
    assert_allclose(ours, numerical, atol=1e-7 * np.abs(numerical).max())


@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_point_has_no_part_in_anything(kind, in_space):
    scene = random_scene(kind, default_rng(8))
    seen = scene.noisy(0.05, default_rng(9))
    points = seen.points.copy()
    points[0, 1, 0] = np.nan
    whole = Problem([seen], Noise(0.05), in_space=in_space)
    part = Problem([replace(seen, points=points)], Noise(0.05), in_space=in_space)

    (full,), (some,) = (
        problem.columns_in_mm(scene.truth, OF_SCANNER) for problem in (whole, part)
    )
    rows = full.shape[2] // points.shape[2]
    present = np.ones(full.shape[2:])
    present[:rows, 1] = 0
    assert_array_equal(some, full * present)


def points_of(scene):
    """The points seen, (n, 3), in the base frame."""
    seen, sensor = scene.observations, homogeneous(scene.R_sensor, scene.T_sensor)
    return in_base(sensor, seen.points[0], seen.R_flange[0], seen.T_flange[0])[0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_fit_to_its_points_is_the_target(kind):
    """Its distances from them are zero, and its sizes those that it has; points off
    by noise are as far from it.
    """
    rng = default_rng(10)
    scene = random_scene(kind, rng)
    points = points_of(scene)
    assert np.abs(scene.target.distance(points)).max() < 1e-9

    target = TARGETS[kind]
    origin, axes, sizes = target.fit(points)
    fitted = target.at(origin, axes, sizes)
    assert np.abs(fitted.distance(points)).max() < 1e-4
    assert_allclose(sizes, target.usual_sizes, atol=1e-3)
    assert_allclose(np.linalg.det(axes), 1)

    noisy = points + 0.05 * rng.normal(size=points.shape)
    origin, axes, sizes = target.fit(noisy)
    distance = target.at(origin, axes, sizes).distance(noisy)
    assert np.sqrt(np.mean(distance**2)) < 0.05 * np.sqrt(3) * 1.1
    origins, _, _ = target.fit(np.stack([points, noisy]))
    assert_allclose(origins[1], origin)


NONE = {  # by what is said of them
    "axis of this plane has length 5; expected 1": lambda: pc.Plane(Z, 5 * Z),
    "radius of this ball is -1; expected mm above 0": lambda: pc.Ball(Z, -1),
    "a plane is met in a curve": lambda: pc.Plane(Z, Z).meet(Z, Z),
    "a point leaves no trace": lambda: pc.Point.find([]),
}


@pytest.mark.parametrize("sentence", NONE)
def test_there_is_no_such_target_and_none_is_met_or_found(sentence):
    with pytest.raises(ValueError, match=sentence):
        NONE[sentence]()


@pytest.mark.parametrize("kind", KINDS)
def test_its_lines_lie_on_it(kind):
    scene = random_scene(kind, default_rng(12))
    lines = scene.target.lines(points_of(scene))
    assert len(np.unique([line[0] for line in lines], axis=0)) == len(lines) > 0
    farthest = 10 if kind == "point" else 0  # mm: the ends of a cross
    for line in lines:
        assert line.shape[1] == 3
        assert np.abs(scene.target.distance(line)).max() < farthest + 1e-9


@pytest.mark.parametrize("kind", IN_PROFILES)
def test_what_is_found_in_raw_profiles_is_as_exact_as_its_finder_states(kind):
    """The residuals at the true poses, over what the finder states, are as large as
    chance makes them. An answer would not show it, which finds the size of the noise
    itself.
    """
    residuals = []
    for seed in range(4):
        scan, truth = pc.simulate(
            kind, seed, measured="profiles", groups=8, positions=3
        )
        seen = observe(scan)
        unit = seen.typical_mm
        (term,) = Problem([as_observations(scan, seen, unit)], Noise(unit)).terms
        state = state_of(truth)
        columns = term.over_noise(term.linearise(state, *state.placements))
        residuals.append(columns[0, -1].ravel())
    r = np.concatenate(residuals)
    count = np.count_nonzero(r)
    assert count > 100
    assert chi2.ppf(1e-4, count) < r @ r < chi2.isf(1e-4, count)
