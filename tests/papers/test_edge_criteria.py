from pathlib import Path

import numpy as np
import pytest

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal.papers import items, published
from profilecal.papers.edge_study import EdgePlan, angle_deviations, edge_scenes, line_distances, printed

TABLES = Path(__file__).parents[2] / "notebooks" / "11_edge_tables.ipynb"
SPACE = EdgePlan(motion="space")


@pytest.mark.parametrize("about_mean", [False, True])
def test_criteria_vanish_without_noise(about_mean):
    """Arcs of 25 mm keep vectors longer than a micrometre, which rounding turns by less than 1e-6."""
    scene = edge_scenes(SPACE, Noise(), np.random.default_rng(1))
    solution = edge_equations(scene.poses.rotations, scene.poses.positions, scene.points)
    assert np.abs(angle_deviations(solution, about_mean)).max() < 1e-6
    assert line_distances(solution).max() < 1e-9


def test_angles_are_signed_and_turn_with_a_group():
    """A group turned about the edge's normal by a small angle deviates by that much more, to one side."""
    scene = edge_scenes(SPACE, Noise(0.1), np.random.default_rng(1), (3,))
    found = edge_equations(scene.poses.rotations, scene.poses.positions, scene.points).translation
    angles = angle_deviations(found)
    assert angles.shape == (3, 25)
    assert (angles < 0).any()
    assert (angles > 0).any()
    u = found.u_b[0]
    aside = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    aside /= np.linalg.norm(aside)
    found.p_b[0, 0] += 0.01 * ((found.p_b[0, 0] - found.p_b[0, 0].mean(axis=0)) @ u)[:, None] * aside
    assert angle_deviations(found)[0, 0] - angles[0, 0] == pytest.approx(0.01, rel=0.05)


def test_criteria_of_many_scenes_are_those_of_each():
    scene = edge_scenes(EdgePlan(), Noise(0.1), np.random.default_rng(2), (4,))
    poses = scene.poses.first(10)
    all_found = edge_equations(poses.rotations, poses.positions, scene.points[:, :10])
    angles, distances = angle_deviations(all_found), line_distances(all_found)
    for k in range(4):
        found = edge_equations(poses.rotations[k], poses.positions[k], scene.points[k, :10])
        assert angles[k] == pytest.approx(angle_deviations(found))
        assert distances[k] == pytest.approx(line_distances(found))


def test_printed_tables():
    np.testing.assert_array_equal(printed("mean Δα")[2], [1.03, 0.86, 0.84])  # 20 rotations; of -1.03 without its sign


@pytest.mark.parametrize(("item", "count"), [("Table 1", 24), ("Table 2", 24), ("Table 3", 12)])
def test_the_page_of_the_tables_holds_each_number_as_printed(item, count):
    (shown,) = [entry for entry in items.items_of(TABLES) if entry.item == item]
    frame = published.table("edge")
    expected = frame[frame["item"] == item]
    assert sorted((row.column, row.row, row.printed) for row in shown.rows) == sorted(
        (entry.component, entry.row.removeprefix("G="), entry.printed) for entry in expected.itertuples()
    )
    assert len(shown.rows) == count
