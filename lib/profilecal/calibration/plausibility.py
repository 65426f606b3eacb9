"""Is a solution to be believed? What its residuals say that its covariance does not.

A covariance speaks of noise. What is wrong in every pose alike (a scale, a drift, a
radius) leaves a pattern in the residuals and moves the answer by more: each is one more
unknown, tested by Rao's score. Contradictions, many rejected poses and a misfit larger
than noise speak against a solution too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress

import numpy as np
from numpy import ndarray
from scipy.linalg import block_diag
from scipy.special import ndtr

from profilecal.calibration.evidence import Evidence, evidence
from profilecal.geometry.noise import FALSE_ALARM, SMOOTH, normalised_square
from profilecal.geometry.observability import (
    HAND_PRECISION,
    WEAK,
    brief,
    how_far,
    of_covariance,
)
from profilecal.joint.first_fit import largest_error_mm
from profilecal.joint.prior import OF_SCANNER, Perturbation, of_target
from profilecal.joint.problem import Problem
from profilecal.joint.rejection import LARGEST_REJECTED
from profilecal.joint.smooth import positions
from profilecal.joint.solution import Solution

# standard deviations that an error moves a pose by, or times what the stated noise
# explains: no more "ok"
MUCH = 3.0
# of the clearest error's clarity: what is less clear is taken for its shadow
SHADOW = 0.8
# of an error's own pattern: less is left of it beside the unknowns than rounding
ABSORBED = 1e-9
SMALLER = np.array([1, 1 / 4, 1 / 16])  # times which the robot's errors are looked at
UNIT = WEAK * HAND_PRECISION  # (6,) of moves of the sensor, mm and rad
ADVICE = (
    "check the mount, units and convention of the poses, which pose each profile "
    "belongs to, x and z of the profiles, the radius"
)
# what the answer allowed for already moves its pose no more; but points of profiles
# that are not corrected stay as wrong as they were
ALLOWED = (
    "the answer and its covariance allow for that already, and hold for data that are "
    "corrected for it"
)


@dataclass(frozen=True)
class Finding:
    """Something that may be wrong in the same way in every pose."""

    error: Perturbation
    correction: float  # that makes the residuals smallest, mm or rad or 1
    clear: float  # the size of the correction over its standard deviation
    moves: ndarray  # (6,) how it moves the sensor pose, mm and rad
    not_allowed_for: float  # the chance that the answer did not allow for as much

    @property
    def chance(self) -> float:
        """That it looks so clear where nothing is wrong."""
        return float(2 * ndtr(-self.clear))

    @property
    def words(self) -> str:
        """The error with its size, in its own unit, the opposite of its correction."""
        size = brief(self.error.unit * abs(self.correction))
        sign = self.error.signs[int(self.correction > 0)]
        return self.error.words.format(sign, size)


def systematic_tests(
    solution: Solution, parts: Mapping[str, ndarray]
) -> tuple[list[Finding], list[str]]:
    """What might be wrong everywhere, each by itself, and what `moved` says of parts of
    the profiles. `parts`: by words on it, which profiles (profiles,) are of it.

    Both are steps in one model, of which nothing is known beforehand: of errors first,
    then of the sensor, part by part.
    """
    problem = solution.problem
    tried = [*OF_SCANNER, *of_target(problem.observations), *robot_patterns(problem)]
    model = solution.model(tried)
    p, n = model.p, model.p - len(tried)
    steps = len(tried) + 6 * len(parts)
    of_part = np.reshape([*parts.values()], (len(parts), len(model.kept))).T

    def widened(rows: ndarray) -> ndarray:
        """[A | B | r] of [A | r]; B has the columns of the sensor, part by part."""
        B = rows[..., None, :6] * UNIT * of_part[:, None, :, None]
        return np.insert(rows, [p], B.reshape(*rows.shape[:2], -1), axis=2)

    known = model.precision[:n, :n]
    model = replace(  # large, so that the one before is not to stay
        model,
        Y=widened(model.Y),
        rest=widened(model.rest),
        precision=block_diag(known, np.eye(steps)),
        of_mount=problem.of_mount(solution.state, n + steps)[0],
    )
    is_robots = [False, *(name != SMOOTH for name in model.names)]
    times = SMALLER if parts else SMALLER[:1]
    smaller = np.where(is_robots, times[:, None], 1.0)
    posterior = model.posterior(smaller**2 * solution.error_sizes.median_v)
    every = [evidence(normal, known) for normal in posterior.normal]
    of_errors = every[0].of(slice(len(tried)))
    pattern = np.diag(posterior.normal[0])[n:p]
    without = posterior.log_evidence - [says.log_odds for says in every]
    single = [
        says.of(slice(k, k + 6)) for says in every for k in range(len(tried), steps, 6)
    ]
    found = findings(solution, tried, of_errors, pattern)
    by_error = [says.of(slice(k, k + 1)) for says in every for k in range(len(tried))]
    other = without.repeat(len(tried)) + [says.log_odds for says in by_error]
    return found, moved([*parts], single, without, other.max()) if parts else []


def findings(
    solution: Solution, tried: list[Perturbation], says: Evidence, pattern: ndarray
) -> list[Finding]:
    """Of errors tried, by what residuals say of them: those that are seen beside the
    unknowns. `pattern` (d,): the square of each error's own pattern.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        corrections, sds = says.each()
        visible = sds**-2 > ABSORBED * pattern
        clear = abs(corrections / sds)
        moves = (says.x_per_step[:6] * corrections).T
    # by error considered, the chance that it is far larger than usual
    problem = solution.problem
    poor = solution.error_sizes.poor[problem.considered_columns]
    allowed = dict(zip(problem.considered, poor, strict=True))
    not_allowed_for = [1 - allowed.get(error, 0.0) for error in tried]
    every = map(Finding, tried, corrections, clear, moves, not_allowed_for)
    return [*compress(every, visible)]


