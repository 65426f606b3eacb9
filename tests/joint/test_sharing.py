"""Which profiles share an error of the flange."""

from dataclasses import replace

import numpy as np
from many_scenes import many

from profilecal.geometry.noise import Noise
from profilecal.joint.sharing import sharing


def observations(kind="edge", groups=3, positions=4):
    return many(kind, 1, 5, groups=groups, positions=positions).observations


def test_every_pose_of_a_plan_is_its_own_and_groups_share_an_orientation():
    found = sharing([observations()])
    assert found.pose.tolist() == list(range(12))
    assert found.orientation.tolist() == np.repeat([0, 1, 2], 4).tolist()
    assert not found.repeated
    assert found.grouped
    assert found.told_apart == ["position_mm", "orientation_deg", "group_position_mm", "group_orientation_deg"]


def test_repeats_are_recognised_as_far_as_a_controller_comes_back():
    seen = observations()
    twice = seen.keep(np.repeat(np.arange(12), 2))
    moved = np.array(twice.T_flange)
    moved[:, 1::2] += 0.02
    found = sharing([replace(twice, T_flange=moved)])
    assert found.pose.tolist() == np.repeat(np.arange(12), 2).tolist()
    assert found.repeated
    moved[:, 1::2] += 0.1
    assert not sharing([replace(twice, T_flange=moved)]).repeated


def test_targets_seen_from_the_same_poses_share_their_errors():
    first = observations("edge")
    second = replace(observations("ball"), R_flange=first.R_flange, T_flange=first.T_flange)
    found = sharing([first, second])
    assert found.pose.tolist() == [*range(12), *range(12)]
    assert len(found.orientation) == 12


def test_levels_that_cannot_be_told_apart_are_one():
    """Their variances add up."""
    seen = replace(observations(), group=None)
    noise = Noise(position_mm=0.3, group_position_mm=0.4, repeatability_mm=1.2)
    ((visit, _),) = sharing([seen]).levels(noise)
    assert np.allclose(visit[:3], 1.3**2)


def test_an_error_that_is_not_there_has_no_level():
    """What belonged to it belongs to the next one."""
    found = sharing([observations().keep(np.repeat(np.arange(12), 2))])
    by_orientation = np.repeat([0, 1, 2], 8).tolist()
    noise = Noise(position_mm=0.3, group_position_mm=0.4, repeatability_mm=1.2)
    assert len(found.levels(noise)) == 3
    (visit, member), (shared, _) = found.levels(replace(noise, position_mm=0.0))
    assert member.tolist() == by_orientation
    assert np.allclose([visit[:3], shared[:3]], [[1.2**2], [0.4**2]])
    (visit, member), (pose, last) = found.levels(replace(noise, group_position_mm=0.0))
    assert member.tolist() == np.repeat(np.arange(12), 2).tolist()
    assert last.tolist() == np.repeat([0, 1, 2], 4).tolist()
    assert np.allclose([visit[:3], pose[:3]], [[1.2**2], [0.3**2]])
    ((visit, member),) = found.levels(Noise(repeatability_mm=1.2))
    assert member.tolist() == by_orientation
    assert np.allclose(visit[:3], 1.2**2)
