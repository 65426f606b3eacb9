"""The papers' methods: the sensor pose from one target in closed form, rotation first, then translation.

In come flange poses and what the scanner saw of an edge, a disk, a ball or a mark; out goes the sensor pose on the
flange, with the quantities that the papers name.
"""

import numpy as np

from profilecal.closed_form.disk import disk_equations, sensing_data
from profilecal.closed_form.edge import EdgeSolution, edge_equations
from profilecal.closed_form.two_step import TwoStepSolution
from profilecal.geometry.fitting import affine_residuals
from profilecal.joint.observations import Observations


def closed_form(seen: Observations, R_sensor=None, how: str = "published") -> EdgeSolution | TwoStepSolution:
    """What the papers' methods make of a batch of edge or disk observations, B of each.

    R_sensor (B, 3, 3) or (3, 3) gives the signs s_i of the disk method, which its user knows. `how`: "regression" takes
    an edge's points from the regression inside their group, and a disk's heights from all chords (`sensing_data`).
    """
    B, G = len(seen.points), seen.group.max() + 1
    R = np.broadcast_to(seen.R_flange, (B, *seen.R_flange.shape[1:])).reshape(B, G, -1, 3, 3)
    T = np.broadcast_to(seen.T_flange, (B, *seen.T_flange.shape[1:])).reshape(B, G, -1, 3)
    points = seen.points.reshape(B, G, -1, *seen.points.shape[2:])
    if seen.kind == "edge":
        p_s = points[:, :, :, 0]
        if how == "regression":
            p_s = p_s - affine_residuals(T, p_s)[0]
        return edge_equations(R[:, :, 0], T, p_s)
    start, end = T[:, :, 0], T[:, :, -1]
    s = np.sign(np.einsum("bga,bga->bg", end - start, (R[:, :, 0] @ R_sensor[..., None, :, :])[..., 1]))
    data = sensing_data(points, start, end, s, seen.sizes[0], how)
    return disk_equations(R[:, :, 0], data.T_tcp, data.q, data.D_i, data.D_b)
