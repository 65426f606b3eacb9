"""What may be wrong in the same way in every pose: a scale, a drift, a wrong radius.

It leaves a pattern in the residuals. Each error is one more unknown; its size and what it does to the sensor pose come
from a score test (Rao 1948) at the solution, where it is zero.
"""

import re
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from profilecal.geometry.noise import FALSE_ALARM
from profilecal.joint.linear_model import score
from profilecal.joint.perturbations import Perturbation, of_scanner, of_target
from profilecal.joint.solution import Solution

ABSORBED = 1e-9  # of an error's own pattern: less is left of it beside the unknowns than rounding


@dataclass(frozen=True)
class Finding:
    """Something that may be wrong in the same way in every pose."""

    words: str  # as `Perturbation` has them
    size: float
    clear: float  # the size over its standard deviation
    moves: np.ndarray  # (6,) the sensor pose, mm and rad
    among: int  # so many tests

    @property
    def is_clear(self) -> bool:
        """Whether chance does not explain it."""
        return abs(self.clear) > -ndtri(FALSE_ALARM / 2 / self.among)

    @property
    def sentence(self) -> str:
        """The error in words, with its size."""
        words = re.sub(r"\[(.*?)\|(.*?)\]", r"\1" if self.size > 0 else r"\2", self.words)
        return words.format(self.size if words == self.words else abs(self.size))


def systematic_tests(solution: Solution) -> list[Finding]:
    """What might be wrong everywhere, each by itself, with the size that fits the residuals best."""
    targets = [entry.target for entry in solution.problem.observations]
    tried = [*of_scanner(), *of_target(targets), *of_robot()]
    model, found = solution.model(tried)
    n, (normal,) = model.n - len(tried), found.normal
    with np.errstate(invalid="ignore", divide="ignore"):
        sizes, sds, moves = score(normal, n, model.precision[:n, :n])
        seen = sds**-2 > ABSORBED * np.diag(normal)[n:-1]
    # the size is what the data would have to change by, the error is the opposite
    return [
        Finding(error.words, -size * error.unit, size / sd, move * size, len(tried))
        for error, size, sd, move, good in zip(tried, sizes, sds, moves.T[:, :6], seen, strict=True)
        if good
    ]


def of_robot() -> list[Perturbation]:
    """Scales of the positions, drifts."""
    along, scale = "along the base's ", "too [far apart|close together] by {:.2g} %"
    words = [
        f"the robot's positions were {scale}",
        *(f"the robot's positions {along}{axis} were {scale}" for axis in "xyz"),
    ]
    axes = [np.ones(3), *np.eye(3)]
    return [
        *(
            Perturbation(said, 100, positions=lambda T, a=a: (T - T.mean(axis=0)) * a)
            for said, a in zip(words, axes, strict=True)
        ),
        *(
            Perturbation(
                f"the robot or the target drifted {along}{axis} by {{:.2g}} mm",
                1,
                positions=lambda T, a=a: np.linspace(0, 1, len(T))[:, None] * a,
            )
            for axis, a in zip("xyz", np.eye(3), strict=True)
        ),
    ]
