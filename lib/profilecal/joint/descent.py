"""Least squares: from a state to the nearest one of least loss, and a search for states
where none is known.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import angle_between
from profilecal.joint.problem import Fit, Problem, reach
from profilecal.targets.observations import Observations
from profilecal.targets.state import State

POSES = 40  # that the search looks at
# 60 rotations: any rotation is within 45° of one of them
GRID = Rotation.create_group("I").as_matrix()
START_ROTATIONS = Rotation.create_group("T").as_matrix()  # 12
# a loss per residual, 1 for residuals as large as the noise; or as many times the best
# loss: residuals of ten noise levels, or ten times as large
HOPELESS = 100.0
KEPT = 6  # starts of the least squares over all poses
AGREEING = 5  # starts of a coarse grid that settle a search
# Rounds of a search: how many steps, how many states are kept after them, and how many
# times the best loss these states may have.
SEARCH_ROUNDS = [(6, 24, 10 * HOPELESS), (8, 10, 10 * HOPELESS), (16, KEPT, HOPELESS)]


def refine(
    problem: Problem,
    state: State,
    *,
    scale: ndarray | None = None,
    iterations: int = 60,
    tolerance: float = 1e-6,
    damping: float = 1e-4,
    anew: bool = False,
) -> Fit:
    """The state of least loss nearest to each of B states, by the scanner's noise
    alone, as Levenberg's and Marquardt's descent finds it for all of them at once.

    `scale`: as `Problem.moments` takes it; `anew`: as `Problem.move` does.

    Each problem has its own damping μ. It follows how much of what a step promised came
    true, the gain γ (Nielsen 1999): after a step that lowers the loss, μ is multiplied
    by 1 - (2 γ - 1)³, between 1/100 and 2; after one that does not, by 2, then 4, 8
    and so on.

    Ends where a step is below `tolerance` (rad, and a hundred times that in mm) or
    promises to lower the loss by less than rounding.
    """
    B = len(state.rotation)
    factor = np.full(B, damping)
    growth = np.full(B, 2.0)
    done = np.zeros(B, dtype=bool)
    with np.errstate(all="ignore"):
        here = problem.moments(state, scale)
        for _ in range(iterations):
            step, promise = damped_step(here.normal, factor)
            small = reach(step) < tolerance
            trial = problem.move(here.state, step, anew)
            # a small last step is taken without another look: the loss and the normal
            # equations of the fit are those before that step
            here = replace(here, state=trial.where(small & ~done, here.state))
            rounding = promise <= 1e-14 * here.loss
            done |= small | rounding
            if done.all():
                break
            there = problem.moments(trial, scale)
            gain = np.fmin((here.loss - there.loss) / promise, 1.0)
            better = (there.loss <= here.loss) & ~done  # false for NaN
            here = there.where(better, here)
            easing = np.clip(1 - (2 * gain - 1) ** 3, 0.01, 2)
            factor = np.clip(factor * np.where(better, easing, growth), 1e-12, 1e8)
            growth = np.where(better, 2.0, 2 * growth)
    return here


def damped_step(normal: ndarray, damping: ndarray) -> tuple[ndarray, ndarray]:
    """The steps x (B, n) that normal equations (B, n + 1, n + 1) ask for, damped by
    (B,), and by how much they promise to lower the loss, (B,).

    With H = Jᵀ J and g = Jᵀ r of the equations and D, the diagonal of H times the
    damping,

        (H + D) x = -g        promise = -2 gᵀ x - xᵀ H x = xᵀ (D x - g)
    """
    H = normal[:, :-1, :-1]
    H = np.where(np.isfinite(H), H, 0.0)
    g = normal[:, :-1, -1]
    diagonal = np.einsum("bii->bi", H)
    D = damping[:, None] * np.where(diagonal > 0, diagonal, 1.0)
    damped = H + D[:, None] * np.eye(D.shape[1])
    x = -np.linalg.solve(damped, g[..., None])[..., 0]
    return x, (x * (D * x - g)).sum(axis=1)


# After each step, targets are placed anew where that is best (variable projection;
# Golub and Pereyra 1973).
onward = partial(refine, damping=1e-3, anew=True)


def search(problem: Problem, starts: Sequence = ()) -> State:
    """Sensor poses worth refining, best first, at most KEPT: from `starts`, pairs (R
    (3, 3), T (3,) mm), and a grid of rotations, on a few poses, by distances in space.
    """
    few = few_poses(problem, POSES)
    count = few.counts.sum()
    if all(term.target.fit_is_best for term in few.terms):
        # targets can be placed at every step: a coarse grid will do if AGREEING of its
        # starts end at one pose that fits, after six steps or some more
        state = started(few, START_ROTATIONS, starts)
        for steps in (6, 3, 3, 3):
            fits = onward(few, state, iterations=steps).best_first
            state = fits.state
            agreeing = np.count_nonzero(are_one(state)[0])
            if fits.loss[0] < HOPELESS * count and agreeing >= AGREEING:
                limit = HOPELESS * max(fits.loss[0], count)
                return distinct(state[fits.loss < limit])
    state = started(few, GRID, starts)
    for steps, most, hopeless in SEARCH_ROUNDS:
        fits = onward(few, state, iterations=steps).best_first
        limit = hopeless * max(fits.loss[0], count)
        state = distinct(fits.state[fits.loss < limit], most)
        if len(state.rotation) == 1 and fits.loss[0] < HOPELESS * count:
            break
    return state


def few_poses(problem: Problem, count: int) -> Problem:
    """The problem of about `count` poses of each target, by distances in space. A
    search needs nothing that is known beforehand of the mount or of systematic errors.
    """
    few = [thin(seen, count) for seen in problem.observations]
    return Problem(few, problem.noise, in_space=True)


def started(problem: Problem, grid: ndarray, starts: Sequence = ()) -> State:
    """The states of the starts, and those of a grid of rotations with the sensor at the
    origin of the flange.
    """
    R, T = zip(*starts, *((R, np.zeros(3)) for R in grid), strict=True)
    return problem.place(np.array(R), np.array(T))


def search_among_outliers(problem: Problem, found: State) -> State:
    """Sensor poses worth refining where a part of the data is wrong, beside what
    `search` found. Rotation k of the grid looks at selection k of groups of poses
    alone, and some selections hold no bad pose. The states that fit most of twice as
    many poses as in a search are the ones worth refining.
    """
    selections = [few_groups(seen, len(GRID)) for seen in problem.observations]
    subsets = Problem(selections, problem.noise, in_space=True)
    tried = refine(subsets, started(subsets, GRID), iterations=25).state
    few = few_poses(problem, 2 * POSES)
    state = found.join(tried[np.isfinite(few.moments(tried).loss)])
    likely = np.argsort(few.typical(few.moments(state).per_pose))[: 4 * KEPT]
    return distinct(reweighted(few, state[likely], rounds=3).state)


def reweighted(problem: Problem, state: State, rounds: int) -> Fit:
    """Fits by Cauchy's loss, the one with the least residuals of most poses first. The
    unit of the loss is how large the residuals of most poses are, anew in each round,
    so that each round weighs bad poses down further.
    """
    fits = problem.moments(state)
    for _ in range(rounds):
        unit = problem.typical(fits.per_pose)
        fits = refine(problem, fits.state, scale=unit, iterations=8)
    return fits[np.argsort(problem.typical(fits.per_pose), kind="stable")]


def thin(observations: Observations, count: int) -> Observations:
    """About `count` poses, and about three points in each where they lie on a curve."""
    _, P, m, _ = observations.points.shape
    poses = np.linspace(0, P - 1, min(P, count)).round().astype(int)
    few = observations.keep(np.unique(poses))
    if not observations.on_curve:
        return few
    step = max(1, m // 3)
    chosen = slice(step // 2, None, step)
    covariance = few.covariance
    if covariance is not None:
        covariance = covariance[..., chosen]
    return replace(few, points=few.points[..., chosen, :], covariance=covariance)


def few_groups(observations: Observations, count: int) -> Observations:
    """A batch of `count` different selections of about a dozen poses of the first
    problem, each from few groups.
    """
    # how many poses a selection has, and how many of one group: few enough for some
    # selections to have no bad pose
    most, most_of_group = 12, 3
    # not the caller's generator: the same observations always have the same answer
    rng = np.random.default_rng(0)
    group = observations.labels
    P = len(group)
    # Poses draw places in their group; place // most_of_group is the round of a pose.
    # The order is by round, and within a round by group, with groups in random order.
    place = rng.random((count, P)) * np.bincount(group)[group]
    order = place // most_of_group + rng.random((count, P))[:, group]
    chosen = np.argsort(order, axis=1)[:, :most]
    few = thin(observations, P)
    arrays = {name: array[0][chosen] for name, array in few.arrays.items()}
    return replace(few, **arrays, group=None)


def distinct(state: State, count: int = KEPT) -> State:
    """At most `count` sensor poses of a batch, in order, without those that repeat an
    earlier one.
    """
    repeats = np.tril(are_one(state), -1).any(axis=1)
    return state[~repeats][:count]


def are_one(state: State) -> ndarray:
    """Which two sensor poses of a batch are one, (B, B)."""
    same = 0.02  # rad, and hundreds of mm: nearer sensor poses are one
    turn = angle_between(state.rotation[:, None], state.rotation)
    shift = np.linalg.norm(state.translation[:, None] - state.translation, axis=-1)
    return (turn < same) & (shift < 100 * same)
