"""What to say of an estimate: its covariance, enlarged where the noise does not explain
the residuals, how well it is known, and whether another sensor pose fits as well.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray

from profilecal.geometry.noise import chi2_limit, normalised_square
from profilecal.geometry.observability import explain, of_covariance, spectrum
from profilecal.geometry.poses import pose_error
from profilecal.joint import delay
from profilecal.joint.descent import refine
from profilecal.joint.error_sizes import ErrorSizes
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.prior import Prior
from profilecal.joint.problem import Problem
from profilecal.joint.rejection import chi2_left_out
from profilecal.joint.solution import Solution
from profilecal.targets.state import State

UNLIKELY = 1e-3  # the chance of residuals so large that the covariance is enlarged
# χ² of the six unknowns of a sensor pose: the true one rarely has more than
# RARE_SQUARE, and what has more than OTHER_SQUARE is another sensor pose
RARE_SQUARE = 12.0
OTHER_SQUARE = 50.0


@dataclass(frozen=True)
class Estimate:
    """The linear model of the profiles that belong together, and what it says with
    errors of the sizes found.
    """

    problem: Problem
    state: State  # where it was linearised
    model: LinearModel
    error_sizes: ErrorSizes
    against: list[str]  # sentences on what another round would change


def conclude(estimated: Estimate, prior: Prior, candidates: State) -> Solution:
    """The solution that an estimate leads to, with its status. `candidates`: sensor
    poses that may fit as well.
    """
    solution = at_the_mean(estimated, prior)
    problem, rotation = solution.problem, solution.rotation
    status, known, remarks = delay.verdict(solution)
    remarks += explain(known, rotation, problem.poses[0], problem.frame)
    if status != "unobservable":
        against = twin(solution, candidates) + estimated.against
        if against:
            status = "weak"
            remarks += against
    messages = (*solution.messages, *remarks)
    return replace(solution, status=status, messages=messages)


def at_the_mean(estimated: Estimate, prior: Prior) -> Solution:
    """The solution at the mean of all unknowns of an estimate, with the status that its
    covariance alone gives.
    """
    model, sizes = estimated.model, estimated.error_sizes
    posterior = model.posterior(sizes.median_v[None])
    problem, state = estimated.problem.after_step(estimated.state, sizes.mean)
    n, chi2 = problem.n, float(posterior.square[0])
    of_flange, of_rest = chi2_left_out(model, posterior)
    square = (of_flange + of_rest) / problem.counts_or_1
    dof = max(int(model.counts[model.kept].sum()) - n, 1)
    enlargement, messages = enlargement_by_misfit(prior, chi2, dof)
    sizes = replace(
        sizes,
        covariance=enlargement * sizes.covariance,
        enlarged=enlargement * sizes.enlarged,
    )
    is_open = spectrum(posterior.normal[0, :n, :n], problem.units).is_open
    observability = of_covariance(sizes.covariance[:6, :6], is_open)
    return Solution(
        state=state,
        covariance=observability.covariance,
        prior=prior,
        error_sizes=sizes,
        chi2=chi2,
        dof=dof,
        rms_mm=estimated.problem.rms_mm(estimated.state, sizes.mean, model.kept),
        normalised=tuple(problem.split(np.sqrt(square))),
        rejected=tuple(problem.split(~model.kept)),
        status=str(observability.status),
        observability=observability,
        messages=messages,
        problem=problem,
    )


def enlargement_by_misfit(
    prior: Prior, chi2: float, dof: int
) -> tuple[float, tuple[str, ...]]:
    """What the covariance is to be multiplied by, where all noise is given and does not
    explain the residuals, with a sentence that says so.
    """
    all_given = prior.source == "given" and prior.robot_known
    if not all_given or chi2 <= chi2_limit(UNLIKELY, dof):
        return 1.0, ()
    factor = chi2 / dof
    return factor, (
        f"residuals are {factor**0.5:.2g} times what the stated noise explains; "
        "the covariance is enlarged to match",
    )


def twin(solution: Solution, candidates: State) -> list[str]:
    """A sentence on another sensor pose that fits as well, if there is one: its χ² is
    below a limit that χ² at the true sensor pose rarely exceeds.
    """
    problem = solution.problem
    largest = solution.chi2 + RARE_SQUARE * max(1.0, solution.chi2_per_dof)
    for k in np.flatnonzero(errors_if_right(solution, candidates)[1]):
        pairs = zip(problem.observations, solution.kept, strict=True)
        kept = problem.of(seen.keep(own) for seen, own in pairs)
        other = refine(kept, candidates[[k]]).state
        # the model there, as if the other sensor pose were the solution
        there = replace(solution, state=other).model()
        posterior = there.posterior(solution.error_sizes.median_v[None])
        other = problem.move(other, posterior.mean[:, : problem.n])
        (error,), is_another = errors_if_right(solution, other)
        if is_another and posterior.square[0] < largest:
            shift, turn = np.linalg.norm(error.reshape(2, 3), axis=1)
            return [
                "another sensor pose explains the data as well, "
                f"{np.degrees(turn):.3g}° and "
                f"{shift:.3g} mm away; add poses from other directions"
            ]
    return []


def errors_if_right(solution: Solution, others: State) -> tuple[ndarray, ndarray]:
    """Errors (B, 6) that a solution has if other sensor poses are right, and whether
    each of these (B,) is too far from the solution to be the same sensor pose.
    """
    theirs = others.rotation, others.translation
    errors = pose_error(solution.rotation, solution.translation, *theirs)
    return errors, normalised_square(solution.covariance, errors) > OTHER_SQUARE
