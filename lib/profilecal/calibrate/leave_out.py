"""Cross-validation: each flange orientation left out in turn, and predicted from the others."""

from dataclasses import dataclass

import numpy as np

from profilecal.calibrate.calibration import Calibration
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.joint.error_sizes import draw, likeliest, normalised
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.observability import of_covariance
from profilecal.joint.solution import Solution


@dataclass(frozen=True)
class LeftOut:
    """What the other orientations say of each one. An orientation that the answer cannot do without has NaN."""

    poses: tuple[tuple[str, ...], ...]  # (G,) labels of each orientation's poses
    rms_mm: np.ndarray  # (G,) of its residuals from the calibration without it
    expected_mm: np.ndarray  # (G,) of it, from the noise and from how well the others determine the answer
    doubted: np.ndarray  # (G,) farther off than expected, and beyond chance
    moved: np.ndarray  # (G, 6) of the sensor pose, its frame, mm and rad

    def messages(self) -> list[str]:
        """Sentences a person can act on."""
        kept = np.flatnonzero(np.isfinite(self.rms_mm))
        lines = []
        if len(kept):
            total, expected = (np.sqrt(np.mean(v[kept] ** 2)) for v in (self.rms_mm, self.expected_mm))
            shift, turn = (np.linalg.norm(self.moved[kept, part], axis=1) for part in (slice(3), slice(3, 6)))
            farthest, most = (name(self.poses[kept[np.argmax(size)]]) for size in (shift, turn))
            lines.append(
                f"{len(kept)} orientations left out one at a time: the others predict them to {total:.2g} mm rms, "
                f"{expected:.2g} expected; the sensor moves by up to {shift.max():.2g} mm (without {farthest}) and "
                f"turns by up to {np.degrees(turn.max()):.2g}° (without {most})"
            )
        for g in np.flatnonzero(self.doubted):
            lines.append(
                f"{name(self.poses[g])} does not fit the other orientations: {self.rms_mm[g]:.2g} mm rms where "
                f"{self.expected_mm[g]:.2g} is expected; measure it again or look for what moved"
            )
        for g in np.flatnonzero(~np.isfinite(self.rms_mm)):
            lines.append(f"without {name(self.poses[g])} the answer is not determined; add orientations like it")
        return lines


def name(poses) -> str:
    """Poses in a few words."""
    return f"pose {poses[0]}" if len(poses) == 1 else f"poses {poses[0]} to {poses[-1].rsplit(': ')[-1]}"


def leave_out(found: Calibration) -> LeftOut:
    """Calibrations without one orientation each, with errors of the size that the others show, to first order at the
    solution. An orientation that does not fit can then not excuse itself.

    Rejected poses stay out. Raises ValueError for a calibration without an answer.
    """
    if found.status == "unobservable":
        raise ValueError("only a calibration that has an answer can be cross-validated")
    solution = found.solution
    problem, whole = solution.problem, solution.model()[0]
    labels = [label for part in found.labels_by_scan() for label in part]
    members, first = [], 0
    for term in problem.terms:
        there = whole.kept[first : first + term.P]
        members += [first + np.flatnonzero((term.group == g) & there) for g in range(term.group.max() + 1)]
        first += term.P
    members = [profiles for profiles in members if len(profiles)]
    rows = [without(solution, whole, profiles, FALSE_ALARM / len(members)) for profiles in members]
    rms, expected, doubted, moved = (np.array(column) for column in zip(*rows, strict=True))
    return LeftOut(tuple(tuple(labels[k] for k in some) for some in members), rms, expected, doubted, moved)


def without(solution: Solution, whole: LinearModel, profiles, chance: float) -> tuple[float, float, bool, np.ndarray]:
    """What the others say of some profiles (k,): rms in mm, the same as expected, whether they are doubted, and by how
    much the sensor moves (6,)."""
    problem, names = solution.problem, whole.names
    kept = whole.kept.copy()
    kept[profiles] = False
    model, v = whole.keeping(kept), solution.level.found.v
    prior, unit = solution.level.prior, problem.noise.profile_mm
    if not prior.robot_known and whole.counts[kept].sum() > problem.n:
        law = prior.law(names, unit)
        drawn = draw(model, law, *likeliest(model, law, np.zeros(len(law.free))))
        v = normalised(drawn.log_weight) @ drawn.v
    found = model.posterior(v[None])
    if str(of_covariance(found.covariance[0, :6, :6], problem.n, problem.n).status) == "unobservable":
        return np.nan, np.nan, False, np.full(6, np.nan)

    stretch = max(1.0, solution.chi2_per_dof) if prior.robot_known else 1.0  # larger than the noise explains
    error, S = model.predicted(found, profiles)
    S, x = stretch * S, np.append(found.mean[0], 1.0)
    rest = x @ whole.rest[profiles].sum(axis=0) @ x
    count, ranks = whole.counts[profiles].sum(), whole.ranks[profiles].sum()
    square, expected = error @ error + rest, np.trace(S) + (count - len(S)) * stretch * v[0]
    excess = np.sqrt(square / expected)
    in_mm = problem.rms_mm(solution.state, found.mean[0], np.isin(np.arange(len(kept)), profiles))
    beyond_chance = error @ np.linalg.solve(S, error) > chi2_limit(chance, ranks)
    return in_mm, in_mm / excess, beyond_chance and excess > 1, found.mean[0, :6]
