"""A straight edge: the scan plane meets it in a point. Three specimens that have one."""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from profilecal.geometry.components import cross
from profilecal.geometry.fitting import principal_axes
from profilecal.geometry.poses import frame_around
from profilecal.profiles.choice import Candidate, choose, common_key, votes
from profilecal.profiles.ends import facing, run_end, step_beyond, with_end_variance
from profilecal.profiles.feature import Feature, mask, nothing
from profilecal.profiles.points import NOISE_LIMIT, present, stretches
from profilecal.profiles.runs import Run, straight_runs
from profilecal.profiles.view import View
from profilecal.targets.target import ALONG_Y, Target

SHAPES = ("corner", "step end", "tip")  # in this order if many profiles show several
LEAST_BEND_DEG = 15.0  # between the sides of a corner
BLUNT = 0.5  # mm around a corner that its rounding and the laser spot spoil
LEAST_SIDE = 10  # points on either side of it
REACH = 2.0  # mm from the end of a straight side to the corner, at most
ALIKE = 0.8  # as many profiles that show the other end of a face leave open which is the edge
LEAST_CORNERS = 3  # profiles that show which end of a face is the edge
TIP_DEPTH, TIP_WIDTH = 0.5, 2.0  # mm of a blade that make up its tip, and its width there at most
LEAST_TIP_POINTS = 3
AROUND = 12  # points on either side of a tip that must be behind it
BOTH_ENDS = "both ends of a face are seen, in this profile or others: which is the edge? Show one of them only"


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


@dataclass(frozen=True)
class Edge(Target):
    """The line through `point` (..., 3) along the unit vector `direction` (..., 3), base frame, mm."""

    point: np.ndarray
    direction: np.ndarray

    kind, shape, tables = "edge", "straight line", ("profiles", "points")
    shifts, turns, points, rows, affine, beside_mm = "xy", "xy", 1, 2, True, 6.0
    groups, positions, stance, specimens = 25, 10, ALONG_Y, tuple(SPECIMENS)

    @classmethod
    def at(cls, origin, axes, sizes):
        return cls(origin, axes[..., 2])

    @property
    def frame(self):
        return self.point, frame_around(self.direction)

    @staticmethod
    def residual(origin, axes, seen, sizes):
        """x and z of the sensed point minus those of the place where the plane meets the edge."""
        (x, z), (px, py, pz), (dx, dy, dz) = seen, origin, axes[2]
        s = py / dy
        r = [x - px + s * dx, z - pz + s * dz]
        force = [[-1.0, dx / dy, 0.0], [0.0, dz / dy, -1.0]]
        by_direction = [[s, -s * dx / dy, 0.0], [0.0, -s * dz / dy, s]]
        return r, force, [cross(axes[2], d) for d in by_direction]

    @staticmethod
    def residual_in_space(origin, axes, seen, sizes):
        """(sensed point - origin) × direction."""
        (x, z), (px, py, pz), (dx, dy, dz) = seen, origin, axes[2]
        vx, vy, vz = x - px, -py, z - pz
        force = [[0.0, -dz, dy], [dz, 0.0, -dx], [-dy, dx, 0.0]]
        by_direction = [[0.0, -vz, vy], [vz, 0.0, -vx], [-vy, vx, 0.0]]
        return cross((vx, vy, vz), axes[2]), force, [cross(axes[2], d) for d in by_direction]

    @staticmethod
    def fit(points):
        return points.mean(axis=-2), frame_around(principal_axes(points)[..., 0, :]), ()

    def distance(self, points):
        offset = points - self.point
        return np.linalg.norm(offset - (offset @ self.direction)[..., None] * self.direction, axis=-1)

    def meet(self, rotation, origin) -> np.ndarray:
        """Where scan planes meet the line: x and z in the sensor frame, (..., 2); infinite where they are parallel."""
        p = ((self.point - origin)[..., None, :] @ rotation)[..., 0, :]
        d = (self.direction[..., None, :] @ rotation)[..., 0, :]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -p[..., 1] / d[..., 1]
        return (p + along[..., None] * d)[..., [0, 2]]

    def points_seen(self, rotation, origin, count):
        return self.meet(rotation, origin)[..., None, :]

    @staticmethod
    def find(profiles, sizes):
        return edges_in(profiles, sizes)

    def outline(self, specimen, rotation, origin, away) -> np.ndarray:
        """The chains (..., V, 2) that scan planes cut from a specimen with this edge, x and z in the sensor frame, mm.

        All its faces run along the edge; its top faces the scanner, on the side of smaller x.
        """
        up = (away @ self.direction) * self.direction - away
        up = up / np.linalg.norm(up)
        aside = np.cross(self.direction, up)
        aside = aside * np.sign(aside @ rotation.reshape(-1, 3, 3).mean(axis=0)[:, 0])
        lines = [Edge(self.point + a * aside + h * up, self.direction) for a, h in SPECIMENS[specimen]]
        return np.stack([line.meet(rotation, origin) for line in lines], axis=-2)

    def lines(self, points):
        """The edge as long as it was seen."""
        low, high = np.nanpercentile((points - self.point) @ self.direction, [1, 99])
        ends = np.array([1.1 * low - 0.1 * high, 1.1 * high - 0.1 * low])
        return [self.point + ends[:, None] * self.direction]


