"""A scan in memory: nothing wrong can be made, nor made of a good one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from simulated import scan_of

import profilecal as pc


def test_a_copy_with_something_wrong_is_refused():
    scan = scan_of("edge", groups=4, positions=3)  # of 12 poses
    wrong_entries = {
        "sizes of Scan: unknown entry 'radius'": {"sizes": {"radius": 50.0}},
        "the array at index 3 has size 3": {
            "values": (*scan.values[:3], np.ones((1, 3)), *scan.values[4:])
        },
        "same label in group, by .*; expected one": {
            "group": np.zeros(12),
            "group_given": True,
        },
        "labels has ' ' 1 times; expected names, each once": {
            "labels": (" ", *scan.labels[1:])
        },
        "guess_sd is .*; expected mm and degrees above 0": {"guess_sd": (-5, 8)},
        "truth is 5; expected a table": {"truth": 5},
        "no rows of points; expected what was seen": {
            "values": (np.ones((0, 2)),) * 12
        },
        "side is 2; expected 1, -1 or 0, for each pose": {"side": 2},
        r"side is \[1, -1, 0\]; expected": {"side": [1, -1, 0]},
    }
    for sentence, entries in wrong_entries.items():
        with pytest.raises(pc.ScanError, match=sentence):
            replace(scan, **entries)


def test_matrices_become_rotations_and_what_is_masked_is_missing():
    scan = scan_of("edge", groups=4, positions=3)
    T = scan.T_base_flange
    T[:, :3, :3] *= 1.0004
    T.setflags(write=False)
    points = np.ma.concatenate(scan.values)
    points[3] = np.ma.masked
    made = pc.Scan.of("edge", T, points=points)
    assert_allclose(made.R_base_flange, scan.R_base_flange, atol=1e-12)
    assert np.isnan(made.values[3]).all()


def test_nothing_of_a_scan_is_written_to():
    scan = scan_of("edge", groups=4, positions=3)
    for array in (scan.p_base_flange, scan.values[0], scan.group, scan.side):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
