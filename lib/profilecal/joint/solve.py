"""From observations to a solution, in four steps: decide the noise, search, reject what does not belong, rescale."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2 as chi2_law

from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import FALSE_ALARM, Noise
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import Fit, refine
from profilecal.joint.noise import NoiseLevel, decide, likeliest_noise, with_robot_error
from profilecal.joint.observability import Spectrum, explain, of_covariance, spectrum
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.search import search, search_among_outliers, typical_residual
from profilecal.joint.solution import Solution, solution_of
from profilecal.joint.state import State, normalised_square, pose_error

UNLIKELY = 1e-3  # the chance of residuals so large that the covariance is enlarged
TWIN_APART, TWIN_AS_GOOD = 50.0, 12.0  # χ² that another sensor pose is away, and by how much it may fit worse
ROUNDS = 6  # of estimating robot errors; two or three are usual
LARGEST_ERROR_MM = 2.0  # of a robot's position; what is larger is a mistake, not an error
LARGEST_REJECTED = 1 / 3  # of the poses


def solve(
    observations: Sequence[Observations], noise: Noise | NoiseLevel | None = None, *, starts=(), robust: bool = True
) -> Solution:
    """The sensor pose from all observations together, with its covariance and what it can be believed.

    `noise`: `profile_mm` 0 is not known, to be estimated; or what `joint.noise.decide` makes of it and more.
    `starts`: poses (R (3, 3), T (3,) mm) to start from besides the grid: closed forms, a mount measured by hand.
    `robust=False` is plain least squares throughout: nothing is rejected.

    Raises ValueError for malformed input and UnobservableError for fewer residuals than unknowns.
    """
    observations = list(observations)
    if not observations:
        raise ValueError("no observations given; expected at least one target")
    level = noise if isinstance(noise, NoiseLevel) else decide(observations, noise or Noise())
    problem = Problem(observations, level.noise)
    total = int(problem.count()[0])
    if total <= problem.n:
        raise UnobservableError(f"{total} measured coordinates cannot determine {problem.n} unknowns; add poses")

    found = search(observations, level.noise, starts)
    solution = settle(problem, level, found, robust, widely=True)
    return estimate_robot_errors(observations, level, solution) if level.features_mm else solution


def settle(problem: Problem, level: NoiseLevel, found: State, robust: bool = True, widely: bool = False) -> Solution:
    """The solution from sensor poses worth refining: what does not belong rejected, an unknown noise rescaled.

    `widely`: where poses are bad, search again among them.
    """
    fits, kept = refine(problem, found), [np.ones(term.P, dtype=bool) for term in problem.terms]
    if robust:
        fits, kept = reject(problem, level, fits.state, widely)
    best = fits.state[[int(np.argmin(fits.loss))]]
    if level.unknown:
        problem = rescale(problem, best, kept)
        level = replace(level, noise=problem.noise)
    return conclude(problem, level, refine(problem, best, weights=kept), fits.state, kept)


def reject(problem: Problem, level: NoiseLevel, state: State, widely: bool) -> tuple[Fit, list[np.ndarray]]:
    """Fits from a batch of states, and the poses (P,) of each target that do not contradict the best one."""
    least = 0.0 if level.unknown else 1.0
    fit, scale = robust_fit(problem, state, least)
    bad = beyond_chance(problem, fit, 0, least or scale)
    if widely and any(b.any() for b in bad):
        fit, scale = robust_fit(problem, search_among_outliers(problem.observations, problem.noise, fit.state), least)
    after = [~b for b in beyond_chance(problem, fit, 0, scale)]
    for _ in range(5):
        kept = after
        if problem.counted(kept) <= problem.n:
            raise UnobservableError("most poses contradict each other: no sensor pose explains half of them")
        fit = refine(problem, fit.state, weights=kept)
        best = int(np.argmin(fit.loss))
        if level.unknown:
            scale = float(typical_residual(fit.per_pose, problem.freedoms())[best])
        after = [~b for b in beyond_chance(problem, fit, best, scale)]
        if all((a == b).all() for a, b in zip(after, kept, strict=True)):
            break
    return fit, kept


def robust_fit(problem: Problem, state: State, least: float) -> tuple[Fit, float]:
    """Cauchy's loss, its unit lowered from what the residuals look like to what the noise is: the fits, best first,
    and that unit."""

    def unit(per_pose):
        return np.maximum(typical_residual(per_pose, problem.freedoms()), max(least, 1e-9))

    per_pose = problem.moments(state).per_pose
    for _ in range(4):
        fit = refine(problem, state, scale=unit(per_pose), iterations=10)
        fit = fit[np.argsort(unit(fit.per_pose), kind="stable")[:3]]
        state, per_pose = fit.state, fit.per_pose
    fit = refine(problem, state, scale=np.full(len(per_pose[0]), unit(per_pose).min()))
    fit = fit[np.argsort(fit.loss)]
    return fit, float(unit(fit.per_pose)[0])


def beyond_chance(problem: Problem, fit: Fit, which: int, scale: float) -> list[np.ndarray]:
    """Poses (P,) of each target whose residuals in one fit of a batch are larger than chance makes them, and groups of
    which more than half are. `scale`: how many noise levels large residuals are."""
    total, rejected = sum(term.P for term in problem.terms), []
    for term, own, k in zip(problem.terms, fit.per_pose, problem.freedoms(), strict=True):
        bad = own[which] * k > scale**2 * chi2_law.isf(FALSE_ALARM / total, k)
        size = np.bincount(term.group)
        crowd = (np.bincount(term.group, bad) > size / 2) & (size > 2)
        rejected.append(bad | crowd[term.group])
    return rejected


def rescale(problem: Problem, state: State, kept) -> Problem:
    """The problem with the scanner noise that makes χ² what its degrees of freedom are."""
    dof = problem.counted(kept) - problem.n
    for _ in range(20):
        factor = np.sqrt(float(refine(problem, state, weights=kept).chi2[0]) / dof)
        noise = replace(problem.noise, profile_mm=max(problem.noise.profile_mm * factor, 1e-12))
        problem = Problem(problem.observations, noise)
        if abs(factor - 1) < 1e-6:
            break
    return problem


def estimate_robot_errors(observations, level: NoiseLevel, solution: Solution) -> Solution:
    """The solution with the scanner's noise and a robot position error at each pose as the residuals have them.

    Features of raw profiles know their own noise. What it does not explain is the robot's: all points of a profile
    share the error of its pose.
    """
    noise = replace(level.noise, profile_mm=level.features_mm)
    for _ in range(ROUNDS):
        before, noise = noise.position_mm, likeliest_noise(observations, noise, solution.state, solution.kept)
        absurd = noise.position_mm > LARGEST_ERROR_MM
        estimated = with_robot_error(level, noise)
        solution = settle(Problem(observations, noise), estimated, solution.state, robust=not absurd)
        absurd |= np.concatenate(solution.rejected).mean() > LARGEST_REJECTED
        if abs(noise.position_mm - before) < 0.02 * noise.position_mm or absurd:
            break
    return solution


def conclude(problem: Problem, level: NoiseLevel, fit: Fit, others: State, kept) -> Solution:
    """What to say of a fit: its covariance, enlarged where the noise does not explain the residuals, and whether one of
    the `others` fits as well."""
    state, found, messages = fit.state, spectrum(fit.information[0], problem.units), []
    dof = problem.counted(kept) - problem.n
    factor = float(fit.chi2[0]) / dof
    if not level.unknown and factor > chi2_law.isf(UNLIKELY, dof) / dof:
        found = of_covariance(found.covariance * factor, found.rank, found.parameters)
        than = "what the stated noise explains"
        if level.source == "groups":
            than = "the scatter inside rotation groups, so groups differ by more than scanner noise (robot errors?)"
        messages.append(f"residuals are {factor**0.5:.2g} times {than}; the covariance is enlarged to match")
    status = str(found.status)
    seen = problem.observations
    R_flange = np.concatenate([np.asarray(o.R_flange).reshape(-1, 3, 3) for o in seen])
    messages += explain(found, state.rotation[0], R_flange, "base" if seen[0].eye_to_hand else "flange")
    if status != "unobservable":
        twin = twin_of(problem, fit, found, others, kept)
        status, messages = ("weak", [*messages, twin]) if twin else (status, messages)
    return solution_of(problem, state, fit, kept, level, found, status, messages, fit.converged[0])


def twin_of(problem: Problem, fit: Fit, found: Spectrum, others: State, kept) -> str:
    """A sentence on another sensor pose that fits as well, if there is one."""
    state, other = fit.state, refine(problem, others, weights=kept)
    delta = pose_error(state.rotation, state.translation, other.state.rotation, other.state.translation)
    apart = normalised_square(found.covariance, delta)
    twins = np.flatnonzero((apart > TWIN_APART) & (other.loss < fit.loss[0] + TWIN_AS_GOOD))
    if not twins.size:
        return ""
    R, T = other.state.rotation[twins[0]], other.state.translation[twins[0]]
    return (
        f"another sensor pose explains the data as well, {np.degrees(angle_between(R, state.rotation[0])):.3g}° and "
        f"{np.linalg.norm(T - state.translation[0]):.3g} mm away; add poses from other directions"
    )
