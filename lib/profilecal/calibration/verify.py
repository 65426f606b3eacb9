"""Is a sensor pose right? A scan that was not used to find it is solved by itself, and
the two answers are compared; or another answer is given.

Where that scan alone gives no answer to rely on, it is looked at near the pose in
question, to first order: only the directions that it determines are compared.

What no residual can show counts once, from the pose in question: an error of the flange
that all poses share cancels where one robot made both scans; the rest of the robot's
accuracy differs between them. Without it, of right answers on simulated arms whose
joints are off by 0.02°, 1 in 5 is doubted; with it, 1 in 40.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy import ndarray
from scipy.special import chdtrc

from profilecal.calibration.answer import DEGREES, Answer, check_another, in_mm_rad
from profilecal.calibration.calibration import Calibration, calibrate
from profilecal.calibration.observe import stated_noise
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import FALSE_ALARM
from profilecal.geometry.observability import HAND_PRECISION, Spectrum, of_covariance
from profilecal.geometry.poses import in_base, pose_error
from profilecal.joint.descent import refine
from profilecal.joint.prior import Mount, prior_from
from profilecal.joint.problem import Problem
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError

# Fewer poses say too little of the robot's errors, and all but fit any target.
FEWEST = 5
HELD = 1e-7  # of a measurement by hand: how well a pose is held


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """How far a second scan's answer is from a sensor pose, and what is expected.

    `as_expected` is the verdict, `chance` what it rests on.
    """

    delta: ndarray  # (6,) from the pose to the answer, the pose's frame, mm and rad
    expected: Spectrum  # of δ
    known: int  # directions that the pose in question is stated to be known in
    # the second scan by itself, or the other answer
    other: Calibration | Answer
    # of the target, mm, as the scan has them by the sensor pose
    lengths: dict[str, float] = field(default_factory=dict)
    rms_mm: float = np.nan  # of the points' distances from the target

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


def verify(
    found: Calibration | Answer, other: Scan | Calibration | Answer
) -> Verification:
    """Compare a sensor pose with another scan, or with the answer of one.

    What counts is `covariance_total_mm_deg`: the robot's accuracy between the poses of
    both scans is 0.3 mm and 0.03° unless the first one's noise states ``accuracy_mm``
    and ``accuracy_deg``; smaller differences are no contradiction. What both share, the
    same artefact or an error of the robot common to all poses, shows in neither.

    Parameters
    ----------
    found : Calibration or Answer
        The sensor pose in question; `read_answer` reads one from a file.
    other : Scan, Calibration or Answer
        Another scan by the same scanner on the same mount, of any target; or what was
        found from it.

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
    self_test : a check within the scans that a calibration is from.

    Examples
    --------
    >>> import profilecal as pc
    >>> found = pc.calibrate(pc.simulate("ball", seed=1)[0])
    >>> another_scanner, _ = pc.simulate("ball", seed=2)
    >>> pc.verify(found, another_scanner).as_expected
    False
    >>> pc.verify(found, pc.calibrate(another_scanner)).as_expected
    False
    """
    check_type("found", found, Calibration, Answer)
    check_type("other", other, Scan, Calibration, Answer)
    found, other = (
        one.answer if isinstance(one, Calibration) else one for one in (found, other)
    )
    is_scan = isinstance(other, Scan)
    title = (other.title or f"the {other.kind}") if is_scan else "the other answer"
    if found.mount != other.mount:
        raise ScanError(
            f"the pose and {title} disagree about the mount, which is {other.mount} in "
            f"the {'scan' if is_scan else 'other'}"
        )
    if is_scan:
        check_another(found.digests, other)
        return likelier(found, other, title)
    if found.digests and {*found.digests} & {*other.digests}:
        raise ScanError("both answers are from one scan; expected those of two")
    return compared(found, other)


def compared(found: Answer, other: Answer) -> Verification:
    """One answer with another."""
    own = other.covariance_mm_deg
    if own is None:
        own = other.covariance_total_mm_deg
    T = other.pose
    delta = pose_error(found.pose[:3, :3], found.pose[:3, 3], T[:3, :3], T[:3, 3])
    return Verification(delta, *expectation(found, in_mm_rad(own)), other)


def expectation(found: Answer, own: ndarray) -> tuple[Spectrum, int]:
    """What is expected of the difference from an answer whose own covariance (6, 6) is
    this, and how many directions the pose in question is stated to be known in.
    """
    total = in_mm_rad(found.covariance_total_mm_deg)
    of_pose, of_both = (
        of_covariance(covariance, rank=6, parameters=6)
        for covariance in (total, total + own)
    )
    return of_both, np.count_nonzero(of_pose.sd < 1)


def likelier(found: Answer, scan: Scan, title: str) -> Verification:
    """A pose with a scan by itself; where that is not "ok", also near the pose: a weak
    answer may be one of several.
    """
    T = found.pose
    R, p = T[:3, :3], T[:3, 3]
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
        delta = pose_error(R, p, solution.rotation, solution.translation)
        answers.append((delta, solution.covariance))
    if alone.status != "ok":
        answers.append(linearised(alone, kept, T, found.noise_mm))
    by_pose = target_by(T, alone, kept)
    verifications = [
        Verification(delta, *expectation(found, own), alone, *by_pose)
        for delta, own in answers
    ]
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
    order where the targets fit best, and its covariance (6, 6), enormous where the scan
    says nothing.

    The robot's errors, which the scan hardly tells, are as usual at least.
    """
    if alone.solution_or_none:
        prior, known = alone.solution.prior, alone.solution.noise
        noise_mm = max(alone.solution.noise_mm, noise_mm)
    else:
        prior = prior_from(stated_noise(alone.scans))
        known = prior.scales
    noise = replace(known, profile_mm=noise_mm)
    R, p = T[None, :3, :3], T[None, :3, 3]
    held = Mount(R[0], p[0], HELD * HAND_PRECISION)
    fixed = Problem(alone.observed, noise, prior.systematic, mount=held)
    state = refine(fixed, fixed.place(R, p), weights=kept).state
    state = replace(state, rotation=R, translation=p)
    problem = Problem(alone.observed, noise, prior.systematic)
    names = prior.names(problem.groups.distinguishable)
    sizes = [1.0]
    for name in names:
        sizes.append(max(getattr(known, name), getattr(prior.scales, name)))
    model = problem.model(state, names).keeping(np.concatenate(kept))
    posterior = model.posterior(np.array([sizes]) ** 2)
    return posterior.mean[0, :6], posterior.covariance[0, :6, :6]


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
