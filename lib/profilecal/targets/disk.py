"""A planar disk: the scan plane meets it in a chord."""

from dataclasses import dataclass

import numpy as np

from profilecal.targets import algebraic_centre, root


@dataclass(frozen=True)
class Disk:
    """The disk around `centre` (3,) with unit `normal` (3,) and `radius`, base frame, mm."""

    centre: np.ndarray
    normal: np.ndarray
    radius: float

    def meet(self, rotation, origin) -> np.ndarray:
        """The chords that scan planes cut from the disk, (..., 2, 2).

        The two tips, the one of smaller x first, each as x and z in the sensor frame; NaN where the disk is missed.
        """
        c = ((self.centre - origin)[..., None, :] @ rotation)[..., 0, :]
        n = self.normal @ rotation
        along = np.stack([n[..., 2], np.zeros_like(n[..., 0]), -n[..., 0]], axis=-1)  # of the chord: y × n
        along *= np.where(along[..., :1] < 0, -1, 1) / np.linalg.norm(along, axis=-1, keepdims=True)
        across = np.cross(n, along)  # from the centre to the chord, within the disk
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -c[..., 1] / across[..., 1]
            half = np.sqrt(self.radius**2 - distance**2)
        middle = c + distance[..., None] * across
        tips = np.stack([middle - half[..., None] * along, middle + half[..., None] * along], axis=-2)
        return tips[..., [0, 2]]

    def profile(self, rotation, origin, x, step: float | None = None) -> np.ndarray:
        """What the scanner sees at x (k,): z (..., k), mm. It looks along its -z.

        Around the disk a plane lies `step` mm behind it, as when it is the top of a cylinder; None: black paper, NaN.
        """
        c = ((self.centre - origin)[..., None, :] @ rotation)[..., 0, :]
        n = (self.normal @ rotation)[..., None, :]
        z = c[..., 2:] + (n[..., 0] * (c[..., :1] - x) + n[..., 1] * c[..., 1:2]) / n[..., 2]
        inside = (x - c[..., :1]) ** 2 + c[..., 1:2] ** 2 + (z - c[..., 2:]) ** 2 <= self.radius**2
        behind = np.nan if step is None else z - step / np.abs(n[..., 2])
        return np.where(inside, z, behind)


MOVES = "anywhere"
TURNS = True  # whether it has a direction


def residual(point, direction, seen, size, in_plane=True):
    """How far sensed chord tips are from the rim of a disk of radius `size`; see `profilecal.targets`.

    In the scan plane: each tip minus its place, across the chord (towards larger z) and along it (towards larger x). In
    space: each tip's height above the disk and its distance from the rim.
    """
    cx, cy, cz = point
    nx, ny, nz = direction
    r, by_point, by_direction = [], [], []
    zero = np.zeros_like(cx)
    if in_plane:
        g = np.hypot(nx, nz)
        sign = np.where(nz < 0, -1, 1)
        to_right = sign / g
        q = cy / g  # distance of the chord from the centre, within the disk
        half, slope = root(size**2 - q**2, 0.1 * size)
        slope = -2 * q * slope
        half_by_point = slope / g
        half_by_n = -slope * q / g**2
    for (x, z), side in zip(seen, (-1, 1), strict=True):
        vx, vy, vz = x - cx, -cy, z - cz
        if in_plane:
            across = sign * (nx * vx + ny * vy + nz * vz) / g
            along = to_right * (nz * vx - nx * vz)
            r += [across, along - side * half]
            by_point += [
                [-sign * nx / g, -sign * ny / g, -sign * nz / g],
                [-to_right * nz, -side * half_by_point, to_right * nx],
            ]
            a, b = across / g**2, along / g**2 + side * half_by_n
            by_direction += [
                [sign * vx / g - a * nx, sign * vy / g, sign * vz / g - a * nz],
                [-to_right * vz - b * nx, zero, to_right * vx - b * nz],
            ]
        else:
            length = np.sqrt(vx**2 + vy**2 + vz**2)
            r += [nx * vx + ny * vy + nz * vz, length - size]
            by_point += [[-nx, -ny, -nz], [-vx / length, -vy / length, -vz / length]]
            by_direction += [[vx, vy, vz], [zero, zero, zero]]
    return r, by_point, by_direction


def place(points, size):
    """The disk whose rim passes near points (..., n, 3): its centre and normal, both (..., 3)."""
    middle = points.mean(axis=-2)
    normal = np.linalg.svd(points - middle[..., None, :], full_matrices=False)[2][..., 2, :]
    return algebraic_centre(points), normal
