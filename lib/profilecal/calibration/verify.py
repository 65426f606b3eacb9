"""Is a sensor pose right? A scan that was not used to find it is solved by itself, and
the two answers are compared.

Where that scan alone gives no answer to rely on, it is looked at near the pose in
question, to first order: only the directions that it determines are compared.

What no residual can show counts once, from the pose in question: an error of the flange
that all poses share cancels where one robot made both scans; the rest of the robot's
accuracy differs between them. Without it, of right answers on simulated arms whose
joints are off by 0.02°, 1 in 5 is doubted; with it, 1 in 40.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from scipy.special import chdtrc

from profilecal.calibration.answer import DEGREES, Answer, in_mm_rad
from profilecal.calibration.calibration import Calibration, calibrate
from profilecal.calibration.observe import stated_noise
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import FALSE_ALARM, normalised_square
from profilecal.geometry.observability import HAND_PRECISION, Spectrum, of_covariance
from profilecal.geometry.poses import in_base, pose_error
from profilecal.joint.prior import prior_from
from profilecal.joint.problem import Problem
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError
from profilecal.targets.observations import State

# standard deviations: the answer of another scan comes as close by a chance of 2e-13;
# poses that are rounded to 0.001 mm move that of the same scan by less
SAME_SCAN = 0.02
# Fewer poses say too little of the robot's errors, and all but fit any target.
FEWEST = 5


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """How far a second scan's answer is from a sensor pose, and what is expected.

    `as_expected` is the verdict, `chance` what it rests on.
    """

    delta: ndarray  # (6,) from the pose to the answer, the pose's frame, mm and rad
    expected: Spectrum  # of δ
    alone: Calibration  # the second scan by itself
    # of the target, mm, as the scan has them by the sensor pose
    lengths: dict[str, float]
    rms_mm: float  # of the points' distances from the target
    known: int  # directions that the pose in question is stated to be known in

    @property
    def difference_mm_deg(self) -> ndarray:
        """(6,) from the pose to the answer, a shift and a turn in the pose's frame."""
        return self.delta * DEGREES

    @property
    def apart(self) -> ndarray:
        """(k,) standard deviations of δ in the directions that the scans determine: the
        last k of `expected`.
        """
        along = self.expected.directions @ (self.delta / HAND_PRECISION)
        return (along / self.expected.sd)[self.expected.sd < 1]

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

    @property
    def is_conclusive(self) -> bool:
        """Whether the scan tells all directions in which the pose is stated to be
        known.
        """
        return len(self.apart) >= self.known

    def __repr__(self) -> str:
        difference = np.array2string(self.difference_mm_deg, precision=3)
        return (
            f"Verification(as_expected={self.as_expected}, chance={self.chance:.2g}, "
            f"in {len(self.apart)} of 6 directions,\n"
            f"difference_mm_deg={difference})"
        )


