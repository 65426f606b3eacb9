"""The disk method from chords: exact without noise."""

from functools import cache

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from profilecal.closed_form.disk import disk_equations, sensing_data
from profilecal.geometry.poses import (
    angle_between,
    nearest_rotation,
    rotation_from_xyz_angles,
)
from profilecal.targets.disk import Disk
from profilecal_papers import published
from profilecal_papers.disk_study import DiskScans, disk_scans, fig15_scans


def test_table_I_gives_equations_49_to_51():
    table = {
        name: published.values("disk", "Table I", name)
        for name in ("R_tcp", "T_tcp", "q", "D_i", "D_b")
    }
    Lambda = published.values("disk", "Eq. 49", "Lambda")
    solution = disk_equations(
        rotation_from_xyz_angles(table.pop("R_tcp")), *table.values()
    )
    assert (
        np.degrees(angle_between(solution.R_sensor, nearest_rotation(Lambda[:, :3])))
        < 0.07
    )
    assert np.linalg.norm(solution.T_sensor - Lambda[:, 3]) < 0.30
    assert (
        np.linalg.norm(
            solution.translation.q_b - published.values("disk", "Eq. 50", "q_b")
        )
        < 0.20
    )
    assert 0.19 < solution.translation.accuracy < 0.21


# whole, most, middle, halves
EXTENTS = [(-0.9, 0.9), (-0.9, 0.3), (-0.64, 0.64), (-0.95, -0.05), (0.1, 0.9)]


def random_scans(rng, n: int = 4, extent=(-0.9, 0.9)) -> DiskScans:
    """Scans whose planes make 40-140° with the disk, and whose motions run about
    half-way between the two normals.
    """
    disk = Disk(
        rng.uniform(-300, 300, 3),
        Rotation.random(rng=rng).as_matrix()[:, 2],
        rng.uniform(20, 60),
    )
    R_sensor, T_sensor = Rotation.random(rng=rng).as_matrix(), rng.uniform(-400, 400, 3)
    rotation, direction = np.empty((n, 3, 3)), np.empty((n, 3))
    for i in range(n):
        chord = np.cross(disk.normal, rng.normal(size=3))
        chord /= np.linalg.norm(chord)
        normal = Rotation.from_rotvec(np.radians(rng.uniform(40, 140)) * chord).apply(
            disk.normal
        )
        rotation[i] = np.column_stack([chord, normal, np.cross(chord, normal)])
        rotation[i] @= Rotation.from_rotvec([0, rng.uniform(-0.7, 0.7), 0]).as_matrix()
        between = disk.normal + np.copysign(1, disk.normal @ normal) * normal
        direction[i] = between / np.linalg.norm(between) + rng.uniform(-0.2, 0.2, 3)
    direction *= rng.choice([-1, 1], n)[:, None] / np.linalg.norm(
        direction, axis=1, keepdims=True
    )
    seen = rng.uniform(-40, 40, (n, 3)) * [1, 0, 1]
    return disk_scans(
        disk, R_sensor, T_sensor, rotation @ R_sensor.T, seen, direction, extent
    )


@cache
def many_scans(extent):
    """200 times four random scans and their chords' tips, 3 to 199 chords a scan."""
    rng = default_rng(11)
    scans = [random_scans(rng, 4, extent) for _ in range(200)]
    return [
        (scan, scan.tips(m))
        for scan, m in zip(scans, rng.integers(3, 200, 200), strict=True)
    ]


@pytest.mark.parametrize("heights", ["regression", "published"])
@pytest.mark.parametrize("extent", EXTENTS, ids=str)
def test_noise_free_chords_give_the_pose_back(extent, heights):
    sides = set()
    for scans, tips in many_scans(extent):
        found = solve(scans, tips, heights)
        sides.update(scans.s)
        assert np.abs(found.R_sensor - scans.R_sensor).max() < 1e-12
        assert np.abs(found.T_sensor - scans.T_sensor).max() < 1e-10
        assert np.abs(found.translation.q_b - scans.disk.centre).max() < 1e-10
        assert found.translation.accuracy < 1e-10
    assert sides == {-1, 1}


def solve(scans, tips, heights):
    seen = sensing_data(
        tips, scans.T_start, scans.T_end, scans.s, scans.disk.radius, heights
    )
    return disk_equations(scans.R_tcp, seen.T_tcp, seen.q, seen.D_i, seen.D_b)


def test_published_heights_are_where_the_first_and_last_chord_meet_the_middles():
    """They lean against the mean chord when there is noise."""
    scans = fig15_scans((-0.9, 0.7))
    tips = scans.tips(60) + default_rng(3).normal(0, 0.1, (4, 60, 2, 2))
    found = sensing_data(
        tips, scans.T_start, scans.T_end, scans.s, scans.disk.radius, "published"
    )
    x, z = found.direction.T
    # the rotated one, in columns
    frame = np.array([[x, -z], [z, x]]).transpose(2, 0, 1)
    first, second = np.moveaxis(tips[:, [0, -1]] @ frame[:, None], 2, 0)
    to_e, along = found.e[:, 3:] - first, second - first
    assert_allclose(
        to_e[..., 0] * along[..., 1], to_e[..., 1] * along[..., 0], atol=1e-9
    )
    assert np.abs(along[..., 1]).min() > 1e-3
