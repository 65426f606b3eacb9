"""Finder of a flat face in raw profiles, which need not be quite flat."""

import numpy as np
from numpy import ndarray
from numpy.lib.stride_tricks import sliding_window_view

from profilecal.profiles.candidates import AMBIGUOUS
from profilecal.profiles.ends import BLUNT
from profilecal.profiles.features import Feature, block_means, nothing
from profilecal.profiles.points import Profiles, in_each, stretches, tolerance
from profilecal.profiles.runs import LEAST_POINTS, Run, straight_runs


def find_lines(profiles: Profiles) -> list[Feature]:
    """The face in each profile (n, 2), mm, as means over points of a line."""
    return in_each(profiles, find_line)


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

    Three steps or more, back and forth by less than BLUNT, do not cut: a scanner sees
    such steps between black and white that are printed on a face.
    """
    steepest = 0.05  # of what is uneven
    k = 5  # points on either side of a step
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
