"""Setups for every target at one rough guess, and what a robot and a scanner that err would measure."""

from dataclasses import replace
from functools import cache

import numpy as np

from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import carry, rotations
from profilecal.joint.observations import Observations
from profilecal.joint.perturbations import considered
from profilecal.joint.pose_groups import pose_groups
from profilecal.joint.state import pose_error
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
    shared, error = pose_groups([seen]), np.zeros((trials, len(T), 6))
    for name in ROBOT:
        member, size = shared.sharing(name), getattr(setup.noise, name)
        part, sd = (slice(3), size) if name.endswith("mm") else (slice(3, 6), np.radians(size))
        error[:, :, part] += sd * rng.normal(size=(trials, member.max() + 1, 3))[:, member]
    R, T = rotations(error[..., 3:]) @ R, T + error[..., :3]
    points = np.concatenate([one_scan(setup, seen, *poses, rng) for poses in zip(R, T, strict=True)])
    noise = rng.normal(size=points.shape)
    if setup.covariance is not None and not seen.on_curve:  # of x and z of all points of a pose
        noise = (noise.reshape(trials, len(T[0]), -1) @ np.linalg.cholesky(setup.covariance).T).reshape(points.shape)
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
        moved = change.points(found.points[..., 0], found.points[..., 1])
        found = replace(found, points=found.points + size * np.stack(moved, axis=-1))
    return found.points


def errors(setup: Setup, R, T, trials: int, rng) -> np.ndarray:
    """Of as many calibrations, (trials, 6), mm and rad."""
    problem, state = problem_of([(setup, R, T)])
    seen, names = measured(setup, R, T, trials, rng), [name for name in ROBOT if getattr(setup.noise, name)]
    v, found = np.array([[1.0, *(getattr(setup.noise, name) ** 2 for name in names)]]), []
    for k in range(trials):
        one, at = type(problem)([seen.take([k])], problem.noise, setup.systematic), state
        for _ in range(4):
            at = one.move(at, one.model(at, names).posterior(v).mean[:, : one.n])
        found.append(pose_error(at.rotation[0], at.translation[0], setup.R_sensor, setup.T_sensor))
    return np.array(found)
