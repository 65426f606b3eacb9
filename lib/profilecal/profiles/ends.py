"""Where straight runs end, finer than a profile's points are spaced, and what is
beyond. Functions look at a run's last point; `Run.reversed` shows them the first one.
"""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.profiles.points import Feature, present
from profilecal.profiles.runs import Run

# mm beyond a run in which the scanner sees nothing, though it looked: the run ends
# there
CLEAR = 5.0
# mm that rounding and the laser spot spoil, of a corner or a blade; what is farther off
# a line is a step
BLUNT = 0.5
ZONE = 12  # points at a step among which the scanner may see both of its sides
ON_FACE = 3.5  # standard deviations from a run's line


@dataclass(frozen=True)
class View:
    """Where what a scanner sees ends, and which way is away from it."""

    points: np.ndarray  # (k, 2) mm
    # sign of z that points away from the scanner, told by its standoff; 0: not known
    away: int

    @staticmethod
    def of(runs) -> "View":
        """From each profile's straight runs; spikes could be anywhere."""
        ends = [
            np.concatenate([run.points[[0, -1]] for run in found])
            for found in runs
            if found
        ]
        points = np.concatenate([*ends, np.zeros((0, 2))])
        z = points[:, 1]
        far = (
            len(z) and np.abs(z).min() > np.median([np.ptp(p[:, 1]) for p in ends]) / 2
        )
        return View(
            points,
            int(np.sign(z[0])) if far and (np.sign(z) == np.sign(z[0])).all() else 0,
        )

    def reaches_beyond(self, end, direction) -> bool:
        """Whether some profile has a point at about this depth, or nearer, clearly
        farther out along x.
        """
        deeper = self.points[:, 1] - end[1]
        # the view widens with depth
        like = self.away * deeper < CLEAR if self.away else np.abs(deeper) < CLEAR
        return bool(
            (
                like & ((self.points[:, 0] - end[0]) * np.sign(direction[0]) > CLEAR)
            ).any()
        )


@dataclass(frozen=True)
class End:
    """Where a run ends."""

    tip: np.ndarray  # (2,) mm
    spacing: np.ndarray  # (2,) mm, from a point of the run to the next one, outwards
    overlaps: int  # how often the step's two sides alternate there
    # points of the step's side wall between one and two thresholds from the run's line
    wall: int
    variance: float  # of where a row is along the run, in points²


def facing(runs) -> list[Run]:
    """Runs that face the scanner: no side walls, of which it sees as much as it can,
    not all.
    """
    steepest_deg = 65.0  # of a face that faces the scanner
    return [
        run for run in runs if abs(run.direction[0]) > np.cos(np.radians(steepest_deg))
    ]


def step_beyond(run: Run, limit: float, view: View) -> int | None:
    """What follows a run's last point: a step, as the sign of its change of z; nothing,
    0, where the scanner looked, as missing points that follow or other profiles tell;
    None if that is unclear.
    """
    beyond = run.profile[run.rows[-1] + 1 :]
    seen = beyond[present(beyond)]
    if len(seen) >= 3:
        return step_to(seen, run, limit)
    missing = (len(beyond) - len(seen)) * run.spacing
    return (
        0
        if missing > CLEAR or view.reaches_beyond(run.points[-1], run.direction)
        else None
    )


def step_to(points, run: Run, limit: float) -> int | None:
    """The sign of the change of z from a run to the `points` (k, 2) that follow it;
    None if that is no step.
    """
    thickness = 3.0  # mm of a face whose side wall may be seen
    wall = int(thickness / max(run.spacing, 1e-3))
    along, off = run.coordinates(points[: wall + 9])
    off = off * np.sign(run.direction[0])
    # a curve leaves the line more slowly
    soon = np.median(off[3:9] if len(off) >= 6 else off)
    if abs(soon) > max(BLUNT, 2 * limit):
        return int(np.sign(soon))
    after = np.median(off[wall:]) if len(off) > wall + 6 else 0.0
    near = np.abs(off) < CLEAR / 2
    # a wall, no bevel
    steep = near.any() and np.ptp(along[near]) < np.abs(off[near]).max()
    return int(np.sign(after)) if steep and abs(after) > CLEAR else None


def run_end(run: Run) -> End:
    """The end of a run, at its last point, on its line.

    The laser spot and the pixels blur a step over a few points, each of which shows one
    side or the other. Their number on the run, not the last of them, is an unbiased
    measure of where the run ends: the last lies outside by about half of what the
    scanner resolves. A side wall adds as many points within a threshold of the line as
    between one and two.
    """
    threshold = ON_FACE * np.sqrt(np.mean(run.off**2))
    face = np.abs(run.off) <= threshold
    rows, along = run.rows[face], run.along[face]
    zone = min(ZONE, len(rows) // 2)
    around = run.profile[rows[-1] + 1 - zone : rows[-1] + 1 + zone]
    off = np.abs(run.coordinates(around)[1])
    on = int((off <= threshold).sum())  # false for NaN
    wall = int((off <= 2 * threshold).sum()) - on
    end = rows[-1] - zone + on - wall + 0.5
    overlaps = int((np.diff(rows[rows > rows[-1] - zone]) > 1).sum())
    # a wall has no length along the line
    near = slice(-2 * ZONE - 2 * wall, len(rows) - min(2 * wall, len(rows) // 2))
    (spacing, place), covariance = np.polyfit(
        rows[near] - end, along[near], 1, cov=True
    )
    spacing = max(spacing, 1e-3)
    tip = run.point + place * run.direction
    return End(
        tip, spacing * run.direction, overlaps, wall, covariance[1, 1] / spacing**2
    )


def with_end_variance(chosen) -> list[Feature]:
    """The features of candidates, with the variance of run ends along their runs."""
    counted = end_variance([end for candidate in chosen for end in candidate.ends])

    def widened(candidate):
        along = [
            (counted + end.variance) * np.outer(end.spacing, end.spacing)
            for end in candidate.ends
        ]
        feature = candidate.feature
        return (
            replace(feature, covariance=feature.covariance + along)
            if along
            else feature
        )

    return [widened(candidate) for candidate in chosen]


def end_variance(ends) -> float:
    """Of where a scan's runs end, along them, in points², by counting points, as all of
    the ends together show.

    Samples that come from anywhere within k spacings of their rays leave a number of
    points on a run that has the variance k/6 (k ≥ 1). The two sides of a step then
    alternate (k - 1)³ / 6k² times on average, which tells k. (Only scanners that keep
    the rows of missing points show all overlaps.)

    Where M points of a side wall were taken off, the end is 2 N - N' with N and N' = N
    + M points within one and two thresholds. If M is small, the same samples decide on
    both: the variance is k/6 + 2 M. It is 5k/6 at most.
    """
    if not ends:
        return 0.0
    overlaps = [end.overlaps for end in ends if not end.wall] or [
        end.overlaps for end in ends
    ]
    k = np.linspace(1, 40, 400)
    spot = np.interp(np.mean(overlaps), (k - 1) ** 3 / (6 * k**2), k)
    return spot / 6 + min(2 * np.mean([end.wall for end in ends]), 2 / 3 * spot)
