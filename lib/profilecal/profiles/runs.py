"""The straight runs of a raw profile, by split and merge: what faces and chords leave in what a scanner sends.

A run survives gaps, spikes and missing points; it ends where the profile leaves its line for good.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

NOISE_LIMIT = 5.0  # standard deviations of the noise from a line within which points are on it
LEAST_TOLERANCE, LARGEST_TOLERANCE = 0.1, 2.0  # mm, however quiet; a profile that needs more shows no surface
LEAST_POINTS = 6  # of a piece that is worth merging
SHORTEST = 1.5  # mm of a run
LEAST_SHARE = 0.5  # of the points between a run's ends
WINDOW = 7  # points whose median a spike leaves
SPIKE = 5.0  # tolerances


@dataclass(frozen=True)
class Run:
    """A straight piece of a profile: the line through its middle `point` along `direction`, from `start` to `stop`."""

    rows: np.ndarray  # (k,) of the profile's points on it, in scan order
    point: np.ndarray  # (2,) mm
    direction: np.ndarray  # (2,) in scan order
    along: np.ndarray  # (k,) mm from `point`
    off: np.ndarray  # (k,) mm from the line

    @property
    def normal(self) -> np.ndarray:
        """Perpendicular to the direction, (2,)."""
        return np.array([-self.direction[1], self.direction[0]])

    @property
    def length(self) -> float:
        """From the first point to the last, mm."""
        return float(np.ptp(self.along))

    @property
    def variance(self) -> float:
        """Of the offset of points from the line, mm², as the line feels it: enlarged where neighbours err alike."""
        return float((self.off**2).sum() / max(len(self.off) - 2, 1) * correlation(self.off))

    @property
    def spacing(self) -> float:
        """Between neighbouring points, mm."""
        rows = self.rows - self.rows.mean()
        return float(abs((rows * self.along).sum() / (rows**2).sum()))

    def offset_covariance(self, first, second) -> float:
        """Of the line's offsets, across it, at two places (2,) on it, mm²."""
        away = (np.array([first, second]) - self.point) @ self.direction
        return float(self.variance * (1 / len(self.along) + away[0] * away[1] / (self.along**2).sum()))

    def offset_variance(self, place) -> float:
        """Of the line at a place (2,) on it, across, mm²."""
        return self.offset_covariance(place, place)


