"""Which profiles do not belong to the others: by the errors that a robot may make, each
by itself, and by what all others say of it.
"""

from dataclasses import replace

import numpy as np
from numpy import ndarray
from scipy.special import fdtri

from profilecal.geometry.noise import FALSE_ALARM, chi2_limit, normalised_square
from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.joint.prior import Prior
from profilecal.joint.problem import Problem

LARGEST_REJECTED = 1 / 3  # of the poses, beyond those that large errors leave out
MOST_MISTAKES = 0.2  # of the poses: nobody makes more
# standard deviations of the coordinate of a size (`Law`): errors large, but usual
LARGE = 1.5


def of_large_errors(problem: Problem, model: LinearModel, prior: Prior) -> ndarray:
    """The profiles (profiles,) whose residuals errors of large, but usual sizes
    explain, each by itself; all profiles, if these are too few.

    At first all sizes have the law of usual ones, of the shorter tail. If that leaves
    out more than MOST_MISTAKES, stated sizes have their own law, of the longer tail.
    Smooth errors explain nothing here.
    """
    of_rest = np.sum(model.rest[..., -1] ** 2, axis=1)
    scanner = 1.0
    if prior.profile_spread:
        chi2 = np.sum(model.Y[..., -1] ** 2, axis=1) + of_rest
        scanner = max(1.0, problem.typical(chi2[None] / problem.counts_or_1)[0])
    for believed in (replace(prior, stated=frozenset()), prior):
        law = believed.law(model.names)
        (v,) = law.variances(np.full((1, len(law.free)), LARGE))
        v[0] = scanner**2
        of_flange = normalised_square(model.own(v), model.Y[..., -1])
        kept = belonging(problem, model, of_flange, of_rest / v[0], model.kept)
        if np.mean(~kept) <= MOST_MISTAKES:
            break
    return kept if model.counts[kept].sum() > problem.n else model.kept


def still_belonging(
    problem: Problem,
    model: LinearModel,
    posterior: Posterior,
    first: ndarray,
    always: ndarray,
) -> ndarray:
    """The profiles (profiles,) that belong to what all others say. If more than
    LARGEST_REJECTED of all profiles are `first` ones that do not belong, or too few
    belong, the model is at fault, not the poses: then the `first` ones.
    """
    after = belonging(problem, model, *chi2_left_out(model, posterior), always)
    rejected = np.mean(first) - np.mean(after)
    too_few = model.counts[after].sum() <= problem.n
    return first if rejected > LARGEST_REJECTED or too_few else after


def chi2_left_out(model: LinearModel, posterior: Posterior) -> tuple[ndarray, ndarray]:
    """Two χ² (profiles,) of each profile: of the rows that speak of the flange, by what
    all other profiles kept say of them; and of the rest of its residuals, at the mean
    of the unknowns by all profiles kept.
    """
    rest = model.rest @ np.append(posterior.mean[0], 1.0)
    # a χ² below zero is rounding
    of_flange = np.maximum(model.left_out(posterior), 0)
    return of_flange, np.sum(rest**2, axis=1) / posterior.v[0, 0]


def belonging(
    problem: Problem,
    model: LinearModel,
    of_flange: ndarray,
    of_rest: ndarray,
    always: ndarray,
) -> ndarray:
    """The profiles (profiles,) whose two χ² chance explains: that of the rows that
    speak of the flange, and that of the rest. If more than half of a group of three or
    more, of one target and orientation or sweep, are bad, the whole group is.

    A profile left out has no part in estimating the sizes of errors, which the others
    tell only roughly. The χ² of its rows that speak of the flange is therefore `ranks`
    times a variable of F's law, of `ranks` and `freedom` degrees of freedom. That law
    stays for all that are not `always` kept: by two limits in turn, a profile between
    them would come and go for ever.
    """
    chance = FALSE_ALARM / 2 / len(of_rest)  # two tests of each
    ranks = np.maximum(model.ranks, 1)
    freedom = max(1, model.ranks[model.kept].sum() - problem.n)
    limit = chi2_limit(chance, ranks)
    limit_out = ranks * fdtri(ranks, freedom, 1 - chance)
    bad = of_flange > np.where(always, limit, limit_out)
    rest = model.counts - model.ranks
    bad |= (rest > 0) & (of_rest > chi2_limit(chance, np.maximum(rest, 1)))
    group = problem.groups.group
    size = np.bincount(group)
    crowd = (np.bincount(group, bad) > size / 2) & (size > 2)
    return ~(bad | crowd[group])
