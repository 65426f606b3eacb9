"""The fast path of the ball's noise study equals the plain loop."""

import numpy as np

from profilecal.closed_form.ball import solve_ball
from profilecal.geometry.fitting import fit_circle
from profilecal_papers.ball_study import PROTOCOLS, ball_study, fig17_scans


def test_ball_study_equals_the_plain_loop():
    scene, sigma, m = fig17_scans(), 0.3, 3
    study = ball_study(
        scene, [0.1, sigma], [1, m], 4, np.random.default_rng(6), workers=1
    )
    streams = np.random.default_rng(6).spawn(len(scene.R_tcp))
    q = np.empty((4, len(scene.R_tcp), m, 3))
    for (i, j), side in np.ndenumerate(scene.sides(m)):
        cx, cz, r = scene.circles(m)[i, j]
        x = scene.x_seen((cx, cz, r))
        z = (
            cz
            + np.sqrt(r**2 - (x - cx) ** 2)
            + sigma * streams[i].standard_normal((4, len(x)))
        )
        circle = fit_circle(np.stack(np.broadcast_arrays(x, z), axis=-1))
        q[:, i, j] = scene.ball.centre_from_circle(circle, side)
    T = scene.positions(m)
    for protocol, of_rotation in zip(PROTOCOLS, (1, m), strict=True):
        arcs = np.where(np.arange(len(T)) < scene.translating, of_rotation, m)
        T_mean = np.array([T[i, :k].mean(axis=0) for i, k in enumerate(arcs)])
        for trial in range(4):
            q_mean = np.array(
                [q[trial, i, :k].mean(axis=0) for i, k in enumerate(arcs)]
            )
            found = solve_ball(scene.R_tcp, T_mean, q_mean, scene.translating)
            expected = found.translation.q_b - scene.ball.centre
            np.testing.assert_allclose(
                study[protocol].centre_error[1, 1, trial], expected, rtol=0, atol=1e-9
            )
