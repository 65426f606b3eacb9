"""The papers' methods: the sensor pose from one target in closed form, rotation first,
then translation.

In come flange poses and what the scanner saw of an edge, a disk, a ball or a mark; out
goes the sensor pose on the flange, with the quantities that the papers name.
"""

import numpy as np

from profilecal.closed_form.disk import disk_equations, sensing_data
from profilecal.closed_form.edge import (
    REFUSED,
    EdgeSolution,
    edge_equations,
    rotation_strength,
)
from profilecal.closed_form.two_step import (
    TwoStepSolution,
    check_line,
    check_orientations,
)
from profilecal.geometry.checks import UnobservableError, check_count
from profilecal.geometry.fitting import affine_residuals
from profilecal.targets.observations import Observations


def closed_form(
    seen: Observations, R_sensor=None, how: str = "published", refuse: bool = True
) -> EdgeSolution | TwoStepSolution:
    """What the papers' methods make of a batch of edge or disk observations, B of each.

    R_sensor (B, 3, 3) or (3, 3) gives the signs s_i of the disk method, which its user
    knows. `how`: "regression" takes an edge's points from the regression inside their
    group, and a disk's heights from all chords (`sensing_data`).

    Raises UnobservableError, with a cure, where poses determine the answer in no data
    set of the batch. Without `refuse` such an answer is given: as wrong as it is, the
    papers' methods do not show it.
    """
    B, G = len(seen.points), seen.group.max() + 1
    R = np.broadcast_to(seen.R_flange, (B, *seen.R_flange.shape[1:])).reshape(
        B, G, -1, 3, 3
    )[:, :, 0]
    T = np.broadcast_to(seen.T_flange, (B, *seen.T_flange.shape[1:])).reshape(
        B, G, -1, 3
    )
    points = seen.points.reshape(B, G, -1, *seen.points.shape[2:])
    if refuse:
        check_count(
            "orientations", G, 3, "two turns about different axes fix the translation"
        )
        check_count(
            "poses of an orientation", T.shape[2], 3, "so many fix the rotation"
        )
        check_orientations(R)
    if seen.kind == "edge":
        p_s = points[:, :, :, 0]
        smooth = p_s - affine_residuals(T, p_s)[0] if how == "regression" else p_s
        found = edge_equations(R, T, smooth)
        strength, rank = (
            rotation_strength(R, T, p_s, found.rotation),
            found.translation.rank.max(),
        )
        if refuse and ((strength < REFUSED).all() or rank < 3):
            raise UnobservableError(
                f"the motions leave the pose open: the smallest singular value of A_r is {strength.max():.2g} times "
                f"what noise makes of a zero, {REFUSED:g} needed, and A_t has rank {rank}, 3 needed; turn the flange "
                "more between groups, about several axes, and move within them in space, or in one plane of the base, "
                "tilted against the edge by 30° or more"
            )
        return found
    start, end = T[:, :, 0], T[:, :, -1]
    s = np.sign(
        np.einsum("bga,bga->bg", end - start, (R @ R_sensor[..., None, :, :])[..., 1])
    )
    data = sensing_data(points, start, end, s, seen.sizes[0], how)
    if refuse:
        check_line(
            data.D_i,
            f"the {G} motions are parallel in the sensor frame",
            "the rotation about them stays open",
        )
    return disk_equations(R, data.T_tcp, data.q, data.D_i, data.D_b)
