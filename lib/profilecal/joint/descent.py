"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.joint.observability import Spectrum, spectrum
from profilecal.joint.observations import Observations, take
from profilecal.joint.problem import Problem, units_by_hand
from profilecal.joint.state import State, pose_error


@dataclass(frozen=True)
class Fit:
    """Where a refinement of B problems ended."""

    state: State
    M: np.ndarray  # (B, n + 1, n + 1) normal equations there
    loss: np.ndarray  # (B,)
    per_pose: list  # (B, P) each pose's χ² per residual, for each target
    converged: np.ndarray  # (B,)

    @property
    def information(self) -> np.ndarray:
        """(B, n, n), mm and rad."""
        return self.M[:, :-1, :-1]

    @property
    def chi2(self) -> np.ndarray:
        return self.M[:, -1, -1]


def refine(
    problem: Problem,
    state: State,
    *,
    scale=None,
    weights=None,
    in_plane: bool = True,
    iterations: int = 60,
    tolerance: float = 1e-10,
    damping: float = 1e-4,
) -> Fit:
    """The state of least loss nearest to each of B states: `descend`, with the whitening of robot errors held fixed
    meanwhile and then brought up to date, until that moves nothing."""
    how = (scale, weights, in_plane, iterations, tolerance, damping)
    if not problem.has_robot:
        return descend(problem, state, None, *how)
    for _ in range(8):
        fit = descend(problem, state, problem.whitening(state), *how)
        moved = pose_error(state.rotation, state.translation, fit.state.rotation, fit.state.translation)
        state = fit.state
        if np.abs(moved / np.r_[100, 100, 100, 1, 1, 1]).max() < 1e3 * tolerance:
            break
    return fit


def descend(problem, state, whitening, scale, weights, in_plane, iterations, tolerance, damping) -> Fit:
    """Damped Gauss-Newton (Levenberg and Marquardt), each of B problems with its own damping.

    Ends where the step is below `tolerance` (rad, and a hundred times that in mm), or promises less than rounding.
    """
    B = len(state.rotation)
    with np.errstate(all="ignore"):
        M, loss, per_pose = problem.moments(state, scale, in_plane, weights, whitening)
        damping, done = np.full(B, damping), np.zeros(B, dtype=bool)
        for _ in range(iterations):
            size = np.sqrt(np.einsum("bii->bi", M)[:, :-1])
            size = np.where(size > 0, size, 1.0)
            H = M[:, :-1, :-1] / (size[:, :, None] * size[:, None])
            H = np.where(np.isfinite(H), H, 0.0) + damping[:, None, None] * np.eye(problem.n)
            g = np.nan_to_num(M[:, :-1, -1] / size, posinf=0, neginf=0)
            scaled = -np.linalg.solve(H, g[..., None])[..., 0]
            step = scaled / size
            trial = problem.move(state, step)
            M_t, loss_t, per_pose_t = problem.moments(trial, scale, in_plane, weights, whitening)
            small = (np.abs(step[:, 3:6]).max(axis=1) < tolerance) & (np.abs(step[:, :3]).max(axis=1) < 100 * tolerance)
            flat = -np.einsum("bi,bi->b", g, scaled) <= 1e-15 * loss
            better = np.isfinite(loss_t) & (loss_t <= loss) & ~done
            state = State.where(better, trial, state)
            M = np.where(better[:, None, None], M_t, M)
            per_pose = [np.where(better[:, None], a, b) for a, b in zip(per_pose_t, per_pose, strict=True)]
            loss = np.where(better, loss_t, loss)
            done |= small | flat
            damping = np.where(better, np.maximum(damping * 0.05, 1e-12), np.minimum(damping * 20, 1e8))
            if done.all():
                break
    return Fit(state, M, loss, per_pose, done)


def estimate(
    observations: Sequence[Observations], noise: Noise, start: State, *, chunk: int = 64, steps: int = 60
) -> tuple[State, Spectrum, np.ndarray]:
    """For noise studies: batches of problems refined from known starts by least squares, chunk by chunk.

    Returns the states (B), the sensor poses' spectra and χ² (B,).
    """
    states, spectra, chi2 = [], [], []
    for first in range(0, len(start.rotation), chunk):
        part = slice(first, first + chunk)
        problem = Problem([take(o, part) for o in observations], noise)
        fit = refine(problem, start[part], iterations=steps, tolerance=1e-8, damping=1e-9)
        states.append(fit.state)
        spectra.append(spectrum(fit.information, units_by_hand(problem)))
        chi2.append(fit.chi2)
    state = states[0]
    for other in states[1:]:
        state = State.join(state, other)
    fields = ("covariance", "sd", "directions", "rank")
    together = Spectrum(*(np.concatenate([getattr(s, f) for s in spectra]) for f in fields), spectra[0].parameters)
    return state, together, np.concatenate(chi2)
