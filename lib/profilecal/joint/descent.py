"""From a state to the nearest state of least loss."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.joint.observability import Spectrum, spectrum
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Moments, Problem
from profilecal.joint.state import State, pose_error

REACH = np.r_[100, 100, 100, 1, 1, 1]  # mm and rad: a step as large in one as in the other
ROUNDS = 8  # of bringing shared errors up to date, at most


@dataclass(frozen=True)
class Fit:
    """Where a refinement of B problems ended."""

    state: State
    normal: np.ndarray  # (B, n + 1, n + 1) normal equations there
    loss: np.ndarray  # (B,)
    per_pose: list  # (B, P) each pose's χ² per residual, for each target
    converged: np.ndarray  # (B,)

    def __getitem__(self, chosen) -> "Fit":
        per_pose = [own[chosen] for own in self.per_pose]
        return Fit(self.state[chosen], self.normal[chosen], self.loss[chosen], per_pose, self.converged[chosen])

    @property
    def information(self) -> np.ndarray:
        """(B, n, n), mm and rad."""
        return self.normal[:, :-1, :-1]

    @property
    def chi2(self) -> np.ndarray:
        return self.normal[:, -1, -1]


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
    """The state of least loss nearest to each of B states, with what shared errors do held fixed meanwhile and then
    brought up to date, until that moves nothing. `scale`, `weights`: as `Problem.moments` takes them."""
    for _ in range(ROUNDS if problem.has_effects else 1):
        effects = problem.effects(state)

        def moments(state, effects=effects):
            return problem.moments(state, scale, weights, effects)

        fit = descend(problem, state, moments, iterations, tolerance, damping)
        moved = pose_error(state.rotation, state.translation, fit.state.rotation, fit.state.translation)
        state = fit.state
        if np.abs(moved / REACH).max() < 1e3 * tolerance:
            break
    return fit


def descend(problem: Problem, state: State, moments, iterations: int, tolerance: float, damping: float) -> Fit:
    """Damped Gauss-Newton (Levenberg and Marquardt) on what `moments(state)` says, each problem with its own damping.

    Ends where the step is below `tolerance` (rad, and a hundred times that in mm), or promises less than rounding.
    """
    B = len(state.rotation)
    with np.errstate(all="ignore"):
        here = moments(state)
        damping, done = np.full(B, damping), np.zeros(B, dtype=bool)
        for _ in range(iterations):
            step, promise = damped_step(here.normal, damping)
            trial = problem.move(state, step)
            there = moments(trial)
            better = np.isfinite(there.loss) & (there.loss <= here.loss) & ~done
            state, here = trial.where(better, state), _where(better, there, here)
            done |= (np.abs(step[:, :6] / REACH).max(axis=1) < tolerance) | (promise <= 1e-15 * here.loss)
            damping = np.where(better, np.maximum(damping * 0.05, 1e-12), np.minimum(damping * 20, 1e8))
            if done.all():
                break
    return Fit(state, here.normal, here.loss, here.per_pose, done)


def damped_step(normal, damping) -> tuple[np.ndarray, np.ndarray]:
    """The steps (B, n) that normal equations (B, n + 1, n + 1) ask for, damped by (B,) relative to each parameter's
    own size, and by how much they promise to lower the loss, (B,)."""
    size = np.sqrt(np.einsum("bii->bi", normal)[:, :-1])
    size = np.where(size > 0, size, 1.0)
    H = normal[:, :-1, :-1] / (size[:, :, None] * size[:, None])
    H = np.where(np.isfinite(H), H, 0.0) + damping[:, None, None] * np.eye(size.shape[1])
    g = np.nan_to_num(normal[:, :-1, -1] / size, posinf=0, neginf=0)
    scaled = -np.linalg.solve(H, g[..., None])[..., 0]
    return scaled / size, -np.einsum("bi,bi->b", g, scaled)


def _where(mask, first: Moments, second: Moments) -> Moments:
    """The first where the mask (B,) holds, the second elsewhere."""
    per_pose = [np.where(mask[:, None], a, b) for a, b in zip(first.per_pose, second.per_pose, strict=True)]
    normal = np.where(mask[:, None, None], first.normal, second.normal)
    return Moments(normal, np.where(mask, first.loss, second.loss), per_pose)


def estimate(
    observations: Sequence[Observations], noise: Noise, start: State, *, chunk: int = 64, steps: int = 60
) -> tuple[State, Spectrum, np.ndarray]:
    """For noise studies: batches of problems refined from known starts by least squares, chunk by chunk.

    Returns the states (B), the sensor poses' spectra and χ² (B,).
    """
    states, spectra, chi2 = [], [], []
    for first in range(0, len(start.rotation), chunk):
        part = slice(first, first + chunk)
        problem = Problem([entry.take(part) for entry in observations], noise)
        fit = refine(problem, start[part], iterations=steps, tolerance=1e-8, damping=1e-9)
        states.append(fit.state)
        spectra.append(spectrum(fit.information, problem.units))
        chi2.append(fit.chi2)
    fields = ("covariance", "sd", "directions", "rank")
    together = {name: np.concatenate([getattr(s, name) for s in spectra]) for name in fields}
    return states[0].join(*states[1:]), Spectrum(**together, parameters=problem.n), np.concatenate(chi2)
