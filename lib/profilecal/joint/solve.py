"""From observations to a solution: search, fit to most of what was seen, estimate all
errors without what does not belong, conclude.
"""

from collections.abc import Sequence

from profilecal.geometry.noise import Noise
from profilecal.joint import delay
from profilecal.joint.conclusion import conclude
from profilecal.joint.descent import search
from profilecal.joint.estimation import estimate
from profilecal.joint.first_fit import fits_of_most, is_beyond_robots, least_squares
from profilecal.joint.prior import Prior, as_stated
from profilecal.joint.problem import Problem
from profilecal.joint.solution import Solution
from profilecal.targets.observations import Observations


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
    if robust:
        fits = fits_of_most(problem, fits, given.usual_mm)
    scale = 1.0 if given.source == "given" else problem.typical(fits)[0]
    prior = given
    if not prior.robot_known and is_beyond_robots(problem, fits, scale):
        prior = prior.without_robot
    if prior.source == "residuals":
        prior = prior.with_scanner(prior.scales.profile_mm * scale)
    if prior is not given:
        problem = problem_of(problem.observations, prior)
    estimated = estimate(problem, prior, fits.state[[0]], robust)
    return conclude(estimated, prior, candidates.join(fits.state))


def problem_of(observations: Sequence[Observations], prior: Prior) -> Problem:
    """What was seen, by noise of the scales that are believed."""
    return Problem(observations, prior.scales, prior.systematic, mount=prior.mount)
