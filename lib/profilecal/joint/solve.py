"""From observations to a solution, in four steps: decide the noise, search, reject what does not belong, rescale."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, astuple, replace

import numpy as np

from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import FALSE_ALARM, ROBOT, Noise, chi2_limit
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import Fit, refine
from profilecal.joint.field import field_over
from profilecal.joint.levels import Likelihood, levels, likeliest
from profilecal.joint.noise import NoiseLevel, decide
from profilecal.joint.observability import Spectrum, explain, of_covariance, spectrum
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.search import search, search_among_outliers, typical_residual
from profilecal.joint.solution import Solution, solution_of
from profilecal.joint.state import State, normalised_square, pose_error

UNLIKELY = 1e-3  # the chance of residuals so large that the covariance is enlarged
TWIN_APART, TWIN_AS_GOOD = 50.0, 12.0  # χ² that another sensor pose is away, and by how much it may fit worse
TWIN_TYPICAL = 10.0  # times the answer's residuals; a sensor pose that fits worse before refinement is not refined
ROUNDS = 6  # of estimating robot errors; two or three are usual
LARGEST_ERROR_MM = 2.0  # of a robot's position; what is larger is a mistake, not an error
LARGEST_REJECTED = 1 / 3  # of the poses
ROUGHLY = 1e-6  # tolerance of refinements that are not the last
HOPELESS = 10.0  # measurements by hand that an answer is open by
FINEST_MM = 1e-5  # scanner noise: residuals of exact data are rounding
SETTLED = 0.02  # of an error's size
TRIED = 4  # of sets of poses that leave fewer out
MANY = 0.2  # of the poses: more mistakes than anyone makes
UNUSUAL = 1.5  # standard deviations above what is known of the errors' sizes beforehand
SHARED = 2  # coordinates of a profile that a shared error moves, at least: it may explain that many large ones
CONTRADICTING = "most poses contradict each other: no sensor pose explains half of them"


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
    return settle(problem, level, found, robust) if level.prior is None else weigh(problem, level, found, robust)


def settle(problem: Problem, level: NoiseLevel, found: State, robust: bool) -> Solution:
    """The solution from sensor poses worth refining: what does not belong rejected, an unknown noise rescaled."""
    fits, kept = refine(problem, found, tolerance=ROUGHLY), [np.ones(term.P, dtype=bool) for term in problem.terms]
    if robust:
        fits, kept = reject(problem, level, fits.state)
    best = fits.state[[int(np.argmin(fits.loss))]]
    if level.unknown:
        problem = rescale(problem, best, kept)
        level = replace(level, noise=problem.noise)
    return conclude(problem, level, refine(problem, best, weights=kept), fits.state, kept)


def weigh(problem: Problem, level: NoiseLevel, found: State, robust: bool) -> Solution:
    """The solution from sensor poses worth refining, with the size of every error as the residuals have it: what does
    not belong is rejected by errors of that size, and they are estimated without it, until nothing changes. Residuals
    that are larger than any robot errs, and answers that are open whatever it does, are left to the scanner's."""
    observations, kept = problem.observations, [np.ones(term.P, dtype=bool) for term in problem.terms]
    fit, scale = robust_fit_widely(problem, refine(problem, found, tolerance=ROUGHLY).state, 0.0)
    if robust:
        kept = [~bad for bad in beyond_chance(problem, fit, 0, scale, SHARED)]
    if problem.counted(kept) <= problem.n:  # too few to tell which are good: a fit to most of them is nearly exact
        kept, fit = [np.ones(term.P, dtype=bool) for term in problem.terms], refine(problem, fit.state)
        fit = fit[np.argsort(fit.loss)]
        scale = float(np.sqrt(fit.loss[0] / (problem.counted(kept) - problem.n)))
    grossly = kept
    seen = spectrum(fit.information[0], problem.units)
    if seen.rank < problem.n or seen.sd[0] * scale > HOPELESS or scale * problem.noise.profile_mm > LARGEST_ERROR_MM:
        return settle(problem, level, fit.state, robust)
    noise = problem.noise
    if level.unknown:
        noise = replace(noise, profile_mm=max(noise.profile_mm * scale, FINEST_MM))
    features_mm = noise.profile_mm if level.source == "residuals" else problem.noise.profile_mm
    prior = level.prior.with_scanner(features_mm)
    others, state = fit.state, fit.state[[0]]
    with_all = Problem(observations, noise, level.systematic)

    def weighed(noise, state, kept):
        """The likeliest sizes of all errors, and the fit with them."""
        problem = with_all.with_noise(noise)
        state = refine(problem, state, weights=kept, tolerance=ROUGHLY).state
        model = Likelihood(problem, state, kept, prior)
        likely = likeliest(model, asdict(noise))
        problem = problem.with_noise(model.noise_of(model.sizes(likely)))
        return model, likely, problem, refine(problem, state, weights=kept, tolerance=ROUGHLY)

    many = lost(kept) > MANY  # then what is stated is doubted, else the poses
    believed = prior if many else replace(prior, stated=frozenset())
    large = {name: believed.law(name)[0](UNUSUAL) * getattr(prior.scales, name) for name in ("profile_mm", *ROBOT)}
    by_large = with_all.with_noise(replace(noise, **large))
    for fewer in fewer_rejected(fit, kept):
        if not all_belong(by_large, refine(by_large, state, weights=fewer, iterations=10, tolerance=ROUGHLY), fewer):
            continue  # no robot errs like that
        model, likely, by_robot, trial = weighed(noise, state, fewer)
        small = all(size < large[name] for name, size in model.sizes(likely).items())
        if small and all_belong(by_robot, trial, fewer):
            noise, state, kept = by_robot.noise, trial.state, fewer
            break
    for _ in range(ROUNDS):
        model, likely, problem, fit = weighed(noise, state, kept)
        before, noise = noise, problem.noise
        after = [~bad for bad in beyond_chance(problem, fit, 0, 1.0)] if robust else kept
        if lost(after) > lost(grossly) + LARGEST_REJECTED or problem.counted(after) <= problem.n:
            after = grossly  # the model is at fault, not the poses
        settled = all((a == b).all() for a, b in zip(after, kept, strict=True)) and alike(noise, before)
        state, kept = fit.state, after
        if settled:
            break
    field = field_over(model.sharing, state.rotation[0], state.translation[0], observations[0].eye_to_hand)
    found = levels(model, likely, field, level.accuracy)
    problem = with_all.with_noise(found.noise)
    level = replace(level, noise=found.noise, prior=prior, levels=found)
    return conclude(problem, level, refine(problem, state, weights=kept), others, kept)


