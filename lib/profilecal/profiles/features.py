"""What the target looks like in raw profiles: edge points, chord tips, arcs and lines, each with its covariance.

A profile is (n, 2), x and z in mm in scan order, as scanners give it: with gaps, spikes, missing points (NaN or depth
zero), backgrounds, the depth axis pointing either way. A profile in which the target is not clear has no feature and a
reason in words: a missing observation costs little, a wrong one much.
"""

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial

from profilecal.geometry.fitting import fit_circle
from profilecal.profiles.runs import (
    LARGEST_TOLERANCE,
    NOISE_LIMIT,
    SPIKE,
    Run,
    coordinates,
    correlation,
    present,
    run_of,
    straight_runs,
    tolerance,
    without_spikes,
)

LEAST_BEND_DEG = 15.0  # between the sides of a corner
BLUNT = 0.5  # mm around a corner that its rounding and the laser spot spoil
LEAST_SIDE = 10  # points on either side of it
REACH = 2.0  # mm from the end of a straight side to the corner, at most
LIKE_ANGLES_DEG = 20.0, 30.0  # from a corner's usual angle, and from that if tilted planes see nothing nearer to it
AMBIGUOUS = 0.5  # a second candidate with this share of the first one's support leaves the choice open
ALIKE = 0.8  # as many profiles that show the other end of a face leave open which is the edge
LEAST_CORNERS = 3  # profiles that show which end of a face is the edge
ZONE = 12  # points at the end of a run among which the scanner may see both sides of a step
ON_FACE = 3.5  # standard deviations from a run's line
LEAST_STEP = 0.5  # mm off a run's line: a step, not a bend
THICKNESS = 3.0  # mm of a face whose side wall may be seen
STEEPEST_DEG = 65.0  # of a face that faces the scanner
CLEAR = 5.0  # mm beyond a run in which the scanner sees nothing, though it looked: the run ends there
TIP_DEPTH, TIP_WIDTH = 0.5, 2.0  # mm of a blade that make up its tip, and its width there at most
LEAST_TIP_POINTS = 3
AROUND = 12  # points on either side of a tip that must be behind it
LEAST_ARC_DEG, LEAST_ARC_POINTS = 30.0, 20  # of a ball's circle that must be seen
LARGEST_RMS = 0.5  # tolerances, of an arc's points from the circle; pieces of lines near a circle have more
LEAST_SHARE = 0.9  # of the points along an arc that must lie on it
BLOCKS = 40  # points that stand for an arc or a line, each the mean of its neighbours
KINDS = ("edge", "disk", "ball", "plane")


