"""The disk method from its sensing data: Section III-C of the disk paper (Chen et al. 2018), Eqs 14-20."""

import numpy as np

from profilecal.checks import check_count, check_rotations, check_vectors
from profilecal.closed_form.two_step import (
    TwoStepSolution,
    check_directions,
    check_orientations,
    solve_rotation,
    solve_translation,
)


def solve_disk(R_tcp, T_tcp, q, D_i, D_b, **readings) -> TwoStepSolution:
    """Sensor pose from the disk method's sensing data, n ≥ 3 poses.

    R_tcp (n, 3, 3) and T_tcp (n, 3), mm: flange poses at which the scan plane passes through the disk's centre;
    q (n, 3), mm: that centre in the sensor frame; D_i and D_b (n, 3): the offset between the two tangent positions
    in the sensor and in the base frame. `readings` of the text: see `disk_equations`.

    Raises ValueError for malformed input, UnobservableError for poses that cannot determine the answer.
    """
    T_tcp = check_vectors("T_tcp", T_tcp)
    n = len(T_tcp)
    check_count("disk sensing data", n, 3, "two differences of orientation about different axes fix the translation")
    R_tcp = check_rotations("R_tcp", R_tcp, n)
    q, D_i, D_b = (check_vectors(name, v, n) for name, v in (("q", q), ("D_i", D_i), ("D_b", D_b)))
    check_directions(D_i.T, "D_i")
    check_directions(D_b.T, "D_b")
    check_orientations(R_tcp)

    return disk_equations(R_tcp, T_tcp, q, D_i, D_b, **readings)


def disk_equations(
    R_tcp, T_tcp, q, D_i, D_b, *, normalise: bool = True, proper: bool = True, pairs: str = "consecutive"
) -> TwoStepSolution:
    """`solve_disk` without its guards, with any leading batch axes: (..., n, 3, 3) and (..., n, 3).

    `normalise=False` and `proper=False` are Eqs 14 and 16 as printed; `pairs` says which differences make up Eq. 18.
    """
    if normalise:
        D_i = D_i / np.linalg.norm(D_i, axis=-1, keepdims=True)
        D_b = D_b / np.linalg.norm(D_b, axis=-1, keepdims=True)
    X = np.swapaxes(D_i, -1, -2)
    Y = np.einsum("...nba,...nb->...an", R_tcp, D_b)  # columns R_tcp⁻¹ D_b
    rotation = solve_rotation(X, Y, proper=proper)
    return TwoStepSolution(rotation, solve_translation(R_tcp, T_tcp, q, rotation.R_sensor, pairs))
