"""What may be wrong in the same way in every pose: a scale, a drift, a wrong radius, a shifted group.

It leaves a pattern in the residuals. Each suspect is one more unknown; its size and what it does to the sensor pose
come from a score test (Rao 1948), one Gauss-Newton step from the solution, where it is zero.
"""

import re
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from profilecal.geometry.noise import FALSE_ALARM, Systematic
from profilecal.geometry.poses import inverse
from profilecal.joint.descent import refine
from profilecal.joint.effects import remove_common
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.solution import Solution
from profilecal.joint.state import State
from profilecal.joint.systematic import Change, of_scanner, of_target

ABSORBED = 1e-9  # of a suspect's own pattern: less is left of it beside the unknowns than rounding


@dataclass(frozen=True)
class Suspect:
    """Something that may be wrong in the same way in every pose."""

    words: str  # as `systematic.Change` has them
    size: float
    clear: float  # the size over its standard deviation
    moves: np.ndarray  # (6,) the sensor pose, mm and rad
    among: int  # so many suspects

    @property
    def is_clear(self) -> bool:
        """Whether chance does not explain it."""
        return abs(self.clear) > -ndtri(FALSE_ALARM / 2 / self.among)

    @property
    def sentence(self) -> str:
        """The suspect in words, with its size."""
        words = re.sub(r"\[(.*?)\|(.*?)\]", r"\1" if self.size > 0 else r"\2", self.words)
        return words.format(self.size if words == self.words else abs(self.size))


def suspects(observed, solution: Solution) -> list[Suspect]:
    """What might be wrong everywhere, each by itself, with the size that fits the residuals best."""
    state, tried = solution.state, [*of_scanner(), *of_target([entry.target for entry in observed]), *of_robot()]
    problem = Problem(observed, solution.noise, solution.level.systematic)
    n, known = problem.n, len(problem.considered)
    effects = problem.effects_at(state, tried)
    M = problem.with_systematic(effects, problem.linear(state), solution.kept)
    M, _ = remove_common(M, n, np.zeros(known))
    A, found = np.linalg.pinv(M[:n, :n], hermitian=True), []
    for k, change in enumerate(tried, n):
        Jd, rd, dd = M[:n, k], M[k, -1], M[k, k]  # d the derivative of the residuals r by the suspect, all over C
        own = dd - Jd @ A @ Jd  # what the other unknowns cannot imitate
        if own > ABSORBED * dd:
            size = -(rd - M[:n, -1] @ A @ Jd) / own
            found.append(
                Suspect(change.words, -size * change.unit, size * np.sqrt(own), (A @ Jd * size)[:6], len(tried))
            )
    return found


def fitted_together(observed, solution: Solution, systematic: Systematic) -> tuple[State, np.ndarray, np.ndarray]:
    """The solution's refit where what `systematic` allows for is free within it, the noise as it was.

    Returns the state, and for each of the n `Problem.considered` by how much the data, or the target's length, is to
    be changed (n,), in its own unit (1: all of it; mm), and the covariance of that (n, n).
    """
    problem = Problem(observed, solution.noise, systematic)
    state = refine(problem, solution.state, weights=solution.kept).state
    effects, first = problem.effects(state), problem.n
    M = problem.with_systematic(effects, problem.linear(state), solution.kept)
    free = M[:-1, :-1]
    return state, -np.linalg.solve(free, M[:-1, -1])[first:], np.linalg.inv(free)[first:, first:]


def of_robot():
    """Scales of the positions, drifts."""
    yield Change("the robot's positions were too [far apart|close together] by {:.2g} %", 100, spread(np.ones(3)))
    for k, axis in enumerate("xyz"):
        yield Change(
            f"the robot or the target drifted along the base's {axis} by {{:.2g}} mm", 1, drifted(np.eye(3)[k])
        )
    for k, axis in enumerate("xyz"):
        words = f"the robot's positions along the base's {axis} were too [far apart|close together] by {{:.2g}} %"
        yield Change(words, 100, spread(np.eye(3)[k]))


def spread(axes):
    """Positions farther from their middle, along some axes of the base (3,)."""

    def change(o, step):
        positions = inverse(o.R_flange, o.T_flange)[1] if o.eye_to_hand else o.T_flange
        return shifted(o, step * (positions - positions.mean(axis=-2, keepdims=True)) * axes)

    return change


def drifted(axis):
    """Positions that move by 1 mm along a base axis (3,) from the first to the last pose."""
    return lambda o, step: shifted(o, step * np.linspace(0, 1, o.T_flange.shape[-2])[:, None] * axis)


def shifted(o: Observations, moved) -> Observations:
    """Positions of the flange shifted in the base frame by (P, 3); eye-to-hand has the base in the flange frame."""
    if o.eye_to_hand:
        moved = -(o.R_flange @ moved[..., None])[..., 0]
    return replace(o, T_flange=o.T_flange + moved)
