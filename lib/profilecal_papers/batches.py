"""Scenes as batches, and the edge and the disk method on them: poses in any order, the
same in all of a batch of B, and an answer even where poses leave it open; as wrong as
it is, the methods do not show it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy import ndarray

from profilecal.closed_form.disk import check_motions, motions_of, scans_of, solve_scans
from profilecal.closed_form.edge import EdgeSolution, edge_equations, smoothed
from profilecal.closed_form.groups import group_members
from profilecal.closed_form.two_step import TwoStepSolution
from profilecal.geometry.poses import rotation_groups
from profilecal.simulation.scene import Scene
from profilecal.targets.observations import Observations
from profilecal.targets.state import State


def stack(scenes: Sequence[Scene]) -> Scene:
    """Scenes of one kind and size as a batch."""
    every = [scene.observations.arrays for scene in scenes]
    joined = {name: np.concatenate([one[name] for one in every]) for name in every[0]}
    observations = replace(scenes[0].observations, **joined)
    truth = State.join(*(scene.truth for scene in scenes))
    return replace(scenes[0], observations=observations, truth=truth)


def flange(seen: Observations) -> tuple[ndarray, ndarray, ndarray]:
    """Orientations (B, P, 3, 3), positions (B, P, 3) and the numbers (P,) of the groups
    of the poses, which are found where the observations leave them out.
    """
    shape = seen.points.shape[:2]
    R = np.broadcast_to(seen.R_flange, (*shape, 3, 3))
    T = np.broadcast_to(seen.T_flange, (*shape, 3))
    return R, T, rotation_groups(R[0]) if seen.group is None else seen.labels


def edge_method(seen: Observations, regression: bool = False) -> EdgeSolution:
    """The edge paper's method; `regression` as in `solve_edge`."""
    R, T, number = flange(seen)
    index, present = group_members(number)
    T_b, points = T[:, index], seen.points[:, index, 0]
    if regression:
        points = smoothed(T_b, points, present)
    return edge_equations(R[:, index[:, 0]], T_b, points, present)


def disk_method(
    seen: Observations, R_sensor: ndarray, heights: str = "published"
) -> TwoStepSolution:
    """The disk paper's method; R_sensor (B, 3, 3) or (3, 3) gives its signs s_i, which
    its user knows, `heights` as in `solve_disk`. Raises ValueError for motions that are
    not straight.
    """
    R, T, number = flange(seen)
    motions = motions_of(T, number)
    check_motions(T, motions)
    R = R[:, [rows.min() for rows in motions]]
    given = motions, seen.sizes[0], heights, R_sensor
    return solve_scans(R, scans_of(R, T, seen.points, *given))
