"""From observations to a solution: search, leave out what does not belong, estimate all
errors, conclude.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from scipy.special import fdtri

from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import (
    ESTIMATED,
    FALSE_ALARM,
    Noise,
    chi2_limit,
    normalised_square,
)
from profilecal.geometry.observability import (
    Spectrum,
    explain,
    of_covariance,
    spectrum,
)
from profilecal.geometry.poses import pose_error
from profilecal.joint import delay
from profilecal.joint.descent import (
    HOPELESS,
    ROUGHLY,
    distinct,
    reach,
    refine,
    robustly,
    search,
    search_among_outliers,
)
from profilecal.joint.error_sizes import ErrorSizes, average, likeliest
from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.joint.prior import Prior, as_stated
from profilecal.joint.problem import Fit, Problem
from profilecal.joint.solution import Solution
from profilecal.targets.observations import Observations, State

LARGEST_ERROR_MM = 2.0  # of a robot's position; what is larger is a mistake
LARGEST_REJECTED = 1 / 3  # of the poses
MANY = 0.1  # of the poses: so many that contradict a fit may all be right
MOST_MISTAKES = 0.2  # of the poses that anyone makes
UNLIKELY = 1e-3  # the chance of residuals so large that the covariance is enlarged
ROUNDS = 10  # of estimates; one or two are usual
UNSETTLED = (
    f"the answer, or which poses belong to it, still changed after {ROUNDS} rounds; "
    "look at the poses that were left out, and add others"
)


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
    prior = known = noise if isinstance(noise, Prior) else as_stated(noise)
    problem = Problem(observations, prior.scales, prior.systematic, mount=prior.mount)
    check_enough(problem)

    if problem.delay_is_open:
        problem = problem.later(delay.roughly(problem, starts))
    fits = least_squares(problem, search(problem, starts))
    others = fits.state
    if robust:
        fits = fits_of_most(problem, fits, prior.usual_mm)
    scale = 1.0 if prior.source == "given" else problem.typical(fits)[0]
    if not prior.robot_known and is_hopeless(problem, fits[[0]], scale):
        prior = prior.without_robot
    if prior.source == "residuals":
        prior = prior.with_scanner(prior.scales.profile_mm * scale)
    if prior is not known:
        seen = problem.observations
        problem = Problem(seen, prior.scales, prior.systematic, mount=prior.mount)
    estimated = estimate(problem, prior, fits.state[[0]], robust)
    return conclude(estimated, prior, others.join(fits.state))


def check_enough(problem: Problem) -> None:
    """Raise UnobservableError unless more is measured than is unknown."""
    total = problem.counts.sum()
    if total <= problem.n:
        raise UnobservableError(
            f"{total} measured coordinates cannot determine {problem.n} unknowns "
            "and noise; add poses"
        )


def least_squares(problem: Problem, state: State) -> Fit:
    """Fits by least squares, best first, but for those that are far from any answer
    early on.
    """
    fits = refine(problem, state, iterations=5, tolerance=ROUGHLY).best_first
    good = distinct(fits.state[fits.loss <= HOPELESS * fits.loss[0]])
    return refine(problem, good, tolerance=ROUGHLY).best_first


def is_hopeless(problem: Problem, fit: Fit, scale: float) -> bool:
    """Whether residuals are larger than any robot errs, or answers are open whatever it
    does: then all is left to the scanner's noise, `scale` times as large as assumed.
    """
    if typical_mm(problem, fit) > LARGEST_ERROR_MM:
        return True
    known = spectrum(fit.normal[0, :-1, :-1], problem.units)
    # ten times worse than measured by hand
    return bool(known.rank < problem.n or known.sd[0] * scale > 10)


def typical_mm(problem: Problem, fits: Fit) -> float:
    """How large the residuals of most poses are in the first of some fits; in mm, as
    the noise of points need not be the same in all directions.
    """
    there = problem.alike.moments(fits.state[[0]])
    return float(problem.typical(there)[0] * problem.noise.profile_mm)


def fits_of_most(problem: Problem, fits: Fit, usual_mm: float) -> Fit:
    """Fits to most of the poses, best first.

    By least squares where no pose contradicts that and residuals are as usual; else by
    Cauchy's loss; and after another search among its fits where these leave many poses
    that contradict, or large residuals: many bad poses hide each other.
    """
    # where nothing says how large residuals usually are, the robust fit is looked at
    if usual_mm and not is_doubtful(problem, fits, usual_mm, 0.0):
        return fits
    robust = robust_fit(problem, fits.state)
    if is_doubtful(problem, robust, usual_mm, MANY):
        state = search_among_outliers(problem, robust.state)
        robust = robust_fit(problem, state)
    agreeing = ~contradicting(problem, robust, usual_mm)
    if problem.freedoms[agreeing].sum() > problem.n:
        return robust
    # of a handful of poses some fit to most is nearly exact, and says nothing
    return least_squares(problem, fits.state.join(robust.state))


def is_doubtful(problem: Problem, fits: Fit, usual_mm: float, share: float) -> bool:
    """Whether residuals of the best fit are twice as large as usual, or more than a
    share of the poses contradict it.
    """
    is_large = bool(usual_mm) and typical_mm(problem, fits) > 2 * usual_mm
    return is_large or np.mean(contradicting(problem, fits, usual_mm)) > share


def contradicting(problem: Problem, fits: Fit, usual_mm: float) -> ndarray:
    """The profiles (profiles,) whose residuals in the best fit are larger than those of
    most let expect, and than usual.
    """
    k = problem.freedoms
    unit = max(problem.typical(fits)[0], usual_mm / problem.noise.profile_mm)
    limit = chi2_limit(FALSE_ALARM / len(k), k)
    return fits.per_pose[0] * k > unit**2 * limit


def robust_fit(problem: Problem, state: State) -> Fit:
    """Fits by Cauchy's loss, best first, its unit lowered from what the residuals look
    like to what the noise is.
    """
    fits = robustly(problem, state, 4)[:3]
    scale = np.full_like(fits.loss, problem.typical(fits).min())
    return refine(problem, fits.state, scale=scale, tolerance=ROUGHLY).best_first


@dataclass(frozen=True)
class Estimate:
    """The linear model of the profiles that belong together, and what it says with
    errors of the sizes found.
    """

    problem: Problem
    state: State  # where it was linearised
    columns: list  # of the targets there, as `Problem.columns_in_mm` has them
    model: LinearModel
    error_sizes: ErrorSizes
    settled: bool  # whether another round would change nothing


def estimate(problem: Problem, prior: Prior, state: State, robust: bool) -> Estimate:
    """The state and the size of every error as the residuals have them, from a state
    nearby: what does not belong is left out, the sizes are estimated without it, and a
    Gauss-Newton step is taken, until nothing changes.
    """
    names = prior.names(problem.groups.distinguishable)
    law = prior.law(names)
    y = step = None
    # profiles: `first`, that large errors explain; `kept`, that a model rests on;
    # `after`, that belong by what it says
    for _ in range(ROUNDS):
        if step is not None:
            problem, state = after_step(problem, state, step)
        columns = problem.columns_in_mm(state)
        model = problem.model(state, names, columns=columns)
        if step is None:
            first = kept = after = model.kept
            if robust:
                first = kept = of_large_errors(problem, state, model, prior)
        model = model.keeping(kept)
        likely = likeliest(model, law, y)
        y, step = likely.y, likely.posterior.mean[0]
        if robust:
            after = still_belonging(problem, model, likely.posterior, first)
        same = bool((after == kept).all())
        settled = same and leaves_little(problem, likely.posterior)
        if settled:
            break
        kept = after
    found = average(model, prior, likely)
    return Estimate(problem, state, columns, model, found, settled)


def still_belonging(
    problem: Problem, model: LinearModel, posterior: Posterior, first: ndarray
) -> ndarray:
    """The profiles (profiles,) that belong to what all others say; or the `first` ones,
    if so few do that not poses are at fault, but the model.
    """
    after = belonging(problem, model, *chi2_left_out(model, posterior))
    rejected = np.mean(first) - np.mean(after)
    too_few = model.counts[after].sum() <= problem.n
    return first if rejected > LARGEST_REJECTED or too_few else after


def leaves_little(problem: Problem, posterior: Posterior) -> bool:
    """Whether the step of all unknowns leaves little to the next one, compared with how
    well they are known.

    What is left is of second order: the step times its own `reach`.
    """
    (x,), variance = posterior.mean, np.diag(posterior.covariance[0])
    left = np.abs(x) * reach(posterior.mean)
    small = (left**2 < 0.002**2 * variance)[: problem.n].all()
    if problem.clock is not None:  # poses follow a delay less evenly
        small &= x[problem.clock] ** 2 < 0.02**2 * variance[problem.clock]
    return bool(small)


def after_step(problem: Problem, state: State, x: ndarray) -> tuple[Problem, State]:
    """The problem and the state after a step x (n + c,), or as much of it as turns by
    no more than 0.1 rad and shifts by 10 mm.
    """
    step = x[None, : problem.n]
    share = 0.1 / max(0.1, reach(step)[0])
    state = problem.move(state, step * share)
    if problem.clock is None:
        return problem, state
    return problem.later(x[problem.clock] * share), state


def of_large_errors(
    problem: Problem, state: State, model: LinearModel, prior: Prior
) -> ndarray:
    """The profiles (profiles,) whose residuals errors of large, but usual sizes
    explain, each by itself; all, if these are too few. What is stated is believed,
    unless that leaves out more poses than anyone makes mistakes.
    """
    large = 1.5  # standard deviations beforehand
    scanner = 1.0
    if prior.profile_spread:
        scanner = np.maximum(1.0, problem.typical(problem.moments(state))[0])
    # counted as usual, what is stated has the shorter tail
    for believed in (replace(prior, stated=frozenset()), prior):
        law = believed.law(model.names)
        (v,) = law.variances(np.full((1, len(law.free)), large))
        v[0] = scanner**2
        no_step = np.eye(model.n + 1)[-1]
        by_itself = chi2_of_each(model, no_step, model.Y[..., -1], model.own(v), v[0])
        kept = belonging(problem, model, *by_itself)
        if np.mean(~kept) <= MOST_MISTAKES:
            break
    return kept if model.counts[kept].sum() > problem.n else model.kept


def belonging(
    problem: Problem, model: LinearModel, of_flange: ndarray, of_rest: ndarray
) -> ndarray:
    """The profiles (profiles,) whose residuals, by their χ², chance explains, but for
    those of groups of which it does not explain more than half.

    Profiles that were left out so far had no part in estimating the sizes of errors,
    which the others tell only roughly: their χ² follow F's law in place of χ².
    """
    chance = FALSE_ALARM / 2 / len(of_rest)  # two tests of each
    rest = model.counts - model.ranks
    ranks = np.maximum(model.ranks, 1)
    freedom = max(1, model.ranks[model.kept].sum() - problem.n)
    by_others = ranks * fdtri(ranks, freedom, 1 - chance)
    bad = of_flange > np.where(model.kept, chi2_limit(chance, ranks), by_others)
    bad |= (rest > 0) & (of_rest > chi2_limit(chance, np.maximum(rest, 1)))
    group = problem.groups.group
    size = np.bincount(group)
    crowd = (np.bincount(group, bad) > size / 2) & (size > 2)
    return ~(bad | crowd[group])


def chi2_of_each(
    model: LinearModel, x: ndarray, errors: ndarray, covariances: ndarray, v: float
) -> tuple[ndarray, ndarray]:
    """Two χ² (profiles,) of each profile: of the rows that speak of the flange, whose
    `errors` (profiles, q) have these `covariances`; and of the rest of its residuals
    after a step x (n + 1,), whose last entry is 1, by the scanner's variance v.
    """
    of_flange = normalised_square(covariances, errors)
    # what is below zero is rounding
    rest = model.rest @ x
    return np.maximum(of_flange, 0), np.sum(rest**2, axis=1) / v


def chi2_left_out(model: LinearModel, posterior: Posterior) -> tuple[ndarray, ndarray]:
    """The same, by what all other profiles say of each."""
    x = np.append(posterior.mean[0], 1.0)
    return chi2_of_each(model, x, *model.left_out(posterior), posterior.v[0, 0])


def conclude(estimated: Estimate, prior: Prior, others: State) -> Solution:
    """What to say of an estimate: its covariance, enlarged where the noise does not
    explain the residuals, how well it is known, and whether one of the `others` fits as
    well.
    """
    model, error_sizes = estimated.model, estimated.error_sizes
    problem, state = after_step(estimated.problem, estimated.state, error_sizes.mean)
    n = problem.n
    posterior = model.posterior(error_sizes.v[None])
    square = sum(chi2_left_out(model, posterior)) / np.maximum(model.counts, 1)
    chi2 = float(posterior.square[0])
    dof = max(int(model.counts[model.kept].sum()) - n, 1)

    enlargement, messages = enlargement_by_misfit(prior, chi2, dof)
    error_sizes = replace(
        error_sizes,
        covariance=error_sizes.covariance * enlargement,
        enlarged=error_sizes.enlarged * enlargement,
    )
    covariance = error_sizes.covariance[:6, :6]
    rank = spectrum(posterior.normal[0, :n, :n], problem.units).rank
    observability = of_covariance(covariance, rank, n)
    status, remarks = how_known(problem, state, error_sizes, observability)
    messages += remarks
    if status != "unobservable":
        # χ² of the six unknowns of a sensor pose rarely exceeds 12
        largest = chi2 + 12 * max(1.0, chi2 / dof)
        against = twin(estimated, state, observability, largest, others)
        if not estimated.settled:
            against.append(UNSETTLED)
        if against:
            status = "weak"
            messages += against

    terms = zip(problem.terms, state.placements, strict=True)
    sizes = {size.name: size.middle for size in error_sizes.sizes}
    return Solution(
        state=state,
        covariance=covariance,
        placements=tuple(
            term.target.at(origin[0], axes[0], term.sizes)
            for term, (origin, axes) in terms
        ),
        prior=prior,
        error_sizes=error_sizes,
        noise=problem.noise.of_sizes(dict.fromkeys(ESTIMATED, 0.0) | sizes),
        chi2=chi2,
        dof=dof,
        rms_mm=problem.rms_mm(estimated.columns, error_sizes.mean, model.kept),
        normalised=tuple(problem.split(np.sqrt(square))),
        rejected=tuple(problem.split(~model.kept)),
        status=status,
        observability=observability,
        messages=tuple(messages),
        problem=problem,
    )


def how_known(
    problem: Problem, state: State, error_sizes: ErrorSizes, known: Spectrum
) -> tuple[str, list[str]]:
    """The status of a sensor pose of which so much is `known`, and what a person should
    know of that, and do.
    """
    status, rotation, frame = str(known.status), state.rotation[0], frame_of(problem)
    remarks: list[str] = []
    if problem.clock is not None:
        C = error_sizes.covariance
        status, known, remarks = delay.verdict(C, problem.clock, known, rotation, frame)
    R_flange = np.concatenate([entry.R_flange[0] for entry in problem.observations])
    return status, remarks + explain(known, rotation, R_flange, frame)


def enlargement_by_misfit(
    prior: Prior, chi2: float, dof: int
) -> tuple[float, list[str]]:
    """What the covariance is to be multiplied by, where all noise is given and does not
    explain the residuals, with a sentence that says so.
    """
    given = prior.source == "given" and prior.robot_known
    factor = chi2 / dof
    if not (given and factor > chi2_limit(UNLIKELY, dof) / dof):
        return 1.0, []
    return factor, [
        f"residuals are {factor**0.5:.2g} times what the stated noise explains; "
        "the covariance is enlarged to match"
    ]


def frame_of(problem: Problem) -> str:
    """The frame that the sensor's pose is in."""
    return "base" if problem.to_hand else "flange"


