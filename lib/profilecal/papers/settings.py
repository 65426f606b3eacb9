"""The papers' simulations, set up from their printed numbers and from what they leave open."""

from functools import cache

import numpy as np

from profilecal.geometry.poses import carry, nearest_rotation, rotation_from_xyz_angles
from profilecal.papers.ball_study import BallScans
from profilecal.papers.disk_study import DiskScans, disk_scans
from profilecal.papers.published import values
from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk

# First and last chord of a scan, as signed fractions of the radius. Eq. 48's positions are not printed: notebook 22
# fits these to the values printed for Fig. 15; other pairs fit as well.
FIG15_EXTENT = (-0.9, 0.31)

# Readings of "the standard deviation e" of the disk paper's Figs 15 and 17: from errors (..., trials, 3) to (...)
READINGS = {
    "standard deviation of the norms": lambda errors: np.linalg.norm(errors, axis=-1).std(axis=-1),
    "root mean square": lambda errors: np.sqrt((errors**2).sum(axis=-1).mean(axis=-1)),
    "mean of the norms": lambda errors: np.linalg.norm(errors, axis=-1).mean(axis=-1),
}


def sensor_pose(item: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """R_sensor (3, 3), projected to a rotation, and T_sensor (3,), mm, of a matrix that the disk paper prints."""
    matrix = values("disk", item, quantity).reshape(-1, 4)[:3]
    return nearest_rotation(matrix[:, :3]), matrix[:, 3]


def fig15_scans(extent=FIG15_EXTENT) -> DiskScans:
    """Disk paper, Section V-B: the disk at Eq. 50, the sensor at Eq. 49, orientations and motions of Table I.

    `extent`: first and last chord as signed fractions of the radius.
    """
    return disk_scans(*_fig15(), extent)


@cache
def _fig15() -> tuple:
    """What `disk_scans` takes of Section V-B, but for the extent."""
    normal = values("disk", "Section V-B", "disk normal of the simulation")
    disk = Disk(values("disk", "Eq. 50", "q_b"), normal, float(values("disk", "Fig. 14", "disk radius")))
    motion = values("disk", "Table I", "D_b")
    motion = motion / np.linalg.norm(motion, axis=1, keepdims=True)
    R_tcp = rotation_from_xyz_angles(values("disk", "Table I", "R_tcp"))
    return disk, *sensor_pose("Eq. 49", "Lambda"), R_tcp, values("disk", "Table I", "q"), motion


def fig17_scans(**free) -> BallScans:
    """Disk paper, Section V-D3: the poses of Table III, the sensor at Eq. 53, the ball where Eq. 53 puts it.

    The motion of the m arcs and the scanner's view are not printed; `free` sets them, see `BallScans`.
    """
    ball_translating = 4  # disk paper, Section V-D2: the first four rows of Table III share one orientation
    R_sensor, T_sensor = sensor_pose("Eq. 53", "Upsilon")
    R_tcp = rotation_from_xyz_angles(values("disk", "Table III", "R_tcp"))
    T_tcp, q = values("disk", "Table III", "T_tcp"), values("disk", "Table III", "q")
    centres = carry(R_tcp, T_tcp, q @ R_sensor.T + T_sensor)
    ball = Ball(centres[ball_translating:].mean(axis=0), float(values("disk", "Fig. 14", "ball radius")))
    return BallScans(ball, R_sensor, T_sensor, R_tcp, T_tcp, ball_translating, **free)
