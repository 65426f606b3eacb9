"""The papers' solvers as users call them: rows in any order, groups of any size, and
refusals that name what is wrong.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import sensing_data as scenes
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.closed_form.ball import (
    solve_ball,
    solve_fixed_point,
    solve_tetra_ball,
)
from profilecal.closed_form.disk import solve_disk
from profilecal.closed_form.edge import solve_edge
from profilecal.geometry.poses import nearest_rotation, pose_error, rotations
from profilecal.simulation.scene import random_scene
from profilecal.targets import Ball
from profilecal_papers.batches import disk_method, edge_method


def arrays(scene, sigma=0.0, seed=2):
    """Flange poses, what is seen and the groups of a scene's rows."""
    seen = scene.noisy(sigma, default_rng(seed))
    points = seen.points[0, :, 0] if seen.kind == "edge" else seen.points[0]
    return seen.R_flange[0], seen.T_flange[0], points, seen.group


def edge_rows():
    return arrays(random_scene("edge", default_rng(1), groups=10), 0.05)


def uneven(group, sizes):
    """The rows of the first poses of each group, as many as `sizes` says in turn."""
    numbers = range(group.max() + 1)
    rows = [np.flatnonzero(group == k)[: sizes[k % len(sizes)]] for k in numbers]
    return np.concatenate(rows)


def shuffled(group, rng):
    """Rows in a random order, in which the first of each group stays the first."""
    rows = rng.permutation(len(group))
    firsts = np.unique(group, return_index=True)[1]
    for k, first in enumerate(firsts):
        places = np.flatnonzero(group[rows] == k)
        rows[places] = np.r_[first, rows[places][rows[places] != first]]
    return rows


def off(found, scene):
    """By how much an answer is wrong, mm and rad."""
    found, true = ((pose.R_sensor, pose.T_sensor) for pose in (found, scene))
    return np.abs(pose_error(*found, *true)).max()


def assert_same(found, expected, within=1e-9):
    assert_allclose(found.R_sensor, expected.R_sensor, rtol=0, atol=within)
    assert_allclose(found.T_sensor, expected.T_sensor, rtol=0, atol=within)


# The edge


def all_pairs(R_b, T_b, p_s, group):
    """R_sensor, T_sensor and the points, but for its shift, of the edge paper's
    equations, pair by pair.
    """
    unit = np.eye(9).reshape(9, 3, 3)
    p_s = np.insert(p_s, 1, 0, axis=1)
    first = np.array([np.flatnonzero(group == k)[0] for k in group])
    u_s, u_t = p_s - p_s[first], T_b - T_b[first]  # zero for the first of a group
    pairs = [*combinations(range(len(group)), 2)]
    A, b = [], []
    for i, j in pairs:  # Eq. 8, with R_s (a × b) = R_s a × R_s b
        if group[i] == group[j]:
            R = R_b[i] @ unit
            block = np.cross(R @ u_s[i], u_t[j]) + np.cross(u_t[i], R @ u_s[j])
            A.append((block + R @ np.cross(u_s[i], u_s[j])).T)
            b.append(-np.cross(u_t[i], u_t[j]))
    r = np.linalg.lstsq(np.concatenate(A), np.concatenate(b))[0]
    R_sensor = nearest_rotation(r.reshape(3, 3))

    p = np.einsum("nab,bc,nc->na", R_b, R_sensor, p_s) + T_b
    u_b = np.linalg.svd(p - p[first])[2][0]
    A, b = [], []
    for i, j in pairs:
        if group[i] != group[j]:
            A.append(np.cross((R_b[j] - R_b[i]).T, u_b).T)
            b.append(-np.cross(p[j] - p[i], u_b))
    return R_sensor, np.linalg.lstsq(np.concatenate(A), np.concatenate(b))[0], p


@pytest.mark.parametrize("sizes", [(10,), (3, 10, 4), (1, 5, 2, 7, 3)], ids=str)
def test_an_edge_seen_in_uneven_groups_is_solved_as_all_pairs_say(sizes):
    R_b, T_b, p_s, group = edge_rows()
    rows = default_rng(3).permutation(uneven(group, sizes))
    R_sensor, T_sensor, p = all_pairs(R_b[rows], T_b[rows], p_s[rows], group[rows])
    names = np.array([f"g{number:02}" for number in group[rows]])
    for given in ({}, {"group": names}):
        found = solve_edge(R_b[rows], T_b[rows], p_s[rows], **given)
        assert_allclose(found.R_sensor, R_sensor, rtol=0, atol=1e-9)
        assert_allclose(found.T_sensor, T_sensor, rtol=0, atol=1e-7)
        assert_allclose(found.p_b, p + R_b[rows] @ T_sensor, rtol=0, atol=1e-7)


