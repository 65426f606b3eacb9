"""Finders of straight edges, and of faces, in raw profiles. Where a profile shows
several things, what most profiles of a scan show tells which is the target's.
"""

from collections import Counter
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np

from profilecal.profiles.ends import (
    BLUNT,
    ZONE,
    End,
    View,
    facing,
    run_end,
    step_beyond,
    with_end_variance,
)
from profilecal.profiles.points import (
    NOISE_LIMIT,
    Feature,
    block_means,
    nothing,
    present,
    stretches,
)
from profilecal.profiles.runs import Run, straight_runs

# a second candidate with this share of the first one's support leaves the choice open
AMBIGUOUS = 0.5


@dataclass(frozen=True)
class Candidate:
    """Something in a profile that may be the target's feature."""

    feature: Feature
    side: int = 0  # what tells it from others of its shape, if anything
    support: float = 0.0  # mm
    angle: float = 0.0  # rad, inner angle of a corner
    ends: tuple[End, ...] = ()  # where its points are the ends of runs

    @property
    def key(self) -> tuple[str, int]:
        """What it has in common with the target's feature in other profiles."""
        return self.feature.shape, self.side


def choose(
    profiles, candidates, key: tuple[str, int] | None, missed
) -> list[Candidate]:
    """For each profile its candidate with the scan's key, if just one is clear; else
    nothing, with the reason. `missed` says for each profile why it has no such
    candidate; "" where it cannot tell.
    """
    alike = [
        sorted((c for c in found if c.key == key), key=lambda c: -c.support)
        for found in candidates
    ]
    angles = np.array([found[0].angle for found in alike if found])
    if not len(angles):
        return [Candidate(nothing("nothing like the target in this profile"))] * len(
            profiles
        )
    usual = np.median(angles)
    spread = 6 * np.median(np.abs(angles - usual)) if len(angles) >= 5 else np.inf
    # tilted planes see corners at other angles, if nothing nearer
    limits = np.maximum(np.radians([20, 30]), spread)
    chosen = []
    for profile, found, why in zip(profiles, alike, missed, strict=True):
        near, far = (
            [c for c in found if abs(c.angle - usual) <= most] for most in limits
        )
        near = near or far
        if not present(profile).any():
            reason = "nothing in this profile"
        elif not found:
            reason = why or f"no {key[0]} as in other profiles"
        elif not near:
            reason = f"a corner of {np.degrees(found[0].angle):.0f}°, {np.degrees(usual):.0f}° in other profiles"
        elif len(near) > 1 and near[1].support > AMBIGUOUS * near[0].support:
            reason = f"{len(near)} candidates for the {key[0]}, none clearly the best"
        else:
            chosen.append(near[0])
            continue
        chosen.append(Candidate(nothing(reason)))
    return chosen


SHAPES = ("corner", "step end", "tip")  # in this order if many profiles show several
LEAST_SIDE = 10  # points on either side of a corner
# mm: from the ends of straight sides to their corner, and across a blade's tip, at most
NEAR = 2.0


def find_edges(profiles) -> list[Feature]:
    """The edge in each profile (n, 2), mm: of what many profiles show the first of
    corners that point at the scanner, ends of faces, tips, and corners that point away,
    where a wall meets a floor.
    """
    found = [straight_runs(profile) for profile in profiles]
    view = View.of([runs for runs, _ in found])
    candidates = [
        [
            *corners(runs),
            *step_ends(runs, limit, view),
            *tips(profile, runs, limit, view),
        ]
        for profile, (runs, limit) in zip(profiles, found, strict=True)
    ]

    def rank(key):
        hollow = key[0] == "corner" and key[1] * view.away > 0
        return len(SHAPES) if hollow else SHAPES.index(key[0])

    count, support = (
        Counter(key for found in candidates for key in {c.key for c in found}),
        Counter(),
    )
    for c in chain.from_iterable(candidates):
        support[c.key] += c.support
    often = [key for key in count if 2 * count[key] >= max(count.values())]
    key = min(
        often, key=lambda key: (rank(key), -count[key], -support[key]), default=None
    )
    if key and key[0] == "step end" and count[key[0], -key[1]] > 0.8 * count[key]:
        at_faces = Counter(
            c.key
            for found in candidates
            for c in corners_of_faces(found)
            if rank(c.key) == 0
        )
        # where a side face is seen
        key, often = max(at_faces.items(), key=lambda item: item[1], default=(None, 0))
        if often < 3:
            reason = "both ends of a face are seen, in this profile or others: which is the edge? Show one of them only"
            return [nothing(reason) for _ in profiles]
    is_corner = key and key[0] == "corner"
    missed = [why_no_corner(runs) if is_corner else "" for runs, _ in found]
    return with_end_variance(choose(profiles, candidates, key, missed))


