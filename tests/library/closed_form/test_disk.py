"""The disk method from chords: the paper's tables, and what is refused."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

import profilecal as pc
from profilecal.closed_form.disk import disk_equations, sensing_data
from profilecal.geometry.poses import (
    angle_between,
    nearest_rotation,
    rotation_from_xyz_angles,
)
from profilecal.simulation.scene import random_scene
from profilecal_papers import published
from profilecal_papers.batches import disk_method
from profilecal_papers.disk_study import fig15_scans


def test_table_I_gives_equations_49_to_51():
    table = {
        name: published.values("disk", "Table I", name)
        for name in ("R_tcp", "T_tcp", "q", "D_i", "D_b")
    }
    Lambda = published.values("disk", "Eq. 49", "Lambda")
    R_tcp = rotation_from_xyz_angles(table.pop("R_tcp"))
    solution = disk_equations(R_tcp, *table.values())
    turn = angle_between(solution.R_sensor, nearest_rotation(Lambda[:, :3]))
    assert np.degrees(turn) < 0.07
    assert np.linalg.norm(solution.T_sensor - Lambda[:, 3]) < 0.30
    q_b = published.values("disk", "Eq. 50", "q_b")
    assert np.linalg.norm(solution.translation.q_b - q_b) < 0.20
    assert 0.19 < solution.translation.accuracy < 0.21


def test_published_heights_are_where_the_first_and_last_chord_meet_the_middles():
    """They lean against the mean chord when there is noise."""
    scans = fig15_scans((-0.9, 0.7))
    tips = scans.tips(60)[0] + default_rng(3).normal(0, 0.1, (60, 2, 2))
    way = scans.T_start[0], scans.T_end[0], scans.s[0]
    found = sensing_data(tips, *way, scans.disk.radius, "published")
    x, z = found.direction
    # in the rotated frame, whose axes are in columns
    first, second = (tips[[0, -1]] @ [[x, -z], [z, x]]).swapaxes(0, 1)
    to_e, along = found.e[3:] - first, second - first
    assert_allclose(np.linalg.det(np.stack([to_e, along], axis=-1)), 0, atol=1e-9)
    assert np.abs(along[:, 1]).min() > 1e-3


OPEN = {
    "orientations: 2 given, at least 3 needed": {"groups": 2},
    "all 4 poses have one orientation": {"spread_deg": 0.1},
    r"all 4 poses turn about one axis, \[.*\] of the flange": {
        "axis": np.array([0.0, 0, 1])
    },
    "the 4 motions are parallel in the (sensor|flange) frame": {"one_way": True},
}


@pytest.mark.parametrize("sentence", OPEN)
@pytest.mark.parametrize("sigma", [0.0, 1e-3, 1.0])
def test_disks_that_leave_the_answer_open_are_refused_unless_asked_for(sentence, sigma):
    """By `solve_disk` alone."""
    rng = default_rng(4)
    scene = random_scene("disk", rng, **{"groups": 4, "positions": 20} | OPEN[sentence])
    seen, R = scene.noisy(sigma, rng, 3), scene.R_sensor
    for chords in seen.points:
        given = seen.R_flange[0], seen.T_flange[0], chords, 50, R
        with pytest.raises(pc.UnobservableError, match=sentence):
            pc.solve_disk(*given, group=seen.group)
    assert np.isfinite(disk_method(seen, R).T_sensor).all()
