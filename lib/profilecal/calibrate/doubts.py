"""Is a solution to be believed? What its residuals say that its covariance does not.

A covariance speaks of noise, which differs from pose to pose. What is wrong in the same way everywhere (a scale, a
drift, a wrong radius) moves the answer by more, and leaves a pattern in the residuals. Each suspect is one more
unknown; what it would change, linearly, and how clearly, comes from the normal equations of slightly changed data.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from profilecal.joint.observability import WEAK, of_covariance, spectrum
from profilecal.joint.problem import Problem, units_by_hand
from profilecal.joint.solution import Solution

LARGEST_ERROR_MM = 2.0  # of a robot's position; what is larger is a mistake, not an error


LARGEST_REJECTED = 1 / 3  # of the poses


LARGEST_MISFIT = 3.0  # residuals over what the stated noise explains


FALSE_ALARM = 0.01  # the chance that a good scan has a suspect


MOVES, MOVES_MUCH = 1.0, 3.0  # standard deviations of the pose that a suspect must move it by to count, and to be weak


ALIKE = 0.8  # of the clearest suspect's clarity: less is taken for its shadow


ABSORBED = 1e-9  # of a suspect's own pattern: less is left of it beside the unknowns than rounding


STEP = 1e-4


ORIENTATION_DEG, LEAST_ADDED = 0.02, 1.25  # what a robot's orientation may err, and the growth worth a word


CHECK = (
    "check the mount, units and convention of the poses, which pose each profile belongs to, x and z of the profiles, "
    "the radius"
)


@dataclass(frozen=True)
class Suspect:
    """Something that may be wrong in the same way in every pose."""

    words: str  # with a place for the size
    size: float
    clear: float  # the size over its standard deviation
    moves: np.ndarray  # (6,) the sensor pose, mm and rad
    among: int  # so many suspects

    @property
    def is_clear(self) -> bool:
        """Whether chance does not explain it."""
        return abs(self.clear) > norm.isf(FALSE_ALARM / 2 / self.among)


def judge(observed, solution: Solution, errors_estimated: bool, orientation_stated: bool) -> Solution:
    """The solution with the status, covariance and messages that its residuals leave.

    `errors_estimated`: the robot's errors in its noise come from the residuals. `orientation_stated`: if only as none.
    """
    noise, messages, weak, C = solution.noise, list(solution.messages), False, solution.covariance

    misfit = np.sqrt(solution.chi2_per_dof)
    if solution.noise_source == "given" and misfit > LARGEST_MISFIT:
        weak = True
        messages.append(f"the residuals are {misfit:.2g} times what the stated noise explains; {CHECK}")

    stated = 3 * noise.steering_mm
    if not errors_estimated:
        stated = max(stated, 3 * noise.position_mm, 3 * noise.group_position_mm)
    error = max(noise.position_mm if errors_estimated else 0.0, solution.rms_mm)
    if error > max(LARGEST_ERROR_MM, stated):
        weak = True
        messages.append(f"the data contradict each other by {error:.2g} mm, more than a robot errs; {CHECK}")

    rejected = np.concatenate(solution.rejected)
    if rejected.mean() > LARGEST_REJECTED:
        weak = True
        messages.append(f"{rejected.sum()} of {len(rejected)} poses contradict the others; {CHECK}")

    if solution.status == "unobservable":
        return replace(solution, messages=tuple(messages))
    clear = [s for s in suspects(observed, solution) if s.is_clear]
    alike = [s for s in clear if abs(s.clear) > ALIKE * max(abs(s.clear) for s in clear)]
    far = [float(np.sqrt(s.moves @ np.linalg.solve(C, s.moves))) for s in alike]
    if alike and max(far) > MOVES:
        weak |= max(far) > MOVES_MUCH
        C = C + sum(np.outer(s.moves, s.moves) for s in alike)
        worst, most = max(alike, key=lambda s: abs(s.clear)), max(alike, key=lambda s: np.linalg.norm(s.moves[:3]))
        words = [s.words.format(s.size) for s in sorted(alike, key=lambda s: -abs(s.clear))]
        messages.append(
            f"the residuals look as if {', or as if '.join(words[:4])} ({abs(worst.clear):.0f} standard deviations), "
            f"which would move the sensor by up to {np.linalg.norm(most.moves[:3]):.2g} mm and "
            f"{np.degrees(np.linalg.norm(most.moves[3:])):.2g}°; the covariance is enlarged to match"
        )
    spectrum = of_covariance(C, solution.observability.rank, solution.observability.parameters)
    if errors_estimated and not orientation_stated:
        messages += _what_orientation_would_add(observed, solution, C)
    status = "weak" if weak or spectrum.sd[0] > WEAK else solution.status
    return replace(solution, covariance=C, observability=spectrum, messages=tuple(messages), status=status)


def _what_orientation_would_add(observed, solution: Solution, C) -> list[str]:
    """A robot's orientation errors, which hardly show in the residuals: what they would do to the covariance C."""
    problem = Problem(observed, replace(solution.noise, orientation_deg=ORIENTATION_DEG))
    state = solution.state
    M = problem.moments(state, weights=solution.kept)[0][0]
    more = spectrum(M[:-1, :-1], units_by_hand(problem)).covariance - solution.covariance
    before, after = (np.sqrt(np.linalg.eigvalsh(V[:3, :3])[-1]) for V in (C, C + more))
    if after < LEAST_ADDED * before:
        return []
    return [
        f"the covariance knows of no orientation errors of the robot: {ORIENTATION_DEG}° at each pose would make its "
        f"largest standard deviation {after:.2g} mm instead of {before:.2g} mm; state orientation_deg in scan.toml"
    ]


