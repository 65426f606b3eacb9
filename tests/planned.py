"""Setups for every target at one rough guess, and what a robot and a scanner that err would measure."""

from dataclasses import replace
from functools import cache

import numpy as np

from profilecal.geometry.poses import carry, rotations
from profilecal.joint.descent import refine
from profilecal.joint.observations import Observations
from profilecal.joint.sharing import level_variances, sharing
from profilecal.joint.state import pose_error
from profilecal.joint.systematic import considered
from profilecal.plan.entries import setup_of
from profilecal.plan.setup import Setup, problem_of
from profilecal.simulate.spec import read_spec

GUESS = {"mount": [60, -40, 110, 170, 10, 30], "target": [900, 50, 300]}
KINDS = ("edge", "disk", "ball", "plane", "rod")


def spec_of(kind: str, **entries):
    return read_spec({"kind": kind, "guess": GUESS} | entries)


@cache
def setup_for(kind: str, measured: str = "") -> Setup:
    """With raw profiles where there are any and nothing else is asked for, and robot errors as usual."""
    measured = measured or ("points" if kind == "point" else "profiles")
    return setup_of(spec_of(kind, measured=measured), {}, np.random.default_rng(1))


def measured(setup: Setup, R, T, trials: int, rng) -> Observations:
    """A batch of what is seen from flange poses (P, 3, 3), (P, 3) if everything errs that the setup says errs."""
    seen = setup.observed(R, T)
    shared, P = sharing([seen]), len(T)
    of_pose, of_orientation = shared.pose, shared.orientation[shared.pose]
    error = np.zeros((trials, P, 6))
    for variances, member in zip(level_variances(setup.noise), (np.arange(P), of_pose, of_orientation), strict=True):
        error += (np.sqrt(variances) * rng.normal(size=(trials, member.max() + 1, 6)))[:, member]
    R, T = rotations(error[..., 3:]) @ R, T + error[..., :3]
    points = np.concatenate([one_scan(setup, seen, *poses, rng) for poses in zip(R, T, strict=True)])
    noise = rng.normal(size=points.shape)
    if setup.covariance is not None and not seen.on_curve:  # of x and z of all points of a pose
        noise = (noise.reshape(trials, P, -1) @ np.linalg.cholesky(setup.covariance).T).reshape(points.shape)
    return replace(seen, points=points + setup.noise.profile_mm * noise)


def one_scan(setup: Setup, seen: Observations, R, T, rng) -> np.ndarray:
    """The points (1, P, m, 2) of one of them, before the scanner's noise."""
    sizes, changes = np.array(setup.sizes), []
    for change, size in considered([seen.target], setup.systematic):
        if change.prior == "tolerance_mm":
            sizes = sizes + size * rng.normal()
        else:
            changes.append((change, size * rng.normal()))
    target = setup.target.at(*setup.target.frame, tuple(sizes))
    planes = R @ setup.R_sensor, carry(R, T, setup.T_sensor)
    found = replace(seen, points=setup.shown(target, planes)[None])
    for change, size in changes:
        found = change.apply(found, size)
    return found.points


def errors(setup: Setup, R, T, trials: int, rng) -> np.ndarray:
    """Of as many calibrations, (trials, 6), mm and rad."""
    problem, state = problem_of([(setup, R, T)])
    problem = type(problem)([measured(setup, R, T, trials, rng)], problem.noise, problem.systematic)
    fit = refine(problem, state.repeat(trials), iterations=15, tolerance=1e-7)
    return pose_error(fit.state.rotation, fit.state.translation, setup.R_sensor, setup.T_sensor)
