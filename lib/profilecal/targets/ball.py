"""A ball: the scan plane meets it in a circle, of which the scanner sees an arc."""

from dataclasses import dataclass

import numpy as np

from profilecal.targets import algebraic_centre, root


@dataclass(frozen=True)
class Ball:
    """The ball around `centre` (3,) with `radius`, base frame, mm."""

    centre: np.ndarray
    radius: float

    def meet(self, rotation, origin) -> np.ndarray:
        """The circles that scan planes cut from the ball, (..., 3): x, z, r; r NaN where they miss it."""
        c = ((self.centre - origin)[..., None, :] @ rotation)[..., 0, :]
        with np.errstate(invalid="ignore"):
            r = np.sqrt(self.radius**2 - c[..., 1] ** 2)
        return np.stack([c[..., 0], c[..., 2], r], axis=-1)

    def centre_from_circle(self, circle, side) -> np.ndarray:
        """The ball's centre in the sensor frame, (..., 3), from circles (..., 3) x, z, r.

        `side` is +1 where the centre lies towards the sensor's +y, else -1 (disk paper, Section IV-A). A circle
        larger than the ball, which noise can give, puts the centre into the scan plane.
        """
        circle = np.asarray(circle, dtype=float)
        y = side * np.sqrt(np.maximum(self.radius**2 - circle[..., 2] ** 2, 0))
        return np.stack([circle[..., 0], y, circle[..., 1]], axis=-1)

    def profile(self, rotation, origin, x) -> np.ndarray:
        """What the scanner, which looks along its -z, sees of the ball at x (k,): z (..., k), mm; NaN beside it."""
        circle = self.meet(rotation, origin)
        with np.errstate(invalid="ignore"):
            return circle[..., 1:2] + np.sqrt(circle[..., 2:] ** 2 - (x - circle[..., :1]) ** 2)


MOVES = "anywhere"
TURNS = False  # whether it has a direction


def residual(point, direction, seen, size, in_plane=True):
    """How far points of arcs are from a ball of radius `size`; see `profilecal.targets`.

    In the scan plane: distance from the circle that the plane cuts out. In space: distance from the ball.
    """
    cx, cy, cz = point
    vx, vz = seen[:, 0] - cx, seen[:, 1] - cz
    zero = np.zeros_like(vx)
    if in_plane:
        distance = np.hypot(vx, vz)
        radius, slope = root(size**2 - cy**2, 0.1 * size)
        r = distance - radius
        by_point = np.stack([-vx / distance, 2 * slope * cy + zero, -vz / distance], axis=1)
    else:
        distance = np.sqrt(vx**2 + vz**2 + cy**2)
        r = distance - size
        by_point = np.stack([-vx / distance, cy / distance, -vz / distance], axis=1)
    return r, by_point, None


def place(points, size):
    """The ball near points (..., n, 3): its centre (..., 3), and no direction."""
    centre = algebraic_centre(points)
    return centre, np.zeros_like(centre)
