"""What noise studies share: random numbers in chunks, the two last steps of the disk
and the ball method, and the joint solution of many problems.

Trials run along the last axis of both methods' arrays, because NumPy is fast along long
axes only.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy import ndarray
from numpy.linalg import norm
from numpy.typing import ArrayLike

from profilecal.closed_form.two_step import solve_translation
from profilecal.geometry.fitting import ROUNDS
from profilecal.geometry.noise import Noise
from profilecal.geometry.observability import Spectrum, spectrum
from profilecal.joint.descent import refine
from profilecal.joint.problem import Problem, reach
from profilecal.targets.observations import Observations
from profilecal.targets.state import State

# Random numbers drawn at a time: 256 kB, which together with their powers stay in a
# processor's own cache.
BLOCK = 2**15
PROBLEMS = 64  # solved at a time


# Readings of "the standard deviation e" of the disk paper's Figs 15 and 17: from errors
# (..., trials, 3) to (...)
READINGS = {
    "standard deviation of the norms": lambda e: norm(e, axis=-1).std(axis=-1),
    "root mean square": lambda e: np.sqrt((e**2).sum(axis=-1).mean(axis=-1)),
    "mean of the norms": lambda e: norm(e, axis=-1).mean(axis=-1),
}
# The one that counts wherever the paper says "standard deviation": no other gives the
# numbers of Section V-D2, the only ones without a free setting.
COUNTED = "root mean square"


@dataclass(frozen=True)
class Scans:
    """The truth behind simulated scans: where the sensor is, how the flange turns."""

    R_sensor: ndarray  # (3, 3) sensor on the flange
    T_sensor: ndarray  # (3,) mm
    R_tcp: ndarray  # (n, 3, 3) flange in the base frame

    @property
    def rotation(self) -> ndarray:
        """Orientations of the sensor in the base frame, (n, 3, 3)."""
        return self.R_tcp @ self.R_sensor

    def origins(self, T_tcp: ndarray) -> ndarray:
        """Origins of the sensor in the base frame, mm, at flange positions T_tcp, both
        (n, m, 3).
        """
        return T_tcp + (self.R_tcp @ self.T_sensor)[:, None]


@dataclass(frozen=True)
class Study:
    """Errors for every setting (sigma_mm, m) and trial."""

    sigma_mm: ndarray  # (k,) noise, mm
    m: ndarray  # (l,) chords of a scan, or arcs of a pose
    errors: ndarray  # (k, l, 9, trials), see `two_step_errors`

    @classmethod
    def blank(cls, sigma_mm: ArrayLike, m: ArrayLike, trials: int) -> "Study":
        """A study whose errors are still to be filled in, for one or more sigma_mm and
        one or more m.
        """
        sigma_mm, m = np.atleast_1d(sigma_mm), np.atleast_1d(m)
        return cls(sigma_mm, m, np.empty((len(sigma_mm), len(m), 9, trials)))

    @property
    def centre_error(self) -> ndarray:
        """Errors of the disk's or ball's centre in the base frame, (k, l, trials, 3),
        mm.
        """
        return self.errors[:, :, :3].mT

    @property
    def rotation_error(self) -> ndarray:
        """Rotation vectors from true to found sensor, flange frame, (k, l, trials, 3),
        rad.
        """
        return self.errors[:, :, 3:6].mT

    @property
    def translation_error(self) -> ndarray:
        """Errors of the sensor's position on the flange, (k, l, trials, 3), mm."""
        return self.errors[:, :, 6:].mT

    @property
    def failed(self) -> ndarray:
        """Trials without a finite result, (k, l, trials)."""
        return ~np.isfinite(self.errors).all(axis=2)


def in_chunks(
    run: Callable,
    shape: tuple[int, ...],
    trials: int,
    rng: np.random.Generator,
    workers: int | None = None,
) -> None:
    """Call run(setting, part, stream) for each setting, an index into `shape`, and each
    chunk of its trials, a slice.

    Each chunk has its own random stream, so that the number of workers changes nothing.
    `workers` None stands for one for each core. They are threads, because NumPy leaves
    the interpreter's lock while it computes.
    """
    chunk = 1000  # trials: memory stays flat, and workers wait little for each other
    firsts = range(0, trials, chunk)
    parts = [slice(first, min(first + chunk, trials)) for first in firsts]
    settings, parts = zip(*product(np.ndindex(*shape), parts), strict=True)
    streams = rng.spawn(len(parts))
    with ThreadPoolExecutor(max_workers=workers or os.cpu_count()) as pool:
        list(pool.map(run, settings, parts, streams))


