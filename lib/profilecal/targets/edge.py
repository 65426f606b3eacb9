"""A straight edge: the scan plane meets it in a point. Three specimens that have one, and how profiles show it."""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.fitting import Line, fit_line


@dataclass(frozen=True)
class Edge:
    """The line through `point` (..., 3) along the unit vector `direction` (..., 3), base frame, mm."""

    point: np.ndarray
    direction: np.ndarray

    def meet(self, rotation, origin) -> np.ndarray:
        """Where scan planes meet the line: x and z in the sensor frame, (..., 2); infinite where they are parallel."""
        p = ((self.point - origin)[..., None, :] @ rotation)[..., 0, :]
        d = (self.direction[..., None, :] @ rotation)[..., 0, :]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -p[..., 1] / d[..., 1]
        return (p + along[..., None] * d)[..., [0, 2]]

    def outline(self, specimen: str, up, rotation, origin) -> np.ndarray:
        """The chains (..., V, 2) that scan planes cut from a specimen with this edge, x and z in the sensor frame, mm.

        All its faces run along the edge; `up` (..., 3), perpendicular to the edge, is where the specimen's top points.
        """
        aside = np.cross(self.direction, up)
        lines = [Edge(self.point + a * aside + h * up, self.direction) for a, h in SPECIMENS[specimen]]
        return np.stack([line.meet(rotation, origin) for line in lines], axis=-2)