def twin(
    estimated: Estimate, state: State, known: Spectrum, largest: float, others: State
) -> list[str]:
    """A sentence on another sensor pose that fits as well, if there is one: with a χ²
    of at most `largest`.
    """
    problem, model = estimated.problem, estimated.model

    def apart(others: State) -> tuple[ndarray, ndarray]:
        """Errors (B, 6) of the state if others are right, and whether it is another."""
        delta = pose_error(
            state.rotation, state.translation, others.rotation, others.translation
        )
        return delta, normalised_square(known.covariance, delta) > 50

    for k in np.flatnonzero(apart(others)[1]):
        pairs = zip(problem.observations, problem.split(model.kept), strict=True)
        kept = problem.of(entry.keep(own) for entry, own in pairs)
        other = refine(kept, others[[k]], tolerance=ROUGHLY).state
        there = problem.model(other, model.names).keeping(model.kept)
        posterior = there.posterior(estimated.error_sizes.v[None])
        other = problem.move(other, posterior.mean[:, : problem.n])
        delta, is_another = apart(other)
        if is_another and posterior.square[0] < largest:
            shift, turn = np.linalg.norm(delta.reshape(2, 3), axis=1)
            return [
                "another sensor pose explains the data as well, "
                f"{np.degrees(turn):.3g}° and "
                f"{shift:.3g} mm away; add poses from other directions"
            ]
    return []