@dataclass(frozen=True)
class Feature:
    """What one profile shows of the target; no points and a reason where it shows none."""

    points: np.ndarray  # (m, 2) mm; edge: 1; disk: the tips, smaller x first; ball and plane: up to 40 on the curve
    covariance: np.ndarray  # (m, 2, 2) mm²
    used: np.ndarray  # (n,) which of the profile's points it rests on
    shape: str = ""  # corner, step end, tip, chord, arc or line
    reason: str = ""  # why nothing was found
    between: np.ndarray | None = None  # (2, 2) mm², disk: covariance of the first tip with the second

    @property
    def found(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class End:
    """Where a run ends."""

    tip: np.ndarray  # (2,) mm
    spacing: np.ndarray  # (2,) mm, from a point of the run to the next one, outwards
    overlaps: int  # how often the step's two sides alternate there
    wall: int  # points of the step's side wall between one and two thresholds from the run's line
    variance: float  # of where that row is along the run, in points²


@dataclass(frozen=True)
class Candidate:
    """Something in a profile that may be the target's feature."""

    feature: Feature
    key: tuple  # what it has in common with the target's feature in other profiles: shape and side
    support: float  # mm
    angle: float = 0.0  # rad, inner angle of a corner
    ends: tuple = ()  # (m,) of End, where its points are the ends of runs


def find_features(kind: str, profiles, radius: float | None = None) -> list[Feature]:
    """The target's feature in each of a scan's profiles, (n, 2) mm, all of one target seen by one scanner.

    `kind` is edge, disk, ball or plane; `radius` that of the disk or ball, mm. The profiles are read together: what
    most of them show clearly settles which of several candidates the others show.

    Raises ValueError for another kind, a missing radius, or a profile of another shape.
    """
    if kind not in KINDS:
        raise ValueError(f"kind is {kind!r}; expected one of {', '.join(KINDS)}")
    if kind in ("disk", "ball") and not (radius and radius > 0):
        raise ValueError(f"the {kind}'s radius is {radius}; expected a length in mm")
    profiles = [np.asarray(profile, dtype=float) for profile in profiles]
    for k, profile in enumerate(profiles):
        if profile.ndim != 2 or profile.shape[1] != 2:
            raise ValueError(f"profile {k} has shape {profile.shape}; expected (n, 2), x and z")

    if kind == "ball":
        return [find_arc(profile, radius) for profile in profiles]
    runs = [straight_runs(profile) for profile in profiles]
    if kind == "plane":
        return [find_line(profile, found) for profile, (found, _) in zip(profiles, runs, strict=True)]
    view = View.of([p[np.concatenate([run.rows for run in r])] for p, (r, _) in zip(profiles, runs, strict=True) if r])
    if kind == "disk":
        candidates = in_front([chords(p, *r, radius, view) for p, r in zip(profiles, runs, strict=True)], view)
    else:
        candidates = [
            [*corners(p, r), *step_ends(p, r, limit, view), *tips(p, r, limit, view)]
            for p, (r, limit) in zip(profiles, runs, strict=True)
        ]
    return with_end_variance(choose(profiles, candidates, view))


def nothing(profile, reason: str) -> Feature:
    """No feature."""
    return Feature(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(len(profile), dtype=bool), "", reason)


def mask(profile, rows) -> np.ndarray:
    """Which points of a profile are the given rows, (n,)."""
    chosen = np.zeros(len(profile), dtype=bool)
    chosen[rows] = True
    return chosen


# What several profiles say together


@dataclass(frozen=True)
class View:
    """What all profiles of a scan tell of the scanner: where it sees something, which way depth grows."""

    points: np.ndarray  # (k, 2) outermost points at each depth, mm
    away: int  # sign of z that points away from the scanner, told by its standoff; 0: not known

    @staticmethod
    def of(straight) -> "View":
        """From the points (k, 2) on straight runs in each profile; spikes could be anywhere."""
        points = np.concatenate([*straight, np.zeros((0, 2))])
        z = points[:, 1]
        far = len(z) and np.abs(z).min() > np.median([np.ptp(p[:, 1]) for p in straight]) / 2
        away = int(np.sign(z[0])) if far and (np.sign(z) == np.sign(z[0])).all() else 0
        layer = np.round(z / 2).astype(int)
        order = np.lexsort((points[:, 0], layer))
        starts = np.flatnonzero(np.diff(layer[order], prepend=np.nan) != 0)
        outer = order[np.concatenate([starts, np.append(starts[1:], len(order)) - 1])] if len(order) else order
        return View(points[outer], away)

    def reaches_beyond(self, end, direction) -> bool:
        """Whether some profile has a point at about this depth, or nearer, clearly farther out along x."""
        deeper = self.points[:, 1] - end[1]
        like = self.away * deeper < CLEAR if self.away else np.abs(deeper) < CLEAR  # the view widens with depth
        return bool((like & ((self.points[:, 0] - end[0]) * np.sign(direction[0]) > CLEAR)).any())


def choose(profiles, candidates, view: View) -> list[Candidate]:
    """For each profile the candidate that is of the scan's kind, if just one is."""
    key, reason = common_key(candidates, view)
    if reason:
        return [Candidate(nothing(profile, reason), (), 0.0) for profile in profiles]
    alike = [sorted((c for c in found if c.key == key), key=lambda c: -c.support) for found in candidates]
    angles = np.array([found[0].angle for found in alike if found])
    middle = np.median(angles)
    spread = 6 * np.median(np.abs(angles - middle)) if len(angles) >= 5 else np.inf
    chosen = []
    for profile, found in zip(profiles, alike, strict=True):
        like = [[c for c in found if abs(c.angle - middle) <= max(a, spread)] for a in np.radians(LIKE_ANGLES_DEG)]
        near = like[0] or like[1]
        if not present(profile).any():
            reason = "nothing in this profile"
        elif not found:
            reason = f"no {key[0]} as in other profiles"
        elif not near:
            reason = f"a corner of {np.degrees(found[0].angle):.0f}°, {np.degrees(middle):.0f}° in other profiles"
        elif len(near) > 1 and near[1].support > AMBIGUOUS * near[0].support:
            reason = f"{len(near)} candidates for the {key[0]}, none clearly the best"
        else:
            chosen.append(near[0])
            continue
        chosen.append(Candidate(nothing(profile, reason), (), 0.0))
    return chosen


def common_key(candidates, view: View) -> tuple[tuple, str]:
    """What the target's feature is in this scan, or why that cannot be told.

    Of the kinds of candidates that are half as frequent as the most frequent one, or more, it is the first of: corners
    that point at the scanner, ends of faces, tips, corners that point away (where a wall meets a floor).
    """
    votes = Counter(key for found in candidates for key in {c.key for c in found})
    support = Counter()
    for c in (c for found in candidates for c in found):
        support[c.key] += c.support

    def order(key):
        hollow = key[0] == "corner" and key[1] * view.away > 0
        return 3 if hollow else ("corner", "step end", "tip", "chord").index(key[0])

    often = [key for key in votes if 2 * votes[key] >= max(votes.values())]
    if not often:
        return (), "nothing like the target in this profile"
    key = min(often, key=lambda key: (order(key), -votes[key], -support[key]))
    if any(k[0] == key[0] == "step end" and k != key and votes[k] > ALIKE * votes[key] for k in votes):
        corners = Counter(c.key for found in candidates for c in corners_of_faces(found) if order(c.key) == 0)
        if not corners or max(corners.values()) < LEAST_CORNERS:
            return (
                (),
                "both ends of a face are seen, in this profile or others: which is the edge? Show one of them only",
            )
        key = max(corners, key=lambda k: corners[k])  # the end with a side face, where that is seen
    return key, ""


def corners_of_faces(found) -> list[Candidate]:
    """The corners among a profile's candidates at which its longest face ends."""
    ends = [c for c in found if c.key[0] == "step end"]
    longest = max((c.support for c in ends), default=0.0)
    tips = [c.feature.points[0] for c in ends if c.support == longest]
    corners = [c for c in found if c.key[0] == "corner"]
    return [c for c in corners if any(np.hypot(*(c.feature.points[0] - tip)) < REACH for tip in tips)]


# Edge: corner, step end, tip


def corners(profile, runs) -> list[Candidate]:
    """Where neighbouring straight runs meet: the apex of a ridge, the corner of a bar."""
    found = []
    for first, second in pairwise(runs):
        if not is_bent(first, second):
            continue
        apex = crossing(first, second)
        sides = [beyond_blunt(profile, run, apex) for run in (first, second)]
        if any(side is None for side in sides) or not is_bent(*sides) or not ends_at(first, second, apex):
            continue
        apex = crossing(*sides)
        normals = np.stack([side.normal for side in sides])
        variance = np.diag([side.offset_variance(apex) for side in sides])
        inverse = np.linalg.inv(normals)
        used = mask(profile, np.concatenate([side.rows for side in sides]))
        feature = Feature(apex[None], (inverse @ variance @ inverse.T)[None], used, "corner")
        towards = first.direction - second.direction  # from between the sides to the apex and on
        bend = np.arccos(first.direction @ second.direction)
        key = ("corner", int(np.sign(towards[1])))
        found.append(Candidate(feature, key, min(side.length for side in sides), np.pi - bend))
    return found


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


def beyond_blunt(profile, run: Run, apex) -> Run | None:
    """The run without the points around the corner; None if too little is left."""
    rows = run.rows[np.abs(run.along - (apex - run.point) @ run.direction) > BLUNT]
    side = run_of(profile, rows) if len(rows) >= LEAST_SIDE else None
    return side if side and side.length > BLUNT else None


def step_ends(profile, runs, limit: float, view: View) -> list[Candidate]:
    """Where a face ends in front of something farther away, or of nothing."""
    found = []
    for run in facing(runs):
        for side in (-1, 1):
            how, depth = ending(profile, run, side, limit, view)
            behind = how == "step" and view.away * depth > 0
            if behind or how == "nothing":
                line = between_ends(profile, run)
                end = run_end(profile, run, line, side)
                across = np.outer(line.normal, line.normal) * line.offset_variance(end.tip)
                feature = Feature(end.tip[None], across[None], mask(profile, run.rows), "step end")
                key = ("step end", int(np.sign(end.tip[0] - run.point[0])))
                found.append(Candidate(feature, key, run.length, ends=(end,)))
    return found


def facing(runs) -> list[Run]:
    """Runs that face the scanner: no side walls, of which it sees as much as it can, not all."""
    return [run for run in runs if abs(run.direction[0]) > np.cos(np.radians(STEEPEST_DEG))]


def ending(profile, run: Run, side: int, limit: float, view: View) -> tuple[str, float]:
    """How a run ends at its last (side 1) or first point (-1): "step" with its change of z, "nothing" or "unclear".

    Nothing beyond counts only where the scanner looked: missing points follow, or other profiles reach farther.
    """
    last = run.rows[-1 if side > 0 else 0]
    beyond = np.arange(last + 1, len(profile)) if side > 0 else np.arange(last - 1, -1, -1)
    seen = beyond[present(profile[beyond])] if len(beyond) else beyond
    if len(seen) >= 3:
        wall = int(min(THICKNESS / max(run.spacing, 1e-3), len(profile)))
        along, off = coordinates(profile[seen[: wall + 9]], run.point, run.direction)
        off = off * np.sign(run.direction[0] or 1.0)
        soon = np.median(off[3:9] if len(off) >= 6 else off)  # or it is a curve
        if abs(soon) > max(LEAST_STEP, 2 * limit):
            return "step", float(np.sign(soon))
        after = np.median(off[wall:]) if len(off) > wall + 6 else 0.0
        near = np.abs(off) < CLEAR / 2
        steep = near.any() and np.ptp(along[near]) < np.abs(off[near]).max()  # a wall, no bevel
        return ("step", float(np.sign(after))) if steep and abs(after) > CLEAR else ("unclear", 0.0)
    looked = (len(beyond) - len(seen)) * run.spacing > CLEAR or view.reaches_beyond(profile[last], side * run.direction)
    return ("nothing", 0.0) if looked else ("unclear", 0.0)


def between_ends(profile, run: Run) -> Run:
    """The run without the points at its ends, of which some may show a side wall, if what is left makes a line."""
    if len(run.rows) <= 5 * ZONE:
        return run
    inner = run_of(profile, run.rows[ZONE:-ZONE])
    return inner if inner.length else run


def run_end(profile, run: Run, line: Run, side: int) -> End:
    """The end of a run on its line, finer than its points are spaced.

    The laser spot and the pixels blur a step over a few points, each of which shows one side or the other. Their number
    on the run, not the last of them, is an unbiased measure of where the run ends. (Its last point lies outside by
    about half of what the scanner resolves.) A side wall that is seen adds points near the run's line, as many within
    a threshold as between that and twice it.
    """
    threshold = ON_FACE * np.sqrt(np.mean(line.off**2))
    along, off = coordinates(profile[run.rows], line.point, line.direction)
    face = np.abs(off) <= threshold
    order = slice(None, None, side)
    rows, along = side * run.rows[face][order], side * along[face][order]
    zone = min(ZONE, len(rows) // 2)
    around = side * rows[-1] + np.arange(1 - zone, zone + 1) * side
    around = around[(around >= 0) & (around < len(profile))]
    off = np.abs(coordinates(profile[around], line.point, line.direction)[1])
    on, wall = int((off <= threshold).sum()), int(((off > threshold) & (off <= 2 * threshold)).sum())  # false for NaN
    near = slice(-4 * ZONE - 2 * wall, len(rows) - min(2 * wall, len(rows) // 2))  # a wall has no length along the line
    where = Polynomial.fit(rows[near], along[near], 2)  # a fan of rays spaces the points of a sloping face unevenly
    end = rows[-1] - zone + on - wall + 0.5
    tip = line.point + side * where(end) * line.direction
    spacing = max(where.deriv()(end), run.spacing / 10, 1e-3)
    basis = np.vander(where.mapparms()[0] + where.mapparms()[1] * np.append(rows[near], end), 3)
    left = along[near] - where(rows[near])
    leverage = basis[-1] @ np.linalg.pinv(basis[:-1].T @ basis[:-1]) @ basis[-1]
    fitted = leverage * (left @ left) / max(len(left) - 3, 1) / spacing**2
    return End(
        tip,
        side * spacing * line.direction,
        int((np.diff(rows[rows > rows[-1] - zone]) > 1).sum()),
        wall,
        float(fitted),
    )


def with_end_variance(chosen) -> list[Feature]:
    """The features, run ends with the variance along the run that all overlaps of the scan show.

    Samples that come from anywhere within w = k spacings alternate (k - 1)³ / 6k² times on average, and their number
    has the variance k/6 (k ≥ 1). Only scanners that keep the rows of missing points show all overlaps.

    Where M points of a side wall were taken off, the end is 2 N - N' with N and N' = N + M points within one and two
    thresholds. Noise moves such a point by M / ON_FACE points along the run, as if k² were larger by 12 (M / ON_FACE)².
    The same samples decide on N and N' if M is small: their covariance is k/6 (1 - M/k)³. A wall is perpendicular to
    its face: a sample from s beside its ray, which is reported on the ray, counts as if it came from s cos² of the
    slope, so that k is smaller by as much. Here M is its mean over faces of like slope, which see as much of the wall:
    an end must not weigh more because it saw few points of it by chance.
    """
    ends = [end for candidate in chosen for end in candidate.ends]
    if not ends:
        return [candidate.feature for candidate in chosen]
    overlaps = [end.overlaps for end in ends if not end.wall] or [end.overlaps for end in ends]
    k = np.linspace(1, 40, 400)
    spot = np.interp(np.mean(overlaps), (k - 1) ** 3 / (6 * k**2), k)
    slope = np.array([end.spacing / np.hypot(*end.spacing) for end in ends])  # (n, 2) cosine and sine
    wall = mean_of_like(slope[:, 1], [end.wall for end in ends])
    seen = spot * (1 - np.minimum(wall, 1) * slope[:, 1] ** 2)
    width = np.sqrt(seen**2 + 12 * (wall / ON_FACE) ** 2)
    variance = width / 6 * (5 - 4 * np.maximum(1 - wall / width, 0) ** 3)
    variance = iter(variance + [end.variance for end in ends])
    features = []
    for candidate in chosen:
        covariance = candidate.feature.covariance.copy()
        for row, end in enumerate(candidate.ends):
            covariance[row] += next(variance) * np.outer(end.spacing, end.spacing)
        features.append(replace(candidate.feature, covariance=covariance))
    return features


def mean_of_like(key, values, count: int = 15) -> np.ndarray:
    """For each of values (n,) the mean of those whose keys (n,) come next in order, `count` together."""
    order, count = np.argsort(key, kind="stable"), min(count, len(key))
    first = np.clip(np.arange(len(key)) - count // 2, 0, len(key) - count)
    total = np.concatenate([[0], np.cumsum(np.asarray(values)[order])])
    means = np.empty(len(key))
    means[order] = (total[first + count] - total[first]) / count
    return means


def tips(profile, runs, limit: float, view: View) -> list[Candidate]:
    """Narrow tips in front of a background or of nothing: a blade that points at the scanner."""
    seen = present(profile)
    free = seen.copy()
    for run in facing(runs):
        free[run.rows] = False
    rows = np.flatnonzero(free)
    found = []
    for cluster in np.split(rows, np.flatnonzero(np.diff(rows) > 3) + 1):
        for away in [view.away] if view.away else (1, -1):
            top = top_of(profile, seen, cluster, away)
            if top is not None:
                points = profile[top]
                apex = points.mean(axis=0)
                noise = limit / NOISE_LIMIT
                edge = [apex[0], away * (away * points[:, 1]).min()]  # or anywhere among them
                covariance = np.diag(np.maximum(((points - edge) ** 2).mean(axis=0), noise**2))
                feature = Feature(apex[None], covariance[None], mask(profile, top), "tip")
                found.append(Candidate(feature, ("tip", -away), 1.0))
    return found


def top_of(profile, seen, cluster, away: int) -> np.ndarray | None:
    """The rows of a cluster's top TIP_DEPTH if they are narrow and what surrounds the cluster lies behind them."""
    depth = away * profile[cluster, 1]
    order = np.argsort(depth)
    for nearest in depth[order[:3]]:  # up to two spikes in front
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


# Disk, plane and ball


def chords(profile, runs, limit: float, radius: float, view: View) -> list[Candidate]:
    """Straight runs no longer than the disk's diameter that end on both sides before a step or nothing."""
    found = []
    for run in facing(runs):
        endings = [ending(profile, run, side, limit, view) for side in (-1, 1)]
        steps = {depth for how, depth in endings if how == "step"}
        if any(how == "unclear" for how, _ in endings) or len(steps) > 1:
            continue
        line = between_ends(profile, run)
        ends = sorted((run_end(profile, run, line, side) for side in (-1, 1)), key=lambda end: end.tip[0])
        points = np.array([end.tip for end in ends])
        step = int(sum(steps))
        if np.linalg.norm(points[1] - points[0]) > 2 * radius + 4 * run.spacing:
            continue
        across = np.outer(line.normal, line.normal)
        variance = np.array([line.offset_variance(tip) for tip in points])
        between = across * line.offset_covariance(*points)  # both lie on one fitted line
        feature = Feature(points, variance[:, None, None] * across, mask(profile, run.rows), "chord", between=between)
        found.append(Candidate(feature, ("chord", step), run.length, ends=tuple(ends)))
    return found


def in_front(candidates, view: View) -> list[list[Candidate]]:
    """Chords without those that lie behind what surrounds them; which way that is, most of them tell if need be."""
    away = view.away or np.sign(sum(c.key[1] for found in candidates for c in found))
    return [[replace(c, key=("chord", 0)) for c in found if c.key[1] * away >= 0] for found in candidates]


def find_line(profile, runs) -> Feature:
    """The profile's dominant straight run."""
    runs = sorted(runs, key=lambda run: -run.length)
    if not runs:
        return nothing(profile, "no straight run in this profile")
    if len(runs) > 1 and runs[1].length > AMBIGUOUS * runs[0].length:
        lengths = f"{runs[0].length:.0f} and {runs[1].length:.0f} mm"
        return nothing(profile, f"two straight runs of similar length, {lengths}")
    best = runs[0]
    size = block_sizes(len(best.rows))
    along, off = means(best.along, size), means(best.off, size)
    points = best.point + along[:, None] * best.direction + off[:, None] * best.normal
    return Feature(points, block_covariance(best.off, size, 2), mask(profile, best.rows), "line")


def block_sizes(count: int) -> np.ndarray:
    """Of nearly equal blocks of neighbours, BLOCKS of them, (b,)."""
    return np.diff(np.linspace(0, count, min(BLOCKS, count) + 1).astype(int))


def means(values, size) -> np.ndarray:
    """Over blocks of `size` (b,) points, (b,)."""
    return np.add.reduceat(values, np.cumsum(size) - size) / size


def block_covariance(errors, size, fitted: int) -> np.ndarray:
    """Of the means over blocks of neighbours, (b, 2, 2) mm²: as much along the curve as across it."""
    variance = (errors**2).sum() / max(len(errors) - fitted, 1) * correlation(errors)
    return (variance / size)[:, None, None] * np.eye(2)


def find_arc(profile, radius: float) -> Feature:
    """The points of a circle no larger than the ball of `radius`, mm."""
    rows = np.flatnonzero(present(profile))
    if len(rows) < LEAST_ARC_POINTS:
        return nothing(profile, f"{len(rows)} points; an arc needs {LEAST_ARC_POINTS}")
    limit = tolerance(profile[rows, 1])
    if limit == LARGEST_TOLERANCE:
        return nothing(profile, "neighbouring points differ too much to be of one surface")
    rows = rows[without_spikes(profile[rows, 1], SPIKE * limit)]
    points = profile[rows]
    circle = best_circle(points, radius, limit)
    on = np.zeros(len(rows), dtype=bool)
    for _ in range(6):
        if circle is None or not np.isfinite(circle).all():
            break
        on = largest_part(np.abs(np.hypot(*(points - circle[:2]).T) - circle[2]) <= limit)
        with np.errstate(divide="ignore", invalid="ignore"):  # repeated points: NaN
            circle = fit_circle(points[on]) if on.sum() >= LEAST_ARC_POINTS else None
    if circle is None or not np.isfinite(circle).all():
        return nothing(profile, "no arc of a circle as large as the ball or smaller")
    offset = points[on] - circle[:2]
    angle, errors = np.unwrap(np.arctan2(offset[:, 1], offset[:, 0])), np.hypot(*offset.T) - circle[2]
    reason = why_no_arc(circle, angle, errors, on, radius, limit)
    if reason:
        return nothing(profile, reason)
    size = block_sizes(len(angle))
    angle, off = means(angle, size), means(errors, size)
    thinned = circle[:2] + (circle[2] + off)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return Feature(thinned, block_covariance(errors, size, 3), mask(profile, rows[on]), "arc")


def why_no_arc(circle, angle, errors, on, radius: float, limit: float) -> str:
    """What speaks against a circle being the ball's, in words; "" if nothing does."""
    extent = float(np.ptp(angle))
    if extent < np.radians(LEAST_ARC_DEG):
        return f"an arc of {np.degrees(extent):.0f}°; expected {LEAST_ARC_DEG:.0f}° or more"
    if circle[2] * (1 - np.cos(min(extent / 2, np.pi))) < 4 * limit:
        return "an arc too flat to be told from a line"
    if np.sqrt(np.mean(errors**2)) > LARGEST_RMS * limit:
        return "points that follow no circle"
    inside = on[on.argmax() : len(on) - on[::-1].argmax()]
    if inside.mean() < LEAST_SHARE:
        return f"only {100 * inside.mean():.0f} % of the points along the arc are on it"
    if circle[2] > 1.01 * radius + 4 * circle_radius_sd(angle, errors):
        return f"a circle of {circle[2]:.4g} mm; expected at most the ball's {radius:.4g} mm"
    return ""


def best_circle(points, radius: float, limit: float) -> np.ndarray | None:
    """Of circles through three points of a profile (k, 2) each, the one on which most points are; None if few are.

    The three are spread over stretches of different length, so that some see the arc alone, without spikes.
    """
    k = len(points)
    spans = np.unique(np.geomspace(max(8, k // 12), k - 1, 7).astype(int))
    triples = [
        np.stack([s, s + span // 2, s + span], axis=-1)
        for span in spans
        for s in [np.unique(np.linspace(0, k - 1 - span, 40).astype(int))]
    ]
    p, q, r = points[np.concatenate(triples)].transpose(1, 0, 2)
    a, b = q - p, r - p
    twice = 2 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        aa, bb = (a**2).sum(axis=1) / twice, (b**2).sum(axis=1) / twice
        centre = p + np.stack([b[:, 1] * aa - a[:, 1] * bb, a[:, 0] * bb - b[:, 0] * aa], axis=-1)
        size = np.hypot(*(centre - p).T)
    fits = np.isfinite(size) & (size < 1.2 * radius) & (size > 10 * limit)
    if not fits.any():
        return None
    centre, size = centre[fits], size[fits]
    few = points[:: max(1, k // 250)]
    distance = np.hypot(few[:, 0] - centre[:, :1], few[:, 1] - centre[:, 1:]) - size[:, None]
    count = (np.abs(distance) < limit).sum(axis=1)
    best = int(count.argmax())
    return np.append(centre[best], size[best]) if count[best] >= 10 else None


def largest_part(on) -> np.ndarray:
    """Of points that are `on` (k,), the stretch with most of them; more than 20 others together split stretches."""
    rows = np.flatnonzero(on)
    return mask(on, max(np.split(rows, np.flatnonzero(np.diff(rows) > 20) + 1), key=len))


def circle_radius_sd(angle, errors) -> float:
    """Standard deviation of the radius of a circle fitted to points at `angle` (k,) with `errors` (k,), mm."""
    J = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=-1)
    variance = (errors**2).sum() / max(len(errors) - 3, 1) * correlation(errors)
    return float(np.sqrt(variance * np.linalg.inv(J.T @ J)[2, 2]))
