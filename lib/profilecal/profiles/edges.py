"""Finders of straight edges, and of faces, in raw profiles. Where a profile shows
several things, what most profiles of a scan show tells which is the target's.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.lib.stride_tricks import sliding_window_view

from profilecal.geometry.progress import watched
from profilecal.profiles.ends import (
    BLUNT,
    ZONE,
    End,
    View,
    end_variance,
    facing,
    run_end,
    step_beyond,
)
from profilecal.profiles.points import (
    NOISE_LIMIT,
    Feature,
    Profiles,
    block_means,
    nothing,
    stretches,
    tolerance,
)
from profilecal.profiles.runs import LEAST_POINTS, Run, runs_in_each, straight_runs

# a second candidate with this share of what supports the first leaves the choice open
AMBIGUOUS = 0.5
SHAPES = ("corner", "step end", "tip")  # in this order if many profiles show several
BLADE = (
    "edge points are tips of a blade, which the scanner sees beside the edge by an "
    "amount that depends on the orientation"
)
LEAST_SIDE = 10  # points on either side of a corner
# mm: from the ends of straight sides to their corner, and across a blade's tip, at most
NEAR = 2.0


class Look(NamedTuple):
    """What the target's features in all profiles of a scan have in common."""

    shape: str
    # the sign of x or z that tells a feature from others of its shape: where a corner
    # or a tip points in z, at which end of its face in x a step end is; 0: nothing does
    side: int = 0


@dataclass(frozen=True)
class Candidate:
    """Something in a profile that may be the target's feature."""

    feature: Feature
    side: int = 0  # of its look
    support: float = 0.0  # mm
    angle: float = 0.0  # rad, inner angle of a corner
    ends: tuple[End, ...] = ()  # where its points are the ends of runs

    @property
    def look(self) -> Look:
        """What it has in common with the target's feature in other profiles."""
        return Look(self.feature.shape, self.side)


def choose(
    profiles: Profiles,
    found: list[list[Run]],
    candidates: list[list[Candidate]],
    shape: str,
) -> list[Feature]:
    """For each profile, with the straight runs found in it, the feature of a shape if
    just one candidate for it is clear; else nothing, with the reason.
    """
    ranked = [sorted(own, key=lambda c: -c.support) for own in candidates]
    angles = np.array([own[0].angle for own in ranked if own])
    if not len(angles):
        counts = map(len, profiles)
        return [nothing(f"nothing like the target in {n} points") for n in counts]
    usual = np.median(angles)
    spread = 6 * np.median(np.abs(angles - usual)) if len(angles) >= 5 else np.inf
    # tilted planes see corners at other angles, if nothing nearer
    close, wide = np.maximum(np.radians([20, 30]), spread)
    chosen = []
    for profile, runs, own in zip(profiles, found, ranked, strict=True):
        near = [c for c in own if abs(c.angle - usual) <= close]
        near = near or [c for c in own if abs(c.angle - usual) <= wide]
        reason = ""
        if not own:
            reason = why_missed(profile, runs, shape)
        elif not near:
            angle, expected = np.degrees([own[0].angle, usual])
            reason = f"a corner of {angle:.0f}°, {expected:.0f}° in other profiles"
        elif len(near) > 1 and near[1].support > AMBIGUOUS * near[0].support:
            reason = f"{len(near)} candidates for the {shape}, none clearly the best"
        chosen.append(Candidate(nothing(reason)) if reason else near[0])
    return with_end_variance(chosen)


def with_end_variance(chosen: list[Candidate]) -> list[Feature]:
    """The features of candidates, with the variance of run ends along their runs."""
    counted = end_variance([end for candidate in chosen for end in candidate.ends])
    features = []
    for candidate in chosen:
        feature = candidate.feature
        along = [
            (counted + end.variance) * np.outer(end.spacing, end.spacing)
            for end in candidate.ends
        ]
        covariance = feature.covariance + (along or 0.0)
        features.append(replace(feature, covariance=covariance))
    return features


