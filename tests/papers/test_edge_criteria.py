import numpy as np
import pytest

from profilecal.closed_form.edge import edge_equations
from profilecal.geometry.noise import Noise
from profilecal.papers.edge_criteria import (
    DIRECTIONS,
    READINGS,
    angle_deviations,
    edge_directions,
    line_distances,
    printed,
    printed_range,
    printed_ratio,
    range_row,
    study,
)
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_scenes


def solved(noise, shape=()):
    scene = edge_scenes(EdgePlan(motion="space"), noise, np.random.default_rng(1), shape)
    return edge_equations(scene.poses.rotations, scene.poses.positions, scene.points)


@pytest.mark.parametrize("of", DIRECTIONS)
@pytest.mark.parametrize("signed", [False, True])
def test_criteria_vanish_without_noise(of, signed):
    """Arcs of 25 mm keep vectors longer than a micrometre, which rounding turns by less than 1e-6."""
    solution = solved(Noise())
    assert np.abs(angle_deviations(solution, of, signed)).max() < 1e-6
    assert line_distances(solution).max() < 1e-9


def test_a_signed_angle_is_the_unsigned_one_seen_from_one_side():
    solution = solved(Noise(0.1), (3,))
    for of in DIRECTIONS:
        unsigned, signed = (angle_deviations(solution, of, s) for s in (False, True))
        assert (unsigned >= 0).all()
        assert (np.abs(signed) <= unsigned + 1e-9).all()
        assert (signed < 0).any()


def test_directions_of_single_vectors_add_up_to_their_groups():
    solution = solved(Noise(0.1))
    vectors = edge_directions(solution.p_b, "vector").reshape(25, 9, 3)
    np.testing.assert_allclose(vectors.sum(axis=1), edge_directions(solution.p_b, "sum"))


def test_unknown_directions_are_refused():
    with pytest.raises(ValueError, match="of is 'edge'; expected one of group, sum, vector"):
        edge_directions(np.zeros((3, 3, 3)), "edge")


def test_a_study_is_the_same_scene_by_scene():
    frames = [study(EdgePlan(), Noise(0.1), 4, np.random.default_rng(2), (10, 25), "group", True) for _ in range(2)]
    assert list(frames[0]["rotations"]) == [10] * 4 + [25] * 4
    np.testing.assert_array_equal(frames[0].to_numpy(), frames[1].to_numpy())


def test_readings_are_named_after_what_they_take():
    assert READINGS["group, signed"] == ("group", True)
    assert READINGS["vector, unsigned"] == ("vector", False)
    assert len(READINGS) == 2 * len(DIRECTIONS)


def test_printed_tables_and_their_ranges():
    np.testing.assert_array_equal(printed("mean Δα")[2], [1.03, 0.86, 0.84])  # 20 rotations; of -1.03 without its sign
    assert printed_range("mean Δd") == pytest.approx((0.215, 0.315))
    assert printed_range("mean Δα", [10]) == pytest.approx((1.845, 3.105))
    low, high = printed_ratio("std Δd", "mean Δd")
    assert low == pytest.approx(0.155 / 0.315)
    assert high == pytest.approx(0.155 / 0.225)


def test_a_row_for_a_range_says_that_its_middle_is_not_printed_and_can_fail_on_either_side():
    rows = [range_row("Table 1", "x", (0.2, 0.4), value, "mm") for value in (0.19, 0.21, 0.39, 0.41)]
    assert [row["verdict"] for row in rows] == ["differs", "reproduced", "reproduced", "differs"]
    assert rows[0]["quantity"] == "x (middle of 0.2 to 0.4, not printed as such)"
    assert range_row("Table 1", "x", (0.2, 0.4), 0.3, "mm", free="noise")["verdict"] == "compatible"
