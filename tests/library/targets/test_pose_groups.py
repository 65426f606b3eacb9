"""Which profiles share an error of the flange."""

from dataclasses import replace

import numpy as np
from many_scenes import many

from profilecal.targets.observations import pose_groups


def observations(kind="edge", groups=3, positions=4):
    return many(kind, 1, 5, groups=groups, positions=positions).observations


def test_every_pose_of_a_plan_is_its_own_and_groups_share_an_orientation():
    found = pose_groups([observations()])
    assert found.pose.tolist() == list(range(12))
    assert found.orientation.tolist() == np.repeat([0, 1, 2], 4).tolist()
    assert found.distinguishable == [
        "position_mm",
        "orientation_deg",
        "group_position_mm",
        "group_orientation_deg",
    ]


def test_repeats_are_recognised_as_far_as_a_controller_comes_back():
    seen = observations()
    twice = seen.keep(np.repeat(np.arange(12), 2))
    moved = np.array(twice.T_flange)
    moved[:, 1::2] += 0.02
    found = pose_groups([replace(twice, T_flange=moved)])
    assert found.pose.tolist() == np.repeat(np.arange(12), 2).tolist()
    assert "repeatability_mm" in found.distinguishable
    moved[:, 1::2] += 0.1
    assert (
        "repeatability_mm"
        not in pose_groups([replace(twice, T_flange=moved)]).distinguishable
    )


def test_at_one_place_poses_that_point_elsewhere_are_others():
    seen = observations()
    found = pose_groups([replace(seen, T_flange=0 * seen.T_flange)])
    assert found.pose.tolist() == np.repeat([0, 1, 2], 4).tolist()


def test_profiles_share_errors_of_their_visit_pose_or_orientation():
    found = pose_groups([observations().keep(np.repeat(np.arange(12), 2))])
    assert found.sharing("repeatability_mm").tolist() == list(range(24))
    assert (
        found.sharing("orientation_deg").tolist()
        == np.repeat(np.arange(12), 2).tolist()
    )
    assert (
        found.sharing("group_position_mm").tolist() == np.repeat([0, 1, 2], 8).tolist()
    )
    single = pose_groups([replace(observations(), group=None)])
    assert single.distinguishable == ["position_mm", "orientation_deg"]


def test_targets_seen_from_the_same_poses_share_their_errors():
    first = observations("edge")
    second = replace(
        observations("ball"), R_flange=first.R_flange, T_flange=first.T_flange
    )
    found = pose_groups([first, second])
    assert found.pose.tolist() == [*range(12), *range(12)]
    assert len(found.orientation) == 12
