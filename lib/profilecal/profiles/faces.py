"""A flat face in raw profiles: the chord that a disk shows, or the line of a plane."""

from dataclasses import replace

import numpy as np

from profilecal.profiles.choice import AMBIGUOUS, Candidate, choose
from profilecal.profiles.ends import View, facing, run_end, step_beyond, with_end_variance
from profilecal.profiles.feature import Feature, block_means, mask, nothing
from profilecal.profiles.runs import straight_runs


def find_chords(profiles, radius: float) -> list[Feature]:
    """The tips of the disk's chord in each profile (n, 2), mm."""
    found = [straight_runs(profile) for profile in profiles]
    view = View.of([runs for runs, _ in found])
    candidates = in_front([chords(runs, limit, radius, view) for runs, limit in found], view)
    return with_end_variance(choose(profiles, candidates, ("chord", 0)))


def chords(runs, limit: float, radius: float, view: View) -> list[Candidate]:
    """Straight runs no longer than the disk's diameter that end on both sides before a step or nothing."""
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
        line = ends[0].line  # both lie on it
        across = line.offset_covariance(tips)[..., None, None] * np.outer(line.normal, line.normal)  # (2, 2, 2, 2)
        used = mask(run.profile, run.rows)
        feature = Feature(tips, across[[0, 1], [0, 1]], used, "chord", between=across[0, 1])
        found.append(Candidate(feature, sum(beyond), run.length, ends=tuple(ends)))
    return found


def in_front(candidates, view: View) -> list[list[Candidate]]:
    """Chords without those that lie behind what surrounds them; which way that is, most of them tell if need be."""
    away = view.away or np.sign(sum(c.side for found in candidates for c in found))
    return [[replace(c, side=0) for c in found if c.side * away >= 0] for found in candidates]


def find_lines(profiles) -> list[Feature]:
    """The face in each profile (n, 2), mm, as up to 40 means over points of a line."""
    return [find_line(profile) for profile in profiles]


def find_line(profile) -> Feature:
    """A profile's longest straight run, if no other is nearly as long."""
    runs = sorted(straight_runs(profile)[0], key=lambda run: -run.length)
    if not runs:
        return nothing(profile, "no straight run in this profile")
    if len(runs) > 1 and runs[1].length > AMBIGUOUS * runs[0].length:
        lengths = f"{runs[0].length:.0f} and {runs[1].length:.0f} mm"
        return nothing(profile, f"two straight runs of similar length, {lengths}")
    best = runs[0]
    normals = np.broadcast_to(best.normal, (len(best.off), 2))
    along, off, covariance = block_means(best.along, best.off, normals, fitted=2)
    points = best.point + along[:, None] * best.direction + off[:, None] * best.normal
    return Feature(points, covariance, mask(profile, best.rows), "line")
