import numpy as np
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.geometry import poses


def test_nearest_rotation_is_proper_and_nearer_than_any_other():
    rng = default_rng(3)
    matrices = rng.normal(size=(40, 3, 3))
    nearest = poses.nearest_rotation(matrices)
    assert_allclose(np.linalg.det(nearest), 1, atol=1e-13)
    others = Rotation.random(500, rng=rng).as_matrix()
    distance = np.linalg.norm(matrices - nearest, axis=(1, 2))
    of_others = np.linalg.norm(matrices[:, None] - others, axis=(2, 3))
    assert (distance <= of_others.min(axis=1)).all()


def test_angle_between_is_exact_from_tiny_to_half_a_turn():
    rng = default_rng(4)
    for angle in (0, 1e-12, 1e-6, 0.1, 3, np.pi):
        axis = rng.normal(size=3)
        first = Rotation.random(rng=rng)
        second = first * Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        measured = poses.angle_between(first.as_matrix(), second.as_matrix())
        assert_allclose(measured, angle, rtol=1e-7, atol=1e-15)
