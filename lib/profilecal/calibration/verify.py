"""Is a sensor pose right? A scan that was not used to find it is solved by itself, and
the two answers are compared; or another answer is given.

Where that scan alone gives no answer to rely on, the pose in question holds what it
leaves open, roughly: only the directions that it determines are compared.

What no residual can show counts once, from the pose in question: an error of the flange
that all poses share cancels where one robot made both scans; the rest of the robot's
accuracy differs between them.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy import ndarray
from scipy.special import chdtrc

from profilecal.calibration.answer import DEGREES, MM_DEG, Answer, checked_name
from profilecal.calibration.calibrate import calibrate
from profilecal.calibration.calibration import Calibration
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import FALSE_ALARM
from profilecal.geometry.observability import HAND_PRECISION, Spectrum, of_covariance
from profilecal.geometry.poses import difference, in_base
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError
from profilecal.targets.observations import Observations
from profilecal.targets.target import Target

# Fewer poses say too little of the robot's errors, and all but fit any target.
FEWEST_POSES = 6
# How far from the pose in question the scan may have it, mm and degrees: three times as
# well as by hand, so that no direction which rests on that counts as determined.
NEAR = (30.0, 15.0)


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
    sizes: dict[str, float] = field(default_factory=dict)
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
    def is_misread(self) -> bool:
        """Whether the scan, which is no other answer, contradicts itself."""
        other = self.other
        return isinstance(other, Calibration) and other.misread and not other.is_known

    @property
    def is_conclusive(self) -> bool:
        """Whether the scan tells all directions in which the pose is stated to be
        known, and does not contradict itself.
        """
        known = of_covariance(self.stated).sd < 1  # better than by hand
        tells_all = len(self.apart) >= int(np.count_nonzero(known))
        return tells_all and not self.is_misread

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
        For a scan of fewer than 6 poses, that determines nothing, that has another
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
    if isinstance(found, Calibration):
        found = found.answer
    if isinstance(other, Calibration):
        other = other.answer
    title = checked_name(found, other)
    T = found.pose
    stated = found.covariance_total_mm_deg / MM_DEG
    if isinstance(other, Answer):
        own = other.covariance_mm_deg
        if own is None:
            own = other.covariance_total_mm_deg
        checked = Verification(difference(T, other.pose), stated, own / MM_DEG, other)
    else:
        alone = calibrate(other, T, NEAR)
        shown = len(alone.seen[0])
        if shown < FEWEST_POSES:
            raise ScanError(
                f"{title}: shows the target from {shown} poses; expected "
                f"{FEWEST_POSES} or more, or check-mount, which does with fewer if the "
                "target stands as it did"
            )
        solution = alone.solution
        target, points, _ = target_by(T, alone.observed[0].keep(solution.kept[0]))
        checked = Verification(
            difference(T, solution.pose),
            stated,
            solution.covariance,
            alone,
            sizes=dict(zip(other.sizes, map(float, target.sizes), strict=True)),
            rms_mm=float(np.sqrt(np.mean(target.distance(points) ** 2))),
        )
    if not len(checked.apart):
        why = getattr(checked.other, "messages", ())
        sentence = f"{title}: determines no direction of the sensor's pose"
        raise ScanError("; ".join([sentence, *why]))
    return checked


def target_by(T: ndarray, observed: Observations) -> tuple[Target, ndarray, ndarray]:
    """The target that fits best where a sensor pose T (4, 4) takes the points, these
    points (N, 3), and the number (N,) of the pose that each was seen from.
    """
    frames = observed.R_flange[0], observed.T_flange[0]
    points, pose = in_base(T, observed.points[0], *frames)
    fitted = observed.target.fit(points)
    return observed.target.at(*fitted), points, pose
