"""From observations to a solution: search, leave out what does not belong, estimate all
errors, conclude.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import (
    FALSE_ALARM,
    ROBOT,
    Noise,
    chi2_limit,
    normalised_square,
)
from profilecal.geometry.observability import (
    WEAK,
    Spectrum,
    explain,
    of_covariance,
    spectrum,
)
from profilecal.geometry.poses import angle_between, pose_error
from profilecal.joint.descent import (
    HOPELESS,
    distinct,
    reach,
    refine,
    search,
    search_among_outliers,
)
from profilecal.joint.error_sizes import ErrorSizes, average, likeliest
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.prior import FINEST_MM, Prior, as_stated
from profilecal.joint.problem import Fit, Problem
from profilecal.joint.solution import Solution
from profilecal.targets.observations import Observations, State

# of a robot's position; what is larger is a mistake, not an error
LARGEST_ERROR_MM = 2.0
LARGEST_REJECTED = 1 / 3  # of the poses
ROUGHLY = 1e-6  # tolerance of refinements


def solve(
    observations: Sequence[Observations],
    noise: Noise | Prior | None = None,
    *,
    starts=(),
    robust: bool = True,
) -> Solution:
    """The sensor pose from all observations together, with its covariance and how far
    it can be believed.

    `noise`: a `Prior`, or what is known; `profile_mm` 0 is estimated. `starts`: poses
    (R (3, 3), T (3,) mm) to start from besides the grid: closed forms, a mount measured
    by hand. `robust=False`: nothing is rejected.

    Raises ValueError for malformed input and UnobservableError for fewer residuals than
    unknowns.
    """
    observations = list(observations)
    if not observations:
        raise ValueError("no observations given; expected at least one target")
    prior = noise if isinstance(noise, Prior) else as_stated(noise or Noise())
    problem = Problem(observations, prior.scales, prior.systematic)
    total = problem.counts.sum()
    if total <= problem.n:
        raise UnobservableError(
            f"{total} measured coordinates cannot determine {problem.n} unknowns and noise; add poses"
        )

    fits = least_squares(problem, search(observations, prior.scales, starts))
    others = fits.state
    if robust:
        fits = fits_of_most(problem, fits, prior.usual_mm)
    scale = 1.0 if prior.source == "given" else problem.typical(fits)[0]
    if not prior.robot_known and is_hopeless(problem, fits[[0]], scale):
        prior = prior.without_robot
    if prior.source == "residuals":
        prior = prior.with_scanner(max(prior.scales.profile_mm * scale, FINEST_MM))
    problem = Problem(observations, prior.scales, prior.systematic)
    return conclude(
        estimate(problem, prior, fits.state[[0]], robust),
        prior,
        others.join(fits.state),
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
    seen = spectrum(fit.normal[0, :-1, :-1], problem.units)
    too_large = problem.typical(fit)[0] * problem.noise.profile_mm > LARGEST_ERROR_MM
    # measurements by hand
    return bool(too_large or seen.rank < problem.n or seen.sd[0] * scale > 10)


def fits_of_most(problem: Problem, fits: Fit, usual_mm: float) -> Fit:
    """Fits to most of the poses, best first: by Cauchy's loss where least squares leave
    poses that contradict the others, or residuals that are large for all (many bad
    poses hide each other); and after another search among them where that does too.
    Least squares for a handful of poses, where some fit to most of them is nearly
    exact.
    """

    def doubtful(fits: Fit, unknown: bool = False) -> bool:
        large = (
            problem.typical(fits)[0] * problem.noise.profile_mm > 2 * usual_mm
            if usual_mm
            else unknown
        )
        return bool(large or contradicting(problem, fits).any())

    if not doubtful(fits, unknown=True):
        return fits
    found = robust_fit(problem, fits.state)
    if doubtful(found):
        found = robust_fit(
            problem,
            search_among_outliers(problem.observations, problem.noise, found.state),
        )
    if problem.freedoms[~contradicting(problem, found)].sum() > problem.n:
        return found
    return least_squares(problem, fits.state.join(found.state))


def contradicting(problem: Problem, fits: Fit) -> np.ndarray:
    """The profiles (profiles,) whose residuals in the best fit are larger than those of
    most let expect.
    """
    k = problem.freedoms
    return fits.per_pose[0] * k > problem.typical(fits)[0] ** 2 * chi2_limit(
        FALSE_ALARM / len(k), k
    )


def robust_fit(problem: Problem, state: State) -> Fit:
    """Cauchy's loss, its unit lowered from what the residuals look like to what the
    noise is.
    """

    def unit(fits):
        return np.maximum(problem.typical(fits), FINEST_MM / problem.noise.profile_mm)

    fits = problem.moments(state)
    for _ in range(4):
        before = unit(fits).min()
        fits = refine(
            problem, state, scale=unit(fits), iterations=10, tolerance=ROUGHLY
        )
        fits = fits[np.argsort(unit(fits), kind="stable")[:3]]
        state = fits.state
        if abs(unit(fits)[0] - before) < 1e-3 * before:
            break
    scale = np.full_like(fits.loss, unit(fits).min())
    return refine(problem, state, scale=scale, tolerance=ROUGHLY).best_first


@dataclass(frozen=True)
class Estimate:
    """The linear model of the profiles that belong together, and what it says with
    errors of the sizes found.
    """

    problem: Problem
    state: State  # where it was linearised
    columns: list  # of the targets there, as `Problem.columns_in_mm` has them
    model: LinearModel
    found: ErrorSizes


def estimate(problem: Problem, prior: Prior, state: State, robust: bool) -> Estimate:
    """The state and the size of every error as the residuals have them, from a state
    nearby: what does not belong is left out, the sizes are estimated without it, and a
    Gauss-Newton step is taken, until nothing changes.
    """
    names = prior.names(problem.groups.distinguishable)
    law = prior.law(names)
    y, kept = np.zeros(len(law.free)), None
    for turn in range(10):  # one or two are usual
        columns = problem.columns_in_mm(state)
        whole = problem.model(state, names, columns=columns)
        if kept is None:
            kept = grossly = (
                of_large_errors(problem, state, whole, prior) if robust else whole.kept
            )
        model = whole.keeping(kept)
        y, _ = likeliest(model, law, y)
        found = model.posterior(law.variances(y[None])[0])
        after = kept
        if robust:
            after = belonging(
                problem, whole, *model.left_out(found), found.mean[0], found.v[0]
            )
            if (
                np.mean(grossly) - np.mean(after) > LARGEST_REJECTED
                or whole.counts[after].sum() <= problem.n
            ):
                after = grossly  # the model is at fault, not the poses
        # what a step leaves to the next one is as much smaller than it as it is a part
        # of a radian or of 100 mm
        left = np.abs(found.mean[0]) * reach(found.mean)
        small = left < 0.002 * np.sqrt(np.diag(found.covariance[0]))
        if ((after == kept).all() and small[: problem.n].all()) or turn == 9:
            break
        state, kept = after_step(problem, state, found.mean[0]), after
    return Estimate(problem, state, columns, model, average(model, prior, y))


def after_step(problem: Problem, state: State, mean) -> State:
    """The state after a step (n + c,), or as much of it as turns by no more than 0.1
    rad and shifts by 10 mm.
    """
    step = mean[None, : problem.n]
    return problem.move(state, step * min(1.0, 0.1 / reach(step)[0]))


def of_large_errors(
    problem: Problem, state: State, model: LinearModel, prior: Prior
) -> np.ndarray:
    """The profiles (profiles,) whose residuals errors of large, but usual sizes
    explain, each by itself; all, if these are too few. What is stated is believed,
    unless that leaves out more poses than anyone makes mistakes.
    """
    scanner = (
        np.maximum(1.0, problem.typical(problem.moments(state))[0])
        if prior.profile_spread
        else 1.0
    )
    for believed in (replace(prior, stated=frozenset()), prior):
        law = believed.law(model.names)
        # standard deviations beforehand
        v = law.variances(np.full((1, len(law.free)), 1.5))[0][0]
        v[0] = scanner**2
        kept = belonging(
            problem, model, model.Y[:, :, -1], model.own(v), np.zeros(model.n), v
        )
        if np.mean(~kept) <= 0.2:
            break
    return kept if model.counts[kept].sum() > problem.n else model.kept


def belonging(
    problem: Problem, model: LinearModel, errors, covariances, x, v
) -> np.ndarray:
    """The profiles (profiles,) whose residuals chance explains, but for those of groups
    of which it does not explain more than half. `errors` (profiles, q), `covariances`:
    of the rows that speak of the flange; `x` (n,): the unknowns.
    """
    chance, x = FALSE_ALARM / 2 / len(errors), np.append(x, 1.0)  # two tests of each
    of_flange, others = squares(model, errors, covariances, x, v)
    rest = model.counts - model.ranks
    bad = of_flange > chi2_limit(chance, np.maximum(model.ranks, 1))
    bad |= (rest > 0) & (others > chi2_limit(chance, np.maximum(rest, 1)))
    group, size = problem.groups.group, np.bincount(problem.groups.group)
    crowd = (np.bincount(group, bad) > size / 2) & (size > 2)
    return ~(bad | crowd[group])


def squares(
    model: LinearModel, errors, covariances, x, v
) -> tuple[np.ndarray, np.ndarray]:
    """χ² (profiles,) of the rows that speak of the flange, and of the rest of the
    residuals.
    """
    of_flange = normalised_square(covariances, errors)
    # below it is rounding
    return np.maximum(of_flange, 0), np.maximum(x @ model.rest @ x, 0) / v[0]


def conclude(estimated: Estimate, prior: Prior, others: State) -> Solution:
    """What to say of an estimate: its covariance, enlarged where the noise does not
    explain the residuals, and whether one of the `others` fits as well.
    """
    unlikely = 1e-3  # the chance of residuals so large that the covariance is enlarged
    problem, model, found, messages = (
        estimated.problem,
        estimated.model,
        estimated.found,
        [],
    )
    state = after_step(problem, estimated.state, found.mean)
    posterior = model.posterior(found.v[None])
    chi2, dof = (
        float(posterior.square[0]),
        max(int(model.counts[model.kept].sum()) - problem.n, 1),
    )
    covariance, factor = found.covariance[:6, :6], chi2 / dof
    if (
        prior.source == "given"
        and prior.robot_known
        and factor > chi2_limit(unlikely, dof) / dof
    ):
        covariance = covariance * factor
        than = "what the stated noise explains; the covariance is enlarged to match"
        messages.append(f"residuals are {factor**0.5:.2g} times {than}")
    kept = problem.split(model.kept)
    rank = spectrum(posterior.normal[0, : problem.n, : problem.n], problem.units).rank
    seen = of_covariance(covariance, rank, problem.n)
    observations = problem.observations
    R_flange = np.concatenate([o.R_flange[0] for o in observations])
    there, worse = (
        seen if prior.robot_known else at_sensor(estimated, prior, seen),
        seen,
    )
    if there.status != seen.status:
        worse = max(seen, there, key=lambda found: found.sd[0])
        messages.append(
            f"the status is {seen.status} if the robot's errors act at the origin of the poses' frame, {there.status} "
            "if they act at the sensor; the weaker counts. If the poses are of a tool, give those of the flange"
        )
    status = str(worse.status)
    messages += explain(
        worse,
        state.rotation[0],
        R_flange,
        "base" if observations[0].eye_to_hand else "flange",
    )
    largest = chi2 + 12 * max(1.0, factor)
    if status != "unobservable" and (
        twin := twin_of(estimated, state, seen, largest, others)
    ):
        status = "weak"
        messages.append(twin)

    of_flange, rest = squares(
        model, *model.left_out(posterior), np.append(posterior.mean[0], 1.0), found.v
    )
    terms = zip(problem.terms, state.placements, strict=True)
    sizes = {size.name: size.middle for size in found.sizes}
    return Solution(
        state=state,
        covariance=covariance,
        placements=tuple(
            term.target.at(origin[0], axes[0], term.sizes)
            for term, (origin, axes) in terms
        ),
        prior=prior,
        found=found,
        noise=replace(problem.noise, **(dict.fromkeys(ROBOT, 0.0) | sizes)),
        chi2=chi2,
        dof=dof,
        rms_mm=problem.rms_mm(estimated.columns, found.mean, model.kept),
        normalised=tuple(
            problem.split(np.sqrt((of_flange + rest) / np.maximum(model.counts, 1)))
        ),
        rejected=tuple(~good for good in kept),
        status=status,
        observability=seen,
        messages=tuple(messages),
        problem=problem,
    )


def at_sensor(estimated: Estimate, prior: Prior, seen: Spectrum) -> Spectrum:
    """How well the pose is known if the robot's errors act at the sensor and not, as in
    `seen`, at the origin of the frame that the poses are of, which a user chooses;
    `seen` where that is too far from any limit to matter.
    """
    if not any(limit / 1.5 < seen.sd[0] < 1.5 * limit for limit in (WEAK, 1.0)):
        return seen
    problem, names = estimated.problem, estimated.model.names
    columns = [np.concatenate([z[:, :-6], z[:, :6]], axis=1) for z in estimated.columns]
    model = problem.model(estimated.state, names, columns=columns).keeping(
        estimated.model.kept
    )
    found = average(model, prior, np.zeros(1 + len(names)))
    return of_covariance(found.covariance[:6, :6], seen.rank, seen.parameters)


def twin_of(
    estimated: Estimate, state: State, seen: Spectrum, largest: float, others: State
) -> str:
    """A sentence on another sensor pose that fits as well, if there is one: with a χ²
    of at most `largest`.
    """
    problem, kept, v = estimated.problem, estimated.model.kept, estimated.found.v[None]

    def apart(others: State) -> np.ndarray:
        delta = pose_error(
            state.rotation, state.translation, others.rotation, others.translation
        )
        return normalised_square(seen.covariance, delta) > 50

    for k in np.flatnonzero(apart(others)):
        other = refine(
            problem, others[[k]], weights=problem.split(kept), tolerance=ROUGHLY
        ).state
        found = problem.model(other, estimated.model.names).keeping(kept).posterior(v)
        other = problem.move(other, found.mean[:, : problem.n])
        if apart(other) and found.square[0] < largest:
            turn = np.degrees(angle_between(other.rotation[0], state.rotation[0]))
            shift = np.linalg.norm(other.translation[0] - state.translation[0])
            return (
                f"another sensor pose explains the data as well, {turn:.3g}° and {shift:.3g} mm away; "
                "add poses from other directions"
            )
    return ""
