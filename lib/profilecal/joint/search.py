"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2 as chi2_law

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import refine
from profilecal.joint.observations import BATCHED, Observations
from profilecal.joint.problem import Problem
from profilecal.joint.state import State
from profilecal.joint.terms import _per_pose

# --- one data set, from start to statement ---

GRID = "I"  # scipy's name for the 60 rotations of the icosahedron: any rotation is within 45° of one of them


SEARCH_POSES, SEARCH_POINTS = 40, 5  # the search looks at that many poses, and points in each


SEARCH_ROUNDS = ((12, 30), (20, 12))  # steps, and how many starts go on after them


KEPT = 6  # starts that all poses are looked at from


SUBSET = 24  # poses that one start looks at where some are bad: few enough to be lucky


def search(observations: Sequence[Observations], noise: Noise, starts=()) -> State:
    """Sensor poses worth refining, best first, at most KEPT: from `starts`, pairs (R (3, 3), T (3,) mm), and from a
    grid of rotations, each with the targets placed where it sees them, by distances in space and on a few poses."""
    problem = Problem([_thin(entry, SEARCH_POSES) for entry in observations], Noise(noise.profile_mm))
    rotation, translation = Rotation.create_group(GRID).as_matrix(), np.zeros((60, 3))
    if len(starts):
        rotation = np.concatenate([[R for R, _ in starts], rotation])
        translation = np.concatenate([[T for _, T in starts], translation])
    state = problem.place(rotation, translation)
    for steps, kept in SEARCH_ROUNDS:
        found = refine(problem, state, in_plane=False, iterations=steps)
        state = found.state[np.argsort(np.where(np.isfinite(found.loss), found.loss, np.inf))[:kept]]
    return state[_distinct(state, range(len(state.rotation)))[:KEPT]]


def search_among_outliers(observations: Sequence[Observations], noise: Noise, found: State) -> State:
    """`search` for data of which a part is wrong, in addition to what it `found`: each rotation of the grid looks at
    another few groups of poses, some of which hold no bad one, and the medians of all residuals tell which."""
    rotation = Rotation.create_group(GRID).as_matrix()
    subsets = Problem([_subsets(entry, len(rotation)) for entry in observations], Noise(noise.profile_mm))
    tried = refine(subsets, subsets.place(rotation, np.zeros((60, 3))), in_plane=False, iterations=25).state
    problem = Problem([_thin(entry, 2 * SEARCH_POSES) for entry in observations], Noise(noise.profile_mm))
    count = [_per_pose(term) for term in problem.terms]
    tried = tried[np.isfinite(problem.moments(tried, in_plane=False)[1])]
    state = State.join(found, tried)
    own = problem.moments(state, in_plane=False)[2]
    state = state[np.argsort(_spread(own, count))[: 4 * KEPT]]
    for _ in range(3):
        scale = np.maximum(_spread(problem.moments(state, in_plane=False)[2], count), 1e-9)
        state = refine(problem, state, scale=scale, in_plane=False, iterations=8).state
    order = np.argsort(_spread(problem.moments(state, in_plane=False)[2], count))
    return state[_distinct(state, order)[:KEPT]]


def _thin(observations: Observations, count: int) -> Observations:
    """About `count` poses, and SEARCH_POINTS points in each where profiles are used."""
    P, m = observations.points.shape[-3:-1]
    step = max(1, m // SEARCH_POINTS) if observations.kind in ("ball", "plane") else 1
    few = observations.keep(np.unique(np.linspace(0, P - 1, min(P, count)).round().astype(int)))
    if step == 1:
        return few
    covariance = None if few.covariance is None else few.covariance[..., step // 2 :: step]
    return replace(few, points=few.points[..., step // 2 :: step, :], covariance=covariance)


def _subsets(observations: Observations, count: int) -> Observations:
    """A batch of `count` different selections of about SUBSET poses, each from few groups."""
    P = observations.points.shape[-3]
    group = np.arange(P) if observations.group is None else np.unique(observations.group, return_inverse=True)[1]
    groups = group.max() + 1
    each = max(3, -(-SUBSET // groups), SUBSET // 5 if groups < P else 1)
    batch = []
    for k in range(count):
        shuffled = np.argsort((np.arange(1, groups + 1) * (k + 1) * (np.sqrt(5) - 1) / 2) % 1, kind="stable")
        members = [np.flatnonzero(group == g) for g in shuffled]
        picked = [m[np.unique(np.linspace(0, len(m) - 1, min(each, len(m))).astype(int))] for m in members]
        batch.append(np.concatenate(picked)[: min(SUBSET, P)])
    short = min(map(len, batch))
    thin = [_thin(observations.keep(chosen[:short]), short) for chosen in batch]
    names = BATCHED if observations.covariance is not None else BATCHED[:-1]
    return replace(thin[0], **{name: np.concatenate([getattr(t, name) for t in thin]) for name in names}, group=None)


def _distinct(state: State, order, turn: float = 0.02, shift: float = 2.0) -> list[int]:
    """Indices in the given order without those that repeat an earlier pose (within 1° and 2 mm)."""
    kept: list[int] = []
    for i in order:
        same = (angle_between(state.rotation[kept], state.rotation[i]) < turn) & (
            np.linalg.norm(state.translation[kept] - state.translation[i], axis=-1) < shift
        )
        if not same.any():
            kept.append(int(i))
    return kept


def _spread(own, count) -> np.ndarray:
    """How many noise levels large the residuals of most poses are, (B,), from medians: bad poses do not count."""
    level = [np.median(o * (k / chi2_law.median(k)), axis=1) for o, k in zip(own, count, strict=True)]
    return np.sqrt(np.mean(level, axis=0))
