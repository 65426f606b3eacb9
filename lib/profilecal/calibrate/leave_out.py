"""Cross-validation: each flange orientation left out in turn, and predicted from the others."""

from dataclasses import dataclass

import numpy as np

from profilecal.calibrate.calibration import Calibration
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit
from profilecal.joint.error_sizes import likeliest
from profilecal.joint.linear_model import LinearModel, Posterior
from profilecal.joint.observability import of_covariance
from profilecal.joint.prior import Law


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
    problem, (whole, _) = solution.problem, solution.model()
    law = solution.prior.law(whole.names, problem.noise.profile_mm)
    columns, start = problem.columns_in_mm(solution.state), likeliest(whole, law, np.zeros(len(law.free)))[0]
    labels = [label for part in found.labels_by_scan() for label in part]
    members = [
        profiles[(term.group == g) & whole.kept[profiles]]
        for profiles, term in zip(problem.split(np.arange(len(labels))), problem.terms, strict=True)
        for g in range(term.group.max() + 1)
    ]
    members = [profiles for profiles in members if len(profiles)]
    rows = []
    for profiles in members:
        chosen = np.isin(np.arange(len(labels)), profiles)
        others = whole.keeping(whole.kept & ~chosen)
        left = others.posterior(mean_variances(law, *likeliest(others, law, start))[None])
        if str(of_covariance(left.covariance[0, :6, :6], problem.n, problem.n).status) == "unobservable":
            rows.append((np.nan, np.nan, False, np.full(6, np.nan)))
            continue
        error, S, excess = predicted(others, left, profiles)
        rms = problem.rms_mm(solution.state, left.mean[0], chosen, columns)
        beyond_chance = error @ np.linalg.solve(S, error) > chi2_limit(
            FALSE_ALARM / len(members), whole.ranks[profiles].sum()
        )
        rows.append((rms, rms / excess, beyond_chance and excess > 1, left.mean[0, :6]))
    rms, expected, doubted, moved = (np.array(column) for column in zip(*rows, strict=True))
    return LeftOut(tuple(tuple(labels[k] for k in some) for some in members), rms, expected, doubted, moved)


def mean_variances(law: Law, likely, root) -> np.ndarray:
    """The mean (1 + k,) of variances over coordinates with that middle (d,) and a root (d, d) of their covariance, by
    points on the axes (cubature)."""
    axes = np.sqrt(max(len(likely), 1)) * root.T
    return (
        law.variances(np.concatenate([likely + axes, likely - axes]))[0].mean(axis=0) if len(likely) else law.scales**2
    )


def predicted(model: LinearModel, found: Posterior, profiles) -> tuple[np.ndarray, np.ndarray, float]:
    """How far profiles (k,) are from what those kept say of them (`LinearModel.predicted`), and how many times as large
    their residuals are as they are to be expected."""
    error, S = model.predicted(found, profiles)
    x = np.append(found.mean[0], 1.0)
    square = error @ error + x @ model.rest[profiles].sum(axis=0) @ x
    expected = np.trace(S) + (model.counts[profiles].sum() - len(S)) * found.v[0, 0]
    return error, S, float(np.sqrt(square / expected))
