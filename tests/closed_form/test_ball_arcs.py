"""The two-step ball method from arcs."""

import numpy as np
import pytest

from profilecal.closed_form.ball import solve_ball_from_arcs
from profilecal.papers.settings import fig17_scans


def arcs_of(scans, counts):
    """Noise-free arcs and flange positions, counts[i] of them at pose i."""
    positions, circles = scans.positions(max(counts)), scans.circles(max(counts))
    arcs = []
    for i, count in enumerate(counts):
        seen = [(scans.x_seen(circle), circle) for circle in circles[i, :count]]
        arcs.append([np.column_stack([x, c[1] + np.sqrt(c[2] ** 2 - (x - c[0]) ** 2)]) for x, c in seen])
    return [positions[i, :count] for i, count in enumerate(counts)], arcs


@pytest.mark.parametrize("fit", ["taubin", "kasa"])
@pytest.mark.parametrize("counts", [[1] * 8, [1] * 4 + [5] * 4, [3] * 8], ids=["one", "published", "all"])
def test_noise_free_arcs_give_the_pose_back(counts, fit):
    scans = fig17_scans()
    T_tcp, arcs = arcs_of(scans, counts)
    found = solve_ball_from_arcs(scans.R_tcp, T_tcp, arcs, scans.side, scans.ball.radius, scans.translating, fit)
    assert np.abs(found.R_sensor - scans.R_sensor).max() < 1e-12
    assert np.abs(found.T_sensor - scans.T_sensor).max() < 1e-10
    assert np.abs(found.translation.q_b - scans.ball.centre).max() < 1e-10


def test_malformed_input_is_refused_in_a_sentence():
    scans = fig17_scans()
    T_tcp, arcs = arcs_of(scans, [1] * 8)
    with pytest.raises(ValueError, match="expected 8 values, each"):
        solve_ball_from_arcs(scans.R_tcp, T_tcp, arcs, scans.side[:-1], 69.5, 4)
    with pytest.raises(ValueError, match="arcs has 7 poses; expected 8"):
        solve_ball_from_arcs(scans.R_tcp, T_tcp, arcs[:-1], scans.side, 69.5, 4)
    with pytest.raises(ValueError, match="pose 0, arc 0: its circle has the radius"):
        solve_ball_from_arcs(scans.R_tcp, T_tcp, arcs, scans.side, 40.0, 4)