def fewer_rejected(fit: Fit, kept) -> Iterator[list[np.ndarray]]:
    """Poses (P,) of each target to keep besides those `kept`: all, all but the one that fits worst, and so on. A robust
    fit to few poses comes near to most and leaves the others out."""
    ends = np.cumsum([len(good) for good in kept])[:-1]
    square = np.concatenate([own[0] for own in fit.per_pose])
    rejected = np.flatnonzero(~np.concatenate(kept))
    for count in range(min(len(rejected), TRIED)):
        worst = rejected[np.argsort(-square[rejected])[:count]]
        yield np.split(~np.isin(np.arange(len(square)), worst), ends)


def all_belong(problem: Problem, fit: Fit, kept) -> bool:
    """Whether chance explains the residuals of all the poses kept (P,) of each target, in the first of a batch."""
    bad = beyond_chance(problem, fit, 0, 1.0)
    return not any((b & k).any() for b, k in zip(bad, kept, strict=True))


def lost(kept) -> float:
    """The share of poses that are not kept (P,)."""
    return 1 - float(np.mean(np.concatenate(kept)))


def alike(noise: Noise, other: Noise) -> bool:
    """Whether no error is larger or smaller in one than in the other by more than matters."""
    pair = np.array([astuple(noise), astuple(other)])
    return bool((np.abs(pair[0] - pair[1]) <= SETTLED * (pair.max(axis=0) + noise.profile_mm)).all())


