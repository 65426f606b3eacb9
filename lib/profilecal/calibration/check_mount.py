"""Is everything where a calibration left it? One to three poses of the same artefact
are predicted from its answer, and compared with what the scanner sees.

The calibration is not solved anew. The residuals at its answer speak (`evidence`) of
moves of the sensor and of the artefact since, where the mean and the covariance that it
left are all that is known of the other unknowns. Whether one of the two explains what
was seen is looked at where it would have moved to, as residuals are not linear.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray
from scipy.special import chndtrinc, fdtrc, fdtri

from profilecal.calibration.answer import DEGREES, Answer, Joint, checked_name
from profilecal.calibration.calibration import Calibration, column_names
from profilecal.calibration.evidence import Evidence, evidence
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import FALSE_ALARM, Noise, Systematic
from profilecal.geometry.observability import HAND_PRECISION
from profilecal.joint.linear_model import LinearModel
from profilecal.joint.prior import TYPICAL
from profilecal.joint.problem import Problem
from profilecal.scan.scan import Scan, described
from profilecal.scan.tables import ScanError
from profilecal.targets.state import State

# errors that a calibration may have considered
ALL_CONSIDERED = Systematic(**dict.fromkeys(vars(TYPICAL), 1.0))
POWER = 0.9
LITTLE = 0.01  # of a move's unit: its square is nothing to the residuals
MOST_STEPS = 20  # to where sensor or target would have moved


@dataclass(frozen=True, eq=False, repr=False)
class MountCheck:
    """How far what was seen is from what a calibration predicts.

    `as_expected` is the verdict, `chance` what it rests on, `is_conclusive` whether a
    move would have shown, `suspects` what may have moved.
    """

    labels: tuple[str, ...]  # of the poses that saw the artefact
    count: int  # of independent residuals
    # what they say of moves of the sensor (6) and of the target (t), in units of how
    # well one would know these by hand
    moves: Evidence
    # by how much the sensor would have moved along or about each of its axes alone, the
    # standard deviations, in the same units, and the χ² that are left then, (3, 6)
    by_axis: ndarray
    # what the residuals say of moves of "sensor" or "target" alone, where it would be
    alone: dict[str, Evidence]
    freedom: float  # degrees of freedom with which the robot's errors are known

    @property
    def chi2(self) -> float:
        """Of all residuals."""
        return float(self.moves.chi2)

    @property
    def limit(self) -> float:
        """What χ² exceeds by a chance of 1 % where nothing has moved."""
        k = self.count
        return float(k * fdtri(k, self.freedom, 1 - FALSE_ALARM))

    @property
    def chance(self) -> float:
        """That χ² is larger where nothing has moved."""
        return self.chance_of(self.chi2, self.count)

    @property
    def as_expected(self) -> bool:
        """Whether the calibration and its errors explain what was seen."""
        return self.chance > FALSE_ALARM

    def chance_of(self, chi2: float, count: int) -> float:
        """That the χ² of so many residuals is larger, which the robot's errors, as they
        are known, make an F law.
        """
        return float(fdtrc(count, self.freedom, chi2 / count)) if count else 1.0

    @cached_property
    def chances(self) -> dict[str, float]:
        """That χ² is larger if the "sensor", or the "target", has moved, alone; 1 where
        such a move explains anything.
        """
        chances = {}
        for what, says in self.alone.items():
            told = np.linalg.eigvalsh(says.information) > 1
            free = self.count - int(np.count_nonzero(told))
            chances[what] = self.chance_of(says.chi2 - says.explained, free)
        return chances

    @property
    def suspects(self) -> tuple[str, ...]:
        """What may have moved, alone: "sensor", "target", both where these poses do not
        tell, or none where neither explains what was seen.
        """
        return tuple(what for what in self.chances if self.chances[what] > FALSE_ALARM)

    @property
    def alone_mm_deg(self) -> ndarray:
        """By how much the sensor would have moved along or about one of its axes alone,
        and the standard deviations, (2, 6).
        """
        return self.by_axis[:2] * HAND_PRECISION * DEGREES

    @property
    def axis(self) -> int:
        """Which of these six moves explains most."""
        return int(np.argmin(self.by_axis[2]))

    @property
    def seen_mm_deg(self) -> ndarray:
        """(6,) how far the sensor would have to move along or about one of its axes for
        these poses to show it with a chance of 90 %.
        """
        sd = self.moves.each()[1, :6]
        return sd * HAND_PRECISION * DEGREES * np.sqrt(self.shown_square)

    @property
    def shown_square(self) -> float:
        """What a move has to add to χ² to be shown with that chance."""
        square = chndtrinc(self.limit, self.count, 1 - POWER)
        # NaN for an enormous limit, from which it then hardly differs
        return float(np.nan_to_num(square, nan=self.limit))

    @property
    def tested(self) -> int:
        """In how many of six directions these poses would show a move of the sensor
        that is too small to be seen by hand, 10 mm and 5°.
        """
        squares = np.linalg.eigvalsh(self.moves.information[:6, :6])
        return int(np.count_nonzero(squares > self.shown_square))

    @property
    def is_conclusive(self) -> bool:
        """Whether these poses show anything, or would in some direction."""
        return not self.as_expected or self.tested > 0

    def __repr__(self) -> str:
        suspects = "" if self.as_expected else f", suspects={self.suspects}"
        return (
            f"MountCheck(as_expected={self.as_expected}, chance={self.chance:.2g}, "
            f"poses={len(self.labels)}{suspects})"
        )


def check_mount(found: Calibration | Answer, scan: Scan) -> MountCheck:
    """Whether sensor and artefact are where a calibration left them.

    Parameters
    ----------
    found : Calibration or Answer
        The calibration; `read_answer` reads its JSON.
    scan : Scan
        One pose or a few of the same artefact, where it stood: best those of the
        calibration's scan, driven again. The noise that it states counts if it holds
        points, chords or arcs and the calibration found less.

    Returns
    -------
    MountCheck
        `as_expected` says whether what was seen is as predicted.

    Raises
    ------
    ScanError
        For another artefact or mount, a scan that shows none or that moves by clocks
        of an unknown delay, and an answer that does not hold what it takes.
    UnobservableError
        For a calibration that leaves the pose open.
    TypeError
        For arguments of another kind.

    See Also
    --------
    verify : compares with another scan, solved by itself.

    Examples
    --------
    >>> import numpy as np
    >>> import profilecal as pc
    >>> found = pc.calibrate(pc.simulate("ball", seed=1)[0])
    >>> later, _ = pc.simulate("ball", seed=1, scan=2)
    >>> poses, arcs = later.T_base_flange[:3], np.concatenate(later.values[:3])
    >>> few = pc.Scan.of("ball", poses, arcs=arcs, radius=25)
    >>> pc.check_mount(found, few).as_expected
    True
    """
    check_type("found", found, Calibration, Answer)
    check_type("scan", scan, Scan)
    if isinstance(found, Calibration):
        found = found.answer
    title = checked_name(found, scan)
    if scan.log and scan.delay_ms is None:
        raise ScanError(
            f"{title}: what the clocks of robot and scanner differ by is not stated; "
            "expected [motion] delay_ms in its scan.toml, or poses at rest; verify "
            "finds it for itself"
        )
    joint = found.joint
    if joint is None:
        raise ScanError(
            "the answer holds no prediction of other poses; calibrate anew with "
            "profilecal calibrate SCAN --json > T.json"
        )
    number = target_seen(joint, scan, title)
    seen = observe(scan, 1)
    noise_mm = seen.typical_mm * joint.noise_factor
    if not noise_mm:  # the calibration may be of profiles, whose features err by less
        noise_mm = max(found.noise_mm, scan.noise.get("profile_mm", 0.0))
    observed = as_observations(scan, seen, seen.typical_mm)
    noise = Noise(**joint.robot_errors | {"profile_mm": noise_mm})
    problem = Problem([observed], noise, ALL_CONSIDERED, known_smooth=joint.smooth)
    _, _, origin, axes = joint.targets[number]
    T, placement = found.pose[None], (np.array([origin]), np.array([axes]))
    state = State(T[:, :3, :3], T[:, :3, 3], (placement,))
    names = column_names(problem, [number], noise.accuracy_mm > 0)

    def model_at(there: State) -> LinearModel:
        return problem.model(there, [*noise.of_robot])

    def moves_by(model: LinearModel) -> Evidence:
        return moves_after(model, noise, *joint.of(names), problem.units)

    def moves_of(part: slice) -> tuple[ndarray, Evidence]:
        """Where some unknowns alone are likeliest, and what is said of them there."""
        moved, says = np.zeros(problem.n), moves.of(part)
        for _ in range(MOST_STEPS):
            if np.abs(says.likeliest).max() < LITTLE:
                break
            moved[part] += says.likeliest
            there = problem.move(state, moved[None] * problem.units)
            says = moves_by(model_at(there)).of(part)
        return moved[part], says

    model = model_at(state)
    moves, by_axis = moves_by(model), []
    for k in range(6):
        moved, says = moves_of(slice(k, k + 1))
        (step, sd), left = says.each()[:, 0], says.chi2 - says.explained
        by_axis.append([moved[0] + step, sd, left])
    return MountCheck(
        labels=tuple(scan.labels[i] for i in seen.poses),
        count=int(model.ranks.sum()),
        moves=moves,
        by_axis=np.transpose(by_axis),
        alone={"sensor": moves_of(slice(6))[1], "target": moves_of(slice(6, None))[1]},
        freedom=joint.freedom,
    )


def target_seen(joint: Joint, scan: Scan, title: str) -> int:
    """Which of a calibration's targets a scan is of. Raises ScanError unless one."""
    known = [described(kind, sizes) for kind, sizes, *_ in joint.targets]
    count = known.count(scan.description)
    if count != 1:
        raise ScanError(
            f"{title}: its {scan.description} is {count or 'none'} of the "
            f"calibration's targets ({'; '.join(known)}); "
            "expected one; verify takes any target"
        )
    return known.index(scan.description)


def moves_after(
    model: LinearModel, noise: Noise, mean: ndarray, V: ndarray, units: ndarray
) -> Evidence:
    """What residuals say of steps of the first n unknowns, in these units (n,), of all
    of which a calibration left the mean and the covariance V. Residuals that no error
    of the flange moves are taken off: they are of the target's shape.

    With V = L Lᵀ, x = x̄ + L ξ, ξ ~ N(0, 1), r becomes r + A x̄ and A becomes A L.
    """
    sizes = [1.0, *noise.of_robot.values()]
    rest, _ = model.rest_of_kept
    normal = model.posterior(np.square([sizes])).products - rest
    values, vectors = np.linalg.eigh(V)
    L = vectors * np.sqrt(np.maximum(values, 0))
    pick = np.eye(model.p + 1, model.p)  # A, of the columns [A | r]
    shifted = np.append(mean, 1)  # r + A x̄
    columns = np.c_[pick @ L, pick[:, : len(units)] * units, shifted]
    return evidence(columns.T @ normal @ columns, np.eye(model.p))
