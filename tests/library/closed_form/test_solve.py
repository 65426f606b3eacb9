"""Poses that leave the disk method's answer open are refused by `solve_disk` alone."""

import numpy as np
import pytest
from numpy.random import default_rng

import profilecal as pc
from profilecal.simulation.scene import random_scene
from profilecal_papers.batches import disk_method

OPEN = {
    "orientations: 2 given, at least 3 needed": {"groups": 2},
    "all 4 poses have one orientation": {"spread_deg": 0.1},
    r"all 4 poses turn about one axis, \[.*\] of the flange": {
        "axis": np.array([0.0, 0, 1])
    },
    "the 4 motions are parallel in the sensor frame": {"one_way": True},
}


@pytest.mark.parametrize("sentence", OPEN)
@pytest.mark.parametrize("sigma", [0.0, 1e-3])
def test_disks_that_leave_the_answer_open_are_refused_unless_asked_for(sentence, sigma):
    rng = default_rng(4)
    scene = random_scene("disk", rng, **{"groups": 4, "positions": 20} | OPEN[sentence])
    seen, R = scene.noisy(sigma, rng, 3), scene.R_sensor
    for chords in seen.points:
        given = seen.R_flange[0], seen.T_flange[0], chords, 50, R
        with pytest.raises(pc.UnobservableError, match=sentence):
            pc.solve_disk(*given, group=seen.group)
    assert np.isfinite(disk_method(seen, R).T_sensor).all()
