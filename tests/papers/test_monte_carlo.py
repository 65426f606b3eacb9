"""What the noise studies share: neither workers nor blocks change a number."""

import numpy as np

from profilecal.papers import monte_carlo
from profilecal.papers.ball_study import ball_study
from profilecal.papers.disk_study import disk_study
from profilecal.papers.monte_carlo import noisy_blocks
from profilecal.papers.settings import fig15_scans, fig17_scans


def test_the_number_of_workers_changes_nothing():
    def run(workers):
        scans = fig15_scans((-0.9, 0.3))
        disk = disk_study(scans, [0.1, 0.9], [10, 30], 1200, np.random.default_rng(7), workers=workers)
        ball = ball_study(fig17_scans(), 0.2, [1, 2], 600, np.random.default_rng(8), workers=workers)
        return [disk.errors, disk.clipped, *(study.errors for study in ball.values())]

    alone, two, five = run(1), run(2), run(5)
    assert all(np.array_equal(a, b) and np.array_equal(a, c) for a, b, c in zip(alone, two, five, strict=True))


def test_the_size_of_a_block_changes_nothing(monkeypatch):
    def drawn(block):
        monkeypatch.setattr(monte_carlo, "BLOCK", block)
        blocks = noisy_blocks(np.ones((2, 3)), [[0.1], [2.0]], 50, np.random.default_rng(11), spare=0)
        return np.concatenate([values.copy() for _, values in blocks])

    whole = drawn(10**6)
    assert whole.shape == (50, 2, 3)
    np.testing.assert_array_equal(drawn(70), whole)
    np.testing.assert_array_equal(drawn(1), whole)