# An edge in raw profiles: a corner of two faces, the end of a face before a step or nothing, the tip of a blade


def edges_in(profiles, sizes) -> list[Feature]:
    """The edge in each profile (n, 2), mm: of what many profiles show the first of corners that point at the scanner,
    ends of faces, tips, and corners that point away, where a wall meets a floor."""
    found = [straight_runs(profile) for profile in profiles]
    view = View.of([runs for runs, _ in found])
    candidates = [
        [*corners(runs), *step_ends(runs, limit, view), *tips(profile, runs, limit, view)]
        for profile, (runs, limit) in zip(profiles, found, strict=True)
    ]

    def rank(key):
        hollow = key[0] == "corner" and key[1] * view.away > 0
        return len(SHAPES) if hollow else SHAPES.index(key[0])

    key = common_key(candidates, rank)
    if key and key[0] == "step end" and shows_both_ends(votes(candidates), key):
        at_faces = Counter(c.key for found in candidates for c in corners_of_faces(found) if rank(c.key) == 0)
        key, often = max(at_faces.items(), key=lambda item: item[1], default=(None, 0))  # where a side face is seen
        if often < LEAST_CORNERS:
            return [nothing(profile, BOTH_ENDS) for profile in profiles]

    def missed(number: int) -> str:
        return why_no_corner(found[number][0]) if key and key[0] == "corner" else ""

    return with_end_variance(choose(profiles, candidates, key, missed))


def shows_both_ends(count, key) -> bool:
    """Whether nearly as many profiles show the end of a face on the other side than that of the key."""
    return any(k[0] == key[0] and k != key and count[k] > ALIKE * count[key] for k in count)


def corners_of_faces(found) -> list[Candidate]:
    """The corners among a profile's candidates at which its longest face ends."""
    ends = [c for c in found if c.feature.shape == "step end"]
    longest = max((c.support for c in ends), default=0.0)
    tips = [c.feature.points[0] for c in ends if c.support == longest]
    corners = [c for c in found if c.feature.shape == "corner"]
    return [c for c in corners if any(np.hypot(*(c.feature.points[0] - tip)) < REACH for tip in tips)]


def corners(runs) -> list[Candidate]:
    """Where neighbouring straight runs meet: the apex of a ridge, the corner of a bar."""
    found = []
    for first, second in pairwise(runs):
        if not is_bent(first, second):
            continue
        apex = crossing(first, second)
        sides = [beyond_blunt(run, apex) for run in (first, second)]
        if None in sides or not is_bent(*sides) or not ends_at(first, second, apex):
            continue
        apex = crossing(*sides)
        variance = np.diag([side.offset_covariance(apex[None])[0, 0] for side in sides])
        inverse = np.linalg.inv(np.stack([side.normal for side in sides]))
        used = mask(first.profile, np.concatenate([side.rows for side in sides]))
        feature = Feature(apex[None], (inverse @ variance @ inverse.T)[None], used, "corner")
        towards = first.direction - second.direction  # from between the sides to the apex and on
        bend = np.arccos(first.direction @ second.direction)
        found.append(Candidate(feature, int(np.sign(towards[1])), min(side.length for side in sides), np.pi - bend))
    return found


