"""The straight runs of a raw profile, which is split into pieces that grow: what faces
and chords leave in what a scanner sends. A run survives gaps, spikes and missing
points; it ends where the profile leaves its line for good.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.profiles.points import (
    stretches,
    surface,
    variance_inflation,
    visible,
)

LEAST_POINTS = 6  # of a piece that may grow
LARGEST_GAP = 8  # steps from one point of a run to the next, at which it goes on


@dataclass(frozen=True)
class Run:
    """A straight piece of a profile: rows of it, and the line through their middle."""

    profile: ndarray  # (n, 2) mm
    rows: ndarray  # (k,) in scan order
    limit: float  # mm, the profile's tolerance
    point: ndarray  # (2,) mm, the middle
    direction: ndarray  # (2,) in scan order
    along: ndarray  # (k,) mm, of its points from `point` along the line
    off: ndarray  # (k,) mm, of its points from the line

    @staticmethod
    def through(profile: ndarray, rows: ndarray, limit: float) -> "Run":
        """The run of some rows of a profile, with the line nearest to them."""
        points = profile.T.take(rows, axis=1)
        middle = points.mean(axis=1)
        x, z = points - middle[:, None]
        angle = np.arctan2(2 * (x @ z), x @ x - z @ z) / 2
        c, s = np.cos(angle), np.sin(angle)
        along = c * x + s * z
        if along[-1] < along[0]:
            c, s, along = -c, -s, -along
        off = c * z - s * x
        return Run(profile, rows, limit, middle, np.array([c, s]), along, off)

    def reversed(self) -> "Run":
        """The same run in the profile from its last point to its first."""
        rows = len(self.profile) - 1 - self.rows[::-1]
        return Run.through(self.profile[::-1], rows, self.limit)

    def coordinates(self, points: ndarray) -> tuple[ndarray, ndarray]:
        """How far points (k, 2) are along the line and off it, mm."""
        offset = points - self.point
        return offset @ self.direction, offset @ self.normal

    @property
    def points(self) -> ndarray:
        """(k, 2) mm."""
        return self.profile.take(self.rows, axis=0)

    @property
    def normal(self) -> ndarray:
        """Perpendicular to the direction, (2,)."""
        return np.array([-self.direction[1], self.direction[0]])

    @property
    def length(self) -> float:
        """From the first point to the last, mm."""
        return float(np.ptp(self.along))

    @property
    def spacing(self) -> float:
        """Between neighbouring points, mm."""
        return self.length / (len(self.rows) - 1)

    def offset_covariance(self, places: ndarray) -> ndarray:
        """Of how far the line is off its true place, at m places (m, 2) on it, (m, m)
        mm².

        It is larger where neighbouring points err alike.
        """
        k = len(self.off)
        mean_square = visible(self.off @ self.off / max(k - 2, 1), self.limit)
        variance = mean_square * variance_inflation(self.off)
        from_middle = self.coordinates(places)[0]
        by_slope = np.outer(from_middle, from_middle) / (self.along @ self.along)
        return variance * (1 / k + by_slope)

    def covariance_across(self, places: ndarray) -> ndarray:
        """Of m places (m, 2) on the line, x and z, (m, m, 2, 2) mm²; none along it."""
        square = np.outer(self.normal, self.normal)
        return self.offset_covariance(places)[..., None, None] * square


def straight_runs(profile: ndarray, uneven: float = 0.0) -> list[Run]:
    """The straight runs of a profile (n, 2), in scan order, whose points are off their
    lines by chance, or by `uneven` mm if that is more. A run holds most of what is seen
    between its ends.
    """
    shortest = 1.5  # mm
    rows, limit = surface(profile)
    limit = max(limit, uneven)
    runs = []
    for piece in split(profile.take(rows, axis=0), limit):
        run = run_through(profile, rows[piece], limit)
        between = run.rows[-1] - run.rows[0] + 1
        is_dense = len(run.rows) >= max(LEAST_POINTS, between / 2)
        if is_dense and run.length >= shortest:
            runs.append(run)
    return distinct(runs)


def split(points: ndarray, limit: float) -> list[ndarray]:
    """Pieces of points (k, 2), as indices, that are nearly straight.

    None leaves the chord between its ends by more than `limit`. A piece that does is
    cut where it is farthest from the chord.
    """
    pieces = []
    todo = [np.arange(len(points))]
    while todo:
        rows = todo.pop()
        if len(rows) < LEAST_POINTS:
            continue
        piece = points[rows]
        first = piece[:3].mean(axis=0)
        chord = piece[-3:].mean(axis=0) - first
        x, z = (piece - first).T
        apart = np.abs(x * chord[1] - z * chord[0])  # times the chord's length
        if apart.max() <= limit * np.hypot(*chord):
            pieces.append(rows)
        else:
            cut = max(apart.argmax(), 1)
            todo += [rows[cut:], rows[:cut]]
    return pieces


def run_through(profile: ndarray, rows: ndarray, limit: float) -> Run:
    """The run of a piece, rows (k,) of a profile, its line refitted to the points near
    it: those between the ends of the piece, and on from there.
    """
    for _ in range(7):  # two or three are usual
        run = Run.through(profile, rows, limit)
        on_line = np.abs(run.coordinates(profile)[1]) <= limit
        near = on_line.copy()
        near[rows[0] : rows[-1] + 1] = True
        parts = stretches(np.flatnonzero(near), LARGEST_GAP)
        # the part that holds the piece
        part = next(part for part in parts if part[-1] >= rows[-1])
        kept = part[on_line[part]]
        if len(kept) < 3 or np.array_equal(kept, rows):
            break
        rows = kept
    is_gap = np.diff(run.along) > LARGEST_GAP * run.spacing
    # one point or two beside a gap are spikes that are on the line by chance
    parts = np.split(run.rows, np.flatnonzero(is_gap) + 1)
    kept = [part for part in parts if len(part) > 2]
    return Run.through(profile, np.concatenate(kept or parts), limit)


def distinct(runs: list[Run]) -> list[Run]:
    """Runs, in scan order, without those of which runs with more points hold most."""
    kept: list[Run] = []
    taken: set[int] = set()
    for run in sorted(runs, key=lambda run: -len(run.rows)):
        if len(taken.intersection(run.rows)) < len(run.rows) / 2:
            kept.append(run)
            taken.update(run.rows)
    return sorted(kept, key=lambda run: run.rows[len(run.rows) // 2])
