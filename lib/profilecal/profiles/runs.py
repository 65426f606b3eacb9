"""The straight runs of a raw profile, by split and merge: what faces and chords leave
in what a scanner sends. A run survives gaps, spikes and missing points; it ends where
the profile leaves its line for good.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from profilecal.profiles.points import FOLLOWS, correlation, present, stretches, surface

LEAST_POINTS = 6  # of a piece that is worth merging


@dataclass(frozen=True)
class Run:
    """A straight piece of a profile: rows of it, and the line through their middle."""

    profile: np.ndarray  # (n, 2) mm
    rows: np.ndarray  # (k,) in scan order
    point: np.ndarray  # (2,) mm, the middle
    direction: np.ndarray  # (2,) in scan order
    along: np.ndarray  # (k,) mm, of its points from `point` along the line
    off: np.ndarray  # (k,) mm, of its points from the line

    @staticmethod
    def through(profile, rows) -> "Run":
        """The run of some rows of a profile, with the line nearest to them."""
        x, z = (column.take(rows) for column in profile.T)
        middle = np.array([x.mean(), z.mean()])
        x, z = x - middle[0], z - middle[1]
        angle = np.arctan2(2 * (x @ z), x @ x - z @ z) / 2
        if np.cos(angle) * (x[-1] - x[0]) + np.sin(angle) * (z[-1] - z[0]) < 0:
            angle += np.pi
        c, s = np.cos(angle), np.sin(angle)
        return Run(
            profile, rows, middle, np.array([c, s]), c * x + s * z, c * z - s * x
        )

    def reversed(self) -> "Run":
        """The same in the profile from its last point to its first."""
        rows = len(self.profile) - 1 - self.rows[::-1]
        return Run(
            self.profile[::-1],
            rows,
            self.point,
            -self.direction,
            -self.along[::-1],
            -self.off[::-1],
        )

    def coordinates(self, points) -> tuple[np.ndarray, np.ndarray]:
        """How far points (k, 2) are along the line and off it, mm."""
        away = points - self.point
        return away @ self.direction, away @ self.normal

    @property
    def points(self) -> np.ndarray:
        """(k, 2) mm."""
        return self.profile.take(self.rows, axis=0)

    @property
    def normal(self) -> np.ndarray:
        """Perpendicular to the direction, (2,)."""
        return np.array([-self.direction[1], self.direction[0]])

    @property
    def length(self) -> float:
        """From the first point to the last, mm."""
        return float(np.ptp(self.along))

    @property
    def spacing(self) -> float:
        """Between neighbouring points, mm."""
        rows = self.rows - self.rows.mean()
        return float(abs((rows * self.along).sum() / (rows**2).sum()))

    def offset_covariance(self, places) -> np.ndarray:
        """Of the line, across it, at places (m, 2) on it, (m, m) mm²; larger where
        neighbouring points err alike.
        """
        variance = (
            (self.off**2).sum() / max(len(self.off) - 2, 1) * correlation(self.off)
        )
        away = (places - self.point) @ self.direction
        return variance * (
            1 / len(self.along) + np.outer(away, away) / (self.along**2).sum()
        )


def straight_runs(profile) -> tuple[list[Run], float]:
    """The straight runs of a profile (n, 2), in scan order, and the tolerance that told
    them apart, mm.
    """
    profile = np.asarray(profile, dtype=float)
    seen = np.flatnonzero(present(profile))
    rows, limit = surface(profile, seen)
    points = profile.take(rows, axis=0)
    pieces = merge(split(points, limit), points, limit)
    runs = [run_through(profile, seen, rows[piece], limit) for piece in pieces]
    return distinct([run for run in runs if is_run(run, seen)]), limit


def split(points, limit: float) -> list[np.ndarray]:
    """Pieces of points (k, 2), as indices, none of which leaves the chord between its
    ends by more than `limit`.
    """
    (x, z), pieces, todo = points.T, [], [(0, len(points))]
    while todo:
        start, stop = todo.pop()
        if stop - start < LEAST_POINTS:
            continue
        first, last = (
            points[start : start + 3].mean(axis=0),
            points[stop - 3 : stop].mean(axis=0),
        )
        chord = last - first
        apart = np.abs(
            (x[start:stop] - first[0]) * chord[1]
            - (z[start:stop] - first[1]) * chord[0]
        )
        worst = int(apart.argmax())
        if apart[worst] <= limit * np.hypot(*chord) or stop - start < 2 * LEAST_POINTS:
            pieces.append(np.arange(start, stop))
        else:
            cut = start + min(max(worst, 1), stop - start - 1)
            todo += [(cut, stop), (start, cut)]
    return pieces


def merge(pieces, points, limit: float) -> list[np.ndarray]:
    """Neighbouring pieces of one line as one piece, the best match first."""

    def match(first, second):
        square = Run.through(points, np.concatenate([first, second])).off ** 2
        return np.sqrt(max(square[: len(first)].mean(), square[len(first) :].mean()))

    matches = [match(*pair) for pair in pairwise(pieces)]
    while matches and min(matches) < FOLLOWS * limit:
        k = int(np.argmin(matches))
        pieces[k : k + 2] = [np.concatenate(pieces[k : k + 2])]
        matches[k : k + 1] = []
        for j in (k - 1, k):
            if 0 <= j < len(matches):
                matches[j] = match(pieces[j], pieces[j + 1])
    return pieces


def run_through(profile, seen, rows, limit: float) -> Run:
    """The run of a piece: the line refitted to the points near it, between the piece's
    ends and on from there.
    """
    largest_gap = 8  # rows from one point on a line to the next: it goes on
    points = profile.take(seen, axis=0)
    for _ in range(2):
        on = np.abs(Run.through(profile, rows).coordinates(points)[1]) <= limit
        first, last = np.searchsorted(seen, (rows[0], rows[-1]))
        near = on.copy()
        near[first : last + 1] = True
        part = next(
            part
            for part in stretches(np.flatnonzero(near), largest_gap)
            if part[-1] >= last
        )
        if on[part].sum() < 3:
            break
        rows = seen[part[on[part]]]
    return Run.through(profile, rows)


def is_run(run: Run, seen) -> bool:
    """Whether a run is long enough and most of the points seen between its ends are on
    it.
    """
    shortest = 1.5  # mm of a run
    between = (
        np.searchsorted(seen, run.rows[-1]) - np.searchsorted(seen, run.rows[0]) + 1
    )
    return len(run.rows) >= max(LEAST_POINTS, between / 2) and run.length >= shortest


def distinct(runs) -> list[Run]:
    """Without runs most of whose points belong to one with more points; in scan order."""
    kept, taken = [], set()
    for run in sorted(runs, key=lambda run: -len(run.rows)):
        rows = set(run.rows.tolist())
        if len(rows & taken) < len(rows) / 2:
            kept.append(run)
            taken |= rows
    return sorted(kept, key=lambda run: run.rows[len(run.rows) // 2])
