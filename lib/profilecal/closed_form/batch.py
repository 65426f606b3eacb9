"""The edge and the disk method on batches of observations."""

from typing import Any

import numpy as np

from profilecal.closed_form import disk, edge
from profilecal.closed_form.edge import EdgeSolution
from profilecal.closed_form.two_step import TwoStepSolution
from profilecal.geometry.poses import rotation_groups
from profilecal.targets.observations import Observations


def closed_form(
    seen: Observations,
    R_sensor: Any = None,
    how: str = "published",
    refuse: bool = True,
) -> EdgeSolution | TwoStepSolution:
    """What the papers' methods make of a batch of edge or disk observations, B of each.

    R_sensor (B, 3, 3) or (3, 3) gives the signs s_i of the disk method, which its user
    knows; an edge needs none. `how`: "regression" takes an edge's points from the
    regression inside their group, and a disk's heights from all chords
    (`sensing_data`). Poses may come in any order, the same in all of the batch; groups
    that `seen` leaves out are found.

    Raises UnobservableError, with a cure, where poses determine the answer in no data
    set of the batch. Without `refuse` such an answer is given: as wrong as it is, the
    papers' methods do not show it.
    """
    B, P = seen.points.shape[:2]
    R = np.broadcast_to(seen.R_flange, (B, P, 3, 3))
    T = np.broadcast_to(seen.T_flange, (B, P, 3))
    number = rotation_groups(R[0]) if seen.group is None else seen.labels
    if seen.kind == "edge":
        points = seen.points[:, :, 0]
        return edge.solve_groups(R, T, points, number, how == "regression", refuse)
    radius = seen.sizes[0]
    return disk.solve_motions(
        R, T, seen.points, number, radius, how, R_sensor, refuse=refuse
    )
