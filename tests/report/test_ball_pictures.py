"""What the pictures of a cut ball draw."""

import numpy as np

from profilecal.report import ball_pictures


def test_the_arc_seen_lies_in_the_scan_plane_and_on_the_ball(space):
    centre, radius = np.array([10.0, 30.0, 5.0]), 69.5
    ball_pictures.draw_cut_ball(space, centre, radius, 60.0)
    (arc,) = (np.array(line.get_data_3d()).T for line in space.lines if line.get_linewidth() == 3)
    np.testing.assert_allclose(arc[:, 1], 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(arc - centre, axis=1), radius)


def test_both_balls_are_cut_in_the_same_line(axes):
    ball_pictures.draw_cut_from_beside(axes, 50.0, 30.0)
    assert sorted(patch.center[0] for patch in axes.patches) == [-30.0, 30.0]
    (cut,) = (line.get_ydata() for line in axes.lines if line.get_linewidth() == 4)
    np.testing.assert_allclose(np.abs(cut), 40.0)