def robust_fit_widely(problem: Problem, state: State, least: float) -> tuple[Fit, float]:
    """`robust_fit`; where poses are bad, after another search among them."""
    fit, scale = robust_fit(problem, state, least)
    if any(bad.any() for bad in beyond_chance(problem, fit, 0, least or scale)):
        fit, scale = robust_fit(problem, search_among_outliers(problem.observations, problem.noise, fit.state), least)
    return fit, scale


def reject(problem: Problem, level: NoiseLevel, state: State) -> tuple[Fit, list[np.ndarray]]:
    """Fits from a batch of states, and the poses (P,) of each target that do not contradict the best one."""
    fit, scale = robust_fit_widely(problem, state, 0.0 if level.unknown else 1.0)
    after = [~b for b in beyond_chance(problem, fit, 0, scale)]
    for _ in range(5):
        kept = after
        if problem.counted(kept) <= problem.n:
            raise UnobservableError(CONTRADICTING)
        fit = refine(problem, fit.state, weights=kept, tolerance=ROUGHLY)
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
        before = unit(per_pose).min()
        fit = refine(problem, state, scale=unit(per_pose), iterations=10, tolerance=ROUGHLY)
        fit = fit[np.argsort(unit(fit.per_pose), kind="stable")[:3]]
        state, per_pose = fit.state, fit.per_pose
        if abs(unit(per_pose)[0] - before) < 1e-3 * before:
            break
    fit = refine(problem, state, scale=np.full(len(per_pose[0]), unit(per_pose).min()), tolerance=ROUGHLY)
    fit = fit[np.argsort(fit.loss)]
    return fit, float(unit(fit.per_pose)[0])


def beyond_chance(problem: Problem, fit: Fit, which: int, scale: float, most: int | None = None) -> list[np.ndarray]:
    """Poses (P,) of each target whose residuals in one fit of a batch are larger than chance makes them, and groups of
    which more than half are. `scale`: how many noise levels large residuals are. `most`: so many residuals of a pose
    are independent."""
    total, rejected = sum(term.P for term in problem.terms), []
    for term, own, k in zip(problem.terms, fit.per_pose, problem.freedoms(), strict=True):
        k = np.minimum(k, most or k)
        bad = own[which] * k > scale**2 * chi2_limit(FALSE_ALARM / total, k)
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
        problem = problem.with_noise(noise)
        if abs(factor - 1) < 1e-6:
            break
    return problem


def conclude(problem: Problem, level: NoiseLevel, fit: Fit, others: State, kept) -> Solution:
    """What to say of a fit: its covariance, enlarged where the noise does not explain the residuals, and whether one of
    the `others` fits as well."""
    state, found, messages = fit.state, spectrum(fit.information[0], problem.units), []
    dof = problem.counted(kept) - problem.n
    factor = float(fit.chi2[0]) / dof
    if level.levels:
        found = of_covariance(level.levels.covariance, found.rank, found.parameters)
    elif not level.unknown and factor > chi2_limit(UNLIKELY, dof) / dof:
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

    state = fit.state

    def apart(poses: State):
        delta = pose_error(state.rotation, state.translation, poses.rotation, poses.translation)
        return normalised_square(found.covariance, delta)

    def typical(per_pose):
        return typical_residual(per_pose, problem.freedoms())

    as_good = typical(problem.moments(others).per_pose) < TWIN_TYPICAL * max(1.0, typical(fit.per_pose)[0])
    others = others[(apart(others) > TWIN_APART) & as_good]
    if not len(others.rotation):
        return ""
    other = refine(problem, others, weights=kept, tolerance=ROUGHLY)
    twins = np.flatnonzero((apart(other.state) > TWIN_APART) & (other.loss < fit.loss[0] + TWIN_AS_GOOD))
    if not twins.size:
        return ""
    R, T = other.state.rotation[twins[0]], other.state.translation[twins[0]]
    return (
        f"another sensor pose explains the data as well, {np.degrees(angle_between(R, state.rotation[0])):.3g}° and "
        f"{np.linalg.norm(T - state.translation[0]):.3g} mm away; add poses from other directions"
    )
