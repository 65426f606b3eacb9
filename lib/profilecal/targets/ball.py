"""A ball: the scan plane meets it in a circle, of which the scanner sees an arc."""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.fitting import fit_sphere
from profilecal.geometry.poses import circle_around, root
from profilecal.profiles.arcs import find_balls
from profilecal.targets.plane import BELOW_MM, Plane
from profilecal.targets.target import Target, in_sensor


@dataclass(frozen=True)
class Ball(Target):
    """The ball around `centre` (3,) with `radius`, base frame, mm."""

    centre: np.ndarray
    radius: float

    kind, shape, lengths, tables = "ball", "sphere", ("radius",), ("profiles", "arcs")
    shifts, turns, rows, fit_is_best = "xyz", "", 1, False
    groups, positions, sizes, with_tool = 10, 4, (25.0,), True
    find = staticmethod(find_balls)

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """Distance from the circle that the plane cuts out."""
        (x, z), (cx, cy, cz), (size,) = seen, origin, sizes
        vx, vz = x - cx, z - cz
        distance = np.hypot(vx, vz)
        radius, slope = root(size**2 - cy**2, 0.1 * size)
        return (
            [distance - radius],
            [[-vx / distance, 2 * slope * cy, -vz / distance]],
            None,
        )

    @staticmethod
    def residual_in_space(origin, axes, seen, sizes):
        """Distance from the ball."""
        (x, z), (cx, cy, cz), (size,) = seen, origin, sizes
        vx, vz = x - cx, z - cz
        distance = np.sqrt(vx**2 + vz**2 + cy**2)
        return (
            [distance - size],
            [[-vx / distance, cy / distance, -vz / distance]],
            None,
        )

    @staticmethod
    def fit(points):
        centre, radius = fit_sphere(points)
        return centre, np.broadcast_to(np.eye(3), (*centre.shape, 3)), (radius,)

    def distance(self, points):
        return np.linalg.norm(points - self.centre, axis=-1) - self.radius

    def meet(self, rotation, origin) -> np.ndarray:
        """The circles that scan planes cut from the ball, (..., 3): x, z, r; r NaN
        where they miss it.
        """
        c = in_sensor(rotation, self.centre - origin)
        with np.errstate(invalid="ignore"):
            r = np.sqrt(self.radius**2 - c[..., 1] ** 2)
        return np.stack([c[..., 0], c[..., 2], r], axis=-1)

    def arc(self, rotation, origin, reach_deg: float, count: int) -> np.ndarray:
        """Points (..., count, 2) of the circles, by angles to either side of the point
        nearest to the scanner.
        """
        circle = self.meet(rotation, origin)[..., None, :]
        angle = np.radians(np.linspace(-reach_deg, reach_deg, count))
        return circle[..., :2] + circle[..., 2:] * np.stack(
            [np.sin(angle), -np.cos(angle)], axis=-1
        )

    def points_seen(self, rotation, origin, count):
        return self.arc(rotation, origin, 50, count)

    def centre_from_circle(self, circle, side) -> np.ndarray:
        """The ball's centre in the sensor frame, (..., 3), from circles (..., 3) x, z,
        r. `side`: +1 where it lies towards the sensor's +y, else -1 (disk paper,
        Section IV-A). A circle larger than the ball puts it into the scan plane.
        """
        circle = np.asarray(circle, dtype=float)
        y = side * np.sqrt(np.maximum(self.radius**2 - circle[..., 2] ** 2, 0))
        return np.stack([circle[..., 0], y, circle[..., 1]], axis=-1)

    def sides(self, rotation, origin):
        return np.sign(np.einsum("na,na->n", self.centre - origin, rotation[:, :, 1]))

    def outline(self, specimen, rotation, origin, away):
        """Above a table."""
        table = Plane(self.centre + (self.radius + BELOW_MM) * away, away)
        return table.behind(self.arc(rotation, origin, 90, 721), rotation, origin)

    @staticmethod
    def offsets(shape, motion, normals, sizes, steering_mm, rng):
        y = sizes[0] * rng.uniform(-0.7, 0.7, shape)
        scale = sizes[0] / Ball.sizes[0]
        return np.stack(
            [
                scale * rng.uniform(-10, 10, shape),
                y,
                scale * rng.uniform(-10, 10, shape),
            ],
            axis=-1,
        )

    def lines(self, points):
        return [circle_around(self.centre, axis, self.radius) for axis in np.eye(3)]