def moved(
    words: list[str], single: list[Evidence], without: ndarray, other: float
) -> list[str]:
    """A sentence on the part of the profiles whose sensor pose is most clearly another
    one than that of all others, if there is one. `words` on each part, with a place for
    how far; `single`: what residuals say of a move of each by itself, for each size of
    the robot's errors; `without`: the log evidence of each size without a move;
    `other`: the largest one with one error in every pose alike in place of a move.

    Where none moved, a move makes the residuals n times as likely in one of n scans at
    most. Errors that were estimated without a move explain it if they are large: they
    are looked at if they are smaller, too. Nothing moved where an error in every pose,
    such as a wrong radius, makes them likelier still.

    >>> import numpy as np
    >>> from profilecal.calibration.plausibility import Evidence, moved
    >>> clear = Evidence(np.eye(6), np.full(6, 10.0), 600.0, np.zeros((6, 6)))
    >>> moved(["{} off"], [clear], np.zeros(1), other=0.0)
    ['8.7 mm and 4.3° off']
    >>> moved(["{} off"], [clear], np.zeros(1), other=1000.0)
    []
    """
    count = len(words)
    with_one = without.repeat(count) + [says.log_odds for says in single]
    best = int(np.argmax(with_one))
    clearest = with_one[best]
    if clearest < max(without.max() + np.log(count / FALSE_ALARM), other):
        return []
    far = " and ".join(how_far(single[best].likeliest * UNIT))
    return [words[best % count].replace("{}", far)]


def robot_patterns(problem: Problem) -> list[Perturbation]:
    """Scales of the positions, drifts.

    Scans share the middle of all: eye-to-hand, that of each would be another sensor's.
    """
    places = [
        positions(seen.R_flange[0], seen.T_flange[0], problem.to_hand)
        for seen in problem.observations
    ]
    off = partial(off_middle, middle=np.concatenate(places).mean(axis=0))
    far, signs = "were too {} by {} %", ("far apart", "close together")
    errors = [Perturbation(f"the robot's positions {far}", 100, signs, positions=off)]
    other = "scanner" if problem.to_hand else "target"
    drift = f"the robot or the {other} drifted along the base's {{}} by {{}} mm"
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        scaled = partial(off, along=direction)
        drifting = partial(drifted, along=direction)
        scale = f"the robot's positions along the base's {axis} {far}"
        errors += [
            Perturbation(scale, 100, signs, positions=scaled),
            Perturbation(drift, 1, (axis, f"-{axis}"), positions=drifting),
        ]
    return errors