def test_matrices_printed_to_four_decimals_form_groups_too():
    scene = random_scene("edge", default_rng(1))
    R_b, T_b, p_s, _ = arrays(scene)
    assert off(solve_edge(R_b.round(4), T_b, p_s), scene) < 0.1


# The disk


@pytest.mark.parametrize("heights", ["published", "regression"])
def test_a_disk_without_noise_is_exact_in_any_order_and_with_any_steps(heights):
    """Of poses and of the tips of each chord, by a rough guess, in groups that are
    given or found.
    """
    rng = default_rng(7)
    for seed in range(20):
        scene = random_scene("disk", default_rng(seed))
        R, T, chords, group = arrays(scene)
        rows = rng.permutation(len(T))[:100]
        swapped = rng.integers(2, size=(100, 1, 1))
        tips = np.where(swapped, chords[rows, ::-1], chords[rows])
        known = {"heights": heights, "group": group[rows] if seed % 2 else None}
        guess = scene.R_sensor @ rotations([0.1, -0.05, 0.15])
        found = solve_disk(R[rows], T[rows], tips, 50, guess, **known)
        assert off(found, scene) < 1e-7


# Batches


@pytest.mark.parametrize("regression", [False, True])
@pytest.mark.parametrize("kind", ["edge", "disk"])
def test_a_batch_takes_its_poses_in_any_order_and_finds_their_groups(kind, regression):
    scene = random_scene(kind, default_rng(4))

    def solved(seen):
        if kind == "edge":
            return edge_method(seen, regression)
        heights = "regression" if regression else "published"
        return disk_method(seen, scene.R_sensor, heights)

    assert off(solved(scene.noisy(0.0, default_rng(5), 3)), scene) < 1e-7
    seen = scene.noisy(0.02, default_rng(5), 3)
    expected = solved(seen)
    rows = shuffled(seen.group, default_rng(6))
    assert_same(solved(seen.keep(rows)), expected)
    assert_same(solved(replace(seen, group=None)), expected, 1e-12)


# Refusals


DISK = random_scene("disk", default_rng(1))
R, T, SEEN, GROUP = edge_rows()
OF_EDGE = {"R_b": R, "T_b": T, "p_s": SEEN}
REFLECTED = R @ np.diag([1.0, 1.0, -1.0])
EDGE_REFUSED = [
    ({"R_b": R[:0], "T_b": T[:0], "p_s": SEEN[:0]}, "poses: 0 given, at least 3"),
    ({"T_b": "here"}, "T_b is no array of numbers: could not convert"),
    (
        {"T_b": [*np.ma.masked_greater(T, 0)]},
        r"T_b\[.*\] is nan; expected finite numbers",
    ),
    ({"group": [1, 2]}, r"group has shape \(2,\); expected \(\d+,\)"),
    ({"group": 0 * GROUP}, r"R_b\[\d+\] differs from R_b\[0\], which has the same l"),
    ({"R_b": R.mT}, "the motions leave the pose open"),
    ({"p_s": SEEN / 25.4}, "the motions leave the pose open"),
]
R, T, SEEN, GROUP = arrays(DISK, 0.05)
OF_DISK = {"R_tcp": R, "T_tcp": T, "chords": SEEN, "radius": "50"}  # as in a file
KNOWN = {"R_sensor_guess": DISK.R_sensor}
TURN = rotations([np.pi / 2, 0, 0])
BENT = T + np.outer(np.arange(len(T)) == 1, [0, 0, 9])
DISK_REFUSED = [
    (KNOWN | {"radius": -1}, "radius is -1; expected a length in mm"),
    *((KNOWN | {"radius": r}, "is this the disk's radius") for r in (10, 45, 55, 500)),
    ({"R_sensor_guess": DISK.R_sensor @ TURN}, "does R_sensor_guess say the right way"),
    (KNOWN | {"chords": 0 * SEEN + SEEN[0, 0]}, "the 40 chords at .* hardly change"),
    (KNOWN | {"chords": SEEN * [1, 0]}, r"R_tcp\[0\] are on no ellipse"),
    (KNOWN | {"heights": "guessed"}, "heights is 'guessed'; expected 'regression'"),
    (KNOWN | {"T_tcp": BENT}, r"R_tcp\[0\], .* leave a line by more than 1% of that"),
    (KNOWN | {"T_tcp": 0 * T + 500}, r"orientation R_tcp\[0\], 0 mm from end to end"),
    ({"R_sensor_guess": REFLECTED[0]}, r"R_sensor_guess\[0\] is a reflection"),
]


def chords_of(rows):
    """Of the disk, these alone."""
    return KNOWN | {name: OF_DISK[name][rows] for name in ("R_tcp", "T_tcp", "chords")}


