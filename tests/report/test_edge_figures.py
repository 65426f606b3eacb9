"""What the drawings of the edge notebooks show."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from profilecal.geometry.noise import Noise
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_scenes
from profilecal.report import edge_pictures


def test_vectors_start_at_the_first_point_and_end_at_the_others(axes):
    points = np.array([[1.0, 2, 3], [2, 2, 3], [4, 3, 3]])
    edge_pictures.draw_vectors(axes, points, np.array([1.0, 0, 0]))
    (quiver,) = [c for c in axes.collections if hasattr(c, "U")]
    assert np.allclose(quiver.XY, 0)
    assert np.allclose(quiver.U, [1, 3])
    assert np.allclose(np.abs(quiver.V), [0, 1])


def test_an_edge_group_is_drawn_with_the_edge_from_left_to_right(space):
    scene = edge_scenes(EdgePlan(groups=1, positions=5), Noise(), np.random.default_rng(0))
    R, T = scene.poses.rotations[0], scene.poses.positions[0]
    seen = (np.insert(scene.points[0], 1, 0, axis=-1) @ scene.R_sensor.T + scene.T_sensor) @ R.T + T
    edge_pictures.draw_edge_group(space, scene.edge, R @ scene.R_sensor, T + R @ scene.T_sensor, seen)
    places, edge, points = (np.array(line.get_data_3d()) for line in space.lines)
    assert np.allclose(edge[1:], 0)
    assert np.allclose(points[1:], 0, atol=1e-9)  # on the edge
    assert edge[0, 0] < points[0].min() <= points[0].max() < edge[0, 1]
    assert places[2].min() > 0  # the scanner is above
    assert len(space.collections) == 3  # first, middle and last scan


def test_a_ball_scan_has_every_group_and_five_circles(space):
    edge_pictures.draw_ball_scan(space, np.zeros((4, 6, 3)), 20.0)
    assert len(space.lines) == 4 + 5
    assert np.allclose(space.get_xlim(), (-20, 20), rtol=0.1)


def test_error_bars_hold_95_in_100(axes):
    frame = pd.DataFrame({"group": np.repeat([1, 2], 1001), "value": np.tile(np.arange(1001.0), 2)})
    edge_pictures.error_bars(axes, {"a": frame.groupby("group")["value"]}, ["black"])
    (bar,) = axes.collections
    assert np.allclose([segment[:, 1] for segment in bar.get_segments()], [[25, 975]] * 2)
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["1", "2"]


RUNS = pd.DataFrame({"name": ["b", "b", "b", "a", "a", "a"], "n": [1, 1, 2, 1, 1, 2], "error": [1.0, 3, 5, 2, 4, 8]})


def test_rows_have_their_median_in_the_order_they_come_and_the_published_band():
    figure, axes = plt.subplots(1, 1, squeeze=False)
    edge_pictures.plot_by_row(axes[0], RUNS, "name", {"error": "error [°]"}, {"error": (2.5, 3.5)})
    (axes,) = axes[0]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["b", "a"]
    assert np.allclose(axes.lines[0].get_xdata(), [3, 4])  # the medians
    (band,) = axes.patches
    assert np.allclose(band.get_extents().transformed(axes.transData.inverted()).intervalx, (2.5, 3.5))
    plt.close(figure)


def test_medians_have_a_line_for_each_value(axes):
    edge_pictures.plot_medians(
        axes, RUNS.assign(spread=RUNS["name"].map({"b": 20.0, "a": 35.0})), "n", "error", "spread", "{:g}°"
    )
    assert {line.get_label(): list(line.get_ydata()) for line in axes.lines} == {"20°": [2, 5], "35°": [3, 8]}


def test_clouds_are_seen_in_their_plane(axes):
    cloud = np.array([[1.0, 2, 3], [4, 5, 6]])
    edge_pictures.plot_clouds(axes, {"10": cloud, "40": cloud}, np.eye(3)[[2, 0]])
    assert [line.get_label() for line in axes.lines[:2]] == ["10", "40"]
    assert np.allclose(axes.lines[0].get_xydata(), [[3, 1], [6, 4]])
    assert np.allclose(axes.lines[2].get_xydata(), 0)  # the truth
