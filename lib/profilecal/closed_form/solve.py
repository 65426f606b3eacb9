"""The papers' methods on observations as the joint calibration takes them.

Edge: Eqs 5-35 of the edge paper. Disk: Eqs 4-20 of the disk paper.
"""

import numpy as np

from profilecal.closed_form.disk import disk_equations, sensing_data
from profilecal.closed_form.edge import edge_equations
from profilecal.joint.observations import Observations


def closed_form(seen: Observations, R_sensor, heights: str = "published") -> tuple[np.ndarray, np.ndarray]:
    """What the papers' methods make of a batch of edge or disk observations: (B, 3, 3) and (B, 3).

    R_sensor (3, 3) gives the signs s_i of the disk method, which its user knows; `heights`: see `sensing_data`.
    """
    B, G = len(seen.points), seen.group.max() + 1
    R = np.broadcast_to(seen.R_flange, (B, *seen.R_flange.shape[1:])).reshape(B, G, -1, 3, 3)
    T = np.broadcast_to(seen.T_flange, (B, *seen.T_flange.shape[1:])).reshape(B, G, -1, 3)
    points = seen.points.reshape(B, G, -1, *seen.points.shape[2:])
    if seen.kind == "edge":
        found = edge_equations(R[:, :, 0], T, points[:, :, :, 0])
        return found.R_sensor, found.T_sensor
    start, end = T[:, :, 0], T[:, :, -1]
    s = np.sign(np.einsum("bga,bga->bg", end - start, (R[:, :, 0] @ R_sensor)[..., 1]))
    data = sensing_data(points, start, end, s, seen.sizes[0], heights)
    found = disk_equations(R[:, :, 0], data.T_tcp, data.q, data.D_i, data.D_b)
    return found.R_sensor, found.T_sensor
