"""The arm's two directions agree, and its errors are what the geometry says."""

import numpy as np
import pytest

from profilecal.geometry.poses import angle_between, rotations
from profilecal.simulation.robot import LINKS, MIDDLE, Arm, joints_at, where_it_is
from profilecal.simulation.scene import in_unit_ball

POSES = 200
AWAY = np.array([3000.0, -2000.0, 500.0])


def poses(seed=1, reach=400.0):
    rng = np.random.default_rng(seed)
    return rotations(rng.uniform(-3, 3, (POSES, 3))), MIDDLE + reach * in_unit_ball(
        rng, POSES
    )


def test_an_arm_without_errors_is_where_it_says_with_its_fifth_joint_bent_forwards():
    R, T = poses()
    found = where_it_is(Arm(), R, T + AWAY)
    np.testing.assert_allclose(found[0], R, atol=1e-12)
    np.testing.assert_allclose(found[1], T + AWAY, atol=1e-9)
    assert (joints_at(R, T)[:, [2, 4]] >= 0).all()


def test_a_place_out_of_reach_is_refused():
    R, T = poses()
    with pytest.raises(
        ValueError, match="mm from its shoulder; expected 100 to 1300 mm"
    ):
        joints_at(R, T + AWAY)


def test_zeros_of_the_first_and_the_last_joint_turn_the_base_and_the_flange_and_the_last_link_shifts_it():
    R, T = poses()
    joints, about_z, shift = (
        joints_at(R, T),
        rotations([0, 0, 1e-3]),
        np.array([0.1, -0.2, 0.3]),
    )
    first, last = (Arm(zeros=1e-3 * np.eye(6)[k]).flange(joints) for k in (0, 5))
    np.testing.assert_allclose(first[0], about_z @ R, atol=1e-12)
    np.testing.assert_allclose(first[1], T @ about_z.T, atol=1e-9)
    np.testing.assert_allclose(last[0], R @ about_z, atol=1e-12)
    np.testing.assert_allclose(last[1], T, atol=1e-9)
    moved = Arm(links=LINKS + np.eye(6)[:, 5:] * shift).flange(joints)
    np.testing.assert_allclose(moved[1] - T, R @ shift, atol=1e-9)


def test_errors_have_their_size():
    rng = np.random.default_rng(3)
    arms = [Arm.erring(0.02, 0.2, rng) for _ in range(300)]
    assert np.std([arm.zeros for arm in arms]) == pytest.approx(
        np.radians(0.02), rel=0.08
    )
    assert np.std([arm.links - LINKS for arm in arms]) == pytest.approx(0.2, rel=0.08)
    R, T = poses()
    turns = [angle_between(where_it_is(arm, R, T)[0], R) for arm in arms]
    # six turns, each about an axis of its own
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(
        np.radians(0.02) * np.sqrt(6), rel=0.08
    )
