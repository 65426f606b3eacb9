import numpy as np
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import angle_between, directions


def test_angle_between_is_exact_from_tiny_to_half_a_turn():
    rng = default_rng(4)
    angles = np.array([0, 1e-12, 1e-6, 0.1, 3, np.pi])
    turns = Rotation.from_rotvec(angles[:, None] * directions(rng, (6,)))
    first = Rotation.random(6, rng=rng)
    found = angle_between(first.as_matrix(), (first * turns).as_matrix())
    assert_allclose(found, angles, rtol=1e-7, atol=1e-15)