def turned(corners, angle_deg: float) -> list[tuple[float, float]]:
    """Corners of a cross-section turned about the edge."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return [(c * a - s * h, s * a + c * h) for a, h in corners]


# Cross-sections as chains of corners (aside, up) from the edge, mm; the paper's Fig. 4 gives no measures
SPECIMENS = {
    "parallel bar": turned([(-20, 0), (0, 0), (0, -20)], 35),  # seen corner on: its top and a side wall
    "straight scale": [(-40, 0), (0, 0), (0, -1), (-39, -1), (-39, -20), (200, -20)],  # 1 mm thick, above a table
    "knife blade": [(-200, -20), (-0.3, -20), (-0.3, -1.2), (0, 0), (0.3, -1.2), (0.3, -20), (200, -20)],  # edge up
}
NEAR_EDGE = 5.0  # mm of a profile that make up a fitted line
ON_FACE = 0.25  # mm from that line: noise, not a side wall
WIDEST_TIP = 2.0  # mm, within half a millimetre of its top
DROP = 3.0  # mm between neighbouring points: the end of a face


def valid(profiles) -> tuple[np.ndarray, np.ndarray]:
    """Which points (..., n) a profile has, and the profiles with zeros in place of the others."""
    there = np.isfinite(profiles).all(axis=-1)
    return there, np.where(there[..., None], profiles, 0.0)


def corner(profiles, rounds: int = 4) -> np.ndarray:
    """Where the two straight sides of a corner meet, (..., 2), in profiles (..., n, 2), mm; NaN where they do not.

    From the point farthest from the chord of the whole profile on, a line is fitted to each side of the corner,
    leaving out half a millimetre, and the corner moved to where they meet.
    """
    there, profiles = valid(profiles)
    ends = there.argmax(axis=-1), profiles.shape[-2] - 1 - there[..., ::-1].argmax(axis=-1)
    first, last = (take(profiles, end) for end in ends)
    chord, offset = last - first, profiles - first[..., None, :]
    distance = np.abs(offset[..., 0] * chord[..., None, 1] - offset[..., 1] * chord[..., None, 0]) * there
    corner = take(profiles, distance.argmax(axis=-1))
    for _ in range(rounds):
        away = np.linalg.norm(profiles - corner[..., None, :], axis=-1)
        near = there & (away > 0.5) & (away < NEAR_EDGE)
        left = profiles[..., 0] < corner[..., None, 0]
        corner = intersect(fit_line(profiles, near & left), fit_line(profiles, near & ~left))
    return corner


def take(profiles, index) -> np.ndarray:
    """One point (..., 2) of each profile (..., n, 2)."""
    return np.take_along_axis(profiles, index[..., None, None], axis=-2)[..., 0, :]


def intersect(first: Line, second: Line) -> np.ndarray:
    """Where lines in the plane meet, (..., 2)."""
    d, e, offset = first.direction, second.direction, second.point - first.point
    cross = d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
    along = (offset[..., 0] * e[..., 1] - offset[..., 1] * e[..., 0]) / cross
    return first.point + along[..., None] * d


def step_end(profiles) -> np.ndarray:
    """The end of a face before a drop, at larger x, (..., 2), in profiles (..., n, 2), mm; NaN where nothing drops.

    The first drop between neighbours marks the end roughly. A line through the face before it, but for the last
    millimetre, tells the face from all else; the last point on the face is the end, moved onto the line.
    """
    there, profiles = valid(profiles)
    drops = np.diff(profiles[..., 1], axis=-1) * (there[..., 1:] & there[..., :-1]) > DROP
    last = drops.argmax(axis=-1)
    before = there & (np.arange(profiles.shape[-2]) <= last[..., None])
    back = take(profiles, last)[..., None, 0] - profiles[..., 0]
    line = fit_line(profiles, before & (back > 1) & (back < NEAR_EDGE))
    offset = profiles - line.point[..., None, :]
    off_line = offset[..., 0] * line.direction[..., None, 1] - offset[..., 1] * line.direction[..., None, 0]
    face = there & (np.abs(off_line) < ON_FACE) & (np.abs(offset[..., 0]) < NEAR_EDGE)
    end = take(offset, face.shape[-1] - 1 - face[..., ::-1].argmax(axis=-1))
    found = line.point + (end * line.direction).sum(axis=-1, keepdims=True) * line.direction
    return np.where(drops.any(axis=-1)[..., None], found, np.nan)


def tip(profiles) -> np.ndarray:
    """The tip of a blade that points at the scanner, (..., 2), in profiles (..., n, 2), mm; NaN where there is none.

    x is the mean over the points within half a millimetre in z of the nearest one; z is the nearest one's. A tip is
    narrow, and not at an end of the profile.
    """
    there, profiles = valid(profiles)
    x, z = profiles[..., 0], np.where(there, profiles[..., 1], np.inf)
    top = z.min(axis=-1, keepdims=True)
    near = z < top + 0.5
    middle = (near * x).sum(axis=-1) / np.maximum(near.sum(axis=-1), 1)
    wide = (near & (np.abs(x - middle[..., None]) > WIDEST_TIP / 2)).any(axis=-1)
    inside = np.cumsum(there, axis=-1) * there
    count = there.sum(axis=-1)
    place = np.take_along_axis(inside, z.argmin(axis=-1)[..., None], axis=-1)[..., 0]
    found = ~wide & (place > 3) & (place < count - 2)
    return np.where(found[..., None], np.stack([middle, top[..., 0]], axis=-1), np.nan)


FEATURES = {"parallel bar": corner, "straight scale": step_end, "knife blade": tip}


MOVES = "across"  # how the point of its placement moves: across its direction
TURNS = True  # whether it has a direction


def residual(point, direction, seen, size=None, in_plane=True):
    """How far sensed edge points are from an edge, and the derivatives; see `profilecal.targets`.

    In the scan plane: sensed point minus where the plane meets the edge, x and z.
    In space: (sensed - point) × direction.
    """
    x, z = seen[0]
    px, py, pz = point
    dx, dy, dz = direction
    zero, one = np.zeros_like(px), np.ones_like(px)
    if in_plane:
        s = py / dy
        r = [x - px + s * dx, z - pz + s * dz]
        by_point = [[-one, dx / dy, zero], [zero, dz / dy, -one]]
        by_direction = [[s, -s * dx / dy, zero], [zero, -s * dz / dy, s]]
        return r, by_point, by_direction
    vx, vy, vz = x - px, -py, z - pz
    r = [vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx]
    by_point = [[zero, -dz, dy], [dz, zero, -dx], [-dy, dx, zero]]
    by_direction = [[zero, -vz, vy], [vz, zero, -vx], [-vy, vx, zero]]
    return r, by_point, by_direction


def place(points, size=None):
    """The edge through points (..., n, 3): a point on it and its direction, both (..., 3)."""
    middle = points.mean(axis=-2)
    return middle, np.linalg.svd(points - middle[..., None, :], full_matrices=False)[2][..., 0, :]
