"""What the drawings of the joint solution show."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from profilecal.geometry.noise import Noise
from profilecal.joint.problem import Problem
from profilecal.report import joint_pictures
from profilecal.simulate.scene import random_scene


@pytest.fixture
def moved():
    """A scene of an edge, another mount 20 mm away along the sensor's x, and the same with the target moved along."""
    scene = random_scene("edge", np.random.default_rng(1), spread_deg=0.0, groups=3, positions=4)
    problem = Problem([scene.observations], Noise(0.05))
    other = problem.move(scene.truth, np.r_[20.0, np.zeros(9)][None])
    shift = scene.observations.R_flange[0, 0] @ scene.truth.rotation[0] @ [20.0, 0, 0]
    (origin, directions), together = other.placements[0], other.__class__
    return scene, other, together(other.rotation, other.translation, ((origin + shift, directions),))


def test_two_scans_are_identical_where_nothing_tells_the_mounts_apart(axes, moved):
    scene, other, together = moved
    assert joint_pictures.draw_two_scans(axes, scene, together) < 1e-9
    assert axes.get_title() == "the scans are identical"
    difference = joint_pictures.draw_two_scans(axes, scene, other)
    seen, crosses = (np.array(line.get_data()) for line in axes.lines[-2:])
    assert difference == pytest.approx(np.sqrt(((seen - crosses) ** 2).mean()))
    assert 5 < difference < 20 / np.sqrt(2)  # the edge is cut where it is, not 20 mm aside
    assert "differ" in axes.get_title()


def test_a_motion_is_drawn_with_both_mounts(space, moved):
    scene, other, _ = moved
    joint_pictures.draw_motion(space, scene, other)
    names = space.get_legend_handles_labels()[1]
    assert [name.strip() for name in names] == ["the mount", "its target", "the other mount", "its target"]


def test_bands_and_coverage_have_a_line_for_each_name(axes):
    joint_pictures.plot_bands(axes, [1, 2], {"edge": np.ones((3, 2)), "disk": np.ones((3, 2))})
    assert [line.get_label() for line in axes.lines] == ["edge", "disk"]
    axes.clear()
    joint_pictures.plot_coverage(axes, {"edge": np.array([0.5, 1.0])}, 0.1)
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [0, 0])


def test_curves_are_those_of_the_methods(axes):
    errors = pd.DataFrame({"sigma_mm": [0.1, 0.2], "closed form": [2.0, 4.0], "joint": [1.0, 2.0], "bound": [1.0, 2.0]})
    joint_pictures.draw_error_against_noise(axes, errors.assign(**{"closed form, all heights": np.nan}))
    assert [line.get_label() for line in axes.lines] == ["closed form", "joint", "bound"]


def test_a_breakdown_is_drawn_by_medians():
    runs = pd.DataFrame(
        {"method": "two-phase", "percent": [0, 0, 0, 9], "rotation": [1.0, 2, 9, 4], "translation": 1.0}
    )
    figure, pair = plt.subplots(2)
    joint_pictures.draw_breakdown(pair, runs, ["two-phase"])
    np.testing.assert_allclose(pair[0].lines[0].get_ydata(), [2, 4])
    plt.close(figure)
