"""From observations to a solution: search, fit to most of what was seen, estimate all
errors without what does not belong, conclude.
"""

from collections.abc import Sequence

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.joint import delay
from profilecal.joint.conclusion import Estimate, conclude
from profilecal.joint.descent import search
from profilecal.joint.error_sizes import average, likeliest
from profilecal.joint.first_fit import fits_of_most, is_beyond_robots, least_squares
from profilecal.joint.linear_model import Posterior
from profilecal.joint.prior import Prior, as_stated
from profilecal.joint.problem import Problem, reach
from profilecal.joint.rejection import of_large_errors, still_belonging
from profilecal.joint.solution import Solution
from profilecal.targets.observations import Observations
from profilecal.targets.state import State

ROUNDS = 10  # of estimates; one or two are usual
UNSETTLED = (
    f"the answer, or which poses belong to it, still changed after {ROUNDS} rounds; "
    "look at the poses that were left out, and add others"
)
# Standard deviations that a step may leave to the next one. Residuals are less linear
# in the delay than in a state, so that more of the delay may be left.
LITTLE_OF_STATE = 0.002
LITTLE_OF_DELAY = 0.02


def solve(
    observations: Sequence[Observations],
    noise: Noise | Prior,
    *,
    starts: Sequence = (),
    robust: bool = True,
) -> Solution:
    """The sensor pose from all observations together, with its covariance and how far
    it can be believed.

    `noise`: a `Prior`, or what is known; `profile_mm` 0 is estimated. `starts`: poses
    (R (3, 3), T (3,) mm) to start from besides the grid: closed forms, a mount measured
    by hand. `robust=False`: nothing is rejected.

    What was seen in motion is looked up in the robot's log as late as fits best.

    Raises UnobservableError for fewer residuals than unknowns.
    """
    given = noise if isinstance(noise, Prior) else as_stated(noise)
    problem = problem_of(observations, given)
    problem.check_enough()

    if problem.delay_is_open:
        problem = problem.later(delay.roughly(problem, starts))
    fits = least_squares(problem, search(problem, starts))
    candidates = fits.state  # for another sensor pose that fits as well
    # no residual is large beside an infinite one: the fits stay as they are
    usual_mm = given.usual_mm if robust else np.inf
    fits, size_mm = fits_of_most(problem, fits, usual_mm)
    # how large residuals are, over the noise of `given`
    scale = 1.0 if given.source == "given" else problem.typical(fits.per_pose)[0]
    prior = given
    # what is believed of robot, scanner and target then explains nothing: none of their
    # errors is estimated but smooth ones
    if not prior.robot_known and is_beyond_robots(problem, fits, size_mm, scale):
        prior = prior.without_robot
    # the noise of `given` then is 1 mm, which stands for noise that is not known
    if prior.source == "residuals":
        prior = prior.with_scanner(prior.scales.profile_mm * scale)
    if prior is not given:
        problem = problem_of(problem.observations, prior)
    estimated = estimate(problem, prior, fits.state[[0]], robust)
    return conclude(estimated, prior, candidates.join(fits.state))


def problem_of(observations: Sequence[Observations], prior: Prior) -> Problem:
    """The problem of what was seen, with noise and errors of the sizes of a prior."""
    return Problem(observations, prior.scales, prior.systematic, mount=prior.mount)


def estimate(problem: Problem, prior: Prior, state: State, robust: bool) -> Estimate:
    """The state and the size of every error that the residuals tell, from a state
    nearby. In each round, profiles that do not belong are left out, a Gauss-Newton step
    is taken, and the sizes are estimated from the profiles kept, until nothing changes.
    `robust`: whether any profile is left out.
    """
    names = prior.names(problem.groups.distinguishable)
    law = prior.law(names)
    model = problem.model(state, names)
    first = after = model.kept  # all profiles, which stay if not `robust`
    if robust:
        first = of_large_errors(problem, model, prior)
    model = model.keeping(first)
    likely = likeliest(model, law)
    always = first  # profiles that no round left out
    for _ in range(ROUNDS):
        if robust:
            after = still_belonging(problem, model, likely.posterior, first, always)
            always = always & after
        settled = (after == model.kept).all()
        settled &= leaves_little(problem, likely.posterior)
        if settled:
            break
        problem, state = problem.after_step(state, likely.posterior.mean[0])
        model = problem.model(state, names).keeping(after)
        likely = likeliest(model, law, likely.y)
    found = average(model, prior, likely)
    return Estimate(problem, state, model, found, [] if settled else [UNSETTLED])


def leaves_little(problem: Problem, posterior: Posterior) -> bool:
    """Whether the step x (n + c,) leaves little to the next one, compared with how well
    the n unknowns and the delay are known. A step leaves an error of second order,
    about |x| times its `reach`; of the delay, the step itself is compared.
    """
    sd = np.sqrt(np.diag(posterior.covariance[0]))
    step = np.abs(posterior.mean[0]) / sd
    small = (step * reach(posterior.mean) < LITTLE_OF_STATE)[: problem.n].all()
    if problem.clock is not None:
        small &= step[problem.clock] < LITTLE_OF_DELAY
    return bool(small)