def verify(found: Calibration | Answer, scan: Scan) -> Verification:
    """Compare a sensor pose with what a scan says that was not used to find it.

    What counts is `covariance_total_mm_deg`: the robot's accuracy between the poses of
    both scans is 0.3 mm and 0.03° unless the first one's noise states ``accuracy_mm``
    and ``accuracy_deg``; smaller differences are no contradiction.

    Parameters
    ----------
    found : Calibration or Answer
        The sensor pose in question; `read_answer` reads one from a file.
    scan : Scan
        Another scan by the same scanner on the same mount, of any target.

    Returns
    -------
    Verification
        `as_expected` says whether the stated uncertainties explain the difference,
        `is_conclusive` whether the scan could have shown it in every direction.

    Raises
    ------
    ScanError
        For a scan of fewer than 5 poses, that determines nothing, that has another
        mount, or that the pose is from.
    UnobservableError
        For a calibration that leaves the pose open.
    TypeError
        For arguments of another kind, or in the other order.

    See Also
    --------
    read_answer : a sensor pose from a file.
    leave_out : a check within the scans that a calibration is from.

    Examples
    --------
    >>> import profilecal as pc
    >>> found = pc.calibrate(pc.simulate("ball", seed=1)[0])
    >>> another_scanner, _ = pc.simulate("ball", seed=2)
    >>> pc.verify(found, another_scanner).as_expected
    False
    """
    check_type("found", found, Calibration, Answer)
    check_type("scan", scan, Scan)
    title = scan.title or f"the {scan.kind}"
    if found.mount != scan.mount:
        raise ScanError(
            f"the pose and {title} disagree about the mount, "
            f"which is {scan.mount} in the scan"
        )
    T = found.pose
    covariance = in_mm_rad(found.covariance_total_mm_deg)
    alone = calibrate(scan, guess=T, guess_sd=(np.inf, np.inf))  # a start
    shown = len(alone.seen[0])
    if shown < FEWEST:
        raise ScanError(
            f"{title}: shows the target from {shown} poses; expected {FEWEST} or more, "
            "or check-mount, which does with fewer if the target stands as it did"
        )
    kept = [np.ones(shown, dtype=bool)]
    if alone.solution_or_none:
        kept = alone.solution.kept
    answers = []
    if alone.is_known:
        solution = alone.solution
        delta = pose_error(T[:3, :3], T[:3, 3], solution.rotation, solution.translation)
        if normalised_square(solution.covariance, delta) < SAME_SCAN**2:
            raise ScanError(
                f"{title}: the pose was found from this very scan; expected another"
            )
        answers.append((delta, solution.covariance))
    if alone.status != "ok":  # a weak answer may be one of several
        answers.append(linearised(alone, kept, T, found.noise_mm))
    lengths, rms_mm = target_by(T, alone, kept)
    of_pose = of_covariance(covariance, rank=6, parameters=6)
    known = int((of_pose.sd < 1).sum())
    verifications = []
    for delta, own in answers:
        expected = of_covariance(covariance + own, rank=6, parameters=6)
        verifications.append(
            Verification(delta, expected, alone, lengths, rms_mm, known)
        )
    likeliest = max(verifications, key=lambda one: one.chance)
    if not len(likeliest.apart):
        raise ScanError(
            f"{title}: determines no direction of the sensor's pose; "
            "expected poses that differ"
        )
    return likeliest


def linearised(
    alone: Calibration, kept: Sequence[ndarray], T: ndarray, noise_mm: float
) -> tuple[ndarray, ndarray]:
    """δ (6,), mm and rad, from a sensor pose T (4, 4) to what a scan says, to first
    order, and its covariance (6, 6), enormous where the scan says nothing.

    The robot's errors, which the scan hardly tells, are as usual at least.
    """
    if alone.solution_or_none:
        prior, known = alone.solution.prior, alone.solution.noise
        noise_mm = max(alone.solution.noise_mm, noise_mm)
    else:
        prior = prior_from(stated_noise(alone.scans))
        known = prior.scales
    noise = replace(known, profile_mm=noise_mm)
    problem = Problem(alone.observed, noise, prior.systematic)
    state = settle_targets(problem, T[None, :3, :3], T[None, :3, 3], kept)
    names = prior.names(problem.groups.distinguishable)
    sizes = [1.0]
    for name in names:
        sizes.append(max(getattr(known, name), getattr(prior.scales, name)))
    model = problem.model(state, names).keeping(np.concatenate(kept))
    posterior = model.posterior(np.array([sizes]) ** 2)
    return posterior.mean[0, :6], posterior.covariance[0, :6, :6]


def settle_targets(
    problem: Problem,
    rotation: ndarray,
    translation: ndarray,
    weights: Sequence[ndarray] | None = None,
) -> State:
    """The sensor pose (1, 3, 3), (1, 3) with the targets where it sees them best:
    Gauss-Newton steps of those alone.
    """
    state = problem.place(rotation, translation)
    step = np.zeros((1, problem.n))
    by_hand = np.diag(problem.units[6:] ** -2)
    for _ in range(20):
        normal = problem.moments(state, weights=weights).normal[0, 6:, 6:]
        H, g = normal[:-1, :-1], normal[:-1, -1]
        step[0, 6:] = -np.linalg.solve(H + by_hand, g)
        state = problem.move(state, step)
        if np.abs(step).max() < 1e-9:
            break
    return state


def target_by(
    T: ndarray, alone: Calibration, kept: Sequence[ndarray]
) -> tuple[dict[str, float], float]:
    """The target's lengths, mm, and the points' rms distance from it, where a sensor
    pose T (4, 4) takes the points.
    """
    (scan,), (observed,) = alone.scans, alone.observed
    used = observed.keep(kept[0])
    points, _ = in_base(T, used.points[0], used.R_flange[0], used.T_flange[0])
    origin, axes, sizes = scan.target.fit(points)
    distance = scan.target.at(origin, axes, sizes).distance(points)
    lengths = dict(zip(scan.measures, map(float, sizes), strict=True)) if sizes else {}
    return lengths, float(np.sqrt(np.mean(distance**2)))