FEW = chords_of(uneven(GROUP, (9, 2)))
MIDDLE = chords_of(np.flatnonzero(np.abs(np.arange(len(GROUP)) % 40 - 20) < 3))
R, T, SEEN = scenes.ball_data(default_rng(8), 5, 4)[1]
BALL = Ball(np.zeros(3), radius=10.0)
OF_BALL = {"R_tcp": R, "T_tcp": T, "q": SEEN}
TWICE = OF_BALL | {"q": SEEN[[0, 1, 0, *range(3, 9)]]}
BEHIND = OF_BALL | {"q": SEEN * [1, -1, 1]}
MASKED = BALL.centre_from_circle(np.ma.masked_equal(np.eye(9, 3), 1), side=1)
SWAPPED = OF_BALL | {"q": SEEN[[*range(5), 6, 5, 7, 8]]}
T = OF_BALL["T_tcp"]
STILL = OF_BALL | {"T_tcp": T[[0, 0, 0, 0, *range(4, 9)]]}
ONE_WAY = OF_BALL | {"T_tcp": T[[0, 1, 1, 1, 1, *range(5, 9)]]}
NO_TRANSLATION = {name: values[4:] for name, values in OF_BALL.items()}
R, T, SEEN = scenes.point_data(default_rng(9))[1]
OF_POINT = {"R_tcp": R, "T_tcp": T, "q": SEEN[:, ::2]}
MIRRORED = {"q_b": np.eye(4, 3), "q_i": -np.eye(4, 3)}
IN_LINE = {"q_b": np.outer([0, 40, 120], [1, 2, 3]), "q_i": np.eye(3)}
REFUSED = [
    *((solve_edge, OF_EDGE | change, sentence) for change, sentence in EDGE_REFUSED),
    *((solve_disk, OF_DISK | change, sentence) for change, sentence in DISK_REFUSED),
    *((solve_ball, given, "no sensor pose fits") for given in (TWICE, BEHIND, SWAPPED)),
    (solve_ball, OF_BALL | {"q": MASKED}, r"q\[0, 0\] is nan; expected finite numbers"),
    (solve_ball, STILL, "translations are parallel in the flange frame"),
    (solve_ball, ONE_WAY, "translations are parallel in the flange frame"),
    (solve_ball, NO_TRANSLATION, "translating poses: 1 given, at least 3 needed"),
    (solve_fixed_point, OF_POINT | {"q": SEEN[::-1, ::2]}, "no sensor pose fits"),
    (solve_tetra_ball, MIRRORED, "no sensor pose fits"),
    (solve_tetra_ball, IN_LINE, "q_b: all 3 points lie on one line"),
    (solve_tetra_ball, MIRRORED | {"q_b": np.eye(2, 3)}, "pairs: 2 given, at least 3"),
    (
        solve_tetra_ball,
        MIRRORED | {"q_i": np.eye(2, 3)},
        "q_i has shape .2, 3.; ex",
    ),
    (solve_disk, OF_DISK | FEW, r"orientation R_tcp\[9\]: 2 given, at least 3"),
    (solve_disk, OF_DISK | MIDDLE, r"the 5 chords at .* hardly change in length"),
    (
        BALL.centre_from_circle,
        {"circle": [0, 9, 9], "side": [1, 0]},
        "side is 0; expected 1",
    ),
]
SOLVERS = [
    (solve_edge, OF_EDGE),
    (solve_disk, OF_DISK | KNOWN),
    (solve_ball, OF_BALL),
    (solve_fixed_point, OF_POINT),
]
ARRAYS = [
    (solve, given, name)
    for solve, given in SOLVERS
    for name in given
    if np.ndim(given[name]) > 1 and name not in KNOWN
]


@pytest.mark.parametrize(("solve", "given", "sentence"), REFUSED)
def test_malformed_arrays_are_refused_in_words(solve, given, sentence):
    with pytest.raises(ValueError, match=sentence):
        solve(**given)


@pytest.mark.parametrize(("solve", "given", "name"), ARRAYS)
def test_every_array_of_every_solver_is_checked(solve, given, name):
    values = given[name]
    mistakes = {
        rf"{name}\[0, 0.*\] is nan; expected finite": values * np.nan,
        rf"{name} has shape .*; expected \(": values[..., :1],
    }
    if name.startswith("R"):
        mistakes |= {
            rf"{name}\[0\] is a reflection": values[..., ::-1],
            rf"{name}\[0\] is not orthonormal: R Rᵀ .* by 0.02": 1.01 * values,
        }
    else:
        mistakes[f"value of {name} is .*; expected 10? to .*in mm"] = values / 1000
    for sentence, wrong in mistakes.items():
        with pytest.raises(ValueError, match=sentence):
            solve(**given | {name: wrong})
