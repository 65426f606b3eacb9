"""What the noise studies share: workers do not change a number, and the
quick rotation is the right one.
"""

import numpy as np
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal

from profilecal.geometry.poses import directions, nearest_rotation, rotations
from profilecal_papers import monte_carlo
from profilecal_papers.disk_study import disk_study, fig15_scans


def test_the_number_of_workers_changes_nothing():
    setting = fig15_scans((-0.9, 0.3)), [0.1, 0.9], [10, 30], 1200
    alone, *others = (
        disk_study(*setting, default_rng(7), workers=workers).errors
        for workers in (1, 2, 5)
    )
    for found in others:
        assert_array_equal(found, alone)


def test_the_quick_rotation_is_that_of_the_svd_for_small_turns_and_large_ones():
    rng = default_rng(12)
    X = directions(rng, (500, 4))
    angle = np.append(rng.uniform(0, 1.5, 250), rng.uniform(1.6, np.pi, 250))
    turn = rotations(angle[:, None] * directions(rng, (500,)))
    B = (X @ turn.mT + 0.01 * rng.normal(size=X.shape)).mT @ X
    right = nearest_rotation(B)
    B[7, 0, 0] = right[7] = np.nan
    found = np.moveaxis(monte_carlo.rotations_near(np.moveaxis(B, 0, -1)), -1, 0)
    assert_allclose(found, right, atol=1e-11)
