"""Bad points in batches of edge scans: robust solutions from a known mount, and what the data say of themselves."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from profilecal.closed_form.edge import EdgeSolution, edge_equations
from profilecal.geometry.fitting import affine_residuals
from profilecal.geometry.noise import FALSE_ALARM, Noise, chi2_limit
from profilecal.geometry.poses import angle_between, frame_around
from profilecal.joint.descent import Fit, refine
from profilecal.joint.observability import spectrum
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.search import POSES, few_groups, in_space, thin, typical_residual
from profilecal.joint.solve import UNLIKELY
from profilecal.joint.state import State, normalised_square, pose_error
from profilecal.papers.edge_scenes import EdgeScene, observations_of

SUBSETS = 30  # tries with few groups each, one of which, it is hoped, holds no bad point
ROUGHLY = 1e-6  # tolerance of refinements
UNEXPLAINED = 2.0  # noise levels: larger residuals of most poses
CHUNK = 25  # problems at a time: what a processor keeps at hand
LEAST_POINTS = 3  # that stay in a group


@dataclass(frozen=True)
class Answers:
    """Sensor poses of a batch of B problems, with what is stated of them."""

    state: State
    covariance: np.ndarray  # (B, 6, 6) mm and rad, in the sensors' frames
    status: np.ndarray  # (B,) "ok", "weak" or "unobservable"
    rejected: np.ndarray  # (B, P)

    def error(self, truth: State) -> np.ndarray:
        """δ (B, 6), mm and rad."""
        return pose_error(self.state.rotation, self.state.translation, truth.rotation, truth.translation)

    def square(self, truth: State) -> np.ndarray:
        """Errors squared over their covariances, (B,): χ² with 6 degrees of freedom if honest."""
        return normalised_square(self.covariance, self.error(truth))


def in_chunks(answer, seen: Observations, start: State, *others) -> Answers:
    """`answer(part of seen, part of start, parts of others)` for CHUNK problems at a time, together."""
    parts = [slice(first, first + CHUNK) for first in range(0, len(start.rotation), CHUNK)]
    found = [answer(seen.take(part), start[part], *(other[part] for other in others)) for part in parts]
    fields = ("covariance", "status", "rejected")
    together = {name: np.concatenate([getattr(f, name) for f in found]) for name in fields}
    return Answers(found[0].state.join(*(f.state for f in found[1:])), **together)


def solve_without(seen: Observations, noise: Noise, start: State, rejected) -> Answers:
    """Least squares of the poses that are not `rejected` (B, P), from known starts."""

    def answer(seen, start, rejected):
        problem = Problem([seen], noise)
        return concluded(problem, refine(problem, start, weights=[~rejected], tolerance=ROUGHLY), rejected)

    return in_chunks(answer, seen, start, rejected)


def solve_robustly(seen: Observations, noise: Noise, start: State) -> Answers:
    """As `joint.solve.solve` with a stated noise, for batches of problems whose mount is roughly known: `start` takes
    the place of the grid of rotations. Where that leaves most poses unexplained, SUBSETS selections of few groups are
    tried from there too."""

    def answer(seen, start):
        problem = Problem([seen], noise)
        state, sizes = robust_fit(problem, start)
        unit = of_most(problem, sizes)
        if (open_ := np.flatnonzero(unit > UNEXPLAINED)).size:
            part = Problem([seen.take(open_)], noise)
            other, sizes[open_] = robust_fit(part, most_fitting(part, state[open_], start[open_]), 3)
            place, unit = np.arange(len(unit)), of_most(problem, sizes)
            place[open_] = len(unit) + np.arange(len(open_))
            state = state.join(other)[place]
        bad = beyond_chance(problem, sizes, unit)
        for _ in range(5):
            rejected, fit = bad, refine(problem, state, weights=[~bad], iterations=10, tolerance=ROUGHLY)
            bad, state = beyond_chance(problem, fit.per_pose[0], 1.0), fit.state
            if (bad == rejected).all():
                break
        return concluded(problem, fit, rejected)

    return in_chunks(answer, seen, start)


def robust_fit(problem: Problem, state: State, rounds: int = 5) -> tuple[State, np.ndarray]:
    """Cauchy's loss, its unit lowered from what the residuals look like to what the noise is; and the χ² (B, P) of each
    pose by residual."""
    sizes = problem.moments(state).per_pose[0]
    for _ in range(rounds):
        fit = refine(problem, state, scale=of_most(problem, sizes), iterations=5, tolerance=ROUGHLY)
        state, sizes = fit.state, fit.per_pose[0]
    return state, sizes


def of_most(problem: Problem, per_pose) -> np.ndarray:
    """How many noise levels large the residuals of most poses are, (B,), one at least, from their χ² (B, P)."""
    return np.maximum(typical_residual([per_pose], problem.freedoms()), 1.0)


def most_fitting(problem: Problem, found: State, start: State) -> State:
    """Of what was `found` and what selections of few groups lead to from the `start`, what fits most poses best, of
    about as many as `search_among_outliers` looks at."""
    (seen,), B = problem.observations, len(start.rotation)
    few = in_space([few_groups(seen, SUBSETS)], problem.noise)
    first = few.place(*(np.repeat(part, SUBSETS, axis=0) for part in (start.rotation, start.translation)))
    tried = refine(few, first, iterations=4, tolerance=ROUGHLY).state
    states = [found, *(tried[np.arange(k, B * SUBSETS, SUBSETS)] for k in range(SUBSETS))]
    looked = Problem([thin(seen, 2 * POSES)], problem.noise)
    sizes = (looked.moments(state).per_pose[0] for state in states)
    best = np.argmin([np.nan_to_num(of_most(looked, own), nan=np.inf) for own in sizes], axis=0)
    return states[0].join(*states[1:])[best * B + np.arange(B)]


def beyond_chance(problem: Problem, per_pose, scale) -> np.ndarray:
    """Poses (B, P) with residuals larger than chance makes them, and groups of which more than half are
    (`joint.solve.beyond_chance`). `scale` (B,) or one: how many noise levels large residuals are."""
    (term,), (k,) = problem.terms, problem.freedoms()
    bad = per_pose * k > np.reshape(scale, (-1, 1)) ** 2 * chi2_limit(FALSE_ALARM / term.P, k)
    member = np.eye(term.group.max() + 1)[term.group]
    size = member.sum(axis=0)
    crowd = (bad @ member > size / 2) & (size > 2)
    return bad | crowd[:, term.group]


def concluded(problem: Problem, fit: Fit, rejected) -> Answers:
    """What is stated of fits: the covariance, enlarged where the noise does not explain the residuals that are left.
    Where too few are left, nothing is known."""
    dof = (~rejected * problem.freedoms()[0]).sum(axis=1) - problem.n
    enough, dof = dof > 0, np.maximum(dof, 1)
    nothing = 1e-20 * np.diag(problem.units**-2.0)
    factor = fit.chi2 / dof
    factor = np.where(factor > chi2_limit(UNLIKELY, dof) / dof, factor, 1.0)[:, None, None]
    found = spectrum(np.where(enough[:, None, None], fit.information / factor, nothing), problem.units)
    return Answers(fit.state, found.covariance, found.status, rejected)


def screen(T_flange, points, noise_mm: float) -> np.ndarray:
    """Which points (..., G, N, 2) of edge scans do not fit their group, (..., G, N), before anything is calibrated.

    Inside a group the sensed point is an affine function of the flange position, T_flange (..., G, N, 3) mm. The point
    that fits worst is taken out as long as chance does not explain it, as `calibrate.check.affine_outliers` does, and
    as long as two degrees of freedom are left: with one, all points of a group fit equally badly.
    """
    bad = np.zeros(points.shape[:-1], dtype=bool)
    limit = chi2_limit(FALSE_ALARM / (bad.shape[-1] * bad.shape[-2]), 2)
    while True:
        left, basis, freedom = affine_residuals(T_flange, points, np.where(bad, 0.0, 1.0))
        free = 1 - np.sum(basis**2, axis=-1)  # the part of a point's own error that its residual shows
        enough = (freedom > bad.sum(axis=-1) + 1) & (free.min(axis=-1) > 1e-6) & ((~bad).sum(axis=-1) > LEAST_POINTS)
        size = np.sum(left**2, axis=-1) / np.maximum(free, 1e-6) / noise_mm**2
        worst = np.arange(bad.shape[-1]) == size.argmax(axis=-1)[..., None]
        found = worst & (size > limit) & enough[..., None]
        if not found.any():
            return bad
        bad |= found


def two_phase_without(scene: EdgeScene, bad) -> EdgeSolution:
    """The two-phase method without bad points (..., G, N). In their place stands the mean of their group's good ones,
    position and point, which fits every equation as these do: the point is affine in the position."""

    def filled(values):
        good = ~bad[..., None]
        mean = (values * good).sum(axis=-2, keepdims=True) / np.maximum(good.sum(axis=-2, keepdims=True), 1)
        return np.where(good, values, mean)

    return edge_equations(scene.poses.rotations, filled(scene.poses.positions), filled(scene.points))


def truth_of(scene: EdgeScene) -> State:
    """What stands behind a batch of edge scenes."""
    edge = scene.edge
    return State(scene.R_sensor, scene.T_sensor, ((edge.point, frame_around(edge.direction)),))


def compare(scene: EdgeScene, planted, noise: Noise, start: State) -> pd.DataFrame:
    """All methods on a batch of scenes with bad points `planted` (B, G, N): one row for each scene and method.

    Rotation [°], translation [mm]: errors. Square: over the covariance, squared; status: as stated; missed, lost: the
    shares of bad points kept and of good ones left out. Robust solutions begin at `start`, least squares at the truth.
    """
    seen, truth, nothing = observations_of(scene), truth_of(scene), np.zeros_like(planted)
    screened, flat = screen(scene.poses.positions, scene.points, noise.profile_mm), (len(planted), -1)
    joint = {
        "good points alone": solve_without(seen, noise, truth, planted.reshape(flat)),
        "least squares": solve_without(seen, noise, truth, nothing.reshape(flat)),
        "robust joint": solve_robustly(seen, noise, start),
    }
    frames = [row_of(name, a.state, planted, a.rejected, truth, a.square(truth), a.status) for name, a in joint.items()]
    for name, bad in (("two-phase", nothing), ("two-phase, screened", screened)):
        found = two_phase_without(scene, bad)
        pose = State(found.R_sensor, found.T_sensor, ())
        frames.append(row_of(name, pose, planted, bad, truth, np.full(len(planted), np.nan), ""))
    return pd.concat(frames, ignore_index=True)


def row_of(method: str, state: State, planted, rejected, truth: State, square, status) -> pd.DataFrame:
    """A method's rows of `compare`."""
    planted, rejected = (mask.reshape(len(mask), -1) for mask in (planted, rejected))
    with np.errstate(invalid="ignore"):
        missed = (planted & ~rejected).sum(axis=1) / planted.sum(axis=1)
        lost = (~planted & rejected).sum(axis=1) / (~planted).sum(axis=1)
    return pd.DataFrame(
        {
            "method": method,
            "rotation": np.degrees(angle_between(state.rotation, truth.rotation)),
            "translation": np.linalg.norm(state.translation - truth.translation, axis=1),
            "square": square,
            "status": status,
            "missed": missed,
            "lost": lost,
        }
    )