def corners_of_faces(found) -> list[Candidate]:
    """The corners among a profile's candidates at which its longest face ends."""
    ends = [c for c in found if c.feature.shape == "step end"]
    longest = max((c.support for c in ends), default=0.0)
    tips = [c.feature.points[0] for c in ends if c.support == longest]
    corners = [c for c in found if c.feature.shape == "corner"]
    return [
        c
        for c in corners
        if any(np.hypot(*(c.feature.points[0] - tip)) < NEAR for tip in tips)
    ]


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
        used = np.concatenate([side.rows for side in sides])
        feature = Feature(
            apex[None], crossing_covariance(*sides, apex)[None], used, "corner"
        )
        # from between the sides to the apex and on
        towards = first.direction - second.direction
        bend = np.arccos(first.direction @ second.direction)
        found.append(
            Candidate(
                feature,
                int(np.sign(towards[1])),
                min(side.length for side in sides),
                np.pi - bend,
            )
        )
    return found


def why_no_corner(runs) -> str:
    """What keeps a profile of a corner from showing it, as far as its straight runs
    tell.
    """
    for first, second in pairwise(runs):
        if is_bent(first, second) and ends_at(first, second, crossing(first, second)):
            return f"one side of the corner shows fewer than {LEAST_SIDE} points beyond its rounding"
    return (
        "one side of the corner shows too few points for a line"
        if len(runs) == 1
        else ""
    )


def is_bent(first: Run, second: Run) -> bool:
    """Whether two runs form a corner, neither straight on nor straight back."""
    least_bend_deg = 15.0  # between the sides of a corner
    return bool(
        abs(first.direction @ second.direction) < np.cos(np.radians(least_bend_deg))
    )


def crossing(first: Run, second: Run) -> np.ndarray:
    """Where the lines of two runs meet, (2,)."""
    normals = np.stack([first.normal, second.normal])
    return np.linalg.solve(
        normals, [first.normal @ first.point, second.normal @ second.point]
    )


def crossing_covariance(first: Run, second: Run, apex) -> np.ndarray:
    """Of the place where the lines of two runs meet, (2, 2) mm²."""
    variance = np.diag(
        [run.offset_covariance(apex[None])[0, 0] for run in (first, second)]
    )
    inverse = np.linalg.inv(np.stack([first.normal, second.normal]))
    return inverse @ variance @ inverse.T


def ends_at(first: Run, second: Run, apex) -> bool:
    """Whether the first run ends and the second begins within reach of the apex."""
    end = (apex - first.point) @ first.direction - first.along[-1]
    start = (apex - second.point) @ second.direction - second.along[0]
    return abs(end) < NEAR and abs(start) < NEAR


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
                tip = end.tip[None]
                across = run.offset_covariance(tip)[..., None] * np.outer(
                    run.normal, run.normal
                )
                feature = Feature(tip, across, run.rows, "step end")
                found.append(
                    Candidate(
                        feature,
                        int(np.sign(end.tip[0] - run.point[0])),
                        run.length,
                        ends=(end,),
                    )
                )
    return found