def find_edges(profiles: Profiles) -> list[Feature]:
    """The edge in each profile (n, 2), mm.

    It is, of what many profiles show, the first of: corners that point at the scanner,
    ends of faces, tips, and corners that point away, where a wall meets a floor.
    """
    found = runs_in_each(profiles)
    view = View.from_runs(found)
    candidates = [
        [*corners(runs), *step_ends(runs, view), *tips(profile, runs, view)]
        for profile, runs in zip(profiles, found, strict=True)
    ]
    shown_by = Counter(look for own in candidates for look in {c.look for c in own})
    look = usual_look(candidates, shown_by, view.away)
    other_end = Look(look.shape, -look.side)
    if look.shape == "step end" and shown_by[other_end] > AMBIGUOUS * shown_by[look]:
        side_face = look_of_side_faces(candidates, view.away)
        if side_face is None:
            reason = (
                "both ends of a face are seen, in this profile or others: "
                "which is the edge? Show one of them only"
            )
            return [nothing(reason)] * len(profiles)
        look = side_face
    alike = [[c for c in own if c.look == look] for own in candidates]
    return choose(profiles, found, alike, look.shape)


def usual_look(
    candidates: list[list[Candidate]], shown_by: Counter[Look], away: int
) -> Look:
    """The look of the edge, from how many profiles each look is `shown_by`.

    Of the looks that at least half as many profiles show as show the most frequent one,
    it is the first in rank, then the most frequent, then the best supported, and where
    all that ties the one of smaller side, so that no order of a set decides.
    """
    most = max(shown_by.values(), default=0)
    often = [look for look, count in shown_by.items() if 2 * count >= most]

    def order(look: Look) -> tuple[int, int, float, int]:
        support = sum(c.support for own in candidates for c in own if c.look == look)
        return rank(look, away), -shown_by[look], -support, look.side

    return min(often, key=order, default=Look(""))


def rank(look: Look, away: int) -> int:
    """The place of a look among those of edges; corners that point away come last."""
    is_hollow = look.shape == "corner" and look.side * away > 0
    return len(SHAPES) if is_hollow else SHAPES.index(look.shape)


def look_of_side_faces(candidates: list[list[Candidate]], away: int) -> Look | None:
    """Of corners that point at the scanner where a profile's longest face ends, the
    most frequent look: a side face is seen there. None if fewer than three show it.
    """
    shown: Counter[Look] = Counter()
    for own in candidates:
        ends = [c for c in own if c.look.shape == "step end"]
        longest = max((end.support for end in ends), default=0.0)
        tips = [end.feature.points for end in ends if end.support == longest]
        for corner in own:
            apart = [np.hypot(*(corner.feature.points - tip)[0]) for tip in tips]
            if rank(corner.look, away) == 0 and min(apart, default=NEAR) < NEAR:
                shown[corner.look] += 1
    return next((look for look, count in shown.most_common(1) if count >= 3), None)


def corners(runs: list[Run]) -> Iterator[Candidate]:
    """Where neighbouring straight runs meet: a ridge's apex, the corner of a bar.

    The lines rest on points beyond its rounding; there is none where these are too few.
    """
    for first, second in pairwise(runs):
        if not form_corner(first, second):
            continue
        rounded = crossing(first, second)
        before = beyond_blunt(first, rounded)
        after = beyond_blunt(second, rounded)
        if not before or not after or not is_bent(before, after):
            continue
        apex = crossing(before, after)
        covariance = crossing_covariance(before, after, apex)
        used = np.concatenate([before.rows, after.rows])
        feature = Feature(apex[None], covariance[None], used, "corner")
        # from between the sides to the apex and on
        towards = first.direction - second.direction
        side = int(np.sign(towards[1]))
        bend = np.arccos(first.direction @ second.direction)
        support = min(before.length, after.length)
        yield Candidate(feature, side, support, np.pi - bend)


def why_missed(profile: ndarray, runs: list[Run], shape: str) -> str:
    """What keeps a profile from showing a shape; of a corner, as far as its straight
    runs tell.
    """
    if not len(profile):
        return "nothing in this profile"
    if shape == "corner":
        if any(form_corner(*pair) for pair in pairwise(runs)):
            few = f"fewer than {LEAST_SIDE} points beyond its rounding"
            return f"one side of the corner shows {few}"
        if len(runs) == 1:
            return "one side of the corner shows too few points for a line"
    return f"no {shape} as in other profiles"


