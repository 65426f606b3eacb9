"""Models of every target at one rough guess, and what a robot and a scanner that err would measure."""

from dataclasses import replace
from functools import cache

import numpy as np

from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import carry, rotations
from profilecal.joint.descent import with_robot
from profilecal.joint.observations import Observations
from profilecal.joint.perturbations import considered
from profilecal.joint.pose_groups import pose_groups
from profilecal.joint.problem import Problem
from profilecal.joint.state import pose_error
from profilecal.plan.known import model_of_spec
from profilecal.plan.scan_model import ScanModel
from profilecal.simulate.spec import read_spec

GUESS = {"mount": [60, -40, 110, 170, 10, 30], "target": [900, 50, 300]}
KINDS = ("edge", "disk", "ball", "plane", "rod")


@cache
def model_for(kind: str, measured: str = "", mount: str = "eye-in-hand") -> ScanModel:
    """With raw profiles where there are any and nothing else is asked for, and robot errors as usual."""
    measured = measured or ("points" if kind == "point" else "profiles")
    guess = GUESS
    if mount == "eye-to-hand":  # the scanner stands in the base, the target is on the flange
        guess = {"mount": [900, 0, 700, 180, 0, 0], "target": [20, 0, 150]}
    spec = read_spec({"kind": kind, "guess": guess, "measured": measured, "mount": mount})
    return model_of_spec(spec, {}, np.random.default_rng(1))


def measured(model: ScanModel, R, T, trials: int, rng) -> Observations:
    """A batch of what is seen from flange poses (P, 3, 3), (P, 3) if everything errs that the model says errs."""
    seen = model.observed(R, T)
    groups, P, error = pose_groups([seen]), len(T), np.zeros((trials, len(T), 6))
    for name in ROBOT:
        member, size = groups.sharing(name), getattr(model.noise, name)
        part, sd = (slice(3), size) if name.endswith("mm") else (slice(3, 6), np.radians(size))
        error[:, :, part] += sd * rng.normal(size=(trials, member.max() + 1, 3))[:, member]
    R, T = rotations(error[..., 3:]) @ R, T + error[..., :3]
    points = np.concatenate([one_scan(model, seen, *poses, rng) for poses in zip(R, T, strict=True)])
    noise = rng.normal(size=points.shape)
    if model.covariance is not None and not seen.on_curve:  # of x and z of all points of a pose
        noise = (noise.reshape(trials, P, -1) @ np.linalg.cholesky(model.covariance).T).reshape(points.shape)
    return replace(seen, points=points + model.noise.profile_mm * noise)


def one_scan(model: ScanModel, seen: Observations, R, T, rng) -> np.ndarray:
    """The points (1, P, m, 2) of one of them, before the scanner's noise."""
    sizes, changes = np.array(model.sizes), []
    for change, size in considered([seen.target], model.systematic):
        if change.prior == "tolerance_mm":
            sizes = sizes + size * rng.normal()
        else:
            changes.append((change, size * rng.normal()))
    there = replace(model, target=model.target.at(*model.target.frame, tuple(sizes)))
    found = replace(seen, points=there.points(R @ model.R_sensor, carry(R, T, model.T_sensor))[None])
    for change, size in changes:
        moved = change.points(found.points[..., 0], found.points[..., 1])
        found = replace(found, points=found.points + size * np.stack(moved, axis=-1))
    return found.points


def errors(model: ScanModel, R, T, trials: int, rng) -> np.ndarray:
    """Of as many calibrations, (trials, 6), mm and rad."""
    seen = measured(model, R, T, trials, rng)
    problems = [Problem([seen.take([k])], model.noise, model.systematic) for k in range(trials)]
    states = [with_robot(problem, model.state)[0] for problem in problems]
    found = states[0].join(*states[1:])
    return pose_error(found.rotation, found.translation, model.R_sensor, model.T_sensor)
