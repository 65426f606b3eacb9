"""Is everything where a calibration left it? One to three poses of the same artefact
are predicted from its answer, and compared with what the scanner sees.

Nothing is solved: the residuals r at the answer, with their derivatives A by all that
the calibration had to find, follow the law

    r + A x̄ ~ N(0, S)        S = C + A V Aᵀ

of the mean x̄ and the covariance V that the calibration left, and of the errors C that
are fresh at each pose. If the sensor, or the artefact, has moved by m since, along
columns B of A, that adds B P Bᵀ to S, P as for a measurement by hand.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy import ndarray
from scipy.special import chndtrinc, fdtrc, fdtri

from profilecal.calibration.answer import DEGREES, Answer, answer_in
from profilecal.calibration.calibration import Calibration
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.checks import check_type
from profilecal.geometry.noise import FALSE_ALARM, Noise, Systematic
from profilecal.geometry.observability import HAND_PRECISION
from profilecal.joint.problem import Problem
from profilecal.joint.solution import column_names
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError
from profilecal.targets.observations import State

ANY = Systematic(1.0, 1.0, 1.0, 1.0)  # all that a calibration may have considered
POWER = 0.9


@dataclass(frozen=True)
class Move:
    """What may have moved since, alone, and how well that explains what was seen."""

    chance: float  # of more, if that has moved; 1 where it explains anything
    delta: ndarray  # (k,) by how much, mm and rad
    covariance: ndarray  # (k, k), enormous where these poses do not tell


@dataclass(frozen=True, eq=False, repr=False)
class MountCheck:
    """How far what was seen is from what a calibration predicts.

    `as_expected` is the verdict, `chance` what it rests on, `is_conclusive` whether a
    move would have shown; `sensor` and `target`, in their own frames, are what may have
    moved.
    """

    labels: tuple[str, ...]  # of the poses that saw the artefact
    residuals: ndarray  # (k,) independent rows, over the scanner's noise
    columns: ndarray  # (k, 6 + t) their derivatives by the sensor's pose and target's
    by_hand: ndarray  # (6 + t,) how well one would know these by hand
    covariance: ndarray  # (k, k) S
    freedom: float  # degrees of freedom with which the robot's errors are known
    rotation: ndarray  # (3, 3) of the sensor in the flange frame, or the base frame

    @cached_property
    def chi2(self) -> float:
        """Of all residuals."""
        return float(self.residuals @ np.linalg.solve(self.covariance, self.residuals))

    @property
    def limit(self) -> float:
        """What χ² exceeds by a chance of 1 % where nothing has moved."""
        k = len(self.residuals)
        return float(k * fdtri(k, self.freedom, 1 - FALSE_ALARM))

    @property
    def chance(self) -> float:
        """That χ² is larger where nothing has moved."""
        return self.chance_of(self.chi2, len(self.residuals))

    @property
    def as_expected(self) -> bool:
        """Whether the calibration and its errors explain what was seen."""
        return self.chance > FALSE_ALARM

    @cached_property
    def sensor(self) -> Move:
        """The sensor, from pose to pose · exp(δ)."""
        return self.moved(slice(0, 6))

    @cached_property
    def target(self) -> Move:
        """The artefact, along and about the axes that its kind has."""
        return self.moved(slice(6, None))

    def chance_of(self, chi2: float, count: int) -> float:
        """That the χ² of so many residuals is larger, which the robot's errors, as they
        are known, make an F law.
        """
        return float(fdtrc(count, self.freedom, chi2 / count)) if count else 1.0

    def moved(self, part: slice) -> Move:
        """What has moved along a part of the columns."""
        B, by_hand = self.columns[:, part], self.by_hand[part]
        P = np.diag(by_hand**2)
        S = self.covariance + B @ P @ B.T
        X = np.linalg.solve(S, np.c_[B, self.residuals])
        delta = -P @ B.T @ X[:, -1]
        white = np.linalg.solve(np.linalg.cholesky(self.covariance), B * by_hand)
        free = len(S) - np.linalg.matrix_rank(white, tol=1.0)
        chi2 = float(self.residuals @ X[:, -1])
        return Move(self.chance_of(chi2, free), delta, P - P @ B.T @ X[:, :-1] @ P)

    @property
    def suspects(self) -> tuple[str, ...]:
        """What may have moved, alone: "sensor", "target", both where these poses do not
        tell, or none where neither explains what was seen.
        """
        moves = {"sensor": self.sensor, "target": self.target}
        return tuple(name for name, one in moves.items() if one.chance > FALSE_ALARM)

    def alone_mm_deg(self, frame: str = "sensor") -> tuple[ndarray, ndarray]:
        """By how much the sensor would have moved along or about one axis alone, each
        of the sensor's or the flange's, in its origin: (6,) with standard deviations.
        """
        shifts, turns = self.columns[:, :3], self.columns[:, 3:6]
        axes = np.eye(3) if frame == "sensor" else self.rotation.T
        B = np.hstack([shifts @ axes, turns @ axes])
        X = np.linalg.solve(self.covariance, B)
        sd = np.sum(B * X, axis=0) ** -0.5
        return -(X.T @ self.residuals) * sd**2 * DEGREES, sd * DEGREES

    @property
    def seen_mm_deg(self) -> ndarray:
        """(6,) how far the sensor would have to move along or about one of its axes for
        these poses to show it with a chance of 90 %.
        """
        _, sd = self.alone_mm_deg()
        square = chndtrinc(self.limit, len(self.residuals), 1 - POWER)
        # NaN for an enormous limit, from which it then hardly differs
        return sd * np.sqrt(np.nan_to_num(square, nan=self.limit))

    @property
    def is_conclusive(self) -> bool:
        """Whether these poses show anything, or would show any move that is too small
        to be seen by hand, 10 mm and 5°.
        """
        would_show = (self.seen_mm_deg < HAND_PRECISION * DEGREES).any()
        return not self.as_expected or bool(would_show)

    def __repr__(self) -> str:
        suspects = "" if self.as_expected else f", suspects={self.suspects}"
        return (
            f"MountCheck(as_expected={self.as_expected}, chance={self.chance:.2g}, "
            f"{len(self.labels)} poses{suspects})"
        )


def check_mount(found: Calibration | Answer, scan: Scan) -> MountCheck:
    """Whether sensor and artefact are where a calibration left them.

    Parameters
    ----------
    found : Calibration or Answer
        The calibration; `read_answer` reads its JSON.
    scan : Scan
        One pose or a few of the same artefact, where it stood: best those of the
        calibration's scan, driven again.

    Returns
    -------
    MountCheck
        `as_expected` says whether what was seen is as predicted.

    Raises
    ------
    ScanError
        For another artefact or mount, a scan that shows none, and an answer that does
        not hold what it takes.
    UnobservableError
        For a calibration that leaves the pose open.
    TypeError
        For arguments of another kind.

    See Also
    --------
    verify : compares with another scan, solved by itself.

    Examples
    --------
    >>> import profilecal as pc
    >>> scan, _ = pc.simulate("ball", seed=1)
    >>> found = pc.calibrate(scan)
    >>> poses, arcs = scan.T_base_flange[:3], np.concatenate(scan.values[:3])
    >>> few = Scan.of("ball", poses, arcs=arcs, radius=25)
    >>> pc.check_mount(found, few).as_expected
    True
    """
    check_type("found", found, Calibration, Answer)
    check_type("scan", scan, Scan)
    if isinstance(found, Calibration):
        found.known_solution  # noqa: B018
        found = answer_in(found.to_json())
    title = scan.title or f"the {scan.kind}"
    if found.mount != scan.mount:
        raise ScanError(f"{title}: the mount is {scan.mount}; expected {found.mount}")
    joint = found.joint
    if joint is None:
        raise ScanError(
            "the answer holds no prediction of other poses; calibrate anew with "
            "profilecal calibrate SCAN --json > T.json"
        )
    alike = [
        k for k, one in enumerate(joint.targets) if one[:2] == (scan.kind, scan.sizes)
    ]
    if len(alike) != 1:
        raise ScanError(
            f"{title}: its {scan.description} is {len(alike) or 'none'} of the "
            f"calibration's targets ({', '.join(one[0] for one in joint.targets)}); "
            "expected one; verify takes any target"
        )
    seen = observe(scan, 1)
    noise_mm = found.noise_mm
    if seen.typical_mm:
        noise_mm = seen.typical_mm * joint.noise_factor
    observed = as_observations(scan, seen, seen.typical_mm)
    noise = replace(Noise(**joint.robot_errors), profile_mm=noise_mm)
    problem = Problem([observed], noise, ANY)
    _, _, origin, axes = joint.targets[alike[0]]
    T = found.pose[None]
    state = State(T[:, :3, :3], T[:, :3, 3], ((origin[None], axes[None]),))
    model = problem.model(state, [*noise.of_robot])
    Y = model.Y.reshape(-1, model.n + 1)
    E = model.E.reshape(len(Y), -1)
    S = np.eye(len(Y))
    for name, unit in zip(model.names, model.units[1:], strict=True):
        number = problem.groups.sharing(name).repeat(model.q)
        alike_rows = number[:, None] == number
        S += getattr(noise, name) ** 2 * (E * unit) @ E.T * alike_rows
    mean, V = joint.of(column_names(problem, alike))
    A = Y[:, :-1]
    S += A @ V @ A.T
    rows = np.abs(E).max(axis=1) > 0
    return MountCheck(
        labels=tuple(scan.labels[i] for i in seen.poses),
        residuals=(Y[:, -1] + A @ mean)[rows],
        columns=A[rows, : problem.n],
        by_hand=problem.units,
        covariance=S[np.ix_(rows, rows)],
        freedom=joint.freedom,
        rotation=found.pose[:3, :3],
    )
