"""The arm's two directions agree, and its errors are what the geometry says."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.geometry.poses import rotations
from profilecal.simulation.robot import LINKS, MIDDLE, Arm, joints_at, where_it_is
from profilecal.simulation.scene import in_unit_ball

POSES = 200
AWAY = np.array([3000.0, -2000.0, 500.0])
TURN = 1e-3  # rad
ABOUT_Z = rotations([0, 0, TURN])


RNG = default_rng(1)
R = rotations(RNG.uniform(-3, 3, (POSES, 3)))
T = MIDDLE + 400 * in_unit_ball(RNG, POSES)
SHIFT = np.array([0.1, -0.2, 0.3])
FIRST, *_, LAST = np.eye(6)
BUILT = {
    "its first joint turns the base": (
        Arm(zeros=TURN * FIRST),
        ABOUT_Z @ R,
        T @ ABOUT_Z.T,
    ),
    "its last joint turns the flange": (Arm(zeros=TURN * LAST), R @ ABOUT_Z, T),
    "its last link shifts it": (
        Arm(links=LINKS + np.outer(LAST, SHIFT)),
        R,
        T + R @ SHIFT,
    ),
}


def test_an_arm_without_errors_is_where_it_says_with_its_fifth_joint_bent_forwards():
    R_found, T_found = where_it_is(Arm(), R, T + AWAY)
    assert_allclose(R_found, R, atol=1e-12)
    assert_allclose(T_found, T + AWAY, atol=1e-9)
    assert (joints_at(R, T)[:, [2, 4]] >= 0).all()


def test_a_place_out_of_reach_is_refused():
    sentence = "mm from its shoulder; expected 100 to 1300 mm"
    with pytest.raises(ValueError, match=sentence):
        joints_at(R, T + AWAY)


@pytest.mark.parametrize("what", BUILT)
def test_an_arm_that_is_built_otherwise_is_elsewhere(what):
    arm, R_expected, T_expected = BUILT[what]
    R_found, T_found = arm.flange(joints_at(R, T))
    assert_allclose(R_found, R_expected, atol=1e-12)
    assert_allclose(T_found, T_expected, atol=1e-9)


def test_errors_have_their_size():
    rng = default_rng(3)
    arms = [Arm.erring(0.02, 0.2, rng) for _ in range(300)]
    zeros = np.std([arm.zeros for arm in arms])
    links = np.std([arm.links - LINKS for arm in arms])
    assert zeros == pytest.approx(np.radians(0.02), rel=0.08)
    assert links == pytest.approx(0.2, rel=0.08)
