"""The disk method from raw chords: exact without noise, and it says what is wrong with the data."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from profilecal.closed_form.disk import solve_disk_from_chords
from profilecal.montecarlo import DiskScans, disk_scans
from profilecal.targets.disk import Disk

EXTENTS = [(-0.9, 0.9), (-0.9, 0.3), (-0.64, 0.64), (-0.95, -0.05), (0.1, 0.9)]  # whole, most, middle, halves
EPS = np.finfo(float).eps


def random_scans(rng, n: int = 4, extent=(-0.9, 0.9)) -> DiskScans:
    """Scans whose planes make 40-140° with the disk, and whose motions run about half-way between the two normals."""
    disk = Disk(rng.uniform(-300, 300, 3), Rotation.random(rng=rng).as_matrix()[:, 2], rng.uniform(20, 60))
    R_sensor, T_sensor = Rotation.random(rng=rng).as_matrix(), rng.uniform(-400, 400, 3)
    rotation, direction = np.empty((n, 3, 3)), np.empty((n, 3))
    for i in range(n):
        chord = np.cross(disk.normal, rng.normal(size=3))
        chord /= np.linalg.norm(chord)
        normal = Rotation.from_rotvec(np.radians(rng.uniform(40, 140)) * chord).apply(disk.normal)
        rotation[i] = np.column_stack([chord, normal, np.cross(chord, normal)])
        rotation[i] @= Rotation.from_rotvec([0, rng.uniform(-0.7, 0.7), 0]).as_matrix()
        between = disk.normal + np.copysign(1, disk.normal @ normal) * normal
        direction[i] = between / np.linalg.norm(between) + rng.uniform(-0.2, 0.2, 3)
    direction *= rng.choice([-1, 1], n)[:, None] / np.linalg.norm(direction, axis=1, keepdims=True)
    seen = rng.uniform(-40, 40, (n, 3)) * [1, 0, 1]
    return disk_scans(disk, R_sensor, T_sensor, rotation @ R_sensor.T, seen, direction, extent)


@pytest.mark.parametrize("heights", ["regression", "published"])
@pytest.mark.parametrize("extent", EXTENTS, ids=str)
def test_noise_free_chords_give_the_pose_back(extent, heights):
    rng = np.random.default_rng(11)
    sides = set()
    for m in rng.integers(3, 200, 200):
        scans = random_scans(rng, 4, extent)
        found = solve_disk_from_chords(
            scans.R_tcp, scans.T_start, scans.T_end, scans.tips(m), scans.s, scans.disk.radius, heights
        )
        sides.update(scans.s)
        assert np.abs(found.R_sensor - scans.R_sensor).max() < 1e-12
        assert np.abs(found.T_sensor - scans.T_sensor).max() < 1e-10
        assert np.abs(found.solution.translation.q_b - scans.disk.centre).max() < 1e-10
        assert found.accuracy < 1e-10
        np.testing.assert_allclose(found.sensing.extent, [extent] * 4, rtol=1e-9)
        assert len(found.remarks) == (4 if extent[0] * extent[1] > 0 else 0)  # halves are said to be halves
    assert sides == {-1, 1}
