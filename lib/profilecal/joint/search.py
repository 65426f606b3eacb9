"""Sensor poses worth refining, where none is known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import gammaincinv

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import descend, refine
from profilecal.joint.observations import Observations, State
from profilecal.joint.problem import Fit, Problem

POSES, POINTS = 40, 5  # the search looks at that many poses, and points in each
COARSE, GRID = "T", "I"  # scipy's names for 12 and 60 rotations: any rotation is within 45° of one of the 60
STEPS, TIMES, AGREEING = 8, 2, 5  # from the coarse grid: steps, how often, and how many starts with one end are enough
ROUNDS = ((6, 24), (8, 10), (16, 6))  # from the grid: steps, and how many starts go on after them
HOPELESS = 100.0  # times the noise, or the best loss
KEPT = 6  # starts that all poses are looked at from
SUBSET = 24  # poses that one start looks at where some are bad: few enough to be lucky
SAME = 0.02  # rad, and hundreds of mm: sensor poses nearer to each other are one


def search(observations: Sequence[Observations], noise: Noise, starts=()) -> State:
    """Sensor poses worth refining, best first, at most KEPT: from `starts`, pairs (R (3, 3), T (3,) mm), and from a
    grid of rotations, each with the targets placed where it sees them, by distances in space and on a few poses. Where
    targets can be placed at every step, a coarse grid will do if several of its starts end at one pose that fits."""
    problem = in_space([thin(entry, POSES) for entry in observations], noise)
    count = problem.count()[0]
    if all(term.target.fit_is_best for term in problem.terms):
        state = problem.place(*started(COARSE, starts))
        for _ in range(TIMES):
            found = onward(problem, state, STEPS)
            state = found.state
            if found.loss[0] < HOPELESS * count and np.count_nonzero(alike(state)[0]) >= AGREEING:
                return distinct(state[found.loss < HOPELESS * max(found.loss[0], count)])
    state = problem.place(*started(GRID, starts))
    for steps, kept in ROUNDS:
        found = onward(problem, state, steps)
        state = distinct(found.state, kept)
    return distinct(found.state[found.loss < HOPELESS * max(found.loss[0], count)])


def started(grid: str, starts) -> tuple[np.ndarray, np.ndarray]:
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
        return typical_residual(problem.moments(state).per_pose, problem.freedoms())

    state = found.join(tried[np.isfinite(problem.moments(tried).loss)])
    state = state[np.argsort(of_most(state))[: 4 * KEPT]]
    for _ in range(3):
        state = refine(problem, state, scale=np.maximum(of_most(state), 1e-9), iterations=8).state
    return distinct(state[np.argsort(of_most(state))])


def in_space(observations: Sequence[Observations], noise: Noise) -> Problem:
    """The problem with distances in space, all points equally precise, and no robot errors."""
    return Problem(observations, Noise(noise.profile_mm), in_space=True)


def thin(observations: Observations, count: int) -> Observations:
    """About `count` poses, and POINTS points in each where they lie on a curve."""
    P, m = observations.points.shape[-3:-1]
    step = max(1, m // POINTS) if observations.on_curve else 1
    few = observations.keep(np.unique(np.linspace(0, P - 1, min(P, count)).round().astype(int)))
    return replace(few, points=few.points[..., step // 2 :: step, :], covariance=None)


def few_groups(observations: Observations, count: int) -> Observations:
    """A batch of `count` different selections of about SUBSET poses of each problem, each from few groups."""
    P, group = observations.points.shape[-3], observations.labels
    groups = group.max() + 1
    each = max(3, -(-SUBSET // groups), SUBSET // 5 if groups < P else 1)
    members = [np.flatnonzero(group == g) for g in range(groups)]
    members = [m[np.unique(np.linspace(0, len(m) - 1, min(each, len(m))).astype(int))] for m in members]
    chosen = []
    for k in range(count):
        shuffled = np.argsort((np.arange(1, groups + 1) * (k + 1) * (np.sqrt(5) - 1) / 2) % 1, kind="stable")
        chosen.append(np.concatenate([members[g] for g in shuffled])[: min(SUBSET, P)])
    short = min(map(len, chosen))
    chosen, few = np.array([poses[:short] for poses in chosen]), thin(observations, P)
    R, T, points = (np.concatenate(value[:, chosen]) for value in (few.R_flange, few.T_flange, few.points))
    return replace(few, R_flange=R, T_flange=T, points=points, group=None)


def distinct(state: State, count: int = KEPT) -> State:
    """At most `count` sensor poses of a batch, in order, without those that repeat an earlier one."""
    repeats, kept = alike(state), []
    for i in range(len(repeats)):
        if not repeats[i, kept].any():
            kept.append(i)
    return state[kept[:count]]


def alike(state: State) -> np.ndarray:
    """Which two sensor poses of a batch are one, (B, B)."""
    turn = angle_between(state.rotation[:, None], state.rotation)
    shift = np.linalg.norm(state.translation[:, None] - state.translation, axis=-1)
    return (turn < SAME) & (shift < 100 * SAME)


def typical_residual(per_pose, freedoms) -> np.ndarray:
    """How many noise levels large the residuals of most poses are, (B,), from medians: bad poses do not count."""
    # the median of χ² with k degrees of freedom is twice that of a gamma law with k/2
    level = [
        np.median(own * (k / (2 * gammaincinv(k / 2, 0.5))), axis=1) for own, k in zip(per_pose, freedoms, strict=True)
    ]
    return np.sqrt(np.mean(level, axis=0))
