"""Where straight runs end, finer than a profile's points are spaced, and what is
beyond. Functions look at a run's last point; `Run.reversed` shows them the first one.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.profiles.points import present
from profilecal.profiles.runs import Run

# mm beyond a run where the scanner looked and saw nothing: the run ends there
CLEAR = 5.0
# mm of a corner or a blade that rounding and the laser spot spoil; what is farther off
# a line is a step
BLUNT = 0.5
ZONE = 12  # points at a step among which the scanner may see both of its sides
ON_FACE = 3.5  # standard deviations from a run's line


@dataclass(frozen=True)
class View:
    """Where what a scanner sees ends, and which way is away from it."""

    points: ndarray  # (k, 2) mm, the ends of all straight runs
    # sign of z that points away from the scanner, told by its standoff; 0: not known
    away: int

    @staticmethod
    def from_runs(runs_by_profile: Iterable[list[Run]]) -> "View":
        """What each profile's straight runs tell; spikes could be anywhere."""
        ends = [
            np.concatenate([run.points[[0, -1]] for run in runs])
            for runs in runs_by_profile
            if runs
        ]
        if not ends:
            return View(np.zeros((0, 2)), 0)
        points = np.concatenate(ends)
        z = points[:, 1]
        usual_depth = np.median([np.ptp(own[:, 1]) for own in ends])
        side = int(np.sign(z[0]))
        is_far = (side * z > usual_depth / 2).all()
        return View(points, side if is_far else 0)

    def reaches_beyond(self, run: Run) -> bool:
        """Whether some profile has a point clearly farther out along x than a run's
        last point, at about its depth or nearer.
        """
        end = run.points[-1]
        deeper = self.points[:, 1] - end[1]
        # the view widens with depth
        alike = self.away * deeper < CLEAR if self.away else np.abs(deeper) < CLEAR
        outwards = (self.points[:, 0] - end[0]) * np.sign(run.direction[0])
        return bool((alike & (outwards > CLEAR)).any())


@dataclass(frozen=True)
class End:
    """Where a run ends."""

    tip: ndarray  # (2,) mm
    spacing: ndarray  # (2,) mm, from a point of the run to the next one, outwards
    overlaps: int  # how often the step's two sides alternate there
    # points of the step's side wall between one and two thresholds from the run's line
    wall: int
    variance: float  # of where a row is along the run, in points²


def facing(runs: list[Run]) -> list[Run]:
    """The runs that face the scanner; of side walls it sees a part alone."""
    steepest_deg = 65.0  # of a face that faces the scanner
    least = np.cos(np.radians(steepest_deg))
    return [run for run in runs if abs(run.direction[0]) > least]


def step_beyond(run: Run, view: View) -> int | None:
    """What follows a run's last point.

    After a step it is the sign of the change of z. It is 0 where nothing follows
    although the scanner looked, as missing points there or other profiles tell; None if
    that is unclear.
    """
    beyond = run.profile[run.rows[-1] + 1 :]
    seen = beyond[present(beyond)]
    if len(seen) >= 3:
        return step_to(seen, run)
    missing = (len(beyond) - len(seen)) * run.spacing
    return 0 if missing > CLEAR or view.reaches_beyond(run) else None


def step_to(points: ndarray, run: Run) -> int | None:
    """The sign of the change of z from a run to the points (k, 2) that follow it; None
    if that is no step.
    """
    thickness = 3.0  # mm of a face whose side wall may be seen
    wall = int(thickness / max(run.spacing, 1e-3))
    along, off = run.coordinates(points[: wall + 9])
    off = off * np.sign(run.direction[0])
    # a curve leaves the line more slowly
    soon = np.median(off[3:9] if len(off) >= 6 else off)
    if abs(soon) > max(BLUNT, 2 * run.limit):
        return int(np.sign(soon))
    behind_wall = np.median(off[wall:]) if len(off) > wall + 6 else 0.0
    near = np.abs(off) < CLEAR / 2
    # a wall, no bevel
    is_steep = near.any() and np.ptp(along[near]) < np.abs(off[near]).max()
    return int(np.sign(behind_wall)) if is_steep and abs(behind_wall) > CLEAR else None


def run_end(run: Run) -> End:
    """Where a run ends on its line, near its last point.

    The laser spot and the pixels blur a step over a few rows, each of which shows one
    side of it or the other. The last row that shows the run lies outside by about half
    of what the scanner resolves. How many of the rows show it has no such bias, so
    points are counted:

    1. The face is the run's points within a threshold of its line. Its last row is L.
    2. Of the Z rows up to L and the Z rows after it, N show points within the
       threshold. Were they the first N, without gaps, the last of them would be row
       L - Z + N, and the face would end half a row later, at L - Z + N + 1/2.
    3. A side wall that the scanner sees adds points to N. It crosses the line at a
       steady pace: as many are within one threshold as between one and two, which are
       counted, M. The face ends M rows earlier: E = L - Z + N - M + 1/2.
    4. The place of row E on the line, and the spacing of rows there, are those of a
       straight line through the face's last points: along = place + spacing (row - E).
       The points of a wall stay out of it, since a wall has no length along the line.
    """
    threshold = ON_FACE * np.sqrt(np.mean(run.off**2))
    on_face = np.abs(run.off) <= threshold
    rows, along = run.rows[on_face], run.along[on_face]
    last = rows[-1]

    zone = min(ZONE, len(rows) // 2)
    first = last - zone + 1
    off = np.abs(run.coordinates(run.profile[first : last + 1 + zone])[1])
    within = (off <= threshold).sum()  # false for NaN
    wall = (off <= 2 * threshold).sum() - within
    end = last - zone + within - wall + 0.5
    overlaps = (np.diff(rows[rows >= first]) > 1).sum()

    walled = min(2 * wall, len(rows) // 2)
    near = slice(-2 * ZONE - 2 * wall, len(rows) - walled)
    line, covariance = np.polyfit(rows[near] - end, along[near], 1, cov=True)
    spacing, place = max(line[0], 1e-3), line[1]
    tip = run.point + place * run.direction
    variance = covariance[1, 1] / spacing**2
    return End(tip, spacing * run.direction, overlaps, wall, variance)


def end_variance(ends: list[End]) -> float:
    """Of where a scan's runs end, along them, in points², by counting points, as all of
    the ends together show.

    Samples that come from anywhere within k spacings of their rays leave a number of
    points on a run that has the variance k/6 (k ≥ 1). The two sides of a step then
    alternate (k - 1)³ / 6k² times on average, which tells k. (Only scanners that keep
    the rows of missing points show all overlaps.)

    Where M points of a side wall were taken off, the end is at 2 N - N', with N and
    N' = N + M points within one and two thresholds. If M is small, the same samples
    decide on both: the variance is k/6 + 2 M. It is 5k/6 at most.
    """
    if not ends:
        return 0.0
    without_wall = [end for end in ends if not end.wall]
    overlaps = np.mean([end.overlaps for end in without_wall or ends])
    k = np.linspace(1, 40, 400)
    spot = np.interp(overlaps, (k - 1) ** 3 / (6 * k**2), k)
    wall = np.mean([end.wall for end in ends])
    return spot / 6 + min(2 * wall, 2 / 3 * spot)
