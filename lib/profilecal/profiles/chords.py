"""Finder of a disk's chord in raw profiles: a straight run in front of what is behind
the disk.
"""

from collections.abc import Iterator

import numpy as np

from profilecal.profiles.candidates import Candidate, choose, ranked
from profilecal.profiles.ends import CLEAR, View, facing, run_end, step_beyond
from profilecal.profiles.features import Feature
from profilecal.profiles.points import Profiles, in_each
from profilecal.profiles.runs import Run, straight_runs


def find_chords(profiles: Profiles, radius: float) -> list[Feature]:
    """The tips of the disk's chord in each profile (n, 2), mm."""
    found = in_each(profiles, straight_runs)
    view = View.from_runs(found)
    candidates = [ranked(chords(runs, radius, view)) for runs in found]
    # most chords are in front
    signs = [one.sign for own in candidates for one in own]
    depth_sign = view.depth_sign or np.sign(sum(signs))
    in_front = [[c for c in own if c.sign * depth_sign >= 0] for own in candidates]
    reasons = [why_no_chord(runs, view) for runs in found]
    return choose(profiles, in_front, "chord", reasons)


def why_no_chord(runs: list[Run], view: View) -> str:
    """Why a single run is none; empty where no more can be said than that."""
    tips = [tip for run in facing(runs) for tip in run.points[[0, -1]]]
    if len(tips) != 2 or not any(map(view.may_cut, tips)):
        return ""
    return f"may be cut by the field of view; chords should end {CLEAR:g} mm inside it"


def chords(runs: list[Run], radius: float, view: View) -> Iterator[Candidate]:
    """Straight runs no longer than the disk's diameter that end on both sides before a
    step or nothing.
    """
    for run in whole_faces(facing(runs)):
        start, stop = run.reversed(), run
        before = step_beyond(start, view)
        after = step_beyond(stop, view)
        # what is on both sides lies behind, or nothing does; None is no end
        if before is None or after is None or before * after < 0:
            continue
        ends = sorted(map(run_end, (start, stop)), key=lambda end: end.point[0])
        tips = np.stack([end.point for end in ends])
        if np.linalg.norm(tips[1] - tips[0]) > 2 * radius + 4 * run.spacing:
            continue
        covariance = run.covariance_across(tips)
        own = covariance[[0, 1], [0, 1]]
        feature = Feature(tips, own, run.rows, "chord", between=covariance[0, 1])
        yield Candidate(feature, before or after, run.length, ends=tuple(ends))


def whole_faces(runs: list[Run]) -> Iterator[Run]:
    """Runs, and as one those that are on one line: a bolt's head or a hole is between
    them.
    """
    for run in runs:
        parts = [one for one in runs if are_one(run, one) and are_one(one, run)]
        if len(parts) == 1:
            yield run
        elif run is parts[0]:
            rows = np.concatenate([one.rows for one in parts])
            yield Run.through(run.profile, rows, run.limit)


def are_one(run: Run, other: Run) -> bool:
    """Whether another run is on the line of this one."""
    off = run.coordinates(other.points)[1]
    return bool(np.abs(off).mean() < 2 * run.limit)
