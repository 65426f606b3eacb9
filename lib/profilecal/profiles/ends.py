"""Where straight runs end, finer than a profile's points are spaced, and what is
beyond. Functions look at a run's last point; `Run.reversed` shows them the first one.

Points are counted: N within a threshold of the run's line, of which M are of the side
wall. `run_end` says where that makes the run end, `end_variance` how well it is known.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.spatial import ConvexHull, QhullError

from profilecal.profiles.runs import LARGEST_GAP, Run

CLEAR = 5.0  # mm from a border at which a run ends by itself
# mm of a corner that rounding and the laser spot spoil; what is farther off a line is a
# step
BLUNT = 0.5
ZONE = 12  # points at a step among which the scanner may see both of its sides
ANYWHERE = np.array([[0.0, 0.0, 1.0]])  # a border that is near all points
FEW = 10  # profiles: in fewer a border need not show
ON_FACE = 3.5  # standard deviations from a run's line


@dataclass(frozen=True)
class View:
    """Where what a scanner sees may end, and which way is away from it.

    Borders are lines, a field of view being convex: sides of the convex hull of all
    that a scan shows, near which many of its runs end. A few ends are on a line by
    chance.
    """

    borders: ndarray  # (b, 3) lines n·p + d = 0, the unit normal n outwards
    # 1 where z grows away from the scanner, -1 where it falls, as its standoff tells;
    # 0: not known
    depth_sign: int

    @staticmethod
    def from_runs(runs_by_profile: Iterable[list[Run]]) -> "View":
        """What each profile's straight runs tell, but for their last two points, which
        may be spikes.
        """
        shown = [
            np.concatenate([run.points[[2, -3]] for run in runs])
            for runs in runs_by_profile
            if runs
        ]
        if not shown:
            return View(ANYWHERE, 0)
        z = np.concatenate(shown)[:, 1]
        usual_depth = np.median([np.ptp(own[:, 1]) for own in shown])
        sign = int(np.sign(z[0]))
        # all z on one side of zero, and far from it for the depth of a profile: zero is
        # at the scanner
        is_far = (sign * z > usual_depth / 2).all()
        return View(borders_of(shown), sign * is_far)

    def may_cut(self, point: ndarray) -> bool:
        """Whether the field of view may end at a point (2,)."""
        return bool((self.borders @ [*point, 1] > -CLEAR).any())


def borders_of(shown: list[ndarray]) -> ndarray:
    """The lines (b, 3) at which the field of view may end, from where the runs of each
    profile end, (k, 2).

    Most ends near a border are on it; those that a plan lines up spread by millimetres.
    Of fewer than `FEW` profiles any side of the hull may be one.
    """
    ends = np.concatenate(shown)
    try:
        sides = ConvexHull(ends).equations
    except (QhullError, ValueError):  # all on one line
        return ANYWHERE
    if len(shown) < FEW:
        return sides
    off = ends @ sides[:, :2].T + sides[:, 2]
    on, near = ((off > -mm).sum(axis=0) for mm in (BLUNT, CLEAR))
    return sides[(on > 2 + len(shown) / 10) & (on > near / 2)]


@dataclass(frozen=True)
class End:
    """Where a run ends."""

    point: ndarray  # (2,) mm
    spacing: ndarray  # (2,) mm, from a point of the run to the next one, outwards
    # how often the step's two sides alternate there: gaps among the run's last points,
    # in which rows show its other side, less those that are usual along the run
    overlaps: float
    # points of the step's side wall between one and two thresholds from the run's line
    wall_points: int
    variance: float  # of where a row is along the run, in points²


def facing(runs: list[Run]) -> list[Run]:
    """The runs that face the scanner; of side walls it sees a part alone."""
    steepest_deg = 65.0  # of a face that faces the scanner
    least = np.cos(np.radians(steepest_deg))
    return [run for run in runs if abs(run.direction[0]) > least]


def step_beyond(run: Run, view: View) -> int | None:
    """What follows a run's last point.

    After a step it is the sign of the change of z. It is 0 where nothing follows
    although the scanner looked; None if that is unclear, or there is no step.
    """
    beyond = run.profile[run.rows[-1] + 1 :]
    if len(beyond) < 3:
        return None if view.may_cut(run.points[-1]) else 0
    # some points that may show both sides, then as many as tell: a curve or a bevel
    # leaves the line more slowly
    both = max(3, int(0.4 / run.spacing))
    off = run.coordinates(beyond[: 3 * both])[1] * np.sign(run.direction[0])
    soon = np.median(off[both:] if len(off) >= 2 * both else off)
    return int(np.sign(soon)) if abs(soon) > max(BLUNT, 2 * run.limit) else None


def run_end(run: Run) -> End:
    """Where a run ends on its line, near its last point.

    The laser spot and the pixels blur a step over a few rows, each of which shows one
    side of it or the other. The last point that shows the run lies outside by about
    half of what the scanner resolves. How many points show it has no such bias, so they
    are counted:

    1. The face is the run's points within a threshold of its line, numbered one by one;
       only a long gap between them counts by its length.
    2. A parabola through points before the last ones, along as a function of their
       number, says where the face would end half a point after its last one. No line
       does: the spacing grows with depth.
    3. A side wall that the scanner sees adds points. It crosses the run's line at a
       steady pace: as many are within one threshold as between one and two, which are
       counted, M. The face ends M points earlier. A wall has no length along the line.
    """
    blurred = 4  # points at the end
    threshold = ON_FACE * np.sqrt(np.mean(run.off**2))
    on_face = np.abs(run.off) <= threshold
    rows, along = run.rows[on_face], run.along[on_face]
    zone = min(ZONE, len(rows) // 2)
    numbers, is_gap = numbered(rows, along)
    first, last = rows[-zone], rows[-1] + zone
    off = np.abs(run.coordinates(run.profile[first : last + 1])[1])
    wall = ((threshold < off) & (off <= 2 * threshold)).sum()
    from_end = numbers - (numbers[-1] - wall + 0.5)

    spoilt = min(max(blurred, 2 * wall), len(rows) // 2)
    clear = len(rows) - spoilt
    place, spacing, variance = end_at(from_end[:clear], along[:clear])
    point = run.point + place * run.direction
    usual = is_gap[: 1 - zone].mean()
    overlaps = is_gap[1 - zone :].sum() - (zone - 1) * usual
    return End(point, spacing * run.direction, overlaps, wall, variance)


def numbered(rows: ndarray, along: ndarray) -> tuple[ndarray, ndarray]:
    """Numbers (k,) of a face's points, one by one, where only a long gap counts by its
    length; and behind which points (k - 1,) there is any gap.
    """
    steps = np.diff(along)
    usual = steps[steps <= LARGEST_GAP * abs(steps.mean())].mean()
    steps = steps / max(usual, 1e-3)
    is_long = steps > LARGEST_GAP
    numbers = np.cumsum([0, *np.where(is_long, steps.round(), 1)])
    usual_spread = steps[~is_long].std()
    is_gap = (np.diff(rows) > 1) | (steps > 1 + 5 * usual_spread)
    return numbers, is_gap


def end_at(number: ndarray, along: ndarray) -> tuple[float, float, float]:
    """Where the point of number 0 would be, how far from the one before it, mm, and the
    variance of that place, in points².

    Where points are missing at random, the others stray from the curve, the farther the
    more steps they are apart: then the last one tells more than the curve.
    """
    last = 6 * ZONE  # so many that the rounding of their coordinates averages out
    degree = 2 if len(number) > ZONE else 1  # fewer points show no bend
    number, along = number[-last:], along[-last:]
    curve, covariance = np.polyfit(number, along, degree, cov=True)
    place, variance = curve[-1], covariance[-1, -1]
    spacing = max(curve[-2], 1e-3)

    off = along - np.polyval(curve, number)
    ahead = int(np.clip(-number[-1], 1, len(off) // 2))
    over_one, over_all = (np.var(off[k:] - off[:-k]) for k in (1, ahead))
    # independent errors are as far apart over any number of steps, those of a random
    # walk twice as far, squared, over two: half-way between
    if over_all > max(variance, 1.5 * over_one):
        # A walk goes as far ahead as `over_all`, of which the fit takes a part away;
        # the parabola's slope at the end is off besides. By the covariance of a walk
        # the variance is so many times `over_all`, to 4 %
        share = ahead / len(off)
        place = place + off[-1]
        variance = over_all * np.exp((7 + 1.4 * share) * share)
    return place, spacing, variance / spacing**2


def end_variance(ends: list[End]) -> float:
    """Of where a scan's runs end, along them, in points², by counting points, as all of
    the ends together show.

    Samples that come from anywhere within k spacings of their rays leave a number of
    points on a run that has the variance k/6 (k ≥ 1). With t the place among these
    spacings, one sample is beyond the step and the next before it

        ∫ (t / k) (1 - (t + 1) / k) dt = (k - 1)³ / 6k²,  t from 0 to k - 1

    times on average, which tells k.

    Where M points of a side wall were taken off, the end is at 2 N - N', with N and
    N' = N + M points within one and two thresholds. If M is small, the same samples
    decide on both: the variance is k/6 + 2 M. It is 5k/6 at most.
    """
    if not ends:
        return 0.0
    without_wall = [end for end in ends if not end.wall_points]
    overlaps = np.mean([end.overlaps for end in without_wall or ends])
    k = np.linspace(1, 40, 400)
    spot = np.interp(overlaps, (k - 1) ** 3 / (6 * k**2), k)
    wall = np.mean([end.wall_points for end in ends])
    return spot / 6 + min(2 * wall, 2 / 3 * spot)
