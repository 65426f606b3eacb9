"""What noise studies share: random numbers in chunks, the two last steps of the disk
and the ball method, and the joint solution of many problems.

Trials run along the last axis of both methods' arrays: NumPy is fast along long axes
only.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from profilecal.geometry.fitting import ROUNDS
from profilecal.geometry.noise import Noise
from profilecal.geometry.observability import Spectrum, spectrum
from profilecal.geometry.poses import cross
from profilecal.joint.descent import reach, refine
from profilecal.joint.problem import Problem
from profilecal.targets.observations import Observations, State

# random numbers drawn at a time: 256 kB, which with their powers stay in a processor's
# own cache
BLOCK = 2**15

# Readings of "the standard deviation e" of the disk paper's Figs 15 and 17: from errors
# (..., trials, 3) to (...)
READINGS = {
    "standard deviation of the norms": lambda errors: np.linalg.norm(
        errors, axis=-1
    ).std(axis=-1),
    "root mean square": lambda errors: np.sqrt((errors**2).sum(axis=-1).mean(axis=-1)),
    "mean of the norms": lambda errors: np.linalg.norm(errors, axis=-1).mean(axis=-1),
}


@dataclass(frozen=True)
class Study:
    """Errors for every setting (sigma_mm, m) and trial."""

    sigma_mm: np.ndarray  # (k,) noise, mm
    m: np.ndarray  # (l,) chords of a scan, or arcs of a pose
    errors: np.ndarray  # (k, l, 9, trials), see `two_step_errors`
    # (k, l, trials) of a disk: whether some scan has no arccos in Eq. 9
    clipped: np.ndarray | None = None

    @classmethod
    def blank(cls, sigma_mm, m, trials: int) -> "Study":
        """With everything still to be filled in, for one or more sigma_mm and m."""
        sigma_mm, m = (
            np.atleast_1d(np.asarray(sigma_mm, dtype=float)),
            np.atleast_1d(np.asarray(m, dtype=int)),
        )
        return cls(sigma_mm, m, np.empty((len(sigma_mm), len(m), 9, trials)))

    @property
    def centre_error(self) -> np.ndarray:
        """Of the disk's or ball's centre in the base frame, (k, l, trials, 3), mm."""
        return self.errors[:, :, :3].mT

    @property
    def rotation_error(self) -> np.ndarray:
        """Rotation vectors from true to found sensor, flange frame, (k, l, trials, 3),
        rad.
        """
        return self.errors[:, :, 3:6].mT

    @property
    def translation_error(self) -> np.ndarray:
        """Of the sensor on the flange, (k, l, trials, 3), mm."""
        return self.errors[:, :, 6:].mT

    @property
    def failed(self) -> np.ndarray:
        """Trials without a finite result, (k, l, trials)."""
        return ~np.isfinite(self.errors).all(axis=2)


def in_chunks(
    run, shape, trials: int, rng: np.random.Generator, workers: int | None
) -> None:
    """Call run(setting, part, stream) for each setting, an index into `shape`, and each
    chunk of its trials, a slice.

    Each chunk has its own random stream: the number of workers changes nothing. None:
    one for each core, as threads, because NumPy leaves the interpreter's lock while it
    computes.
    """
    chunk = 1000  # trials: memory stays flat, and workers wait little for each other
    parts = [
        slice(first, min(first + chunk, trials)) for first in range(0, trials, chunk)
    ]
    tasks = [(setting, part) for setting in np.ndindex(*shape) for part in parts]
    with ThreadPoolExecutor(max_workers=workers or os.cpu_count()) as pool:
        done = pool.map(
            lambda task, stream: run(*task, stream), tasks, rng.spawn(len(tasks))
        )
        for _ in tqdm(done, total=len(tasks), disable=None, leave=False):
            pass


def noisy_blocks(exact, sd, size: int, rng: np.random.Generator):
    """Blocks of `size` trials of `exact` (...) plus normal noise, whose standard
    deviation `sd` broadcasts against it.

    Yields the trials, as a slice; their values (block, ...); and two arrays of that
    shape to be filled, until the next block takes them over: new memory would cost more
    than what is computed in it.
    """
    memory = np.empty((3, max(1, min(size, BLOCK // exact.size)), *exact.shape))
    for first in range(0, size, memory.shape[1]):
        part = slice(first, min(first + memory.shape[1], size))
        block, *work = memory[:, : part.stop - first]
        rng.standard_normal(out=block)
        block *= sd
        block += exact
        yield part, block, *work


def two_step_errors(scans, centre, R_tcp, T_tcp, q, X, Y) -> np.ndarray:
    """Errors (9, k) of k trials: of the fixed point `centre`, mm, of the rotation, rad,
    and of the translation, mm.

    Eqs 14-20 of the disk paper; `scans` has the truth. The rotation comes from
    directions X (n, 3, k) and Y (n, 3), the translation from R_tcp (l, 3, 3), T_tcp and
    q (l, 3, k) or (l, 3, 1), by one matrix for all trials (Eq. 19).
    """
    X = X / np.linalg.norm(X, axis=1, keepdims=True)
    Y = Y / np.linalg.norm(Y, axis=1, keepdims=True)
    # of Eq. 15, seen from the truth
    turn = rotations_near(np.tensordot(Y, scans.R_sensor @ X, (0, 0)))
    in_flange = np.einsum("abk,nbk->nak", turn, scans.R_sensor @ q)
    seen = R_tcp @ in_flange + T_tcp
    M, N = (
        (R_tcp[:-1] - R_tcp[1:]).reshape(-1, 3),
        (seen[1:] - seen[:-1]).reshape(-1, seen.shape[-1]),
    )
    T_sensor = np.linalg.pinv(M) @ N
    point = seen.mean(axis=0) + R_tcp.mean(axis=0) @ T_sensor
    errors = (
        point - centre[:, None],
        rotation_vectors(turn),
        T_sensor - scans.T_sensor[:, None],
    )
    return np.concatenate(errors)


def rotation_vectors(R) -> np.ndarray:
    """Rotation vectors (3, k) of rotations (3, 3, k) by less than a half turn."""
    sine_axis = np.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = np.linalg.norm(sine_axis, axis=0)
    angle = np.arctan2(sine, (np.trace(R) - 1) / 2)
    return sine_axis * (angle / np.maximum(sine, np.finfo(float).tiny))


def rotations_near(B) -> np.ndarray:
    """The rotations (3, 3, k) nearest to B (3, 3, k).

    A rotation equals its cofactors. The mean of another matrix and its cofactors, both
    scaled to a rotation's norm, has the same nearest rotation and is closer to it, soon
    by the square of their distance: an eighth of an SVD's time.
    """

    def half(A):  # of a matrix with a rotation's norm
        return A * np.sqrt(0.75 / np.einsum("abk,abk->k", A, A))

    R = B
    for _ in range(ROUNDS):
        first, second = (
            half(R),
            half(np.array([cross(R[1], R[2]), cross(R[2], R[0]), cross(R[0], R[1])])),
        )
        R = first + second
        if not (np.abs(first - second) > 1e-8).any():
            break
    return R


def estimate(
    observations: Sequence[Observations],
    noise: Noise,
    start: State,
    *,
    chunk: int = 64,
    steps: int = 60,
) -> tuple[State, Spectrum, np.ndarray]:
    """States (B) of least squares from known starts, with errors of scanner and robot
    as large as `noise` says, the sensor poses' spectra and χ² (B,).
    """
    found = []
    for first in range(0, len(start.rotation), chunk):
        part = slice(first, first + chunk)
        seen = [entry.take(part) for entry in observations]
        problem = Problem(seen, noise)
        fit = refine(
            problem, start[part], iterations=steps, tolerance=1e-6, damping=1e-9
        )
        if noise.of_robot:
            for k in range(len(fit.loss)):
                alone = Problem([entry.take([k]) for entry in seen], noise)
                found.append(with_robot(alone, fit.state[[k]]))
        else:
            found.append((fit.state, fit.normal))
    states, normals = zip(*found, strict=True)
    normal = np.concatenate(normals)
    return (
        State.join(*states),
        spectrum(normal[:, :-1, :-1], problem.units),
        normal[:, -1, -1],
    )


def with_robot(problem: Problem, state: State) -> tuple[State, np.ndarray]:
    """Generalised least squares of one problem from a state nearby, with errors of the
    robot as large as its noise says: Gauss-Newton steps on the linear model. And the
    normal equations (1, n + 1, n + 1) there.
    """
    sizes = problem.noise.of_robot
    v = np.array([[1.0, *sizes.values()]]) ** 2
    for _ in range(8):
        found = problem.model(state, sizes).posterior(v)
        state = problem.move(state, found.mean)
        if reach(found.mean).max() < 1e-6:
            break
    return state, problem.model(state, sizes).posterior(v).normal
