"""Noise studies of the disk and ball methods at any size: batched, in chunks, the same on any number of workers."""

from dataclasses import dataclass

import numpy as np

from profilecal.targets.disk import Disk


@dataclass(frozen=True)
class DiskScans:
    """Scans across a disk: one flange orientation and a straight motion each."""

    disk: Disk
    R_sensor: np.ndarray  # (3, 3) sensor on the flange
    T_sensor: np.ndarray  # (3,) mm
    R_tcp: np.ndarray  # (n, 3, 3) flange in the base frame
    T_start: np.ndarray  # (n, 3) mm, flange at the first chord
    T_end: np.ndarray  # (n, 3) mm, flange at the last chord

    @property
    def s(self) -> np.ndarray:
        """+1 where the motion is towards the sensor's +y, else -1, (n,): Eq. 3."""
        return np.sign(np.einsum("na,nab,b->n", self.T_end - self.T_start, self.R_tcp, self.R_sensor[:, 1]))

    def tips(self, m: int) -> np.ndarray:
        """The tips of m evenly spaced chords of each scan, without noise, (n, m, 2, 2)."""
        way = np.linspace(0, 1, m)[:, None]
        T_tcp = (1 - way) * self.T_start[:, None] + way * self.T_end[:, None]
        rotation = self.R_tcp @ self.R_sensor
        return self.disk.meet(rotation[:, None], T_tcp + (self.R_tcp @ self.T_sensor)[:, None])


def disk_scans(disk: Disk, R_sensor, T_sensor, R_tcp, centre_seen, direction, extent) -> DiskScans:
    """Scans (n) at flange orientations R_tcp (n, 3, 3) that see the disk's centre at `centre_seen` (n, 3), sensor frame, mm,
    and move along `direction` (n, 3), base frame.

    `extent`: first and last chord as signed fractions of the radius; at -1 and 1 the scan plane is tangent to the disk.
    """
    rotation = R_tcp @ R_sensor
    normal = rotation[..., 1]  # of the scan plane
    in_disk = np.linalg.norm(np.cross(normal, disk.normal), axis=-1)
    across = np.einsum("na,na->n", direction, normal)
    to_tangent = (disk.radius * in_disk / np.abs(across))[:, None] * direction
    T_centre = disk.centre - np.einsum("nab,nb->na", rotation, centre_seen) - R_tcp @ T_sensor
    return DiskScans(
        disk, R_sensor, T_sensor, R_tcp, T_centre + extent[0] * to_tangent, T_centre + extent[1] * to_tangent
    )
