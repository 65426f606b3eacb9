"""Models of every target at one rough guess, and what erring robots would measure."""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.random import default_rng

from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import pose_error, rotations
from profilecal.targets.observations import pose_groups
from profilecal_papers.monte_carlo import estimate
from profilecal_tool.plan.knowledge import model_of_spec
from profilecal_tool.plan.scan_model import ScanModel
from profilecal_tool.plan.specification import read_specification

GUESS = {"mount": [60, -40, 110, 170, 10, 30], "target": [900, 50, 300]}
# the scanner stands in the base, the target is on the flange
GUESS_TO_HAND = {"mount": [900, 0, 700, 180, 0, 0], "target": [20, 0, 150]}
KINDS = ("edge", "disk", "ball", "plane", "rod")


@cache
def model_for(kind: str, measured: str = "", mount: str = "eye-in-hand") -> ScanModel:
    """A model with robot errors as usual.

    It has raw profiles where there are any and nothing else is asked for.
    """
    entries = {
        "kind": kind,
        "guess": GUESS_TO_HAND if mount == "eye-to-hand" else GUESS,
        "measured": measured or ("points" if kind == "point" else "profiles"),
        "mount": mount,
    }
    spec = read_specification(entries, "specification")
    return model_of_spec(spec, {}, default_rng(1))


def errors(model: ScanModel, R, T, trials: int, rng) -> np.ndarray:
    """Errors (trials, 6), mm and rad, of as many simulated calibrations.

    They are from flange poses (P, 3, 3), (P, 3) where the robot and the scanner err as
    the model says.
    """
    observed = model.observed(R, T)
    shift, turn = robot_errors(model, observed, trials, rng)
    R_actual = (rotations(turn) @ R).reshape(-1, 3, 3)
    T_actual = (T + shift).reshape(-1, 3)
    points = model.observed(R_actual, T_actual).points[0]
    noise = rng.normal(size=points.shape)
    if model.covariance is not None and not observed.on_curve:
        # of x and z of all points of a pose
        root = np.linalg.cholesky(model.covariance)
        noise = (noise.reshape(len(points), -1) @ root.T).reshape(points.shape)
    measured = points + model.noise.profile_mm * noise
    observed = replace(observed, points=measured.reshape(trials, len(T), -1, 2))
    starts = model.state[[0] * trials]
    states, *_ = estimate([observed], model.noise, starts)
    return pose_error(
        states.rotation, states.translation, model.R_sensor, model.T_sensor
    )


def robot_errors(model, observed, trials, rng):
    """Shifts, mm, and turns, rad, of the flange, (trials, P, 3) each."""
    shape = (trials, len(observed.R_flange[0]), 3)
    shift = np.zeros(shape)
    turn = np.zeros(shape)
    for name in ROBOT:
        group = pose_groups([observed]).sharing(name)
        size = getattr(model.noise, name)
        drawn = rng.normal(size=(trials, group.max() + 1, 3))[:, group]
        if name.endswith("mm"):
            shift += size * drawn
        else:
            turn += np.radians(size) * drawn
    return shift, turn
