"""A robot's accuracy over its workspace."""

import numpy as np
from many_scenes import many
from scipy.linalg import block_diag

from profilecal.geometry.noise import variances
from profilecal.geometry.poses import rotations
from profilecal.joint.effects import Information
from profilecal.joint.field import FIELD_SHARE, field_over
from profilecal.joint.sharing import sharing
from profilecal.joint.state import pose_error


def some_field():
    scene = many("edge", 1, 7, groups=5, positions=2)
    R, T = scene.truth.rotation[0], scene.truth.translation[0]
    return field_over(sharing([scene.observations]), R, T, eye_to_hand=False), R, T


def test_the_common_error_moves_the_sensor_as_an_error_of_the_flange_does():
    """By differences: the flange is off by ε in its own frame, and the answer takes it in."""
    field, R, T = some_field()
    h, columns = 1e-6, []
    for error in np.eye(6):
        turn = rotations(h * error[3:])
        columns.append(pose_error(R, T, turn @ R, turn @ T + h * error[:3]) / h)
    J = np.array(columns).T
    expected = (J * variances(0.3, 0.05)) @ J.T
    np.testing.assert_allclose(field.common([0.3], [0.05])[0], expected, atol=1e-6)


def test_removing_the_field_agrees_with_the_dense_covariance():
    rng, (field, _, _) = np.random.default_rng(3), some_field()
    G, K, n = 5, 4, 3
    E, z = rng.normal(size=(G, K, 6)), rng.normal(size=(G, K, n))
    size = np.sqrt(variances(FIELD_SHARE[0] * 0.7, FIELD_SHARE[1] * 40.0))
    in_base = block_diag(*(E[g] @ field.to_base[g].T * size for g in range(G)))
    kernel = field.patterns @ field.patterns.T
    V = np.eye(G * K) + in_base @ np.kron(kernel, np.eye(6)) @ in_base.T
    flat = z.reshape(G * K, n)
    A, B = np.swapaxes(E, 1, 2) @ E, np.swapaxes(E, 1, 2) @ z
    left = field.remove(Information(A[None], B[None], (flat.T @ flat)[None], np.zeros(1)), [0.7], [40.0])
    np.testing.assert_allclose(left.normal[0], flat.T @ np.linalg.solve(V, flat), rtol=1e-8)
    np.testing.assert_allclose(left.log_determinant[0], np.linalg.slogdet(V)[1], rtol=1e-8)