def form_corner(first: Run, second: Run) -> bool:
    """Whether the first run ends and the second begins within reach of where their
    lines meet at an angle.
    """
    if not is_bent(first, second):
        return False
    apex = crossing(first, second)
    end = (apex - first.point) @ first.direction - first.along[-1]
    start = (apex - second.point) @ second.direction - second.along[0]
    return abs(end) < NEAR and abs(start) < NEAR


def is_bent(first: Run, second: Run) -> bool:
    """Whether two runs are at an angle, neither straight on nor straight back."""
    least_bend_deg = 15.0  # between the sides of a corner
    cosine = abs(first.direction @ second.direction)
    return bool(cosine < np.cos(np.radians(least_bend_deg)))


def crossing(first: Run, second: Run) -> ndarray:
    """Where the lines of two runs meet, (2,)."""
    normals = [first.normal, second.normal]
    offsets = [first.normal @ first.point, second.normal @ second.point]
    return np.linalg.solve(normals, offsets)


def crossing_covariance(first: Run, second: Run, apex: ndarray) -> ndarray:
    """Of the place where the lines of two runs meet, (2, 2) mm²."""
    lines = (first, second)
    variances = [line.offset_covariance(apex[None])[0, 0] for line in lines]
    inverse = np.linalg.inv([line.normal for line in lines])
    return inverse @ np.diag(variances) @ inverse.T


def beyond_blunt(run: Run, apex: ndarray) -> Run | None:
    """The run without the points around the corner; None if too little is left."""
    from_apex = run.along - (apex - run.point) @ run.direction
    rows = run.rows[np.abs(from_apex) > BLUNT]
    if len(rows) < LEAST_SIDE:
        return None
    return Run.through(run.profile, rows, run.limit)


def step_ends(runs: list[Run], view: View) -> Iterator[Candidate]:
    """Where a face ends in front of something farther away, or of nothing."""
    for run in facing(runs):
        for outwards in (run.reversed(), run):
            step = step_beyond(outwards, view)
            if step is None or (step != 0 and step * view.away <= 0):
                continue
            end = run_end(outwards)
            tip = end.tip[None]
            covariance = run.covariance_across(tip)[0]
            feature = Feature(tip, covariance, run.rows, "step end")
            side = int(np.sign(end.tip[0] - run.point[0]))
            yield Candidate(feature, side, run.length, ends=(end,))


def tips(profile: ndarray, runs: list[Run], view: View) -> Iterator[Candidate]:
    """Narrow tips in front of a background or of nothing: a blade that points at the
    scanner.
    """
    noise = tolerance(profile[:, 1]) / NOISE_LIMIT
    free = np.ones(len(profile), dtype=bool)
    for run in facing(runs):
        free[run.rows] = False
    for cluster in stretches(np.flatnonzero(free), 3):
        for away in [view.away] if view.away else (1, -1):
            top = top_of(profile, view, cluster, away)
            if not len(top):
                continue
            points = profile[top]
            apex = points.mean(axis=0)
            # the edge may be anywhere among them
            edge = [apex[0], away * (away * points[:, 1]).min()]
            spread = ((points - edge) ** 2).mean(axis=0)
            variances = np.maximum(spread, noise**2)
            covariance = np.diag(variances)[None]
            feature = Feature(apex[None], covariance, top, "tip", bias=BLADE)
            yield Candidate(feature, -away, 1.0)


def top_of(profile: ndarray, view: View, cluster: ndarray, away: int) -> ndarray:
    """The rows of a cluster's top BLUNT if they are narrow and what surrounds the
    cluster lies behind them; else none.
    """
    none = cluster[:0]
    depth = away * profile[:, 1]
    front = np.sort(depth[cluster])
    # three points close to each other: spikes may be in front of them
    close = front[2:] < front[:-2] + BLUNT
    if not close.any():
        return none
    nearest = front[close.argmax()]
    is_top = (depth[cluster] >= nearest) & (depth[cluster] < nearest + BLUNT)
    top = cluster[is_top]
    if np.ptp(profile[top, 0]) > NEAR:
        return none
    first, last = top[0], top[-1]
    before, after = depth[:first][-ZONE:], depth[last + 1 :][:ZONE]
    for end, beside in ((first, before), (last, after)):
        if len(beside) < 3 and view.may_cut(profile[end]):
            return none
        if len(beside) and np.median(beside) < nearest + BLUNT:
            return none
    return top


