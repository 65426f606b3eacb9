"""Is a sensor pose right? Each flange orientation is left out in turn and predicted
from the others (`leave_out`). Or a scan that was not used to find it is solved by
itself, and the two answers are compared (`verify`).

Where that scan alone gives no answer to rely on, it is looked at near the pose in
question, to first order: only the directions that it determines are compared.

What no residual can show counts once, from the pose in question: an error of the flange
that all poses share cancels where one robot made both scans; the rest of the robot's
accuracy differs between them. Without it, of right answers on simulated arms whose
joints are off by 0.02°, 1 in 5 is doubted; with it, 1 in 40.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import chdtrc

from profilecal.calibration.calibration import Calibration, calibrate
from profilecal.calibration.observe import stated_noise
from profilecal.geometry.checks import check_array, check_rotations
from profilecal.geometry.noise import FALSE_ALARM, chi2_limit, normalised_square
from profilecal.geometry.observability import (
    HAND_PRECISION,
    Spectrum,
    of_covariance,
)
from profilecal.geometry.poses import carry, pose_error
from profilecal.joint.error_sizes import likeliest
from profilecal.joint.prior import Law, prior_from
from profilecal.joint.problem import Problem
from profilecal.joint.solve import squares
from profilecal.scan.scan import Scan, ScanError
from profilecal.targets.observations import State


@dataclass(frozen=True)
class Verification:
    """How far the answer of a second scan is from a sensor pose, and what is to be
    expected.
    """

    delta: np.ndarray  # (6,) from the pose to the answer, the pose's frame, mm and rad
    expected: Spectrum  # of δ
    alone: Calibration  # the second scan by itself
    # of the target, mm, as the scan has them by the sensor pose
    lengths: dict[str, float]
    rms_mm: float  # of the points' distances from the target

    @property
    def apart(self) -> np.ndarray:
        """(k,) standard deviations of δ in the directions that the scans determine: the
        last k of `expected`.
        """
        found = self.expected
        return ((found.directions @ (self.delta / HAND_PRECISION)) / found.sd)[
            found.sd < 1
        ]

    @property
    def chance(self) -> float:
        """That more is found where nothing is wrong; 0 for a pose that the scan makes
        no sense of.
        """
        return float(np.nan_to_num(chdtrc(len(self.apart), np.sum(self.apart**2))))

    @property
    def as_expected(self) -> bool:
        """Whether the stated uncertainties explain the difference."""
        return self.chance > FALSE_ALARM


def read_pose(path) -> tuple[np.ndarray, np.ndarray, float, bool]:
    """From what `profilecal calibrate --json` printed: T (4, 4) mm, covariance (6, 6)
    of δ in mm and rad, the total where it is stated, noise in mm, and whether it is
    eye-to-hand. Raises ScanError.
    """
    try:
        found = json.loads(Path(path).read_bytes())
        to_hand = "T_base_sensor" in found
        T = np.asarray(
            list(found["T_base_sensor" if to_hand else "T_flange_sensor"]), dtype=float
        )  # null has no list
        units = np.repeat([1, np.pi / 180], 3)
        # old files have no total
        stated = found.get("covariance_total", found["covariance"])
        covariance = np.asarray(stated, dtype=float) * units[:, None] * units
        noise = float(found["noise_mm"])
    except OSError as error:
        raise ScanError(f"{path}: {error.strerror}") from error
    except (ValueError, TypeError, KeyError) as error:
        raise ScanError(
            f"{path}: not what `profilecal calibrate --json` prints where it finds a sensor pose, a JSON object with "
            "that, its covariance and noise_mm; write one from another scan: profilecal calibrate SCAN --json > T.json"
        ) from error
    try:
        check_array("the sensor pose", T, (4, 4))
        check_rotations("the sensor pose", T[None, :3, :3], 1)
        check_array("its covariance", covariance, (6, 6))
        check_array("noise_mm", [noise], (1,))
    except ValueError as error:
        raise ScanError(f"{path}: {str(error).replace('[0]', '')}") from error
    if np.abs(T[3] - [0, 0, 0, 1]).max() > 0:
        raise ScanError(
            f"{path}: the last row of the sensor pose is {T[3].tolist()}; expected [0, 0, 0, 1]"
        )
    values = np.linalg.eigvalsh(covariance)
    if (
        not np.allclose(covariance, covariance.T)
        or values[0] < -1e-9 * values[-1]
        or values[-1] <= 0
    ):
        raise ScanError(
            f"{path}: holds no covariance; expected a symmetric, positive 6x6 matrix"
        )
    return T, covariance, noise, to_hand


def verify(scan: Scan, T, covariance, noise_mm: float) -> Verification:
    """Compare a sensor pose T (4, 4), mm, with what a scan says that was not used to
    find it. `covariance` (6, 6): the pose's, mm and rad, with what no residual can
    show. `noise_mm`: the scanner's, where the scan is too short to tell it. Raises
    ScanError for a scan that determines nothing, and for the one that T is from.
    """
    same = 1e-3  # standard deviations: no other scan's answer comes so close by chance
    alone = calibrate([scan], guess=T)
    s, said, title = alone.solution, [], scan.title or f"the {scan.kind}"
    kept = s.kept if s else [np.ones(len(alone.seen[0]), dtype=bool)]
    if alone.status != "unobservable":
        delta = pose_error(T[:3, :3], T[:3, 3], s.rotation, s.translation)
        if normalised_square(s.covariance, delta) < same**2:
            raise ScanError(
                f"{title}: the pose was found from this very scan; expected another"
            )
        said.append((delta, s.covariance))
    if alone.status != "ok":  # a weak answer may be one of several
        said.append(linearised(alone, kept, T, noise_mm))
    both = [
        (delta, of_covariance(covariance + own, rank=6, parameters=6))
        for delta, own in said
    ]
    found = max(
        (Verification(*pair, alone, *target_by(T, alone, kept)) for pair in both),
        key=lambda v: v.chance,
    )
    if not len(found.apart):
        raise ScanError(
            f"{title}: determines no direction of the sensor's pose; expected poses that differ"
        )
    return found


def linearised(
    alone: Calibration, kept, T, noise_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """δ (6,), mm and rad, from a sensor pose T (4, 4) to what a scan says, to first
    order, and its covariance (6, 6), enormous where the scan says nothing. The robot's
    errors, which it hardly tells, are as usual at least.
    """
    s = alone.solution
    prior = s.prior if s else prior_from(stated_noise(alone.scans))
    known = s.noise if s else prior.scales
    noise = replace(known, profile_mm=max(s.noise_mm if s else 0, noise_mm))
    problem = Problem(alone.observed, noise, prior.systematic)
    state = settle_targets(problem, T[None, :3, :3], T[None, :3, 3], kept)
    names = prior.names(problem.groups.distinguishable)
    sizes = [
        1.0,
        *(max(getattr(known, name), getattr(prior.scales, name)) for name in names),
    ]
    found = (
        problem.model(state, names)
        .keeping(np.concatenate(kept))
        .posterior(np.array([sizes]) ** 2)
    )
    return found.mean[0, :6], found.covariance[0, :6, :6]


def settle_targets(problem: Problem, rotation, translation, weights=None) -> State:
    """The sensor pose (1, 3, 3), (1, 3) with the targets where it sees them best:
    Gauss-Newton steps of those alone.
    """
    state, step = problem.place(rotation, translation), np.zeros((1, problem.n))
    for _ in range(20):
        normal = problem.moments(state, weights=weights).normal[0, 6:, 6:]
        step[0, 6:] = -np.linalg.solve(
            normal[:-1, :-1] + np.diag(problem.units[6:] ** -2), normal[:-1, -1]
        )
        state = problem.move(state, step)
        if np.abs(step).max() < 1e-9:
            break
    return state


def target_by(T, alone: Calibration, kept) -> tuple[dict[str, float], float]:
    """The target's lengths, mm, and the points' rms distance from it, where a sensor
    pose T (4, 4) takes the points.
    """
    (scan,), (seen,) = alone.scans, alone.observed
    there = np.isfinite(seen.points[0]).all(axis=-1) & kept[0][:, None]
    pose, _ = np.nonzero(there)
    in_flange = seen.points[0][there] @ T[:3, [0, 2]].T + T[:3, 3]
    in_base = carry(seen.R_flange[0, pose], seen.T_flange[0, pose], in_flange)
    origin, axes, sizes = scan.target.fit(in_base)
    distance = scan.target.at(origin, axes, sizes).distance(in_base)
    lengths = dict(zip(scan.measures, map(float, sizes), strict=True)) if sizes else {}
    return lengths, float(np.sqrt(np.mean(distance**2)))


@dataclass(frozen=True)
class LeftOut:
    """What the other orientations say of each one. An orientation that the answer
    cannot do without has NaN.
    """

    poses: tuple[tuple[str, ...], ...]  # (G,) labels of each orientation's poses
    rms_mm: np.ndarray  # (G,) of its residuals from the calibration without it
    # (G,) of it, from the noise and from how well the others determine the answer
    expected_mm: np.ndarray
    doubted: np.ndarray  # (G,) farther off than expected, and beyond chance
    moved: np.ndarray  # (G, 6) of the sensor pose, its frame, mm and rad

    def messages(self) -> list[str]:
        """Sentences a person can act on."""
        kept = np.flatnonzero(np.isfinite(self.rms_mm))
        lines = []
        if len(kept):
            total, expected = (
                np.sqrt(np.mean(v[kept] ** 2)) for v in (self.rms_mm, self.expected_mm)
            )
            shift, turn = (
                np.linalg.norm(self.moved[kept, part], axis=1)
                for part in (slice(3), slice(3, 6))
            )
            farthest, most = (
                name(self.poses[kept[np.argmax(size)]]) for size in (shift, turn)
            )
            lines.append(
                f"{len(kept)} orientations left out one at a time: the others predict them to {total:.2g} mm rms, "
                f"{expected:.2g} expected; the sensor moves by up to {shift.max():.2g} mm (without {farthest}) and "
                f"turns by up to {np.degrees(turn.max()):.2g}° (without {most})"
            )
        for g in np.flatnonzero(self.doubted):
            found = f"{self.rms_mm[g]:.2g} mm rms where {self.expected_mm[g]:.2g} is expected"
            what = f"what {name(self.poses[g])} saw does not fit the other orientations"
            lines.append(f"{what}: {found}; measure it again or look for what moved")
        for g in np.flatnonzero(~np.isfinite(self.rms_mm)):
            lines.append(
                f"without {name(self.poses[g])} the answer is not determined; add orientations like it"
            )
        return lines


def name(poses) -> str:
    """Poses in a few words."""
    return (
        f"pose {poses[0]}"
        if len(poses) == 1
        else f"poses {poses[0]} to {poses[-1].rsplit(': ')[-1]}"
    )


def leave_out(found: Calibration) -> LeftOut:
    """Calibrations without one orientation each, to first order at the solution, with
    errors of the size that the others show: none can excuse itself. Rejected poses stay
    out. Raises ValueError for one without an answer.
    """
    if found.status == "unobservable":
        raise ValueError("only a calibration that has an answer can be cross-validated")
    solution, problem, (whole, _) = (
        found.solution,
        found.solution.problem,
        found.solution.model(),
    )
    law = solution.prior.law(whole.names)
    columns, start = (
        problem.columns_in_mm(solution.state),
        likeliest(whole, law, np.zeros(len(law.free)))[0],
    )
    labels = [label for part in found.labels_by_scan() for label in part]
    group = problem.groups.group
    members = [
        np.flatnonzero((group == g) & whole.kept) for g in np.unique(group[whole.kept])
    ]
    rows, chance = [], FALSE_ALARM / whole.kept.sum()
    for profiles in members:
        chosen = np.isin(np.arange(len(labels)), profiles)
        others = whole.keeping(whole.kept & ~chosen)
        left = others.posterior(
            mean_variances(law, *likeliest(others, law, start))[None]
        )
        if (
            str(of_covariance(left.covariance[0, :6, :6], problem.n, problem.n).status)
            == "unobservable"
        ):
            rows.append((np.nan, np.nan, False, np.full(6, np.nan)))
            continue
        error, S = others.left_out(left)
        x = np.append(left.mean[0], 1.0)
        square = np.sum(error[profiles] ** 2) + x @ whole.rest[profiles].sum(axis=0) @ x
        # residuals that no error of the flange moves
        beside = whole.counts[profiles].sum() - error[profiles].size
        variance = np.trace(S[profiles], axis1=1, axis2=2).sum() + beside * left.v[0, 0]
        excess = float(np.sqrt(square / variance))
        rms = problem.rms_mm(columns, left.mean[0], chosen)
        off = squares(whole, error, S, x, left.v[0])[0] > chi2_limit(
            chance, np.maximum(whole.ranks, 1)
        )
        rows.append(
            (rms, rms / excess, off[profiles].any() and excess > 1, left.mean[0, :6])
        )
    rms, expected, doubted, moved = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    return LeftOut(
        tuple(tuple(labels[k] for k in some) for some in members),
        rms,
        expected,
        doubted,
        moved,
    )


def mean_variances(law: Law, likely, root) -> np.ndarray:
    """The mean (1 + k,) of variances over coordinates with that middle (d,) and a root
    (d, d) of their covariance, by points on the axes (cubature).
    """
    if not len(likely):
        return law.scales**2
    axes = np.sqrt(len(likely)) * root.T
    return law.variances(np.concatenate([likely + axes, likely - axes]))[0].mean(axis=0)
