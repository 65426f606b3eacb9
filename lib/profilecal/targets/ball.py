"""A ball: the scan plane meets it in a circle, of which the scanner sees an arc."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.fitting import fit_sphere
from profilecal.geometry.poses import circle_around, root
from profilecal.profiles.arcs import find_balls
from profilecal.targets.plane import Round, fan
from profilecal.targets.target import Fitted, Linearised, Sight, Views, length_of


@dataclass(frozen=True)
class Ball(Round):
    """A ball.

    `centre` (3,) is its centre in the base frame and `radius` its radius, both in mm.

    A scanner in the base frame, whose scan plane passes the centre at 6 mm, sees a
    circle of 8 mm:

    >>> import numpy as np
    >>> import profilecal as pc
    >>> ball = pc.Ball(centre=np.array([5.0, 6.0, 100.0]), radius=10.0)
    >>> x, z, r = ball.meet(rotation=np.eye(3), origin=np.zeros(3))
    >>> print(x, z, r)
    5.0 100.0 8.0
    """

    centre: ndarray
    radius: float

    kind = "ball"
    shape = "sphere"
    shifts = "xyz"
    turns = ""
    half_arc_deg = 50.0
    tables = ("profiles", "arcs")
    finder = staticmethod(find_balls)
    groups = 10
    positions = 4
    usual_sizes = (25.0,)
    with_tool = True
    across = (0.3, 1.0, 0.2)

    @staticmethod
    def residual(sight: Sight) -> Linearised:
        """Distance from the circle that the plane cuts out."""
        x, y, z = sight.offset
        (radius,) = sight.sizes
        circle, slope = root(radius**2 - y * y, 0.1 * radius)
        distance = np.sqrt(x * x + z * z)
        force = [-x / distance, -2 * slope * y, -z / distance]
        return [distance - circle], [force], None

    @staticmethod
    def residual_in_space(sight: Sight) -> Linearised:
        """Distance from the ball."""
        distance = length_of(sight.offset)
        force = [-part / distance for part in sight.offset]
        return [distance - sight.sizes[0]], [force], None

    @staticmethod
    def fit(points: ndarray) -> Fitted:
        centre, radius = fit_sphere(points)
        return centre, np.broadcast_to(np.eye(3), (*centre.shape, 3)), (radius,)

    def lines(self, points: ndarray) -> list[ndarray]:
        """Three great circles."""
        return [circle_around(self.centre, axis, self.radius) for axis in np.eye(3)]

    def meet(self, rotation: ndarray, origin: ndarray) -> ndarray:
        """The circles that scan planes cut from the ball, (..., 3): x, z, r; r NaN
        where they miss it.
        """
        x, y, z = self.sight_from(rotation, origin).origin[..., 0, 0]
        with np.errstate(invalid="ignore"):
            return np.stack([x, z, np.sqrt(self.radius**2 - y * y)], axis=-1)

    def arc(
        self, rotation: ndarray, origin: ndarray, reach_deg: float, count: int
    ) -> ndarray:
        """Points (..., count, 2) of the circles, by angles to either side of the point
        nearest to the scanner.
        """
        circle = self.meet(rotation, origin)[..., None, :]
        return circle[..., :2] + circle[..., 2:] * [1, -1] * fan(reach_deg, count)

    def sides(self, rotation: ndarray, origin: ndarray) -> ndarray:
        return np.sign(np.vecdot(self.centre - origin, rotation[..., 1]))

    def centre_from_circle(self, circle: ArrayLike, side: ArrayLike) -> ndarray:
        """The ball's centre in the sensor frame, (..., 3), from circles (..., 3) x, z,
        r.

        `side` (...): +1 where it lies towards the sensor's +y, else -1 (disk paper,
        Section IV-A). A circle larger than the ball puts it into the scan plane; what
        is masked is NaN.
        """
        for other in np.setdiff1d(side, [1, -1]):
            raise ValueError(f"a side is {other:g}; expected 1 or -1 for each circle")
        filled: ndarray = np.ma.filled(np.ma.asarray(circle, float), np.nan)
        x, z, r = np.moveaxis(filled, -1, 0)
        y = side * np.sqrt(np.maximum(self.radius**2 - r * r, 0))
        return np.stack([x, y, z], axis=-1)

    @staticmethod
    def offsets(views: Views, rng: np.random.Generator) -> ndarray:
        """The scan plane passes the centre at up to 0.7 radii."""
        y, x, z = rng.uniform(-1, 1, (3, *views.shape))
        return views.sizes[0] * np.stack([0.4 * x, 0.7 * y, 0.4 * z], axis=-1)
