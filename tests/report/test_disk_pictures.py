"""What the disk paper's sketches are drawn from is the geometry they show."""

import numpy as np
import pytest

from profilecal.papers.disk_study import scan_at_angles
from profilecal.report.disk_pictures import Drawn


@pytest.mark.parametrize("s", [1, -1])
def test_the_picture_has_the_angles_of_the_scan(s):
    drawn = Drawn.of(scan_at_angles(40.0, 0.9, 0.3, (0.2, -0.4), (5.0, 150.0), (-0.8, 0.6), s), 12)
    np.testing.assert_allclose(drawn.across, [s * np.sin(0.9), np.cos(0.9)])
    np.testing.assert_allclose(drawn.at, [-1, 1, 0, -0.8, 0.6], atol=1e-12)
    np.testing.assert_allclose(drawn.way, [1, -0.4 * s])
    np.testing.assert_allclose(drawn.rotated @ [np.cos(0.3), np.sin(0.3)], [1, 0], atol=1e-12)


@pytest.mark.parametrize("s", [1, -1])
def test_q_carried_along_the_motion_onto_the_first_plane_is_e(s):
    drawn = Drawn.of(scan_at_angles(40.0, 0.9, 0.3, (0.2, -0.4), (5.0, 150.0), (-0.8, 0.6), s), 12)
    onto = drawn.projected(drawn.q)
    np.testing.assert_allclose(onto[:, 0], drawn.q[3, 0])
    np.testing.assert_allclose(onto[:, 1] - onto[2, 1], drawn.data.e[:, 1] - drawn.data.e[2, 1], atol=1e-9)


def test_all_tips_lie_on_the_ellipse_that_is_drawn():
    drawn = Drawn.of(scan_at_angles(40.0, 0.9, 0.3, (0.2, -0.4), (5.0, 150.0), (-0.8, 0.6)), 12)
    tips = (drawn.tips @ drawn.rotated.T).reshape(-1, 1, 2)
    assert np.linalg.norm(tips - drawn.ellipse(20_000), axis=-1).min(axis=1).max() < 0.02
