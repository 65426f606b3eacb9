"""What is found from a user's scans: a sensor pose with its evidence, and what to tell
the user; as JSON.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import chain, compress
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.calibration.answer import MM_DEG, Answer, answer_of, fingerprints
from profilecal.calibration.points import point_sd
from profilecal.calibration.several_scans import prefixes
from profilecal.geometry.checks import UnobservableError, check_type
from profilecal.geometry.noise import SMOOTH
from profilecal.geometry.observability import name_direction, shift_and_turn
from profilecal.joint.problem import Problem
from profilecal.joint.smooth import COEFFICIENTS
from profilecal.joint.solution import Solution
from profilecal.scan.scan import MOUNTS, Scan
from profilecal.targets.observations import Observations
from profilecal.targets.target import Target


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A sensor pose from scans, or the reason why there is none.

    Look at `status` and `messages` first. Where the status is "unobservable", `pose`
    and what belongs to it raise `UnobservableError` with the motions to add.
    `to_json` is the contract with programs.

    >>> import profilecal as pc
    >>> found = pc.calibrate(pc.simulate("edge", seed=1, spread_deg=0.0)[0])
    >>> found.status, found.is_known
    ('unobservable', False)
    >>> len(found.messages)
    1
    """

    scans: tuple[Scan, ...]  # what it is from
    # for each scan, indices of the poses from which the target was found
    seen: tuple[ndarray, ...]
    observed: tuple[Observations, ...]  # for each scan, what was seen from them
    # "ok", "weak" (solved, but not to be relied on) or "unobservable"
    status: str = "unobservable"
    # None where measurements are fewer than unknowns
    solution_or_none: Solution | None = None
    messages: tuple[str, ...] = ()  # sentences a person can act on
    # the data contradict what is stated, as `messages` say; more poses would not help.
    # It may be so where the status is "ok": the covariance then allows for it
    misread: bool = False

    @property
    def is_known(self) -> bool:
        """Whether there is a sensor pose, be it a weak one."""
        return self.status != "unobservable"

    @property
    def made(self) -> dict[str, Any]:
        """Where it is from: the version, the time of asking, and the scans."""
        return {
            "version": version("profilecal"),
            "time": datetime.now(UTC).isoformat(timespec="seconds"),
            "scans": [*map(fingerprints, self.scans)],
        }

    @property
    def answer(self) -> Answer:
        """As `write_answer` writes it and `read_answer` reads it. Raises
        UnobservableError.
        """
        _ = self.known_solution  # raises where there is none
        return answer_of(self.to_json() | {"made": self.made})

    @property
    def mount(self) -> str:
        """Where the scanner is: "eye-in-hand" or "eye-to-hand"."""
        return self.scans[0].mount

    @property
    def frame(self) -> str:
        """The one that the sensor's pose is in: "flange", or "base" where the scanner
        stands still.
        """
        return MOUNTS[self.mount]

    @property
    def solution(self) -> Solution:
        """The joint solution with all its evidence, in mm and rad, also where it leaves
        the pose open. Raises UnobservableError where there is none.
        """
        if self.solution_or_none is None:
            raise UnobservableError("; ".join(self.messages))
        return self.solution_or_none

    @property
    def known_solution(self) -> Solution:
        """The joint solution where it determines the pose. Raises UnobservableError
        where it does not, with the motions to add.
        """
        if not self.is_known:
            raise UnobservableError("; ".join(self.messages))
        return self.solution

    @property
    def pose(self) -> ndarray:
        """(4, 4) mm, the sensor in the flange frame (eye-to-hand: in the base frame).
        Raises UnobservableError.
        """
        return self.known_solution.pose

    @property
    def covariance_mm_deg(self) -> ndarray:
        """(6, 6) of δ, a shift in mm and a rotation vector in degrees, both in the
        sensor's frame, of the mount that the poses used show where they saw the target:
        pose · exp(δ). It serves near them. Raises UnobservableError.
        """
        return self.known_solution.covariance * MM_DEG

    @property
    def covariance_total_mm_deg(self) -> ndarray:
        """(6, 6) of the true mount: with an error of the flange common to all poses,
        which no residual shows. Raises UnobservableError.
        """
        return self.known_solution.covariance_total * MM_DEG

    @property
    def translation_sd_mm(self) -> ndarray:
        """(3,) standard deviations along the sensor's x, y and z: square roots of the
        diagonal of `covariance_mm_deg`, near the poses of the scans; `sd_total_mm_deg`
        holds elsewhere too. Raises UnobservableError.
        """
        return np.sqrt(np.diag(self.covariance_mm_deg))[:3]

    @property
    def rotation_sd_deg(self) -> ndarray:
        """(3,) standard deviations about the sensor's x, y and z: square roots of the
        covariance's diagonal. Raises UnobservableError.
        """
        return np.sqrt(np.diag(self.covariance_mm_deg))[3:]

    @property
    def sd_total_mm_deg(self) -> ndarray:
        """(6,) standard deviations in mm and degrees with what no residual shows added:
        what matters away from the poses of the scans. Raises UnobservableError.
        """
        return np.sqrt(np.diag(self.covariance_total_mm_deg))

    def point_sd_mm(
        self, x: ArrayLike, z: ArrayLike, T_base_flange: ArrayLike | None = None
    ) -> ndarray:
        """How well points of a profile are known, by the total covariance.

        With the pose's rotation R, C = `covariance_total_mm_deg` in mm and rad, and a
        point p = (x, 0, z), the covariance in the flange's frame is J C Jᵀ, J = R [1,
        -[p]×]. In the base frame, at a pose of the flange, the robot's own error there
        is added, as large as the scans show it; one that shifts all points alike, as
        if the base stood elsewhere, is not.

        Parameters
        ----------
        x, z : array (...)
            Of the points, mm.
        T_base_flange : array (4, 4) or (..., 4, 4), optional
            Poses of the flange, mm; left out, points are in the flange's frame.
            Eye-to-hand, they are in the base's, and with a pose in the flange's.

        Returns
        -------
        array (..., 3)
            Standard deviations along the axes of that frame, mm.

        Raises
        ------
        UnobservableError
            Where there is no pose.
        ValueError
            For a `T_base_flange` that is no rigid transform.

        Examples
        --------
        >>> import profilecal as pc
        >>> found = pc.calibrate(pc.simulate("ball", seed=1)[0])
        >>> found.point_sd_mm([-20, 20], [100, 100]).shape
        (2, 3)
        """
        return point_sd(self.known_solution, x, z, T_base_flange)

    @property
    def noise_mm(self) -> float:
        """The scanner's noise, given or estimated. Raises UnobservableError."""
        return self.solution.noise_mm

    @property
    def targets(self) -> tuple[Target, ...]:
        """The target of each scan where it stands: in the base frame, mm (eye-to-hand:
        in the flange frame). Raises UnobservableError.
        """
        return self.known_solution.placements

    @property
    def poses_used(self) -> list[str]:
        """Labels of the poses that the answer rests on."""
        return self._labels(rejected=False)

    @property
    def poses_rejected(self) -> list[str]:
        """Labels of the poses that contradict the others."""
        return self._labels(rejected=True)

    def _labels(self, rejected: bool) -> list[str]:
        """Of the poses used or rejected."""
        if self.solution_or_none is None:
            return []
        labels = chain.from_iterable(self.labels_by_scan())
        bad = np.concatenate(self.solution_or_none.rejected)
        return [*compress(labels, bad == rejected)]

    def labels_by_scan(self) -> list[list[str]]:
        """Of the poses from which the target was found; with the scan's title before
        them where there are several scans.
        """
        parts = zip(prefixes(self.scans), self.scans, self.seen, strict=True)
        return [
            [before + scan.labels[i] for i in poses] for before, scan, poses in parts
        ]

    def __repr__(self) -> str:
        kinds = ", ".join(scan.kind for scan in self.scans)
        used, rejected = len(self.poses_used), len(self.poses_rejected)
        counts = f"{used} poses used, {rejected} rejected"
        lines = [f"Calibration({self.status}, {kinds}, {counts})"]
        if self.is_known:
            rows = np.array2string(self.pose, precision=4, suppress_small=True)
            near = [*self.translation_sd_mm, *self.rotation_sd_deg]
            total = self.sd_total_mm_deg
            lines += [
                f"pose of the sensor in the {self.frame} frame, mm:\n{rows}",
                f"sd near these poses: {shift_and_turn(near)} about x, y, z",
                f"sd elsewhere: {shift_and_turn(total)} about x, y, z",
            ]
        lines += [shorten(message, 88) for message in self.messages[:7]]
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """The object that `profilecal calibrate --json` prints, but for `made`;
        data/README.md says what each entry is. Those that are not known are None.
        """
        known, solution = self.is_known or None, self.solution_or_none
        entries = {
            "status": self.status,
            f"T_{self.frame}_sensor": known and self.pose,
            "covariance": known and self.covariance_mm_deg,
            "covariance_total": known and self.covariance_total_mm_deg,
            "translation_sd_mm": known and self.translation_sd_mm,
            "rotation_sd_deg": known and self.rotation_sd_deg,
            "rms_mm": solution and solution.rms_mm,
            "chi2_per_dof": solution and solution.chi2_per_dof,
            "noise_mm": solution and solution.noise_mm,
            "noise_source": solution and solution.noise_source,
            "poses_used": self.poses_used,
            "poses_rejected": self.poses_rejected,
            "observability": solution and observability_entries(solution),
            "method": "joint",
            "target": known and target_entries(self.solution),
            **dict.fromkeys(("delay_ms", "delay_sd_ms", "delay_source")),
            "messages": self.messages,
            "joint": known and joint_entries(self.solution),
        }
        if solution and solution.delay_s is not None:
            is_open = solution.problem.delay_is_open
            entries |= {
                "delay_ms": 1e3 * solution.delay_s,
                "delay_sd_ms": 1e3 * solution.delay_sd_s,
                "delay_source": "estimated" if is_open else "given",
            }
        return json.loads(json.dumps(entries, default=ndarray.tolist))


