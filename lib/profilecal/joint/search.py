"""Sensor poses worth refining, where none is known."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import descend, refine
from profilecal.joint.observations import Observations, State
from profilecal.joint.problem import Fit, Problem

POSES = 40  # the search looks at that many
GRID: Final = "I"  # scipy's name for 60 rotations: any rotation is within 45° of one of them
HOPELESS = 100.0  # times the noise, or the best loss
KEPT = 6  # starts that all poses are looked at from


def search(observations: Sequence[Observations], noise: Noise, starts=()) -> State:
    """Sensor poses worth refining, best first, at most KEPT: from `starts`, pairs (R (3, 3), T (3,) mm), and from a
    grid of rotations, each with the targets placed where it sees them, by distances in space and on a few poses. Where
    targets can be placed at every step, a coarse grid will do if several of its starts end at one pose that fits."""
    problem = in_space([thin(entry, POSES) for entry in observations], noise)
    count = problem.count()[0]
    if all(term.target.fit_is_best for term in problem.terms):
        state = problem.place(*started("T", starts))  # 12 rotations
        for _ in range(2):
            found = onward(problem, state, steps=8)
            state = found.state
            if found.loss[0] < HOPELESS * count and np.count_nonzero(alike(state)[0]) >= 5:
                return distinct(state[found.loss < HOPELESS * max(found.loss[0], count)])
    state = problem.place(*started(GRID, starts))
    for steps, kept in ((6, 24), (8, 10), (16, 6)):
        found = onward(problem, state, steps)
        state = distinct(found.state[found.loss < 10 * HOPELESS * max(found.loss[0], count)], kept)
    return distinct(found.state[found.loss < HOPELESS * max(found.loss[0], count)])


def started(grid: Literal["I", "T"], starts) -> tuple[np.ndarray, np.ndarray]:
    """Sensor poses (B, 3, 3), (B, 3): the starts, and those of a grid, at the flange."""
    rotation = Rotation.create_group(grid).as_matrix()
    R, T = [R for R, _ in starts], [T for _, T in starts]
    return np.array([*R, *rotation]), np.array([*T, *np.zeros((len(rotation), 3))])


def onward(problem: Problem, state: State, steps: int) -> Fit:
    """Where that many steps lead, best first."""
    found = descend(problem.moments, placing(problem), state, steps)
    return found[np.argsort(np.where(np.isfinite(found.loss), found.loss, np.inf))]


def placing(problem: Problem):
    """How to take steps, `problem.move`, that then place the targets anew where that is best: the search does not have
    to follow a target that turns as the sensor pose does (variable projection; Golub and Pereyra 1973)."""

    def move(state, step):
        moved = problem.move(state, step)
        placements = tuple(
            term.place(moved.rotation, moved.translation) if term.target.fit_is_best else placement
            for term, placement in zip(problem.terms, moved.placements, strict=True)
        )
        return replace(moved, placements=placements)

    return move


def search_among_outliers(observations: Sequence[Observations], noise: Noise, found: State) -> State:
    """`search` for data of which a part is wrong, in addition to what it `found`: each rotation of the grid looks at
    another few groups of poses, some of which hold no bad one, and the medians of all residuals tell which."""
    rotation = Rotation.create_group(GRID).as_matrix()
    subsets = in_space([few_groups(entry, len(rotation)) for entry in observations], noise)
    tried = refine(subsets, subsets.place(rotation, np.zeros((60, 3))), iterations=25).state
    problem = in_space([thin(entry, 2 * POSES) for entry in observations], noise)

    def of_most(state):
        return problem.typical(problem.moments(state))

    state = found.join(tried[np.isfinite(problem.moments(tried).loss)])
    state = state[np.argsort(of_most(state))[: 4 * KEPT]]
    for _ in range(3):
        state = refine(problem, state, scale=np.maximum(of_most(state), 1e-9), iterations=8).state
    return distinct(state[np.argsort(of_most(state))])


def in_space(observations: Sequence[Observations], noise: Noise) -> Problem:
    """The problem with distances in space and no robot errors."""
    return Problem(observations, Noise(noise.profile_mm), in_space=True)


def thin(observations: Observations, count: int) -> Observations:
    """About `count` poses, and five points in each where they lie on a curve."""
    P, m = observations.points.shape[-3:-1]
    step = max(1, m // 5) if observations.on_curve else 1
    few = observations.keep(np.unique(np.linspace(0, P - 1, min(P, count)).round().astype(int)))
    if step == 1:
        return few
    covariance = None if few.covariance is None else few.covariance[..., step // 2 :: step]
    return replace(few, points=few.points[..., step // 2 :: step, :], covariance=covariance)


def few_groups(observations: Observations, count: int) -> Observations:
    """A batch of `count` different selections of about a dozen poses of the first problem, each from few groups."""
    subset, of_group = 12, 3  # poses that one start looks at where some are bad, and of a group: few enough to be lucky
    rng, group, P = np.random.default_rng(0), observations.labels, len(observations.labels)
    size, chosen = np.bincount(group), []
    rank = np.concatenate([np.arange(n) for n in size])
    for _ in range(count):
        poses = rng.permutation(P)
        poses = poses[np.argsort(group[poses], kind="stable")]
        order = np.argsort(rank // of_group + rng.random(len(size)).repeat(size))  # a few of each group, then others
        chosen.append(poses[order[:subset]])
    few = thin(observations, P)
    given = {name: getattr(few, name) for name in ("R_flange", "T_flange", "points", "covariance")}
    together = {name: value[0][chosen] for name, value in given.items() if value is not None}
    return replace(few, **together, group=None)


def distinct(state: State, count: int = KEPT) -> State:
    """At most `count` sensor poses of a batch, in order, without those that repeat an earlier one."""
    repeats = alike(state)
    kept: list[int] = []
    for i in range(len(repeats)):
        if not repeats[i, kept].any():
            kept.append(i)
    return state[kept[:count]]


def alike(state: State) -> np.ndarray:
    """Which two sensor poses of a batch are one, (B, B)."""
    same = 0.02  # rad, and hundreds of mm: sensor poses nearer to each other are one
    turn = angle_between(state.rotation[:, None], state.rotation)
    shift = np.linalg.norm(state.translation[:, None] - state.translation, axis=-1)
    return (turn < same) & (shift < 100 * same)
