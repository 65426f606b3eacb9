"""A disk in raw profiles: a chord, whose tips lie on the rim."""

from dataclasses import replace

import numpy as np

from profilecal.profiles.choice import Candidate, choose
from profilecal.profiles.ends import facing, run_end, step_beyond, with_end_variance
from profilecal.profiles.feature import Feature, mask
from profilecal.profiles.runs import straight_runs
from profilecal.profiles.view import View


def find(profiles, sizes) -> list[Feature]:
    """The tips of the disk's chord in each profile (n, 2), mm; `sizes` is its radius, mm."""
    found = [straight_runs(profile) for profile in profiles]
    view = View.of([runs for runs, _ in found])
    candidates = in_front([chords(runs, limit, *sizes, view) for runs, limit in found], view)
    return with_end_variance(choose(profiles, candidates, ("chord", 0)))


def chords(runs, limit: float, radius: float, view: View) -> list[Candidate]:
    """Straight runs no longer than the disk's diameter that end on both sides before a step or nothing."""
    found = []
    for run in facing(runs):
        beyond = {step_beyond(side, limit, view) for side in (run.reversed(), run)}
        if None in beyond or {-1, 1} <= beyond:
            continue
        ends = sorted((run_end(side) for side in (run.reversed(), run)), key=lambda end: end.tip[0])
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
