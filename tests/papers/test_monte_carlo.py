"""What the noise studies share: neither workers nor blocks change a number, and the
quick rotation is the right one.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import nearest_rotation
from profilecal_papers import monte_carlo
from profilecal_papers.ball_study import ball_study, fig17_scans
from profilecal_papers.disk_study import disk_study, fig15_scans
from profilecal_papers.monte_carlo import noisy_blocks, rotations_near


def test_the_number_of_workers_changes_nothing():
    def run(workers):
        scans = fig15_scans((-0.9, 0.3))
        disk = disk_study(
            scans, [0.1, 0.9], [10, 30], 1200, np.random.default_rng(7), workers=workers
        )
        ball = ball_study(
            fig17_scans(), 0.2, [1, 2], 600, np.random.default_rng(8), workers=workers
        )
        return [disk.errors, disk.clipped, *(study.errors for study in ball.values())]

    alone, two, five = run(1), run(2), run(5)
    assert all(
        np.array_equal(a, b) and np.array_equal(a, c)
        for a, b, c in zip(alone, two, five, strict=True)
    )


def test_the_size_of_a_block_changes_nothing(monkeypatch):
    def drawn(block):
        monkeypatch.setattr(monte_carlo, "BLOCK", block)
        blocks = noisy_blocks(
            np.ones((2, 3)), [[0.1], [2.0]], 50, np.random.default_rng(11)
        )
        return np.concatenate([values.copy() for _, values, *_ in blocks])

    whole = drawn(10**6)
    assert whole.shape == (50, 2, 3)
    np.testing.assert_array_equal(drawn(70), whole)
    np.testing.assert_array_equal(drawn(1), whole)


def test_the_quick_rotation_is_that_of_the_svd_for_small_turns_and_large_ones():
    rng = np.random.default_rng(12)
    X = rng.normal(size=(500, 4, 3))
    X /= np.linalg.norm(X, axis=-1, keepdims=True)
    angle = np.where(
        np.arange(500) < 250, rng.uniform(0, 1.5, 500), rng.uniform(1.6, np.pi, 500)
    )
    axis = rng.normal(size=(500, 3))
    turn = Rotation.from_rotvec(
        angle[:, None] * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    ).as_matrix()
    Y = X @ turn.transpose(0, 2, 1) + 0.01 * rng.normal(size=X.shape)
    Y /= np.linalg.norm(Y, axis=-1, keepdims=True)
    B = np.einsum("kna,knb->abk", Y, X)
    B[0, 0, 7] = np.nan
    found = np.moveaxis(rotations_near(B), -1, 0)
    good = np.arange(500) != 7
    np.testing.assert_allclose(
        found[good], nearest_rotation(np.moveaxis(B, -1, 0)[good]), atol=1e-11
    )
    assert np.isnan(found[7]).all()
