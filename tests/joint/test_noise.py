"""The noise that a solution rests on."""

import numpy as np
import pytest
from many_scenes import SIGMA

from profilecal.calibrate.check import affine_noise
from profilecal.joint.solve import solve
from profilecal.simulate.scene import random_scene


def test_noise_is_estimated_and_said_how():
    rng = np.random.default_rng(18)
    edge = random_scene("edge", rng).noisy(SIGMA, rng)
    level, freedom = affine_noise(edge)
    assert freedom == 25 * (10 - 4) * 2
    assert abs(level / SIGMA - 1) < 4 * np.sqrt(0.5 / freedom) * np.sqrt(np.pi / 2)  # of a median over the groups
    found = solve([edge])
    assert found.noise_source == "estimated"
    assert found.noise_mm == pytest.approx(SIGMA, rel=4 * np.sqrt(0.5 / found.dof))
    ball = solve([random_scene("ball", rng, count=20).noisy(SIGMA, rng)])
    assert ball.prior.how == "from the residuals"
    assert abs(ball.noise_mm / SIGMA - 1) < 4 * np.sqrt(0.5 / ball.dof)
    assert abs(ball.chi2_per_dof - 1) < np.sqrt(2 / ball.dof)
