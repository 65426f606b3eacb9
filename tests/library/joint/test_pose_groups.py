"""Which profiles share an error of the flange."""

from dataclasses import replace

import numpy as np
from many_scenes import many
from numpy.random import default_rng
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import (
    SAME_ORIENTATION_DEG,
    angle_between,
    rotation_groups,
    rotations,
)
from profilecal.joint.pose_groups import pose_groups

POSES = np.arange(12)  # of a plan of three orientations
TWICE = np.repeat(POSES, 2)


def observations(kind="edge"):
    return many(kind, 1, 5, groups=3, positions=4).observations


def test_repeats_are_recognised_as_far_as_a_controller_comes_back():
    repeated = observations().keep(TWICE)
    for by_mm, are_one in ((0.02, True), (0.12, False)):
        T_flange = repeated.T_flange.copy()
        T_flange[:, 1::2] += by_mm
        groups = pose_groups([replace(repeated, T_flange=T_flange)])
        assert ("repeatability_mm" in groups.distinguishable) == are_one


def test_profiles_share_errors_of_their_visit_pose_or_orientation():
    groups = pose_groups([observations().keep(TWICE)])
    visits, orientations = np.arange(24), np.repeat([0, 1, 2], 8)
    assert groups.sharing("repeatability_mm").tolist() == visits.tolist()
    assert groups.sharing("orientation_deg").tolist() == TWICE.tolist()
    assert groups.sharing("group_position_mm").tolist() == orientations.tolist()


def test_without_groups_errors_of_a_group_are_not_told_apart():
    groups = pose_groups([replace(observations(), group=None)])
    assert groups.distinguishable == ["position_mm", "orientation_deg"]


def test_targets_seen_from_the_same_poses_share_their_errors():
    first, second = observations("edge"), observations("ball")
    same = {"R_flange": first.R_flange, "T_flange": first.T_flange}
    groups = pose_groups([first, replace(second, **same)])
    assert groups.pose.tolist() == [*POSES, *POSES]
    assert len(groups.orientation) == 12


def by_all_distances(observed):
    """The first pose that each is at, by comparing each with every other."""
    T, R = observed.T_flange[0], observed.R_flange[0]
    near = np.abs(T[:, None] - T).max(axis=-1) < 0.05
    turned = np.degrees(angle_between(R[:, None], R)) < 0.01
    alike = observed.labels[:, None] == observed.labels
    return np.unique((near & turned & alike).argmax(axis=1), return_inverse=True)[1]


def test_poses_that_a_tree_finds_are_those_that_all_distances_show():
    """At one place, those that point elsewhere are others."""
    rng = default_rng(3)
    repeated = observations().keep(rng.permutation(TWICE))
    for share, size in ((1, 0.01), (1, 0.06), (0, 0)):
        error = size * rng.normal(size=repeated.T_flange.shape)
        moved = replace(repeated, T_flange=share * repeated.T_flange + error)
        assert pose_groups([moved]).pose.tolist() == by_all_distances(moved).tolist()


def test_orientations_join_the_first_that_they_are_parallel_to():
    rng = default_rng(4)
    few = Rotation.random(5, rng=rng).as_matrix()[rng.integers(0, 5, 60)]
    R = few @ rotations(np.radians(0.03) * rng.normal(size=(60, 3)))
    expected, firsts = [], R[:1]
    for one in R:
        near = np.degrees(angle_between(one, firsts)) < SAME_ORIENTATION_DEG
        if not near.any():
            firsts, near = np.append(firsts, [one], axis=0), np.append(near, True)
        expected.append(near.argmax())
    assert rotation_groups(R).tolist() == expected
