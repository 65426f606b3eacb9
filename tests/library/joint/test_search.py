"""The search and descent from no guess, or a poor one: exact without noise."""

import numpy as np
import pytest
from many_scenes import KINDS, SIGMA, assert_exact, errors, many
from numpy.random import default_rng

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import directions, rotations
from profilecal.joint.descent import refine, search
from profilecal.joint.problem import Problem
from profilecal.joint.solve import solve

SCENES = 30
NOISE = Noise(SIGMA)


@pytest.mark.parametrize("kind", KINDS)
def test_noise_free_from_no_guess_at_all(kind):
    scene = many(kind, SCENES, 7)
    best = []
    for i in range(SCENES):
        one = scene.observations.take([i])
        problem = Problem([one], NOISE)
        fits = refine(problem, search(problem))
        best.append(fits.state[[np.argmin(fits.loss)]])
    assert_exact(errors(best[0].join(*best[1:]), scene.truth))


@pytest.mark.parametrize("kind", KINDS)
def test_noise_free_from_a_mount_guess(kind):
    """20° and 30 mm wrong. Descent alone does it nearly always, for a rod mostly; the
    others need `solve`'s grid.
    """
    scene = many(kind, SCENES, 7, spread_deg=20.0)
    rng = default_rng(8)
    turn = rotations(np.radians(20) * directions(rng, (SCENES,)))
    R = scene.truth.rotation @ turn
    T = scene.truth.translation + 30 * directions(rng, (SCENES,))
    in_space = Problem([scene.observations], NOISE, in_space=True)
    problem = Problem([scene.observations], NOISE)
    near = refine(in_space, problem.place(R, T)).state
    fit = refine(problem, near)
    lost = np.flatnonzero(fit.loss > 1e-9)
    assert len(lost) <= (0.3 if kind == "rod" else 0.1) * SCENES
    for i in lost:
        one = scene.observations.take([i])
        solution = solve([one], NOISE, starts=[(R[i], T[i])], robust=False)
        fit.state.rotation[i] = solution.rotation
        fit.state.translation[i] = solution.translation
    assert_exact(errors(fit.state, scene.truth))
