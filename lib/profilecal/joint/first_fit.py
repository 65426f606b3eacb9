"""Sensor poses that fit most of what was seen, before anything is known of the sizes of
errors: by least squares, or by Cauchy's loss where bad poses spoil that.
"""

from dataclasses import replace

import numpy as np
from numpy import ndarray

from profilecal.geometry.noise import FALSE_ALARM, Noise, chi2_limit
from profilecal.geometry.observability import spectrum
from profilecal.joint.descent import (
    HOPELESS,
    distinct,
    refine,
    reweighted,
    search_among_outliers,
)
from profilecal.joint.problem import Fit, Problem
from profilecal.targets.state import State

LARGEST_ERROR_MM = 2.0  # of a robot's position that nothing is stated of


def least_squares(problem: Problem, state: State) -> Fit:
    """Fits by least squares, best first. After five steps, doubles and fits that are
    far from any answer are dropped; the others go on to the end.
    """
    if len(state.rotation) > 1:
        fits = refine(problem, state, iterations=5).best_first
        state = distinct(fits.state[fits.loss <= HOPELESS * fits.loss[0]])
    return refine(problem, state).best_first


def fits_of_most(problem: Problem, fits: Fit, usual_mm: float) -> tuple[Fit, float]:
    """Fits to most of the poses, best first, and `typical_mm` of these. `usual_mm`: how
    large residuals usually are; 0: nothing says it.

    The fits are `fits`, by least squares, where no pose contradicts the best of these
    and residuals are not more than twice as large as usual; else they are by Cauchy's
    loss. Many bad poses hide each other: where residuals of most poses are so large in
    the best fit by Cauchy's loss, too, another search comes first.
    """
    size_mm, most_mm = typical_mm(problem, fits), 2 * usual_mm
    if not (size_mm > most_mm or contradicting(problem, fits, usual_mm).any()):
        return fits, size_mm
    by_most = robust_fit(problem, fits.state)
    if typical_mm(problem, by_most) > most_mm:
        by_most = robust_fit(problem, search_among_outliers(problem, by_most.state))
    agreeing = ~contradicting(problem, by_most, usual_mm)
    too_few_agree = problem.counts_or_1[agreeing].sum() <= problem.n
    if too_few_agree:  # a fit to so few poses is nearly exact, and says nothing
        by_most = least_squares(problem, fits.state.join(by_most.state))
    return by_most, typical_mm(problem, by_most)


def contradicting(problem: Problem, fits: Fit, usual_mm: float) -> ndarray:
    """The profiles (profiles,) whose residuals in the best fit chance does not explain,
    if the noise is as large as the residuals of most poses, and at least as usual.

    χ² of these is the mean square of their residuals, over that noise, times how many
    residuals there are.
    """
    count = problem.counts_or_1
    unit = max(problem.typical(fits.per_pose)[0], usual_mm / problem.noise.profile_mm)
    limit = chi2_limit(FALSE_ALARM / len(count), count)
    return fits.per_pose[0] * count > unit**2 * limit


def robust_fit(problem: Problem, state: State) -> Fit:
    """Three fits by Cauchy's loss, best first: those with the least residuals of most
    poses. The unit of Cauchy's loss is the least of these, for all three, so that their
    losses can be compared.
    """
    fits = reweighted(problem, state, rounds=4)[:3]
    scale = np.full_like(fits.loss, problem.typical(fits.per_pose).min())
    return refine(problem, fits.state, scale=scale).best_first


def is_beyond_robots(problem: Problem, fits: Fit, size_mm: float, scale: float) -> bool:
    """Whether residuals of the best fit, as large as `size_mm`, are larger than the
    errors of any robot, or the answer is open however exact the robot is, with a
    scanner's noise that is `scale` times as large as assumed.
    """
    known = spectrum(fits.normal[0, :-1, :-1], problem.units)
    # the worst direction is ten times worse than measured by hand
    is_open = known.is_open or known.sd[0] * scale > 10
    return bool(is_open or size_mm > largest_error_mm(problem.noise))


def largest_error_mm(noise: Noise) -> float:
    """The largest error of a robot's position, by what is believed of it; a larger one
    is a mistake.
    """
    sizes = noise.steering_mm, noise.position_mm, noise.group_position_mm
    return max(LARGEST_ERROR_MM, 3 * max(sizes))


def typical_mm(problem: Problem, fits: Fit) -> float:
    """How large the residuals of most poses are in the best fit; in mm, as the noise of
    points need not be the same in all directions.
    """
    observations = problem.observations
    if any(seen.covariance is not None for seen in observations):
        equal = problem.of(replace(seen, covariance=None) for seen in observations)
        fits = equal.moments(fits.state[[0]])
    return float(problem.typical(fits.per_pose)[0] * problem.noise.profile_mm)
