"""From a state to the nearest state of least loss."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from profilecal.geometry.noise import ROBOT, Noise
from profilecal.joint.observability import Spectrum, spectrum
from profilecal.joint.observations import Observations, State
from profilecal.joint.problem import Fit, Problem


def refine(
    problem: Problem,
    state: State,
    *,
    scale=None,
    weights=None,
    iterations: int = 60,
    tolerance: float = 1e-10,
    damping: float = 1e-4,
) -> Fit:
    """The state of least loss nearest to each of B states, by the scanner's noise alone. `scale`, `weights`: as
    `Problem.moments` takes them."""
    return descend(lambda at: problem.moments(at, scale, weights), problem.move, state, iterations, tolerance, damping)


def descend(moments, move, state: State, iterations: int, tolerance: float = 1e-10, damping: float = 1e-3) -> Fit:
    """Damped Gauss-Newton (Levenberg and Marquardt) on what `moments(state)` says, each problem with its own damping,
    which follows how much of what a step promised came true (Nielsen 1999). `move(state, step)` takes a step.

    Ends where the undamped step is below `tolerance` (rad, and a hundred times that in mm), promises less than
    rounding, or, along a flat valley, promises nothing that noise would not hide and does not even keep that.
    """
    flat = 1e-6  # of a loss: of a thousand residuals, a thirtieth of a standard deviation
    undamped = 1e-12
    B = len(state.rotation)
    factor, growth, done = np.full(B, damping), np.full(B, 2.0), np.zeros(B, dtype=bool)
    with np.errstate(all="ignore"):
        here = moments(state)
        for _ in range(iterations):
            step, promise = damped_step(here.normal, factor)
            small = reach(step) < tolerance
            early = small & (growth == 2.0) & (factor > undamped)  # perhaps small by damping only
            if early.any():
                factor = np.where(early, undamped, factor)
                step, promise = damped_step(here.normal, factor)
                small = reach(step) < tolerance
            trial = move(here.state, step)
            if small.any():  # nothing to look at there
                here = replace(here, state=trial.where(small & ~done, here.state))
            done |= small | (promise <= 1e-14 * here.loss)  # less is rounding
            if done.all():
                break
            there = moments(trial)
            kept = np.nan_to_num((here.loss - there.loss) / promise, nan=-1.0)
            better = (there.loss <= here.loss) & ~done  # false for NaN
            done |= (promise <= flat * here.loss) & (kept < 0.9)
            if better.all():
                here = there
            elif better.any():
                here = there.where(better, here)
            eased = factor * np.clip(1 - (2 * np.minimum(kept, 1) - 1) ** 3, 0.01, 2)
            factor = np.clip(np.where(better, eased, factor * growth), undamped, 1e8)
            growth = np.where(better, 2.0, 2 * growth)
    return here


def reach(step) -> np.ndarray:
    """How far steps (B, 6 or more) move sensor poses, rad or hundreds of mm."""
    reach = np.r_[100, 100, 100, 1, 1, 1]  # mm and rad: a step as large in one as in the other
    return np.abs(step[:, :6] / reach).max(axis=1)


def damped_step(normal, damping) -> tuple[np.ndarray, np.ndarray]:
    """The steps (B, n) that normal equations (B, n + 1, n + 1) ask for, damped by (B,) relative to each parameter's
    own size, and by how much they promise to lower the loss, (B,)."""
    size = np.sqrt(np.einsum("bii->bi", normal))
    size = np.where(size > 0, size, 1.0)
    size[:, -1] = 1.0  # of the residual
    relative = normal / (size[:, :, None] * size[:, None])
    relative = np.where(np.isfinite(relative), relative, 0.0)
    H, g = relative[:, :-1, :-1] + damping[:, None, None] * np.eye(size.shape[1] - 1), relative[:, :-1, -1]
    step = -np.linalg.solve(H, g[..., None])[..., 0]
    return step / size[:, :-1], (step * (damping[:, None] * step - g)).sum(axis=1)


def settle_targets(problem: Problem, rotation, translation, weights=None) -> State:
    """The sensor poses (1, 3, 3), (1, 3) with the targets where they see them best: Gauss-Newton steps of those alone,
    which leave what no residual shows where it is."""
    state, step = problem.place(rotation, translation), np.zeros((1, problem.n))
    for _ in range(20):
        normal = problem.moments(state, weights=weights).normal[0, 6:, 6:]
        step[0, 6:] = -np.linalg.solve(normal[:-1, :-1] + np.diag(problem.units[6:] ** -2), normal[:-1, -1])
        state = problem.move(state, step)
        if np.abs(step).max() < 1e-9:
            break
    return state


def estimate(
    observations: Sequence[Observations], noise: Noise, start: State, *, chunk: int = 64, steps: int = 60
) -> tuple[State, Spectrum, np.ndarray]:
    """For noise studies: batches of problems refined from known starts, chunk by chunk, by least squares with errors of
    the scanner and the robot that are as large as `noise` says.

    Returns the states (B), the sensor poses' spectra and χ² (B,).
    """
    states, information, chi2 = [], [], []
    for first in range(0, len(start.rotation), chunk):
        part = slice(first, first + chunk)
        seen = [entry.take(part) for entry in observations]
        problem = Problem(seen, noise)
        fit = refine(problem, start[part], iterations=steps, tolerance=1e-6, damping=1e-9)
        state, normal = fit.state, fit.normal
        if noise.of_robot:
            alone = (Problem([entry.take([k]) for entry in seen], noise) for k in range(len(state.rotation)))
            found = [with_robot(one, state[[k]]) for k, one in enumerate(alone)]
            state, normal = found[0][0].join(*(one for one, _ in found[1:])), np.array([n for _, n in found])
        states.append(state)
        information.append(normal[:, :-1, :-1])
        chi2.append(normal[:, -1, -1])
    return (
        states[0].join(*states[1:]),
        spectrum(np.concatenate(information), problem.units),
        np.concatenate(chi2),
    )


def with_robot(problem: Problem, state: State) -> tuple[State, np.ndarray]:
    """The generalised least squares of one problem from a state nearby, with errors of the robot as large as its noise
    says, and its normal equations (n + 1, n + 1): Gauss-Newton steps on the linear model."""
    names = [name for name in ROBOT if getattr(problem.noise, name)]
    v = np.array([[1.0, *(getattr(problem.noise, name) ** 2 for name in names)]])
    for _ in range(8):
        found = problem.model(state, names).posterior(v)
        state = problem.move(state, found.mean)
        if reach(found.mean).max() < 1e-6:
            break
    return state, problem.model(state, names).posterior(v).normal[0]