def suspects(observed, solution: Solution) -> list[Suspect]:
    """What might be wrong everywhere, each by itself, with the size that fits the residuals best."""
    noise = solution.noise
    problem = Problem(observed, noise)
    state = solution.state
    weights, whitening = solution.kept, problem.whitening(state)

    def moments(change, step):
        changed = Problem([change(o, step) for o in observed], noise)
        return changed.moments(state, weights=weights, whitening=whitening)[0][0]

    M = moments(lambda o, step: o, 0.0)
    A = np.linalg.pinv(M[:-1, :-1], hermitian=True)
    found = []
    usual = [rest for *rest, applies in SUSPECTS if any(applies(o) for o in observed)]
    groups = list(_groups(observed))
    for words, unit, change in [*usual, *groups]:
        more, less = moments(change, STEP), moments(change, -STEP)
        Jd = (more - less)[:-1, -1] / (2 * STEP)
        rd = (more - less)[-1, -1] / (4 * STEP)
        dd = (more + less - 2 * M)[-1, -1] / (2 * STEP**2)
        own = dd - Jd @ A @ Jd
        if own > ABSORBED * dd:
            size = -(rd - M[:-1, -1] @ A @ Jd) / own
            found.append(
                Suspect(words, -size * unit, size * np.sqrt(own), (A @ Jd * size)[:6], len(usual) + len(groups))
            )
    return found


def _stretch(x: float, z: float, shear: float):
    """Profiles stretched along x and z, or x moved with z."""

    def change(o, step):
        A = np.eye(2) + step * np.array([[x, 0], [shear, z]])
        return replace(o, points=o.points @ A)

    return change


def _spread(axes):
    """Positions farther from their middle, along some axes of the base (3,)."""

    def change(o, step):
        positions = o.T_flange
        if o.eye_to_hand:
            positions = -np.einsum("...pba,...pb->...pa", o.R_flange, positions)
        return _shifted(o, step * (positions - positions.mean(axis=-2, keepdims=True)) * axes)

    return change


def _shifted(o, moved):
    """Positions shifted in the base frame by (P, 3), as eye-to-hand sees it or not."""
    if o.eye_to_hand:
        moved = -np.einsum("...pab,...pb->...pa", o.R_flange, moved)
    return replace(o, T_flange=o.T_flange + moved)


def _drift(axis: int):
    """Positions that move by 1 mm along a base axis from the first to the last pose."""

    def change(o, step):
        return _shifted(o, step * np.linspace(0, 1, o.T_flange.shape[-2])[:, None] * np.eye(3)[axis])

    return change


def _groups(observed):
    """For each rotation group of two poses or more and each base axis: the group shifted by 1 mm."""
    for target in observed:
        label, group, size = np.unique(target.group, return_inverse=True, return_counts=True)
        for g in np.flatnonzero((size > 1) & (len(label) > 1)):
            for k, axis in enumerate("xyz"):
                words = f"the poses of rotation group {g + 1} were shifted along the base's {axis} by {{:.2g}} mm"
                yield words, 1, _group_shift(target, group == g, np.eye(3)[k])


def _group_shift(target, members, direction):
    """Some poses (P,) of one target shifted by 1 mm."""

    def change(o, step):
        return _shifted(o, step * members[:, None] * direction) if o is target else o

    return change


def _always(o) -> bool:
    return True


def _has_size(o) -> bool:
    return o.size is not None


SUSPECTS = (
    ("the profiles' x were too long by {:+.2g} %", 100, _stretch(1, 0, 0), _always),
    ("the profiles' z were too long by {:+.2g} %", 100, _stretch(0, 1, 0), _always),
    ("the profiles' x and z were too long by {:+.2g} %", 100, _stretch(1, 1, 0), _always),
    ("the profiles' x grew with z by {:+.2g} %", 100, _stretch(0, 0, 1), _always),
    (
        "the radius were too large by {:+.2g} %",
        100,
        lambda o, s: replace(o, size=o.size and o.size * (1 + s)),
        _has_size,
    ),
    (
        "the robot's positions were too far apart by {:+.2g} %",
        100,
        _spread(np.ones(3)),
        _always,
    ),
    *(
        (f"the robot or the target drifted along the base's {'xyz'[k]} by {{:.2g}} mm", 1, _drift(k), _always)
        for k in range(3)
    ),
    *(
        (
            f"the robot's positions along the base's {a} were too far apart by {{:+.2g}} %",
            100,
            _spread(np.eye(3)[k]),
            _always,
        )
        for k, a in enumerate("xyz")
    ),
)