def noisy_blocks(
    exact: ndarray, sd: ArrayLike, size: int, rng: np.random.Generator
) -> Iterator[tuple]:
    """Blocks of `size` trials of `exact` (...) plus normal noise, whose standard
    deviation `sd` broadcasts against it.

    Yields the trials, as a slice; their values (block, ...); and two arrays of that
    shape to compute in. The next block takes all three arrays over, because new memory
    would cost more than what is computed in it.
    """
    length = max(1, min(size, BLOCK // exact.size))
    memory = np.empty((3, length, *exact.shape))
    for first in range(0, size, length):
        last = min(first + length, size)
        block, *work = memory[:, : last - first]
        rng.standard_normal(out=block)
        block *= sd
        block += exact
        yield slice(first, last), block, *work


def two_step_errors(
    scans: Scans,
    centre: ndarray,
    R_tcp: ndarray,
    T_tcp: ndarray,
    q: ndarray,
    X: ndarray,
    Y: ndarray,
) -> ndarray:
    """Errors (9, k) of k trials: of the fixed point `centre`, mm, of the rotation, rad,
    and of the translation, mm.

    Eqs 14-20 of the disk paper; `scans` has the truth. The rotation comes from
    directions X (n, 3, k) and Y (n, 3) or (n, 3, k), the translation from R_tcp (l, 3,
    3), T_tcp and q (l, 3, k) or (l, 3, 1).

    With the true rotation R₀ and R_sensor = turn R₀, Eqs 14 and 15 ask for turn R₀ X_i
    = Y_i, where X_i and Y_i have length one. The best turn is the rotation nearest to

        B = Σ Y_i (R₀ X_i)ᵀ,

    and is itself the error of the rotation.
    """
    X = X / np.linalg.norm(X, axis=1, keepdims=True)
    Y = Y / np.linalg.norm(Y, axis=1, keepdims=True)
    turn = rotations_near(np.tensordot(Y, scans.R_sensor @ X, (0, 0)))
    R_sensor = np.moveaxis(turn, -1, 0) @ scans.R_sensor
    seen = (np.moveaxis(of, -1, 0) for of in (T_tcp, q))
    found = solve_translation(R_tcp, *seen, R_sensor)
    point, shift = found.q_b - centre, found.T_sensor - scans.T_sensor
    return np.concatenate([point.T, rotation_vectors(turn), shift.T])


def rotation_vectors(R: ndarray) -> ndarray:
    """Rotation vectors (3, k), rad, of rotations R (3, 3, k) by less than a half turn.

    A rotation by θ about the unit vector a has R - Rᵀ = 2 sin θ [a]ₓ and trace R = 1 +
    2 cos θ.
    """
    sine_axis = np.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = np.linalg.norm(sine_axis, axis=0)
    angle = np.arctan2(sine, (np.trace(R) - 1) / 2)
    return sine_axis * (angle / np.maximum(sine, np.finfo(float).tiny))


def rotations_near(B: ndarray) -> ndarray:
    """The rotations (3, 3, k) nearest to B (3, 3, k).

    Let B = U diag(s₁, s₂, s₃) Vᵀ with rotations U and V, where at most one sᵢ is
    negative. The nearest rotation is U Vᵀ where all sᵢ + sⱼ > 0. The cofactors of B are

        cof B = U diag(s₂ s₃, s₃ s₁, s₁ s₂) Vᵀ,

    and those of a rotation are the rotation itself. A sum α B + β cof B, with α and β
    that give both one norm, keeps U and V, and of s₁ + s₂ it makes (s₁ + s₂) (α + β s₃)
    > 0, of the other pairs likewise: the nearest rotation stays the same.

    The sum also comes closer to it. Where B and cof B have a rotation's norm √3 and
    sᵢ = 1 + dᵢ, the dᵢ add up to zero but for their squares, and s₂ s₃ = 1 + d₂ + d₃ =
    1 - d₁ but for squares: in the mean of both, dᵢ is gone and its square left. A few
    rounds take an eighth of an SVD's time.
    """

    def halved(A: ndarray) -> ndarray:
        """A with half a rotation's norm, √3 / 2."""
        return A * np.sqrt(0.75 / np.einsum("abk,abk->k", A, A))

    R = B
    for _ in range(ROUNDS):
        first = halved(R)
        second = halved(np.cross(R[[1, 2, 0]], R[[2, 0, 1]], axis=1))  # of cofactors
        R = first + second
        if not (np.abs(first - second) > 1e-8).any():
            break
    return R


def estimate(
    observations: Sequence[Observations],
    noise: Noise,
    start: State,
    steps: int = 60,
) -> tuple[State, Spectrum, ndarray]:
    """States (B) of least squares from known starts, with errors of scanner and robot
    as large as `noise` says, the sensor poses' spectra and χ² (B,).
    """
    solved = []
    for first in range(0, len(start.rotation), PROBLEMS):
        part = slice(first, first + PROBLEMS)
        taken = [entry.take(part) for entry in observations]
        problem = Problem(taken, noise)
        fit = refine(problem, start[part], iterations=steps, damping=1e-9)
        if not noise.of_robot:
            solved.append((fit.state, fit.normal))
            continue
        for k in range(len(fit.loss)):
            alone = Problem([entry.take([k]) for entry in taken], noise)
            solved.append(with_robot(alone, fit.state[[k]]))
    states, normals = zip(*solved, strict=True)
    normal = np.concatenate(normals)
    found = spectrum(normal[:, :-1, :-1], problem.units)
    return State.join(*states), found, normal[:, -1, -1]


def with_robot(problem: Problem, state: State) -> tuple[State, ndarray]:
    """Generalised least squares of one problem from a state nearby, with errors of the
    robot as large as its noise says.

    Takes Gauss-Newton steps on the linear model. Returns the state, and the normal
    equations (1, n + 1, n + 1) of the last step, which is too small to change them.
    """
    sizes = problem.noise.of_robot
    variances = np.array([[1.0, *sizes.values()]]) ** 2
    for _ in range(8):
        found = problem.model(state, [*sizes]).posterior(variances)
        state = problem.move(state, found.mean)
        if reach(found.mean).max() < 1e-5:
            break
    return state, found.normal
