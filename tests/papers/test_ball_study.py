"""The fast path of the ball's noise study equals the plain loop."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.closed_form.ball import solve_ball
from profilecal.geometry.fitting import fit_circle
from profilecal_papers.ball_study import ball_study, fig17_scans

TRIALS = 4


def noisy_centres(scans, sigma, m, rng):
    """The ball's centres (n, m, TRIALS, 3), sensor frame, that the engine's streams
    stand for, fitted arc by arc.
    """
    streams = rng.spawn(len(scans.R_tcp))
    centres = np.empty((len(streams), m, TRIALS, 3))
    for (i, j), side in np.ndenumerate(scans.sides(m)):
        cx, cz, r = scans.circles(m)[i, j]
        x = scans.x_seen((cx, cz, r))
        noise = sigma * streams[i].standard_normal((TRIALS, len(x)))
        z = cz + np.sqrt(r**2 - (x - cx) ** 2) + noise
        circle = fit_circle(np.stack(np.broadcast_arrays(x, z), axis=-1))
        centres[i, j] = scans.ball.centre_from_circle(circle, side)
    return centres


@pytest.mark.parametrize(("protocol", "first"), [("one arc", 1), ("m arcs", 3)])
def test_ball_study_equals_the_plain_loop(protocol, first):
    """`first`: arcs of the poses that fix the rotation."""
    scans, m = fig17_scans(), 3
    study = ball_study(scans, [0.1, 0.3], [1, m], TRIALS, default_rng(6))[protocol]
    counts = np.where(np.arange(len(scans.R_tcp)) < scans.translating, first, m)
    seen = zip(noisy_centres(scans, 0.3, m, default_rng(6)), counts, strict=True)
    q = np.stack([of[:k].mean(axis=0) for of, k in seen], axis=1)
    moved = zip(scans.positions(m), counts, strict=True)
    T = np.array([of[:k].mean(axis=0) for of, k in moved])
    expected = [solve_ball(scans.R_tcp, T, of).translation.q_b for of in q]
    found = study.centre_error[1, 1] + scans.ball.centre
    assert_allclose(found, expected, rtol=0, atol=1e-9)
