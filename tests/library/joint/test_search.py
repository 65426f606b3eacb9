"""The search and descent from no guess, or a poor one: exact without noise."""

import numpy as np
import pytest
from many_scenes import KINDS, SIGMA, errors, many

from profilecal.geometry.noise import Noise
from profilecal.joint.descent import refine, search
from profilecal.joint.problem import Problem

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
    off = errors(best[0].join(*best[1:]), scene.truth).reshape(-1, 2, 3)
    shift, turn = np.linalg.norm(off, axis=2).T
    assert shift.max() < 1e-9
    assert np.degrees(turn).max() < 1e-9
