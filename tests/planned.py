"""Models of every target at one rough guess, and what a robot and a scanner that err
would measure.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import pose_error, rotations
from profilecal.simulation.spec import read_spec
from profilecal.targets.observations import pose_groups
from profilecal_papers.monte_carlo import estimate
from profilecal_tool.plan.knowledge import model_of_spec
from profilecal_tool.plan.scan_model import ScanModel

GUESS = {"mount": [60, -40, 110, 170, 10, 30], "target": [900, 50, 300]}
KINDS = ("edge", "disk", "ball", "plane", "rod")


@cache
def model_for(kind: str, measured: str = "", mount: str = "eye-in-hand") -> ScanModel:
    """With raw profiles where there are any and nothing else is asked for, and robot
    errors as usual.
    """
    measured = measured or ("points" if kind == "point" else "profiles")
    guess = GUESS
    if (
        mount == "eye-to-hand"
    ):  # the scanner stands in the base, the target is on the flange
        guess = {"mount": [900, 0, 700, 180, 0, 0], "target": [20, 0, 150]}
    spec = read_spec(
        {"kind": kind, "guess": guess, "measured": measured, "mount": mount}
    )
    return model_of_spec(spec, {}, np.random.default_rng(1))


def errors(model: ScanModel, R, T, trials: int, rng) -> np.ndarray:
    """Of as many calibrations, (trials, 6), mm and rad, from flange poses (P, 3, 3),
    (P, 3) where the robot and the scanner err as the model says.
    """
    seen, P, error = model.observed(R, T), len(T), np.zeros((trials, len(T), 6))
    for name in ROBOT:
        member, size = pose_groups([seen]).sharing(name), getattr(model.noise, name)
        part, sd = (
            (slice(3), size) if name.endswith("mm") else (slice(3, 6), np.radians(size))
        )
        error[:, :, part] += (
            sd * rng.normal(size=(trials, member.max() + 1, 3))[:, member]
        )
    actual = (
        (rotations(error[..., 3:]) @ R).reshape(-1, 3, 3),
        (T + error[..., :3]).reshape(-1, 3),
    )
    points = model.observed(*actual).points[0]
    noise = rng.normal(size=points.shape)
    if (
        model.covariance is not None and not seen.on_curve
    ):  # of x and z of all points of a pose
        noise = (
            noise.reshape(trials * P, -1) @ np.linalg.cholesky(model.covariance).T
        ).reshape(points.shape)
    seen = replace(
        seen, points=(points + model.noise.profile_mm * noise).reshape(trials, P, -1, 2)
    )
    states, *_ = estimate([seen], model.noise, model.state[[0] * trials])
    return pose_error(
        states.rotation, states.translation, model.R_sensor, model.T_sensor
    )