def correlation(errors, lags: int = 40) -> float:
    """How many times the variance of a mean of `errors` (k,) exceeds that of independent ones: 1 + 2 Σ ρ.

    Summed up to the first autocorrelation that is not twice its own standard error away from zero.
    """
    k = len(errors)
    square = (errors**2).sum()
    total = 1.0
    for lag in range(1, min(lags, k // 4)):
        rho = (errors[lag:] * errors[:-lag]).sum() / square if square else 0.0
        if rho < 2 / np.sqrt(k):
            break
        total += 2 * rho
    return total


def present(profile) -> np.ndarray:
    """Which points (n,) of a profile (n, 2) the scanner saw: finite, and no zero depth that stands for nothing.

    A zero is a depth only between points within a millimetre of it.
    """
    finite = np.isfinite(profile).all(axis=1)
    zero = finite & (profile[:, 1] == 0)
    real = np.flatnonzero(finite & ~zero)
    if zero.any() and real.size:
        rows = np.flatnonzero(zero)
        after = np.searchsorted(real, rows)
        depth = np.abs(profile[real, 1])
        near = np.maximum(depth[np.clip(after - 1, 0, None)], depth[np.clip(after, None, real.size - 1)]) < 1
        zero[rows[near]] = False
    return finite & ~zero


def tolerance(z) -> float:
    """How far points are from a smooth outline by chance at most, mm, from the second differences of z (k,)."""
    if len(z) < 5:
        return LEAST_TOLERANCE
    second = np.abs(z[2:] - 2 * z[1:-1] + z[:-2])
    sigma = np.partition(second, int(0.68 * len(second)))[int(0.68 * len(second))] / np.sqrt(6)
    return float(np.clip(NOISE_LIMIT * sigma, LEAST_TOLERANCE, LARGEST_TOLERANCE))


def without_spikes(z, limit: float) -> np.ndarray:
    """Which depths (k,) lie within `limit` of the median of their neighbours."""
    if len(z) < WINDOW:
        return np.ones(len(z), dtype=bool)
    padded = np.pad(z, WINDOW // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)
    return np.abs(z - np.partition(windows, WINDOW // 2, axis=1)[:, WINDOW // 2]) <= limit


def straight_runs(profile) -> tuple[list[Run], float]:
    """The straight runs of a profile (n, 2), in scan order, and the tolerance that told them apart, mm."""
    profile = np.asarray(profile, dtype=float)
    seen = np.flatnonzero(present(profile))
    limit = tolerance(profile[seen, 1])
    if limit == LARGEST_TOLERANCE:
        return [], limit
    rows = seen[without_spikes(profile[seen, 1], SPIKE * limit)]
    points = profile[rows]
    pieces = merge([piece for piece in split(points, limit) if len(piece) >= LEAST_POINTS], points, limit)
    runs = [run_through(profile, seen, rows[piece], limit) for piece in pieces]
    return distinct([run for run in runs if is_run(run, seen)]), limit


def is_run(run: Run, seen) -> bool:
    """Whether a run is long enough and most of the points seen between its ends are on it."""
    between = np.searchsorted(seen, run.rows[-1]) - np.searchsorted(seen, run.rows[0]) + 1
    return len(run.rows) >= max(LEAST_POINTS, LEAST_SHARE * between) and run.length >= SHORTEST


def distinct(runs) -> list[Run]:
    """Without runs most of whose points belong to one with more points; in scan order."""
    kept, taken = [], set()
    for run in sorted(runs, key=lambda run: -len(run.rows)):
        rows = set(run.rows.tolist())
        if len(rows & taken) < len(rows) / 2:
            kept.append(run)
            taken |= rows
    return sorted(kept, key=lambda run: run.rows[len(run.rows) // 2])


def line_through(points) -> tuple[np.ndarray, np.ndarray]:
    """Middle and unit direction, from the first towards the last, of the line nearest to points (k, 2)."""
    middle = points.mean(axis=0)
    x, z = (points - middle).T
    angle = np.arctan2(2 * x @ z, x @ x - z @ z) / 2
    direction = np.array([np.cos(angle), np.sin(angle)])
    return middle, -direction if direction @ (points[-1] - points[0]) < 0 else direction


def coordinates(points, middle, direction) -> tuple[np.ndarray, np.ndarray]:
    """How far points (k, 2) are along a line and off it, mm."""
    x, z = (points - middle).T
    return x * direction[0] + z * direction[1], z * direction[0] - x * direction[1]


def run_of(profile, rows) -> Run:
    """The run through some rows of a profile."""
    line = line_through(profile[rows])
    return Run(rows, *line, *coordinates(profile[rows], *line))


def split(points, limit: float) -> list[np.ndarray]:
    """Pieces of points (k, 2), as indices, none of which leaves the chord between its ends by more than `limit`."""
    pieces, todo = [], [(0, len(points))]
    while todo:
        start, stop = todo.pop()
        if stop - start < LEAST_POINTS:
            continue
        first, last = points[start : start + 3].mean(axis=0), points[stop - 3 : stop].mean(axis=0)
        chord = last - first
        offset = points[start:stop] - first
        apart = np.abs(offset[:, 0] * chord[1] - offset[:, 1] * chord[0])
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
        line = line_through(points[np.concatenate([first, second])])
        return max(np.sqrt(np.mean(coordinates(points[piece], *line)[1] ** 2)) for piece in (first, second))

    pieces = list(pieces)
    matches = [match(*pair) for pair in pairwise(pieces)]
    while matches and min(matches) < 0.4 * limit:
        k = int(np.argmin(matches))
        pieces[k : k + 2] = [np.concatenate(pieces[k : k + 2])]
        matches[k : k + 1] = []
        for j in (k - 1, k):
            if 0 <= j < len(matches):
                matches[j] = match(pieces[j], pieces[j + 1])
    return pieces


def run_through(profile, seen, rows, limit: float) -> Run:
    """The run of a piece: the line refitted to the points near it, between the piece's ends and on from there."""
    for _ in range(2):
        on = np.abs(coordinates(profile[seen], *line_through(profile[rows]))[1]) <= limit
        first, last = np.searchsorted(seen, (rows[0], rows[-1]))
        first, last = len(on) - 1 - on_from(on[::-1], len(on) - 1 - first), on_from(on, last)
        chosen = first + np.flatnonzero(on[first : last + 1])
        if len(chosen) < 3:
            break
        rows = seen[chosen]
    return run_of(profile, rows)


def on_from(on, last: int, reach: int = 8) -> int:
    """The last of the points that are `on`, from `last` on, before more than `reach` together are not."""
    later = np.concatenate([[last], np.flatnonzero(on[last + 1 :]) + last + 1])
    far = np.flatnonzero(np.diff(later) > reach)
    return int(later[far[0]] if far.size else later[-1])
