"""What may be wrong in the same way at every pose, and what it does to the residuals.

Nobody knows the scanner's and the target's errors, but everybody knows about how large they can be. They are not
estimated beside the sensor pose; they are considered: the answer gives way to them as far as they are likely (Schmidt
1966). Those of the robot are tested only (`calibrate.systematic_tests`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from profilecal.geometry.noise import Systematic
from profilecal.geometry.poses import inverse
from profilecal.joint.observations import Observations

STEP = 1e-4  # mm, of a length


@dataclass(frozen=True)
class Perturbation:
    """One error, which moves points, positions of the robot, or a length by so much for one unit of its size."""

    words: str  # with a place for the size, and [one word|another] for its sign
    unit: float  # what the size is to be multiplied by, for the words
    prior: str = ""  # the entry of `Systematic` that says how large it can be
    points: Callable | None = None  # of points x and z (...): by how much both are wrong, mm
    positions: Callable | None = None  # of flange positions (P, 3) in the base: by how much they are wrong, mm
    length: str = ""  # of the target


def of_scanner() -> list[Perturbation]:
    """Scales of the profiles, x that grows with z, and a bend."""
    words, scale = "the profiles' {} were too [large|small] by {{:.2g}} %", "scale_percent"
    return [
        Perturbation(words.format("x"), 100, scale, points=lambda x, z: (x, 0 * z)),
        Perturbation(words.format("z"), 100, scale, points=lambda x, z: (0 * x, z)),
        Perturbation("the profiles' x grew with z by {:+.2g} %", 100, "shear_percent", points=lambda x, z: (z, 0 * z)),
        Perturbation(
            "the profiles were bent by {:+.2g} mm, 50 mm from the middle",
            1,
            "bend_mm",
            points=lambda x, z: (0 * x, (x / 50) ** 2),
        ),
    ]


def of_target(targets: Sequence) -> list[Perturbation]:
    """Wrong lengths."""
    names = dict.fromkeys(name for target in targets for name in target.lengths)
    words = "the {} was too [large|small] by {{:.2g}} mm"
    return [Perturbation(words.format(name), 1, "tolerance_mm", length=name) for name in names]


def considered(targets: Sequence, prior: Systematic) -> list[tuple[Perturbation, float]]:
    """What may be wrong, with its standard deviation in its own unit, of which there is none where that is 0."""
    errors = [*of_scanner(), *of_target(targets)]
    sizes = [getattr(prior, error.prior) / error.unit for error in errors]
    return [(error, size) for error, size in zip(errors, sizes, strict=True) if size]


def derivative(error: Perturbation, state, placement, observed: Observations, residuals, columns) -> np.ndarray:
    """By the size of an error at a state, of a batch of one: (1, K, P). `columns`: of these `residuals`, there."""
    if error.length:
        plus, minus = (
            residuals.with_sizes(
                size + step * (name == error.length)
                for name, size in zip(residuals.target.lengths, residuals.sizes, strict=True)
            )
            .linearise(state, placement)
            .residual
            for step in (STEP, -STEP)
        )
        return (plus - minus) / (2 * STEP)
    if error.points:
        dx, dz = error.points(*residuals.seen)  # (1, m, P) each
        by_x, by_z = residuals.by_point(columns)
        return (by_x * dx[:, :, None] + by_z * dz[:, :, None]).reshape(columns.residual.shape)
    moved = error.positions(positions_in_base(observed))
    if observed.eye_to_hand:
        in_sensor = -moved @ state.rotation[0]
    else:
        in_sensor = (moved[:, None] @ observed.R_flange[0])[:, 0] @ state.rotation[0]
    return np.sum(columns.by_flange[:, :3] * in_sensor.T[:, None], axis=1)


def positions_in_base(observed: Observations) -> np.ndarray:
    """Of the flange, (P, 3), in the first problem."""
    R, T = observed.R_flange.reshape(-1, *observed.R_flange.shape[-3:])[0], observed.T_flange
    T = T.reshape(-1, *T.shape[-2:])[0]
    return inverse(R, T)[1] if observed.eye_to_hand else T
