from pathlib import Path

import numpy as np
import pytest

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal.papers import items, published
from profilecal.papers.edge_criteria import (
    ROTATIONS,
    angle_deviations,
    evaluate,
    line_distances,
    nested_calibrations,
    printed,
)
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_scenes

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
    found = list(nested_calibrations(scene))[-1]
    angles = angle_deviations(found)
    assert angles.shape == (3, 25)
    assert (angles < 0).any()
    assert (angles > 0).any()
    u = found.u_b[0]
    aside = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    aside /= np.linalg.norm(aside)
    found.p_b[0, 0] += 0.01 * ((found.p_b[0, 0] - found.p_b[0, 0].mean(axis=0)) @ u)[:, None] * aside
    assert angle_deviations(found)[0, 0] - angles[0, 0] == pytest.approx(0.01, rel=0.05)


def test_nested_calibrations_are_those_of_their_first_groups():
    """As `edge_equations` finds them, which takes the vectors as they are."""
    scene = edge_scenes(EdgePlan(), Noise(0.1), np.random.default_rng(2), (4,))
    for count, found in zip(ROTATIONS, nested_calibrations(scene, about_mean=False), strict=True):
        poses = scene.poses.first(count)
        alone = edge_equations(poses.rotations, poses.positions, scene.points[:, :count])
        np.testing.assert_allclose(found.R_sensor, alone.R_sensor, atol=1e-9)
        np.testing.assert_allclose(found.T_sensor, alone.T_sensor, atol=1e-7)
        np.testing.assert_allclose(found.p_b, alone.p_b, atol=1e-7)


def test_criteria_of_many_scenes_are_those_of_each():
    scene = edge_scenes(EdgePlan(), Noise(0.1), np.random.default_rng(2), (4,))
    frame = evaluate(scene, 10, 0.1)
    found = next(nested_calibrations(scene, about_mean=False))
    np.testing.assert_allclose(frame["std Δα"], np.degrees(angle_deviations(found)).std(axis=-1), rtol=1e-6)
    np.testing.assert_allclose(frame["mean Δd"], line_distances(found).mean(axis=-1), rtol=1e-6)


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