def find_chords(profiles: Profiles, radius: float) -> list[Feature]:
    """The tips of the disk's chord in each profile (n, 2), mm."""
    found = runs_in_each(profiles)
    view = View.from_runs(found)
    candidates = [list(chords(runs, radius, view)) for runs in found]
    # most chords are in front
    away = view.away or np.sign(sum(c.side for own in candidates for c in own))
    in_front = [[c for c in own if c.side * away >= 0] for own in candidates]
    return choose(profiles, found, in_front, "chord")


def chords(runs: list[Run], radius: float, view: View) -> Iterator[Candidate]:
    """Straight runs no longer than the disk's diameter that end on both sides before a
    step or nothing.
    """
    for run in facing(runs):
        start, stop = run.reversed(), run
        before = step_beyond(start, view)
        after = step_beyond(stop, view)
        if before is None or after is None or before * after < 0:
            continue
        ends = sorted(map(run_end, (start, stop)), key=lambda end: end.tip[0])
        tips = np.stack([end.tip for end in ends])
        if np.linalg.norm(tips[1] - tips[0]) > 2 * radius + 4 * run.spacing:
            continue
        covariance = run.covariance_across(tips)
        own = covariance[[0, 1], [0, 1]]
        feature = Feature(tips, own, run.rows, "chord", between=covariance[0, 1])
        yield Candidate(feature, before or after, run.length, ends=tuple(ends))


def find_lines(profiles: Profiles) -> list[Feature]:
    """The face in each profile (n, 2), mm, as up to 40 means over points of a line."""
    return [*map(find_line, watched(profiles, "looking for the target"))]


def find_line(profile: ndarray) -> Feature:
    """A profile's longest face, if no other is nearly as long."""
    runs = sorted(faces(profile), key=lambda run: -run.length)
    if not runs:
        return nothing("no straight run in this profile")
    best = runs[0]
    if len(runs) > 1 and runs[1].length > AMBIGUOUS * best.length:
        lengths = f"{best.length:.0f} and {runs[1].length:.0f} mm"
        return nothing(f"two straight runs of similar length, {lengths}")
    normals = np.broadcast_to(best.normal, (len(best.off), 2))
    points, _, covariance = block_means(best.points, best.off, normals)
    return Feature(points, covariance, best.rows, "line")


def faces(profile: ndarray) -> list[Run]:
    """Straight runs of points that go on without a step, off their lines by less than
    a millimetre: a board is not quite flat.

    Neighbouring points then err alike, which makes the covariance of a face larger.
    """
    uneven = 1.0  # mm
    limit = tolerance(profile[:, 1])
    return [
        Run.through(profile, rows, run.limit)
        for run in straight_runs(profile, uneven)
        for rows in between_steps(run, limit)
        if len(rows) >= LEAST_POINTS
    ]


def between_steps(run: Run, limit: float) -> list[ndarray]:
    """The rows of a run, cut where it steps off its line by more than `limit`, mm.

    Steps back and forth, three or more of less than BLUNT, are none: black and white
    are as far apart where they are printed.
    """
    steepest = 0.05  # of what is uneven
    k = 5  # points on either side of a step
    if len(run.rows) < 2 * k:
        return [run.rows]
    means = sliding_window_view([run.along, run.off], k, axis=1).mean(axis=-1)
    apart, step = means[:, k:] - means[:, :-k]
    most = limit + np.minimum(steepest * np.abs(apart), BLUNT / 2)
    places = stretches(np.flatnonzero(np.abs(step) > most), 3)
    cuts = [place[np.abs(step[place]).argmax()] for place in places if len(place)]
    steps = step[cuts]
    is_printed = len(cuts) > 2 and (steps[1:] * steps[:-1] < 0).all()
    if is_printed and np.abs(steps).max() < BLUNT:
        return [run.rows]
    return np.split(run.rows, np.array(cuts, dtype=int) + k)
