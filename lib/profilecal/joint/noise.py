"""The noise that a solution rests on, decided once, before it."""

from dataclasses import fields, replace

import numpy as np

from profilecal.geometry.noise import ROBOT, Noise, Systematic
from profilecal.joint.error_sizes import USUAL, Prior

FINEST_MM = 1e-5  # scanner noise: residuals of exact data are rounding


TYPICAL = Systematic(  # where nothing is stated
    scale_percent=0.1,  # linearity as data sheets of laser profile scanners state it, of the measuring range
    shear_percent=0.1,
    bend_mm=0.02,
    tolerance_mm=0.01,
    accuracy_mm=0.3,  # each axis, after the base is fitted; Slamani et al. 2012, Nubiola and Bonev 2013
    accuracy_deg=0.03,
)


def as_stated(noise: Noise) -> Prior:
    """The noise to begin with where the robot errs as stated, and the scanner too, or as the residuals tell.

    Raises ValueError for a noise that is none.
    """
    if noise.profile_mm < 0:
        raise ValueError(f"profile_mm is {noise.profile_mm}; expected a standard deviation, 0 if unknown")
    source = "given" if noise.profile_mm else "residuals"
    return Prior(replace(noise, profile_mm=noise.profile_mm or 1.0), source=source, robot_known=True)


def prior_from(stated: dict[str, float], features_mm: float = 0.0, shared_mm: float = 0.0) -> Prior:
    """The noise to begin with where the robot's errors are to be estimated. What is `stated` of them, entries of
    `Noise` and `Systematic`, is the scale of what is believed beforehand, 0 that there is none; the rest is as usual.

    `features_mm`: the noise of features that raw profiles themselves show, 0 where there are none. `shared_mm`: what
    features of one orientation err together; it counts as the robot's.
    """
    robot = {name: stated.get(name, getattr(USUAL, name)) for name in ROBOT}
    robot["group_position_mm"] = float(np.hypot(robot["group_position_mm"], shared_mm))
    systematic = Systematic(**{f.name: stated.get(f.name, getattr(TYPICAL, f.name)) for f in fields(Systematic)})
    given_mm = stated.get("profile_mm", 0.0)
    scales = Noise(features_mm or given_mm or 1.0, steering_mm=stated.get("steering_mm", 0.0), **robot)
    source = "profiles" if features_mm else "given" if given_mm else "residuals"
    return Prior(scales, frozenset(ROBOT) & stated.keys(), source, systematic=systematic)
