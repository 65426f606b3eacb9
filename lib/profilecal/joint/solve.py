"""One calibration for every target: the sensor pose and all placements in one maximum-likelihood step.

Unknown are the sensor pose (6) and where each target is (edge 4, disk 5, ball 3, plane 3, point 3). A residual is an
observed point minus where the scan plane meets the target, in the scan plane. Each target file offers `residual` and
its derivatives in the *sensor* frame; everything else is the same for all of them and is written once, here.

The sensor pose is perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ, a direction d to d + d × φ. Every function takes a batch of problems along the leading axis.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2 as chi2_law

from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between
from profilecal.joint.descent import Fit, refine
from profilecal.joint.observability import explain, of_covariance, spectrum
from profilecal.joint.observations import Observations, affine_noise
from profilecal.joint.problem import Problem, units_by_hand
from profilecal.joint.search import _spread, search, search_among_outliers
from profilecal.joint.solution import Solution
from profilecal.joint.state import State, pose_error
from profilecal.joint.terms import _per_pose, target_at

FALSE_ALARM = 0.01  # the chance that any good pose at all is rejected


def _bad_poses(problem: Problem, own, count, scale: float) -> list[np.ndarray]:
    """Poses (P,) of each term whose residuals are beyond chance, and groups of which more than half are."""
    total, rejected = sum(len(o) for o in own), []
    for term, o, k in zip(problem.terms, own, count, strict=True):
        bad = o * k > scale**2 * chi2_law.isf(FALSE_ALARM / total, k)
        size = np.bincount(term.group)
        crowd = (np.bincount(term.group, bad) > size / 2) & (size > 2)
        rejected.append(bad | crowd[term.group])
    return rejected


def solve(
    observations: Sequence[Observations],
    noise: Noise | None = None,
    *,
    starts=(),
    robust: bool = True,
    searching: bool = True,
) -> Solution:
    """The sensor pose from all observations together, with its covariance and what it can be believed.

    `noise.profile_mm` 0: not known, to be estimated.
    `starts`: poses (R (3, 3), T (3,) mm) to start from besides the grid: closed forms, a mount measured by hand.
    `robust=False` is plain least squares throughout: nothing is rejected. `searching=False` trusts `starts` alone, as
    where only the noise has changed since a solution.

    Raises ValueError for malformed input and UnobservableError for fewer residuals than unknowns.
    """
    observations, noise = list(observations), noise or Noise()
    if not observations:
        raise ValueError("no observations given; expected at least one target")
    noise, source, how = _first_noise(observations, noise)
    problem = Problem(observations, noise)
    total = int(problem.count()[0])
    if total <= problem.n:
        raise UnobservableError(f"{total} measured coordinates cannot determine {problem.n} unknowns; add poses")

    if searching:
        found = search(observations, noise, starts)
    else:
        found = problem.place(np.stack([R for R, _ in starts]), np.stack([T for _, T in starts]))
    fit = refine(problem, found)
    count = [_per_pose(term) for term in problem.terms]
    weights, scale = None, 1.0
    if robust:
        least = 0.0 if source == "residuals" else 1.0
        fit, scale = _robust(problem, fit.state, count, least)
        bad = _bad_poses(problem, [o[0] for o in fit.per_pose], count, least or scale)
        if searching and any(b.any() for b in bad):
            fit, scale = _robust(problem, search_among_outliers(observations, noise, fit.state), count, least)
        weights = [~bad for bad in _bad_poses(problem, [o[0] for o in fit.per_pose], count, scale)]
        for _ in range(5):
            if sum(int((w * k).sum()) for w, k in zip(weights, count, strict=True)) <= problem.n:
                raise UnobservableError("most poses contradict each other: no sensor pose explains half of them")
            fit = refine(problem, fit.state, weights=weights)
            if source == "residuals":
                scale = float(_spread(fit.per_pose, count)[np.argmin(fit.loss)])
            best = int(np.argmin(fit.loss))
            before, weights = weights, [~b for b in _bad_poses(problem, [o[best] for o in fit.per_pose], count, scale)]
            if all((a == b).all() for a, b in zip(before, weights, strict=True)):
                break
        weights = before
    best = int(np.argmin(fit.loss))
    kept = total if weights is None else sum(int((w * k).sum()) for w, k in zip(weights, count, strict=True))
    dof = kept - problem.n
    one = fit.state[[best]]
    if source == "residuals":
        for _ in range(20):
            factor = np.sqrt(float(refine(problem, one, weights=weights).chi2[0]) / dof)
            noise = replace(noise, profile_mm=max(noise.profile_mm * factor, 1e-12))
            problem = Problem(observations, noise)
            if abs(factor - 1) < 1e-6:
                break
    everything = fit.state
    fit = refine(problem, one, weights=weights)
    return _state_result(problem, observations, noise, source, how, fit, everything, weights, dof)


def _first_noise(observations, noise: Noise) -> tuple[Noise, str, str]:
    """The scanner noise to begin with: given, from rotation groups, or 1 mm until the residuals tell."""
    if noise.profile_mm:
        if not noise.profile_mm > 0:
            raise ValueError(f"profile_mm is {noise.profile_mm}; expected a standard deviation, 0 if unknown")
        return noise, "given", "as given"
    found = [affine_noise(o) for o in observations if o.kind in ("edge", "point") and o.group is not None]
    freedom = sum(f for _, f in found)
    if freedom >= 10:
        level = np.sqrt(sum(f * s**2 for s, f in found) / freedom)
        return (
            replace(noise, profile_mm=max(float(level), 1e-12)),
            "groups",
            (f"from the scatter inside rotation groups, {freedom} degrees of freedom"),
        )
    return replace(noise, profile_mm=1.0), "residuals", "from the residuals"


def _robust(problem: Problem, state: State, count, least: float) -> tuple[Fit, float]:
    """Cauchy's loss, its unit lowered from what the residuals look like to what the noise is: the fits, best first,
    and that unit."""

    def unit(per_pose):
        return np.maximum(_spread(per_pose, count), max(least, 1e-9))

    per_pose = problem.moments(state)[2]
    for _ in range(4):
        fit = refine(problem, state, scale=unit(per_pose), iterations=10)
        best = np.argsort(unit(fit.per_pose), kind="stable")[:3]
        state, per_pose = fit.state[best], [own[best] for own in fit.per_pose]
    fit = refine(problem, state, scale=np.full(len(best), unit(per_pose).min()))
    order = np.argsort(fit.loss)
    per_pose = [own[order] for own in fit.per_pose]
    fit = Fit(fit.state[order], fit.M[order], fit.loss[order], per_pose, fit.converged[order])
    return fit, float(unit(per_pose)[0])


def _state_result(problem, observations, noise, source, how, fit, everything, weights, dof) -> Solution:
    """The solution object, with what there is to say."""
    state, chi2 = fit.state, float(fit.chi2[0])
    found = spectrum(fit.information[0], units_by_hand(problem))
    messages, status = [], str(found.status)
    factor = chi2 / dof
    unlikely = chi2_law.isf(1e-3, dof) / dof
    covariance = found.covariance
    if source != "residuals" and factor > unlikely:
        covariance = found.covariance * factor
        found = of_covariance(covariance, found.rank, found.parameters)
        status = str(found.status)
        than = {
            "groups": "the scatter inside rotation groups, so groups differ by more than scanner noise (robot errors?)",
            "given": "what the stated noise explains",
        }[source]
        messages.append(f"residuals are {factor**0.5:.2g} times {than}; the covariance is enlarged to match")
    messages += explain(
        found,
        state.rotation[0],
        np.concatenate([np.asarray(o.R_flange).reshape(-1, 3, 3) for o in observations]),
        "base" if observations[0].eye_to_hand else "flange",
    )

    if status != "unobservable":
        other = refine(problem, everything, weights=weights)
        delta = pose_error(state.rotation, state.translation, other.state.rotation, other.state.translation)
        apart = np.einsum("bi,ij,bj->b", delta, np.linalg.inv(covariance), delta)
        twin = np.flatnonzero((apart > 50) & (other.loss < fit.loss[0] + 12))
        if twin.size:
            status = "weak"
            R, T = other.state.rotation[twin[0]], other.state.translation[twin[0]]
            messages.append(
                "another sensor pose explains the data as well, "
                f"{np.degrees(angle_between(R, state.rotation[0])):.3g}° and "
                f"{np.linalg.norm(T - state.translation[0]):.3g} mm away; add poses from other directions"
            )
    residuals = [
        term.linearise(state, p, True)[0][0, -1] for term, p in zip(problem.terms, state.placements, strict=True)
    ]
    weights = weights or [np.ones(term.P, dtype=bool) for term in problem.terms]
    square = sum(float((r**2 * w).sum()) for r, w in zip(residuals, weights, strict=True))
    return Solution(
        state.rotation[0],
        state.translation[0],
        covariance,
        tuple(target_at(o, p[0], d[0]) for o, (p, d) in zip(observations, state.placements, strict=True)),
        float(noise.profile_mm),
        "given" if source == "given" else "estimated",
        how,
        chi2,
        dof,
        float(np.sqrt(square / (dof + problem.n))),
        tuple(np.sqrt(o[0]) for o in fit.per_pose),
        tuple(~w for w in weights),
        status,
        found,
        tuple(messages),
        bool(fit.converged[0]),
        noise,
    )
