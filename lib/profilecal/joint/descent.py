"""Least squares: from a state to the nearest one of least loss, and a search for states
where none is known.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between
from profilecal.joint.problem import Fit, Problem
from profilecal.targets.observations import Observations, State

POSES = 40  # the search looks at that many
# 60 rotations: any rotation is within 45° of one of them
GRID = Rotation.create_group("I").as_matrix()
COARSE = Rotation.create_group("T").as_matrix()  # 12
HOPELESS = 100.0  # times the noise, or the best loss
KEPT = 6  # starts that all poses are looked at from


def refine(
    problem: Problem,
    state: State,
    *,
    scale=None,
    weights=None,
    iterations=60,
    tolerance=1e-10,
    damping=1e-4,
) -> Fit:
    """The state of least loss nearest to each of B states, by the scanner's noise
    alone. `scale`, `weights`: as `Problem.moments` takes them.
    """
    return descend(
        lambda at: problem.moments(at, scale, weights),
        problem.move,
        state,
        iterations,
        tolerance,
        damping,
    )


def descend(
    moments,
    move,
    state: State,
    iterations: int,
    tolerance: float = 1e-10,
    damping: float = 1e-3,
) -> Fit:
    """Levenberg and Marquardt on what `moments(state)` says; `move(state, step)` takes
    a step. Each problem has its own damping, which follows how much of what a step
    promised came true (Nielsen 1999).

    Ends where a step is below `tolerance` (rad, and a hundred times that in mm) or
    promises less than rounding.
    """
    B = len(state.rotation)
    factor, growth, done = np.full(B, damping), np.full(B, 2.0), np.zeros(B, dtype=bool)
    with np.errstate(all="ignore"):
        here = moments(state)
        for _ in range(iterations):
            step, promise = damped_step(here.normal, factor)
            small = reach(step) < tolerance
            trial = move(here.state, step)
            # nothing to look at there
            here = replace(here, state=trial.where(small & ~done, here.state))
            done |= small | (promise <= 1e-14 * here.loss)  # less is rounding
            if done.all():
                break
            there = moments(trial)
            kept = np.nan_to_num((here.loss - there.loss) / promise, nan=-1.0)
            better = (there.loss <= here.loss) & ~done  # false for NaN
            here = there.where(better, here)
            eased = factor * np.clip(1 - (2 * np.minimum(kept, 1) - 1) ** 3, 0.01, 2)
            factor = np.clip(np.where(better, eased, factor * growth), 1e-12, 1e8)
            growth = np.where(better, 2.0, 2 * growth)
    return here


def reach(step) -> np.ndarray:
    """How far steps (B, 6 or more) move sensor poses, rad or hundreds of mm."""
    return np.abs(step[:, :6] / [100, 100, 100, 1, 1, 1]).max(axis=1)


def damped_step(normal, damping) -> tuple[np.ndarray, np.ndarray]:
    """The steps (B, n) that normal equations (B, n + 1, n + 1) ask for, damped by (B,)
    relative to each unknown's own size, and by how much they promise to lower the loss,
    (B,).
    """
    H, g = np.nan_to_num(normal[:, :-1, :-1]), normal[:, :-1, -1]
    size = np.einsum("bii->bi", H)
    more = damping[:, None] * np.where(size > 0, size, 1.0)
    step = -np.linalg.solve(H + more[:, None] * np.eye(size.shape[1]), g[..., None])[
        ..., 0
    ]
    return step, (step * (more * step - g)).sum(axis=1)


def search(observations: Sequence[Observations], noise: Noise, starts=()) -> State:
    """Sensor poses worth refining, best first, at most KEPT: from `starts`, pairs (R
    (3, 3), T (3,) mm), and a grid of rotations, on a few poses, by distances in space.
    Where targets can be placed at every step, a coarse grid will do if several of its
    starts end at one pose that fits.
    """
    problem = Problem(
        [thin(entry, POSES) for entry in observations], noise, in_space=True
    )
    count = problem.counts.sum()
    if all(term.target.fit_is_best for term in problem.terms):
        state = problem.place(*started(COARSE, starts))
        for _ in range(2):
            found = onward(problem, state, steps=8)
            state = found.state
            if (
                found.loss[0] < HOPELESS * count
                and np.count_nonzero(alike(state)[0]) >= 5
            ):
                return distinct(
                    state[found.loss < HOPELESS * max(found.loss[0], count)]
                )
    state = problem.place(*started(GRID, starts))
    for steps, kept, hopeless in (
        (6, 24, 10 * HOPELESS),
        (8, 10, 10 * HOPELESS),
        (16, KEPT, HOPELESS),
    ):
        found = onward(problem, state, steps)
        state = distinct(
            found.state[found.loss < hopeless * max(found.loss[0], count)], kept
        )
    return state


def started(grid, starts=()) -> tuple[np.ndarray, np.ndarray]:
    """Sensor poses (B, 3, 3), (B, 3): the starts, and those of a grid of rotations, at
    the flange.
    """
    R, T = zip(*starts, *((R, np.zeros(3)) for R in grid), strict=True)
    return np.array(R), np.array(T)


def onward(problem: Problem, state: State, steps: int) -> Fit:
    """Where that many steps lead, best first. After each, targets are placed anew where
    that is best (variable projection; Golub and Pereyra 1973).
    """

    def move(state, step):
        moved = problem.move(state, step)
        placements = tuple(
            term.place(moved.rotation, moved.translation)
            if term.target.fit_is_best
            else placement
            for term, placement in zip(problem.terms, moved.placements, strict=True)
        )
        return replace(moved, placements=placements)

    return descend(problem.moments, move, state, steps).best_first


def search_among_outliers(
    observations: Sequence[Observations], noise: Noise, found: State
) -> State:
    """`search` for data of which a part is wrong, beside what it `found`: each rotation
    of the grid looks at another few groups of poses, some of which hold no bad one. The
    medians of all residuals tell which.
    """
    subsets = Problem(
        [few_groups(entry, len(GRID)) for entry in observations], noise, in_space=True
    )
    tried = refine(subsets, subsets.place(*started(GRID)), iterations=25).state
    problem = Problem(
        [thin(entry, 2 * POSES) for entry in observations], noise, in_space=True
    )

    def of_most(state):
        return problem.typical(problem.moments(state))

    state = found.join(tried[np.isfinite(problem.moments(tried).loss)])
    state = state[np.argsort(of_most(state))[: 4 * KEPT]]
    for _ in range(3):
        state = refine(
            problem, state, scale=np.maximum(of_most(state), 1e-9), iterations=8
        ).state
    return distinct(state[np.argsort(of_most(state))])


def thin(observations: Observations, count: int) -> Observations:
    """About `count` poses, and about five points in each where they lie on a curve."""
    _, P, m, _ = observations.points.shape
    step = max(1, m // 5) if observations.on_curve else 1
    few = observations.keep(
        np.unique(np.linspace(0, P - 1, min(P, count)).round().astype(int))
    )
    covariance = (
        None if few.covariance is None else few.covariance[..., step // 2 :: step]
    )
    return replace(
        few, points=few.points[..., step // 2 :: step, :], covariance=covariance
    )


def few_groups(observations: Observations, count: int) -> Observations:
    """A batch of `count` different selections of about a dozen poses of the first
    problem, each from few groups.
    """
    # poses that one start looks at where some are bad, and of a group: few enough to be
    # lucky
    subset, of_group = 12, 3
    rng, group, P = (
        np.random.default_rng(0),
        observations.labels,
        len(observations.labels),
    )
    size, chosen = np.bincount(group), []
    rank = np.concatenate([np.arange(n) for n in size])
    for _ in range(count):
        poses = rng.permutation(P)
        poses = poses[np.argsort(group[poses], kind="stable")]
        # a few of each group, then others
        order = np.argsort(rank // of_group + rng.random(len(size)).repeat(size))
        chosen.append(poses[order[:subset]])
    few = thin(observations, P)
    return replace(
        few,
        **{name: array[0][chosen] for name, array in few.arrays.items()},
        group=None,
    )


def distinct(state: State, count: int = KEPT) -> State:
    """At most `count` sensor poses of a batch, in order, without those that repeat an
    earlier one.
    """
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
