"""A scan in memory: nothing wrong can be made, nor made of a good one."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import scan_of

import profilecal as pc

MIRROR = np.diag([1, 1, -1])
WRONG = {  # changes of a good scan of 12 poses, by what is said of them
    "mount is 'eye_to_hand'; expected": lambda scan: {"mount": "eye_to_hand"},
    "kind is 'edgy'; expected edge or": lambda scan: {"kind": "edgy"},
    "title is": lambda scan: {"title": 7},
    "sizes has 1 entries; a edge has 0": lambda scan: {"sizes": (50.0,)},
    "a target of kind 'edge' needs": lambda scan: {"measured": "arcs"},
    "points .* are they in mm": lambda scan: {
        "values": tuple(rows / 1000 for rows in scan.values)
    },
    "unknown entry 'profile_um'": lambda scan: {"noise": {"profile_um": 50}},
    "R_base_flange.* is a reflection": lambda scan: {
        "R_base_flange": scan.R_base_flange @ MIRROR
    },
    "p_base_flange .* are they in mm": lambda scan: {
        "p_base_flange": scan.p_base_flange / 1000
    },
    "R_base_flange has shape": lambda scan: {"values": scan.values[:5]},
    "labels has 1 entries for 12 poses": lambda scan: {"labels": ("p",)},
    "labels has 'p' 12 times": lambda scan: {"labels": ("p",) * 12},
    r"group has shape \(3,\)": lambda scan: {"group": np.zeros(3)},
    "side is 2; expected 1, -1 or 0": lambda scan: {"side": np.array(2)},
}


@pytest.mark.parametrize("sentence", WRONG)
def test_a_copy_with_something_wrong_is_refused(sentence):
    scan = scan_of("edge", groups=4, positions=3)
    with pytest.raises(pc.ScanError, match=sentence) as caught:
        replace(scan, **WRONG[sentence](scan))
    assert "\n" not in str(caught.value)


def of_arrays(scan, **entries):
    """A scan made of what another has in arrays."""
    points = np.concatenate(scan.values)
    return pc.Scan.of(scan.kind, scan.T_base_flange, points=points, **entries)


@pytest.mark.parametrize("side", [1, -1, 0, [1, -1, 0] * 4])
def test_a_side_is_that_of_each_pose(side):
    recorded = scan_of("edge", groups=4, positions=3)
    expected = np.resize(side, 12).tolist()
    assert of_arrays(recorded, side=side).side.tolist() == expected
    assert replace(recorded, side=np.array(side)).side.tolist() == expected


@pytest.mark.parametrize("side", [[1, -1, 0], [1] * 11 + [2]])
def test_a_side_for_some_poses_or_of_no_sign_is_refused(side):
    with pytest.raises(pc.ScanError, match="expected 1, -1 or 0, for each pose"):
        of_arrays(scan_of("edge", groups=4, positions=3), side=side)


def test_groups_found_in_memory_are_those_found_from_a_folder(tmp_path):
    recorded = scan_of("edge", groups=12, positions=5)
    pc.write_scan(recorded, tmp_path / "scan")
    from_folder = pc.read_scan(tmp_path / "scan")
    from_arrays = of_arrays(from_folder, noise=from_folder.noise)
    np.testing.assert_array_equal(from_arrays.group, from_folder.group)
    np.testing.assert_array_equal(from_arrays.group, recorded.group)
    assert not from_arrays.group_given
    of_folder = pc.calibrate(from_folder).covariance_mm_deg
    of_memory = pc.calibrate(from_arrays).covariance_mm_deg
    np.testing.assert_array_equal(of_memory, of_folder)