def write_answer(found: Calibration, path: str | Path) -> None:
    """Write what was found as JSON, as ``profilecal calibrate --json`` prints it.

    Parameters
    ----------
    found : Calibration
        What `calibrate` gives.
    path : str or Path
        The file, such as ``T.json``; an old one is replaced.

    Raises
    ------
    OSError
        Where the file cannot be written.
    TypeError
        For what is no Calibration.

    See Also
    --------
    read_answer : the way back, where there is a sensor pose.

    Examples
    --------
    >>> import profilecal as pc
    >>> from tempfile import NamedTemporaryFile
    >>> found = pc.calibrate(pc.simulate("edge", seed=1)[0])
    >>> with NamedTemporaryFile(suffix=".json") as file:
    ...     pc.write_answer(found, file.name)
    ...     answer = pc.read_answer(file.name)
    >>> bool((answer.pose == found.pose).all())
    True
    """
    check_type("found", found, Calibration)
    Path(path).write_text(answer_text(found) + "\n", encoding="utf-8")


def answer_text(found: Calibration) -> str:
    """What was found as JSON, with where it is from."""
    return json.dumps(found.to_json() | {"made": found.made}, indent=2)


def target_entries(solution: Solution) -> Any:
    """The targets in their places; one, or a list of several."""
    targets = [{"kind": one.kind} | vars(one) for one in solution.placements]
    return targets if len(targets) > 1 else targets[0]