def tips(profile, runs, limit: float, view: View) -> list[Candidate]:
    """Narrow tips in front of a background or of nothing: a blade that points at the
    scanner.
    """
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
                # or anywhere among them
                edge = [apex[0], away * (away * points[:, 1]).min()]
                variances = np.maximum(
                    ((points - edge) ** 2).mean(axis=0), (limit / NOISE_LIMIT) ** 2
                )
                found.append(
                    Candidate(
                        Feature(apex[None], np.diag(variances)[None], top, "tip"),
                        -away,
                        1.0,
                    )
                )
    return found


def top_of(profile, seen, cluster, away: int) -> np.ndarray | None:
    """The rows of a cluster's top BLUNT if they are narrow and what surrounds the
    cluster lies behind them.
    """
    depth = away * profile[cluster, 1]
    for nearest in np.sort(depth)[:3]:  # up to two spikes in front
        top = cluster[(depth >= nearest) & (depth < nearest + BLUNT)]
        if len(top) >= 3:
            break
    else:
        return None
    if np.ptp(profile[top, 0]) > NEAR:
        return None
    for around in (
        np.arange(top[0] - ZONE, top[0]),
        np.arange(top[-1] + 1, top[-1] + 1 + ZONE),
    ):
        if around[0] < 0 or around[-1] >= len(profile):
            return None
        if (
            seen[around].any()
            and np.median(away * profile[around[seen[around]], 1]) < nearest + BLUNT
        ):
            return None
    return top


def find_chords(profiles, radius: float) -> list[Feature]:
    """The tips of the disk's chord in each profile (n, 2), mm."""
    found = [straight_runs(profile) for profile in profiles]
    view = View.of([runs for runs, _ in found])
    candidates = [chords(runs, limit, radius, view) for runs, limit in found]
    # most chords are in front
    away = view.away or np.sign(sum(c.side for found in candidates for c in found))
    in_front = [
        [replace(c, side=0) for c in found if c.side * away >= 0]
        for found in candidates
    ]
    return with_end_variance(
        choose(profiles, in_front, ("chord", 0), [""] * len(profiles))
    )


def chords(runs, limit: float, radius: float, view: View) -> list[Candidate]:
    """Straight runs no longer than the disk's diameter that end on both sides before a
    step or nothing.
    """
    found = []
    for run in facing(runs):
        sides = run.reversed(), run
        beyond = {step_beyond(side, limit, view) for side in sides}
        if None in beyond or {-1, 1} <= beyond:
            continue
        ends = sorted(map(run_end, sides), key=lambda end: end.tip[0])
        tips = np.stack([end.tip for end in ends])
        if np.linalg.norm(tips[1] - tips[0]) > 2 * radius + 4 * run.spacing:
            continue
        across = run.offset_covariance(tips)[..., None, None] * np.outer(
            run.normal, run.normal
        )  # (2, 2, 2, 2)
        feature = Feature(
            tips, across[[0, 1], [0, 1]], run.rows, "chord", between=across[0, 1]
        )
        found.append(Candidate(feature, sum(beyond), run.length, ends=tuple(ends)))
    return found


def find_lines(profiles) -> list[Feature]:
    """The face in each profile (n, 2), mm, as up to 40 means over points of a line."""
    return [find_line(profile) for profile in profiles]


def find_line(profile) -> Feature:
    """A profile's longest straight run, if no other is nearly as long."""
    runs = sorted(straight_runs(profile)[0], key=lambda run: -run.length)
    if not runs:
        return nothing("no straight run in this profile")
    if len(runs) > 1 and runs[1].length > AMBIGUOUS * runs[0].length:
        return nothing(
            f"two straight runs of similar length, {runs[0].length:.0f} and {runs[1].length:.0f} mm"
        )
    best = runs[0]
    normals = np.broadcast_to(best.normal, (len(best.off), 2))
    points, _, covariance = block_means(best.points, best.off, normals)
    return Feature(points, covariance, best.rows, "line")
