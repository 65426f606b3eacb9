from itertools import product

import numpy as np
import pytest
from numpy.random import default_rng

from profilecal.closed_form import edge
from profilecal.closed_form.edge import edge_equations, solve_edge
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal_papers.edge_study import (
    EdgePlan,
    edge_scenes,
    observations_of,
)

SPACE = EdgePlan(motion="space")


def data(scene):
    """What edge_equations takes."""
    return scene.poses.rotations, scene.poses.positions, scene.points


def solve(scene, **choices):
    """`solve_edge` of a scene with its groups known."""
    seen = observations_of(scene)
    rows = seen.R_flange[0], seen.T_flange[0], seen.points[0, :, 0]
    return solve_edge(*rows, group=seen.group, **choices)


def all_pairs(R_b, T_b, p_s):
    """A_r of all pairs of vectors."""
    return edge.pair_equations(R_b, *edge.difference_vectors(T_b, p_s))[0]


RANKS = [  # of A_r and A_t, for one, two and ten groups
    ({"positions": 3}, [(3, 0), (6, 2), (9, 3)]),
    ({"motion": "space", "positions": 4}, [(7, 0), (9, 2), (9, 3)]),
    ({"tilt_deg": 0.0}, [(2, 0), (4, 2), (6, 3)]),
    ({"motion": "space", "one_axis": True}, [(7, 0), (9, 2), (9, 2)]),
]


@pytest.mark.parametrize(("motion", "expected"), RANKS)
def test_rank_of_the_two_systems(motion, expected):
    for groups, ranks in zip((1, 2, 10), expected, strict=True):
        plan = EdgePlan(groups=groups, **motion)
        scene = edge_scenes(plan, Noise(), default_rng(4), (20,))
        solution = edge_equations(*data(scene))
        assert (solution.rotation.rank == ranks[0]).all()
        assert (solution.translation.rank == ranks[1]).all()


def test_noise_gain_is_the_derivative_of_the_singular_value_summed_over_all_points():
    rng = default_rng(5)
    R_b, T_b, p_s = data(edge_scenes(EdgePlan(groups=3, positions=4), Noise(), rng))
    v = rng.normal(size=9)
    squares = 0.0
    # A_r is linear in each coordinate, so a difference is a derivative
    for index in np.ndindex(p_s.shape):
        moved = p_s.copy()
        moved[index] += 1
        squares += np.sum(
            ((all_pairs(R_b, T_b, moved) - all_pairs(R_b, T_b, p_s)) @ v) ** 2
        )
    gain = edge.noise_gain(v, R_b, T_b, p_s)
    assert gain == pytest.approx(np.sqrt(squares), rel=1e-9)


DEGENERATE = {
    "arc contains the edge": EdgePlan(tilt_deg=0.0),
    "arcs contain the edge": EdgePlan(tilt_deg=0.0, frame="group"),
    "arc turns with the tool": EdgePlan(frame="tool"),
    "collinear": EdgePlan(motion="line"),
}


def test_over_many_scenes_the_detector_neither_misses_nor_cries_wolf():
    """None of 500 seen means below 0.6 % at 95 % confidence (the rule of three)."""
    rng = default_rng(7)

    def strengths(plan):
        scene = edge_scenes(plan, Noise(0.05), rng, (500,))
        found = edge_equations(*data(scene))
        noise = edge.scatter_about_line(found.p_b.reshape(500, -1, 3))
        return edge.rotation_strength(noise, *data(scene), found.rotation)

    assert (strengths(SPACE) < 10).sum() == 0
    for plan in DEGENERATE.values():
        assert (strengths(plan) > edge.REFUSED).sum() == 0


UNTURNED = {
    "turn about one axis": EdgePlan(motion="space", one_axis=True),
    "one orientation": EdgePlan(motion="space", spread_deg=0.3),
}


@pytest.mark.parametrize("why", [*DEGENERATE, *UNTURNED])
def test_motion_that_determines_nothing_is_refused_with_a_cure(why):
    plan = (DEGENERATE | UNTURNED)[why]
    words = why if why in UNTURNED else "times what noise makes of a zero"
    sentence = f"{words}.*(turn the flange|tilted)"
    for seed, regression in product(range(10), (False, True)):
        scene = edge_scenes(plan, Noise(0.05), default_rng(seed))
        with pytest.raises(UnobservableError, match=sentence):
            solve(scene, regression=regression)


@pytest.mark.parametrize("plan", [EdgePlan(groups=2), EdgePlan(positions=2)])
def test_too_few_groups_or_positions_are_refused(plan):
    scene = edge_scenes(plan, Noise(0.05), default_rng(11))
    with pytest.raises(UnobservableError, match=r"orientation.*: 2 given, at least 3"):
        solve(scene)