def why_no_corner(runs) -> str:
    """What keeps a profile of a corner from showing it, as far as its straight runs tell."""
    for first, second in pairwise(runs):
        if is_bent(first, second) and ends_at(first, second, crossing(first, second)):
            return f"one side of the corner shows fewer than {LEAST_SIDE} points beyond its rounding"
    return "one side of the corner shows too few points for a line" if len(runs) == 1 else ""


def is_bent(first: Run, second: Run) -> bool:
    """Whether two runs form a corner, neither straight on nor straight back."""
    return bool(abs(first.direction @ second.direction) < np.cos(np.radians(LEAST_BEND_DEG)))


def crossing(first: Run, second: Run) -> np.ndarray:
    """Where the lines of two runs meet, (2,)."""
    normals = np.stack([first.normal, second.normal])
    return np.linalg.solve(normals, [first.normal @ first.point, second.normal @ second.point])


def ends_at(first: Run, second: Run, apex) -> bool:
    """Whether the first run ends and the second begins within reach of the apex."""
    end = (apex - first.point) @ first.direction - first.along[-1]
    start = (apex - second.point) @ second.direction - second.along[0]
    return abs(end) < REACH and abs(start) < REACH


def beyond_blunt(run: Run, apex) -> Run | None:
    """The run without the points around the corner; None if too little is left."""
    rows = run.rows[np.abs(run.along - (apex - run.point) @ run.direction) > BLUNT]
    side = Run.through(run.profile, rows) if len(rows) >= LEAST_SIDE else None
    return side if side and side.length > BLUNT else None


def step_ends(runs, limit: float, view: View) -> list[Candidate]:
    """Where a face ends in front of something farther away, or of nothing."""
    found = []
    for run in facing(runs):
        for side in (run.reversed(), run):
            step = step_beyond(side, limit, view)
            if step == 0 or (step and step * view.away > 0):
                end = run_end(side)
                feature = Feature(end.tip[None], end.across[None], mask(run.profile, run.rows), "step end")
                found.append(Candidate(feature, int(np.sign(end.tip[0] - run.point[0])), run.length, ends=(end,)))
    return found


def tips(profile, runs, limit: float, view: View) -> list[Candidate]:
    """Narrow tips in front of a background or of nothing: a blade that points at the scanner."""
    seen = present(profile)
    free = seen.copy()
    for run in facing(runs):
        free[run.rows] = False
    found = []
    for cluster in stretches(np.flatnonzero(free), 3):
        for away in [view.away] if view.away else (1, -1):
            top = top_of(profile, seen, cluster, away)
            if top is not None:
                points = profile[top]
                apex = points.mean(axis=0)
                edge = [apex[0], away * (away * points[:, 1]).min()]  # or anywhere among them
                noise = limit / NOISE_LIMIT
                covariance = np.diag(np.maximum(((points - edge) ** 2).mean(axis=0), noise**2))
                feature = Feature(apex[None], covariance[None], mask(profile, top), "tip")
                found.append(Candidate(feature, -away, 1.0))
    return found


def top_of(profile, seen, cluster, away: int) -> np.ndarray | None:
    """The rows of a cluster's top TIP_DEPTH if they are narrow and what surrounds the cluster lies behind them."""
    depth = away * profile[cluster, 1]
    for nearest in np.sort(depth)[:3]:  # up to two spikes in front
        top = cluster[(depth >= nearest) & (depth < nearest + TIP_DEPTH)]
        if len(top) >= LEAST_TIP_POINTS:
            break
    else:
        return None
    if np.ptp(profile[top, 0]) > TIP_WIDTH:
        return None
    for around in (np.arange(top[0] - AROUND, top[0]), np.arange(top[-1] + 1, top[-1] + 1 + AROUND)):
        if around[0] < 0 or around[-1] >= len(profile):
            return None
        if seen[around].any() and np.median(away * profile[around[seen[around]], 1]) < nearest + TIP_DEPTH:
            return None
    return top
