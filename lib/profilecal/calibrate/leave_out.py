"""Cross-validation: each flange orientation left out in turn, and predicted from the others."""

from dataclasses import asdict, dataclass

import numpy as np
from tqdm import tqdm

from profilecal.calibrate.calibration import Calibration
from profilecal.geometry.noise import FALSE_ALARM, Noise, chi2_limit
from profilecal.joint.descent import Fit, refine
from profilecal.joint.levels import Likelihood, draw, likeliest
from profilecal.joint.observability import spectrum
from profilecal.joint.problem import Problem, by_pose
from profilecal.joint.sharing import level_variances, sharing
from profilecal.joint.solution import Solution
from profilecal.joint.solve import SHARED
from profilecal.joint.state import pose_error


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
    """Calibrations without one orientation each, at the noise that all of them show.

    Rejected poses stay out. Raises ValueError for a calibration without an answer.
    """
    solution = found.solution
    if found.status == "unobservable":
        raise ValueError("only a calibration that has an answer can be cross-validated")
    problem, state = Problem(found.observed, solution.noise, solution.level.systematic), solution.state
    kept, units = solution.kept, problem.units
    stretch = 1.0 if solution.level.levels else max(1.0, solution.chi2_per_dof)  # larger than the noise explains
    groups = [
        (index, np.flatnonzero((term.group == g) & used))
        for index, (term, used) in enumerate(zip(problem.terms, kept, strict=True))
        for g in range(term.group.max() + 1)
    ]
    groups = [(index, rows) for index, rows in groups if len(rows)]
    labels, rows_out = found.labels_by_scan(), []
    for index, rows in tqdm(groups, desc="leaving out", unit="orientation", disable=None, leave=False, delay=1):
        weights = [used.copy() for used in kept]
        weights[index][rows] = False
        problem = problem.with_noise(noise_without(problem, solution, weights))
        fit = refine(problem, state, weights=weights)
        if str(spectrum(fit.information[0], units).status) == "unobservable":
            rows_out.append((np.nan, np.nan, False, np.full(6, np.nan)))
            continue
        r, S, rms = prediction(problem, fit, weights, index, rows)
        S = stretch * S
        square, excess = r @ np.linalg.solve(S, r), np.sqrt(r @ r / np.trace(S))
        moved = pose_error(state.rotation, state.translation, fit.state.rotation, fit.state.translation)[0]
        beyond_chance = square > chi2_limit(FALSE_ALARM / len(groups), len(r))
        rows_out.append((rms, rms / excess, beyond_chance and excess > 1, moved))
    rms, expected, doubted, moved = (np.array(column) for column in zip(*rows_out, strict=True))
    names = tuple(tuple(labels[index][k] for k in rows) for index, rows in groups)
    return LeftOut(names, rms, expected, doubted, moved)


def noise_without(problem: Problem, solution: Solution, kept) -> Noise:
    """The noise that the poses kept (P,) show, so that one which does not fit cannot excuse itself; as stated, where it
    is not estimated."""
    level = solution.level
    if level.prior is None or sum(map(np.sum, kept)) * SHARED <= problem.n:
        return solution.noise
    model = Likelihood(problem, solution.state, kept, level.prior)
    drawn = draw(model, likeliest(model, asdict(solution.noise)))
    return model.noise_of({name: float(np.sqrt(drawn.weight @ size**2)) for name, size in drawn.sizes.items()})


def prediction(problem: Problem, fit: Fit, kept, index: int, rows) -> tuple[np.ndarray, np.ndarray, float]:
    """Residuals (k,) of some poses of one target at a fit to those kept (P,), less the systematic errors that these
    suggest, independent and over the noise; their covariance (k, k) from noise, robot errors and the uncertainty of the
    fit; and their root mean square in mm."""
    effects, n = problem.effects_at(fit.state), problem.n
    linears = problem.linear(fit.state)
    known = problem.with_systematic(effects, linears, kept)
    covariance = np.linalg.inv(known[:-1, :-1])
    suggested = -(covariance @ known[:-1, -1])[n:]

    linear = linears[index]
    there = np.ones(linear.residual.shape[1:], dtype=bool) if linear.present is None else linear.present[0]
    there = there[:, rows].T
    z, by_effect = by_pose(linear.columns)[0, rows][there], effects.rows[index][0, rows][there]
    J = np.zeros((len(z), len(covariance)))
    J[:, problem.columns(index)[:-1]], J[:, n:] = z[:, :-1], by_effect[:, 6:]
    E, visit = by_effect[:, :6], np.nonzero(there)[0]
    pose = sharing([problem.observations[index].keep(rows)]).pose[visit]
    at_visit, at_pose, at_orientation = (E * variances @ E.T for variances in level_variances(problem.noise))
    robot = np.equal.outer(visit, visit) * at_visit + np.equal.outer(pose, pose) * at_pose + at_orientation
    left = problem.without_systematic(fit.state, kept).residuals(fit.state)[index][0][:, rows].T[there]
    residual = z[:, -1] + J[:, n:] @ suggested
    return residual, np.eye(len(z)) + robot + J @ covariance @ J.T, float(np.sqrt(np.mean(left**2)))
