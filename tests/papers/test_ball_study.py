"""The fast path of the ball's noise study equals the plain loop."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.closed_form.ball import solve_ball
from profilecal.geometry.fitting import fit_circle
from profilecal_papers.ball_study import PROTOCOLS, ball_study, fig17_scans

TRIALS = 4


def noisy_centres(scans, sigma, m, rng):
    """The ball's centres (TRIALS, n, m, 3), sensor frame, that the engine's streams
    stand for, fitted arc by arc.
    """
    n = len(scans.R_tcp)
    streams = rng.spawn(n)
    centres = np.empty((TRIALS, n, m, 3))
    for (i, j), side in np.ndenumerate(scans.sides(m)):
        cx, cz, r = scans.circles(m)[i, j]
        x = scans.x_seen((cx, cz, r))
        noise = sigma * streams[i].standard_normal((TRIALS, len(x)))
        z = cz + np.sqrt(r**2 - (x - cx) ** 2) + noise
        circle = fit_circle(np.stack(np.broadcast_arrays(x, z), axis=-1))
        centres[:, i, j] = scans.ball.centre_from_circle(circle, side)
    return centres


def means_of_first(values, counts):
    """Of each pose, the mean of its first so many values (n, m, 3)."""
    return np.array([of[:k].mean(axis=0) for of, k in zip(values, counts, strict=True)])


@pytest.mark.parametrize(
    ("protocol", "turning"), [(PROTOCOLS[0], 1), (PROTOCOLS[1], 3)]
)
def test_ball_study_equals_the_plain_loop(protocol, turning):
    scans, sigma, m = fig17_scans(), 0.3, 3
    rng = default_rng(6)
    study = ball_study(scans, [0.1, sigma], [1, m], TRIALS, rng, workers=1)[protocol]
    centres = noisy_centres(scans, sigma, m, default_rng(6))
    poses = np.arange(len(scans.R_tcp))
    counts = np.where(poses < scans.translating, turning, m)
    T = means_of_first(scans.positions(m), counts)
    for trial in range(TRIALS):
        q = means_of_first(centres[trial], counts)
        solution = solve_ball(scans.R_tcp, T, q)
        expected = solution.translation.q_b - scans.ball.centre
        found = study.centre_error[1, 1, trial]
        assert_allclose(found, expected, rtol=0, atol=1e-9)
