"""What the noise studies share: neither workers nor blocks change a number, and the
quick rotation is the right one.
"""

import numpy as np
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal

from profilecal.geometry.poses import directions, nearest_rotation, rotations
from profilecal_papers import monte_carlo
from profilecal_papers.ball_study import ball_study, fig17_scans
from profilecal_papers.disk_study import disk_study, fig15_scans
from profilecal_papers.monte_carlo import noisy_blocks, rotations_near


def test_the_number_of_workers_changes_nothing():
    def run(workers):
        rng = default_rng(7)
        scans = fig15_scans((-0.9, 0.3))
        disk = disk_study(scans, [0.1, 0.9], [10, 30], 1200, rng, workers=workers)
        rng = default_rng(8)
        ball = ball_study(fig17_scans(), 0.2, [1, 2], 600, rng, workers=workers)
        return [disk.errors, *(study.errors for study in ball.values())]

    alone = run(1)
    for workers in (2, 5):
        for found, expected in zip(run(workers), alone, strict=True):
            assert_array_equal(found, expected)


def test_the_size_of_a_block_changes_nothing(monkeypatch):
    def drawn(block):
        monkeypatch.setattr(monte_carlo, "BLOCK", block)
        rng = default_rng(11)
        blocks = noisy_blocks(np.ones((2, 3)), [[0.1], [2.0]], 50, rng)
        return np.concatenate([values.copy() for _, values, *_ in blocks])

    whole = drawn(10**6)
    assert whole.shape == (50, 2, 3)
    assert_array_equal(drawn(70), whole)
    assert_array_equal(drawn(1), whole)


def test_the_quick_rotation_is_that_of_the_svd_for_small_turns_and_large_ones():
    rng = default_rng(12)
    X = directions(rng, (500, 4))
    angle = np.append(rng.uniform(0, 1.5, 250), rng.uniform(1.6, np.pi, 250))
    turn = rotations(angle[:, None] * directions(rng, (500,)))
    Y = X @ turn.mT + 0.01 * rng.normal(size=X.shape)
    Y /= np.linalg.norm(Y, axis=-1, keepdims=True)
    B = Y.mT @ X
    B[7, 0, 0] = np.nan
    found = np.moveaxis(rotations_near(np.moveaxis(B, 0, -1)), -1, 0)
    assert np.isnan(found[7]).all()
    good = np.arange(500) != 7
    assert_allclose(found[good], nearest_rotation(B[good]), atol=1e-11)
