"""Finder of a straight edge in raw profiles: a corner or the end of a face. Where a
profile shows several, what most profiles of a scan show tells which it is.
"""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from profilecal.profiles.candidates import AMBIGUOUS, Candidate, choose, ranked
from profilecal.profiles.ends import BLUNT, View, facing, run_end, step_beyond
from profilecal.profiles.features import Feature, nothing
from profilecal.profiles.points import Profiles, in_each
from profilecal.profiles.runs import Run, straight_runs

LEAST_SIDE = 10  # points on either side of a corner
NEAR = 2.0  # mm, from the ends of straight sides to their corner, at most
Look = tuple[str, int]  # of the edge in all profiles of a scan: `Candidate.look`


def find_edges(profiles: Profiles) -> list[Feature]:
    """The edge in each profile (n, 2), mm.

    It is a corner that points at the scanner if many profiles show one, else the end of
    a face. Corners that point away are no edges: there a wall meets a floor.
    """
    found = in_each(profiles, straight_runs)
    view = View.from_runs(found)
    candidates = [[*corners(runs, view), *step_ends(runs, view)] for runs in found]
    shown_by = Counter(look for own in candidates for look in {c.look for c in own})
    look = look_of_most(shown_by)
    if not look:
        reason = (
            "both ends of a face are seen, in this profile or others: "
            "which is the edge? Show one of them only (and where z are heights "
            "that are all above zero, negate them: they pass for depths)"
        )
        return [nothing(reason)] * len(profiles)
    alike = [ranked(c for c in own if c.look == look) for own in candidates]
    reasons = [""] * len(profiles)
    shape, _ = look
    if shape == "corner":
        reasons = [*map(why_no_corner, found)]
        alike, reasons = of_usual_angle(alike, reasons)
    return choose(profiles, alike, shape, reasons)


def look_of_most(shown_by: Counter[Look]) -> Look | None:
    """The look of the edge, from how many profiles each look is `shown_by`; None where
    either end of a face may be it.

    It is a corner that at least half as many profiles show as show an end, else the
    end. Where the face's other end shows too, it is a corner that a few profiles show:
    beside one of both ends a side face may show now and then. Of two that are as usual
    it is the one of smaller sign, so that no order of a set decides.
    """
    usual = sorted(shown_by, key=lambda look: (-shown_by[look], look[1]))
    corner, end = (
        next((look for look in usual if look[0] == shape), ("", 0))
        for shape in ("corner", "step end")
    )
    if 2 * shown_by[corner] >= shown_by[end]:
        return corner
    shape, sign = end
    if shown_by[shape, -sign] <= AMBIGUOUS * shown_by[end]:
        return end
    return corner if shown_by[corner] > 2 else None


def corners(runs: list[Run], view: View) -> Iterator[Candidate]:
    """Where neighbouring straight runs meet and point at the scanner: a ridge's apex,
    the corner of a bar.

    The lines rest on points beyond the rounded tips of all corners; there is none where
    these are too few. At a shallow corner a run takes points of the next face.
    """
    joined = joints(runs)
    for joint in joined:
        rows = [clear_rows(runs, joint.first + side, joined) for side in (0, 1)]
        if min(map(len, rows)) < LEAST_SIDE:
            continue
        run = runs[joint.first]
        before, after = (Run.through(run.profile, own, run.limit) for own in rows)
        if not is_bent(before, after):
            continue
        apex = crossing(before, after)
        # from between the sides to the apex and on
        sign = int(np.sign(before.direction[1] - after.direction[1]))
        if sign * view.depth_sign > 0:
            continue
        covariance = crossing_covariance(before, after, apex)
        used = np.concatenate(rows)
        feature = Feature(apex[None], covariance[None], used, "corner")
        angle = np.arccos(-before.direction @ after.direction)
        support = min(before.length, after.length)
        yield Candidate(feature, sign, support, angle)


def of_usual_angle(
    candidates: list[list[Candidate]], reasons: list[str]
) -> tuple[list[list[Candidate]], list[str]]:
    """Ranked candidates for corners without those of another angle than the first ones
    of most profiles, and the reasons why a profile has none.

    Planes that are tilted see a corner at other angles, by up to 20°; what differs by
    30° counts if nothing is nearer, and more where profiles scatter more.
    """
    best = [own[0].angle for own in candidates if own]
    usual = np.median(best)
    scatter = np.median(np.abs(np.subtract(best, usual))) if len(best) >= 5 else np.inf
    close, wide = np.maximum(np.radians([20, 30]), 6 * scatter)
    chosen, said = [], []
    for own, reason in zip(candidates, reasons, strict=True):
        near = [one for one in own if abs(one.angle - usual) <= close]
        near = near or [one for one in own if abs(one.angle - usual) <= wide]
        if own and not near:
            angle, expected = np.degrees([own[0].angle, usual])
            reason = f"a corner of {angle:.0f}°, {expected:.0f}° in other profiles"
        chosen.append(near)
        said.append(reason)
    return chosen, said


def why_no_corner(runs: list[Run]) -> str:
    """What keeps a profile from showing a corner, as far as its straight runs tell."""
    if joints(runs):
        few = f"fewer than {LEAST_SIDE} points beyond the rounded tip"
        return f"one side of the corner shows {few}"
    if len(runs) == 1:
        return "one side of the corner shows too few points for a line"
    return ""


class Joint(NamedTuple):
    """Where the lines of two neighbouring runs meet, within reach of both."""

    first: int  # index of the first run
    apex: ndarray  # (2,)
    spoilt: float  # mm around the apex, in which a point may be of either


def joints(runs: list[Run]) -> list[Joint]:
    """Where a run ends and the next one begins near where their lines meet at an
    angle.
    """
    found = []
    for k, (first, second) in enumerate(pairwise(runs)):
        if not is_bent(first, second):
            continue
        apex = crossing(first, second)
        end = first.coordinates(apex)[0] - first.along[-1]
        start = second.coordinates(apex)[0] - second.along[0]
        if max(abs(end), abs(start)) < NEAR:
            # as far along a face as the next one is within its limit, and half as far
            # again
            along, off = np.abs([first.direction, first.normal] @ second.direction)
            spoilt = max(BLUNT, first.limit, 1.5 * first.limit * along / off)
            found.append(Joint(k, apex, spoilt))
    return found


def clear_rows(runs: list[Run], k: int, joined: list[Joint]) -> ndarray:
    """The rows of a run but for those that a corner at either end spoils."""
    run = runs[k]
    is_clear = np.full(len(run.rows), True)
    for joint in joined:
        if joint.first in (k - 1, k):
            from_apex = run.along - run.coordinates(joint.apex)[0]
            is_clear &= np.abs(from_apex) > joint.spoilt
    return run.rows[is_clear]


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
    lines = first, second
    variances = [line.offset_covariance(apex[None])[0, 0] for line in lines]
    inverse = np.linalg.inv([line.normal for line in lines])
    return inverse * variances @ inverse.T


def step_ends(runs: list[Run], view: View) -> Iterator[Candidate]:
    """Where a face ends in front of something farther away, or of nothing."""
    for run in facing(runs):
        for outwards in (run.reversed(), run):
            step = step_beyond(outwards, view)
            # no step counts where it is not known which way is farther away
            if step is None or (step and step * view.depth_sign <= 0):
                continue
            end = run_end(outwards)
            place = end.point[None]
            covariance = run.covariance_across(place)[0]
            feature = Feature(place, covariance, run.rows, "step end")
            sign = int(np.sign(outwards.direction[0]))
            yield Candidate(feature, sign, run.length, ends=(end,))
