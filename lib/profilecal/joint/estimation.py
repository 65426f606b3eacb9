"""The sizes of all errors and the unknowns, in rounds: what does not belong is left
out, the sizes are estimated without it, and a Gauss-Newton step is taken, until nothing
changes.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from profilecal.joint.descent import reach
from profilecal.joint.error_sizes import ErrorSizes, average, likeliest
from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.joint.prior import Prior
from profilecal.joint.problem import Problem
from profilecal.joint.rejection import of_large_errors, still_belonging
from profilecal.targets.observations import State

ROUNDS = 10  # of estimates; one or two are usual
# Standard deviations that a step may leave to the next one; poses follow a delay less
# evenly than a state.
LITTLE = 0.002
LITTLE_OF_DELAY = 0.02
FARTHEST = 0.1  # that a step goes: rad, or hundreds of mm


@dataclass(frozen=True)
class Estimate:
    """The linear model of the profiles that belong together, and what it says with
    errors of the sizes found.
    """

    problem: Problem
    state: State  # where it was linearised
    model: LinearModel
    error_sizes: ErrorSizes
    settled: bool  # whether another round would change nothing


def estimate(problem: Problem, prior: Prior, state: State, robust: bool) -> Estimate:
    """The state and the size of every error as the residuals have them, from a state
    nearby. `robust`: whether anything is left out.
    """
    names = prior.names(problem.groups.distinguishable)
    law = prior.law(names)
    model = problem.model(state, names)
    first = after = model.kept
    if robust:
        first = of_large_errors(problem, state, model, prior)
    model = model.keeping(first)
    likely = likeliest(model, law)
    for _ in range(ROUNDS):
        if robust:
            after = still_belonging(problem, model, likely.posterior, first)
        same = bool((after == model.kept).all())
        settled = same and leaves_little(problem, likely.posterior)
        if settled:
            break
        problem, state = after_step(problem, state, likely.posterior.mean[0])
        model = problem.model(state, names).keeping(after)
        likely = likeliest(model, law, likely.y)
    return Estimate(problem, state, model, average(model, prior, likely), settled)


def leaves_little(problem: Problem, posterior: Posterior) -> bool:
    """Whether the step x of all unknowns leaves little to the next one, compared with
    how well they are known: about |x| `reach`(x), as that is of second order.
    """
    (x,), sd = posterior.mean, np.sqrt(np.diag(posterior.covariance[0]))
    left = np.abs(x) * reach(posterior.mean)
    small = (left < LITTLE * sd)[: problem.n].all()
    if problem.clock is not None:
        small &= np.abs(x[problem.clock]) < LITTLE_OF_DELAY * sd[problem.clock]
    return bool(small)


def after_step(problem: Problem, state: State, x: ndarray) -> tuple[Problem, State]:
    """The problem and the state after a step x (n + c,), or after as much of it as goes
    no farther than FARTHEST. The clock then counts from its new delay, as if that were
    as likely as none.
    """
    step = x[None, : problem.n]
    share = FARTHEST / max(FARTHEST, reach(step)[0])
    state = problem.move(state, step * share)
    if problem.clock is None:
        return problem, state
    return problem.later(x[problem.clock] * share), state
