"""Is a sensor pose right? A scan that was not used to find it is solved by itself, and
the two answers are compared; or another answer is given.

Where that scan alone gives no answer to rely on, it is looked at near the pose in
question, to first order: only the directions that it determines are compared.

What no residual can show counts once, from the pose in question: an error of the flange
that all poses share cancels where one robot made both scans; the rest of the robot's
accuracy differs between them.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy import ndarray
from scipy.special import chdtrc

from profilecal.calibration.answer import DEGREES, Answer, check_another, in_mm_rad
from profilecal.calibration.calibrate import calibrate
from profilecal.calibration.calibration import Calibration
from profilecal.calibration.several_scans import stated_noise
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import FALSE_ALARM
from profilecal.geometry.observability import HAND_PRECISION, Spectrum, of_covariance
from profilecal.geometry.poses import in_base, pose_error
from profilecal.joint.prior import prior_from
from profilecal.joint.problem import Problem
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError
from profilecal.targets.observations import Observations

# Fewer poses say too little of the robot's errors, and all but fit any target.
FEWEST_POSES = 5


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """How far a second scan's answer is from a sensor pose, and what is expected.

    `as_expected` is the verdict, `chance` what it rests on.
    """

    delta: ndarray  # (6,) from the pose to the answer, the pose's frame, mm and rad
    # (6, 6) covariances in mm and rad: of the pose in question, as it is stated, and of
    # the answer alone
    stated: ndarray
    own: ndarray
    # the second scan by itself, or the other answer
    other: Calibration | Answer
    # of the target, mm, as the scan has them by the sensor pose
    lengths: dict[str, float] = field(default_factory=dict)
    rms_mm: float = np.nan  # of the points' distances from the target

    @property
    def expected(self) -> Spectrum:
        """Of δ."""
        return of_covariance(self.stated + self.own)

    @property
    def difference_mm_deg(self) -> ndarray:
        """(6,) from the pose to the answer, a shift and a turn in the pose's frame."""
        return self.delta * DEGREES

    @property
    def apart(self) -> ndarray:
        """(k,) standard deviations of δ in the directions that the scans determine: the
        last k of `expected`.
        """
        expected = self.expected
        along = expected.directions @ (self.delta / HAND_PRECISION)
        return (along / expected.sd)[expected.sd < 1]

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
        known = of_covariance(self.stated).sd < 1
        return len(self.apart) >= np.count_nonzero(known)

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

    What counts is `covariance_total_mm_deg`: between the poses of both scans the robot
    errs as smoothly as the first one found it to; smaller differences are no
    contradiction. What both share, the same artefact or an error of the robot common
    to all poses, shows in neither.

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
    title = check_another(found, other)
    if isinstance(other, Answer):
        return compared(found, other)
    return with_scan_alone(found, other, title)


def compared(found: Answer, other: Answer) -> Verification:
    """One answer with another."""
    own = other.covariance_mm_deg
    if own is None:
        own = other.covariance_total_mm_deg
    T, T_other = found.pose, other.pose
    delta = pose_error(T[:3, :3], T[:3, 3], T_other[:3, :3], T_other[:3, 3])
    stated = in_mm_rad(found.covariance_total_mm_deg)
    return Verification(delta, stated, in_mm_rad(own), other)


def with_scan_alone(found: Answer, scan: Scan, title: str) -> Verification:
    """A pose with a scan by itself; where that is not "ok", also near the pose: a weak
    answer may be one of several.
    """
    T, stated = found.pose, in_mm_rad(found.covariance_total_mm_deg)
    R, p = T[:3, :3], T[:3, 3]
    alone = calibrate(scan, guess=T, guess_sd=(np.inf, np.inf))  # a start, no more
    shown = len(alone.seen[0])
    if shown < FEWEST_POSES:
        raise ScanError(
            f"{title}: shows the target from {shown} poses; expected {FEWEST_POSES} or "
            "more, or check-mount, which does with fewer if the target stands as it did"
        )
    solution, (used,) = alone.solution_or_none, alone.observed
    if solution:
        used = used.keep(solution.kept[0])
    answers = []
    if alone.is_known:
        delta = pose_error(R, p, solution.rotation, solution.translation)
        answers.append((delta, solution.covariance))
    if alone.status != "ok":
        answers.append(linearised(alone, used, T, found.noise_mm))
    by_pose = target_by(T, scan, used)
    verifications = [
        Verification(delta, stated, own, alone, *by_pose) for delta, own in answers
    ]
    likeliest = max(verifications, key=lambda one: one.chance)
    if not len(likeliest.apart):
        raise ScanError(
            f"{title}: determines no direction of the sensor's pose; "
            "expected poses that differ"
        )
    return likeliest


def linearised(
    alone: Calibration, used: Observations, T: ndarray, noise_mm: float
) -> tuple[ndarray, ndarray]:
    """δ (6,), mm and rad, from a sensor pose T (4, 4) to what the observations say of
    it, to first order where the target fits best, and its covariance (6, 6), enormous
    where they say nothing.

    The robot's errors, which a scan hardly tells, are as usual at least.
    """
    prior = prior_from(stated_noise(alone.scans))
    noise = replace(prior.scales, profile_mm=noise_mm)
    if alone.solution_or_none:
        prior, noise = alone.solution.prior, alone.solution.noise
        noise = replace(noise, profile_mm=max(noise.profile_mm, noise_mm))
    problem = Problem([used], noise, prior.systematic)
    state = problem.place(T[None, :3, :3], T[None, :3, 3])
    names = prior.names(problem.groups.distinguishable)
    sizes = [max(getattr(noise, name), getattr(prior.scales, name)) for name in names]
    posterior = problem.model(state, names).posterior(np.square([[1.0, *sizes]]))
    return posterior.mean[0, :6], posterior.covariance[0, :6, :6]


def target_by(
    T: ndarray, scan: Scan, used: Observations
) -> tuple[dict[str, float], float]:
    """The target's lengths, mm, and the points' rms distance from it, where a sensor
    pose T (4, 4) takes the points.
    """
    points, _ = in_base(T, used.points[0], used.R_flange[0], used.T_flange[0])
    origin, axes, sizes = scan.target.fit(points)
    distance = scan.target.at(origin, axes, sizes).distance(points)
    lengths = dict(zip(scan.measures, map(float, sizes), strict=True)) if sizes else {}
    return lengths, float(np.sqrt(np.mean(distance**2)))