def off_middle(T: ndarray, middle: ndarray, along: ndarray | float = 1.0) -> ndarray:
    """Positions (P, 3) from a middle (3,), or the part of that `along` a unit vector of
    the base.
    """
    return along * (T - middle)


def drifted(T: ndarray, along: ndarray) -> ndarray:
    """A shift that grows evenly from the first pose to the last."""
    return np.outer(np.linspace(0, 1, len(T)), along)


def check(
    solution: Solution, parts: Mapping[str, ndarray] | None = None
) -> tuple[Solution, list[str]]:
    """The solution with the status and the covariance that its residuals leave, and
    sentences on what in them speaks against it, which more poses would not mend.
    `parts` as `systematic_tests` takes them.
    """
    found, objections = systematic_tests(solution, parts or {})
    misfits, are_large = contradictions(solution)
    objections += misfits
    if are_large:  # what poses to add, as the solution says, does not mend that
        solution = replace(solution, status="unobservable", messages=())
    if solution.status == "unobservable":
        return solution, objections
    C = solution.covariance
    before = solution.observability
    guilty = clear_findings(found)
    enlarged = C + sum(
        one.not_allowed_for * np.outer(one.moves, one.moves) for one in guilty
    )
    observability = of_covariance(enlarged, before.is_open)
    is_far = any(
        one.not_allowed_for * normalised_square(C, one.moves) > MUCH**2
        for one in guilty
    )
    if objections or observability.sd[0] > WEAK or is_far:
        solution = replace(solution, status="weak")
    if guilty:
        objections.append(accusation(guilty))
    checked = replace(solution, covariance=enlarged, observability=observability)
    return checked, objections


def contradictions(solution: Solution) -> tuple[list[str], bool]:
    """What in the residuals no noise explains, in words, and whether the data
    contradict each other by more than a robot errs.
    """
    messages = []
    misfit = np.sqrt(max(solution.chi2_per_dof, 0.0))  # below it is rounding
    if solution.noise_source == "given" and misfit > MUCH:
        messages.append(
            f"the residuals are {brief(misfit)} times what the stated noise explains; "
            f"{ADVICE}"
        )
    error_mm = max(solution.rms_mm, solution.noise.position_mm)
    are_large = error_mm > largest_error_mm(solution.prior.scales)
    if are_large:
        messages.append(
            f"the data contradict each other by {brief(error_mm)} mm, "
            f"more than a robot errs; {ADVICE}"
        )
    problem = solution.problem
    groups = problem.split(problem.groups.group)
    of_scans = zip(problem.observations, solution.rejected, groups, strict=True)
    for seen, rejected, group in of_scans:
        count = int(rejected.sum())
        in_a_row = rejected[:count].all() or rejected[-count:].all()
        several = count > 2 and np.ptp(group[rejected]) > 0
        if rejected.mean() > LARGEST_REJECTED or (in_a_row and several):
            row = ", in a row, as if sensor or target had moved" * bool(in_a_row)
            messages.append(
                f"the {seen.kind}: {count} of {len(rejected)} poses contradict the "
                f"others{row}; {ADVICE}"
            )
    return messages, are_large


def clear_findings(findings: list[Finding]) -> list[Finding]:
    """Those that chance does not explain, clearest first."""
    clear = [one for one in findings if one.chance * len(findings) < FALSE_ALARM]
    clear.sort(key=lambda one: -one.clear)
    return [one for one in clear if one.clear > SHADOW * clear[0].clear]


def accusation(guilty: list[Finding]) -> str:
    """What the residuals look like, and what the clearest of it would do."""
    clearest = guilty[0]
    causes = ", or as if ".join(one.words for one in guilty[:4])
    far = " and ".join(how_far(clearest.moves))
    remedy = "the covariance is enlarged to match"
    if max(one.not_allowed_for for one in guilty) < 0.5:
        remedy = ALLOWED
    return (
        f"the residuals look as if {causes} "
        f"({clearest.clear:.0f} standard deviations), "
        f"which would move the sensor by up to {far}; {remedy}"
    )