def joint_entries(solution: Solution) -> dict[str, Any]:
    """All that was found, by which `check_mount` predicts other poses.

    What `plausibility` adds to a covariance for an error that it finds is left out:
    where the same poses are driven again the error is there again. At other poses it
    may pass for a move.
    """
    mean, covariance = solution.known_of_all
    problem, prior, noise = solution.problem, solution.prior, solution.noise
    noise_mm = solution.noise_mm
    shown_mm = prior.scales.profile_mm if prior.source == "profiles" else noise_mm
    placed = zip(problem.observations, solution.state.placements, strict=True)
    sizes = solution.error_sizes.of_robot
    smooth = solution.smooth.known if SMOOTH in sizes else None
    robot_errors = sizes | {"steering_mm": noise.steering_mm}
    if smooth:
        robot_errors["accuracy_deg"] = noise.of_sizes(sizes).accuracy_deg
    return {
        "smooth": smooth,
        "columns": column_names(problem, range(len(problem.targets)), bool(smooth)),
        "mean": mean,
        "covariance": covariance,
        "targets": [
            [observed.kind, observed.sizes, origin[0], axes[0]]
            for observed, (origin, axes) in placed
        ],
        "robot_errors": robot_errors,
        "freedom": solution.error_sizes.freedom,
        "noise_factor": noise_mm / shown_mm,
    }


def column_names(problem: Problem, numbers: Sequence[int], smooth: bool) -> list[str]:
    """What the columns of a problem's linear model are derivatives by. `numbers`: of
    its targets in the calibration; `smooth`: whether the robot has smooth errors.
    """
    names = [f"sensor {word} {axis}" for word in ("shift", "turn") for axis in "xyz"]
    for number, target in zip(numbers, problem.targets, strict=True):
        names += [f"target {number} shift {axis}" for axis in target.shifts]
        names += [f"target {number} turn {axis}" for axis in target.turns]
    names += [error.name for error in problem.considered]
    return names + [f"smooth {k}" for k in range(COEFFICIENTS * smooth)]


def observability_entries(solution: Solution) -> dict[str, Any]:
    """How well each direction is determined; "singular_values" are 1 / sd, as those of
    residuals' derivatives over the noise.
    """
    known, frame = solution.observability, solution.problem.frame
    return {
        "singular_values": 1 / np.maximum(known.sd, np.finfo(float).eps),
        "worst_direction": name_direction(
            known.directions[0], solution.rotation, frame
        ),
    }
