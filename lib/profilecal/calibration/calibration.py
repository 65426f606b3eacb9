"""From a user's scans to a sensor pose with its evidence: observations, joint solution,
and what to tell the user.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import chain, compress
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from profilecal.calibration import plausibility
from profilecal.calibration.answer import (
    Answer,
    answer_in,
    fingerprints,
    in_mm_deg,
    sample,
)
from profilecal.calibration.memory import check_memory
from profilecal.calibration.mount import contradiction, rests_on
from profilecal.calibration.observe import (
    Seen,
    doubts,
    names,
    observe_all,
    stated_noise,
    with_few_joined,
)
from profilecal.calibration.other_conventions import better_readings
from profilecal.calibration.points import point_sd
from profilecal.geometry.checks import (
    UnobservableError,
    check_array,
    check_rigid,
    check_type,
)
from profilecal.geometry.noise import SMOOTH
from profilecal.geometry.observability import name_direction
from profilecal.geometry.poses import carry
from profilecal.joint.prior import Mount, Prior, prior_from
from profilecal.joint.solution import Solution, column_names
from profilecal.joint.solve import solve
from profilecal.scan.scan import GUESS_SD, MOUNTS, Scan
from profilecal.scan.tables import ScanError, listed
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
    # None where measurements are fewer than unknowns
    solution_or_none: Solution | None = None
    messages: tuple[str, ...] = ()  # sentences a person can act on
    # the data contradict what is stated, as `messages` say; more poses would not help
    misread: bool = False

    @property
    def status(self) -> str:
        """ "ok", "weak" (solved, but not to be relied on) or "unobservable"."""
        return self.solution_or_none.status if self.solution_or_none else "unobservable"

    @property
    def is_known(self) -> bool:
        """Whether there is a sensor pose, be it a weak one."""
        return self.status != "unobservable"

    @property
    def made(self) -> dict[str, Any]:
        """Where it is from: by which version, when, and from which scans."""
        return {
            "version": version("profilecal"),
            "time": datetime.now(UTC).isoformat(timespec="seconds"),
            "scans": [*map(sample, self.scans)],
        }

    @property
    def answer(self) -> Answer:
        """As `write_answer` writes it and `read_answer` reads it. Raises
        UnobservableError.
        """
        self.known_solution  # noqa: B018
        return answer_in(self.to_json() | {"made": self.made})

    @property
    def mount(self) -> str:
        """Where the scanner is: "eye-in-hand" or "eye-to-hand"."""
        return self.scans[0].mount

    @property
    def frame(self) -> str:
        """The one that the sensor's pose is in: "flange", or "base" where the scanner
        stands still.
        """
        return "flange" if self.mount == MOUNTS[0] else "base"

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
        sensor's frame, of the mount that the poses of the scans show: pose · exp(δ).
        It serves near them. Raises UnobservableError.
        """
        return in_mm_deg(self.known_solution.covariance)

    @property
    def covariance_total_mm_deg(self) -> ndarray:
        """(6, 6) of the true mount: with an error of the flange common to all poses,
        which no residual shows. Raises UnobservableError.
        """
        return in_mm_deg(self.known_solution.covariance_total)

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
        triples = zip(names(self.scans), self.scans, self.seen, strict=True)
        return [
            [before + scan.labels[i] for i in seen] for before, scan, seen in triples
        ]

    def __repr__(self) -> str:
        kinds = ", ".join(scan.kind for scan in self.scans)
        used, rejected = len(self.poses_used), len(self.poses_rejected)
        counts = f"{used} poses used, {rejected} rejected"
        lines = [f"Calibration({self.status}, {kinds}, {counts})"]
        if self.is_known:
            rows = np.array2string(self.pose, precision=4, suppress_small=True)
            near = [*self.translation_sd_mm, *self.rotation_sd_deg]
            lines += [
                f"pose of the sensor in the {self.frame} frame, mm:\n{rows}",
                f"one standard deviation, near these poses: {brief(near)}",
                f"one standard deviation, elsewhere: {brief(self.sd_total_mm_deg)}",
            ]
        lines += [shorten(message, 88) for message in self.messages[:7]]
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """The object that `profilecal calibrate --json` prints; data/README.md says
        what each entry is. Those that are not known are None.
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
            "observability": solution and observability_entries(solution, self.frame),
            "method": "joint",
            "target": solution and target_entries(self.scans, solution),
            "messages": self.messages,
            "joint": known and joint_entries(self.scans, self.solution),
        }
        if solution and solution.delay_s is not None:
            given = any(scan.delay_ms is not None for scan in self.scans)
            entries |= {
                "delay_ms": 1e3 * solution.delay_s,
                "delay_sd_ms": 1e3 * solution.delay_sd_s,
                "delay_source": "given" if given else "estimated",
            }
        return json.loads(json.dumps(entries, default=ndarray.tolist))


def brief(mm_deg: Iterable[float]) -> str:
    """Three lengths and three angles, two digits each."""
    x, y, z, rx, ry, rz = (f"{value:.2g}" for value in mm_deg)
    return f"{x}  {y}  {z} mm, {rx}  {ry}  {rz}°"


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
    Path(path).write_text(answer_text(found) + "\n", encoding="utf-8")


def answer_text(found: Calibration) -> str:
    """What was found as JSON, with where it is from."""
    return json.dumps(found.to_json() | {"made": found.made}, indent=2)


def target_entries(scans: Sequence[Scan], solution: Solution) -> Any:
    """The targets in their places; one, or a list of several."""
    placed = zip(scans, solution.placements, strict=True)
    targets = [{"kind": scan.kind} | asdict(target) for scan, target in placed]
    return targets if len(targets) > 1 else targets[0]


def joint_entries(scans: Sequence[Scan], solution: Solution) -> dict[str, Any]:
    """All that was found, by which `check_mount` predicts other poses."""
    sizes = solution.error_sizes
    problem, prior = solution.problem, solution.prior
    shown = prior.scales.profile_mm if prior.source == "profiles" else solution.noise_mm
    frames = zip(scans, solution.state.placements, strict=True)
    robot = zip(sizes.sizes[1:], sizes.mean_v[1:], strict=True)
    robot_errors = {size.name: v**0.5 for size, v in robot}
    smooth = {}
    if SMOOTH in robot_errors:
        smooth["smooth"] = solution.smooth.known
        robot_errors["accuracy_deg"] = solution.noise.accuracy_deg
    return smooth | {
        "columns": column_names(problem, smooth=bool(smooth)),
        "mean": np.r_[np.zeros(problem.n), sizes.mean[problem.n :]],
        "covariance": sizes.covariance,
        "targets": [
            [scan.kind, scan.sizes, origin[0], axes[0]]
            for scan, (origin, axes) in frames
        ],
        "robot_errors": robot_errors | {"steering_mm": solution.noise.steering_mm},
        "freedom": sizes.freedom,
        "noise_factor": solution.noise_mm / shown,
    }


def observability_entries(solution: Solution, frame: str) -> dict[str, Any]:
    """How well each direction is determined."""
    known = solution.observability
    worst = name_direction(known.directions[0], solution.rotation, frame)
    singular_values = 1 / np.maximum(known.sd, np.finfo(float).eps)
    return {"singular_values": singular_values, "worst_direction": worst}


def calibrate(
    scans: Scan | Iterable[Scan],
    guess: ArrayLike | RigidTransform | None = None,
    guess_sd: tuple[float, float] = GUESS_SD,
) -> Calibration:
    """The sensor pose from one scan or several of one sensor.

    It is the most likely one, with the places of all targets, by all measurements
    together (notebook 40), and says how far it can be believed.

    Parameters
    ----------
    scans : Scan or iterable of Scan
        What one scanner on one mount saw of one target or several.
    guess : array (4, 4) or RigidTransform, optional
        Where the sensor is believed to be, mm; left out, what a scan has of it. The
        answer is compared with it, and rests on it where the scans leave it open, as
        `messages` then say.
    guess_sd : (float, float)
        How good the guess is: standard deviations of each component, mm and degrees.

    Returns
    -------
    Calibration
        With the status "ok", "weak" (solved, but not to be relied on) or
        "unobservable" (no pose: the motions leave it open, or the data contradict each
        other). `messages` say why, and what to do.

    Raises
    ------
    ScanError
        For scans that do not belong together or hold too little.
    TypeError
        For what is no Scan: `Scan.of` and `read_scan` make one.

    See Also
    --------
    verify : whether another scan agrees with the answer.
    self_test : whether the stated uncertainty can be believed here.

    Examples
    --------
    >>> import numpy as np
    >>> import profilecal as pc
    >>> scan, truth = pc.simulate("disk", seed=1, groups=6, positions=10)
    >>> found = pc.calibrate(scan)
    >>> found.status
    'ok'
    >>> off = found.pose - truth.pose
    >>> bool(np.abs(off[:3, 3]).max() < 0.5)  # mm
    True
    """
    if not isinstance(scans, Iterable):
        scans = [scans]  # one scan, or what is none
    scans = tuple(scans)
    check_scans(scans)
    stated, mount = stated_noise(scans), mount_of(scans, guess, guess_sd)
    check_different(scans)
    scans, merged = with_few_joined(scans)
    seen, observed, features_mm = observe_all(scans)
    check_memory(observed)
    shared_mm = max(entry.shared_mm for entry in seen)
    prior = replace(prior_from(stated, features_mm, shared_mm), mount=mount)
    notes = merged + by_scan(scans, [entry.remarks for entry in seen])
    asked = by_scan(scans, [doubts(scan) for scan in scans])
    try:
        solution, wrong = believed(scans, seen, observed, prior)
        observed, messages = tuple(solution.problem.observations), solution.messages
    except UnobservableError as error:
        solution, wrong, messages = None, False, (str(error),)
    if solution and asked and solution.status == "ok":
        solution = replace(solution, status="weak")
    readings = []
    if not solution or solution.status != "ok":
        delay_ms = 1e3 * (solution.delay_s or 0.0) if solution else 0.0
        standing = [scan.at_rest(delay_ms) for scan in scans]
        readings = by_scan(scans, [*map(better_readings, standing, seen)])
    if readings:
        messages = ()
        solution = solution and replace(solution, status="unobservable")
    return Calibration(
        scans=scans,
        seen=tuple(entry.poses for entry in seen),
        observed=observed,
        solution_or_none=solution,
        messages=(*readings, *notes, *asked, *messages),
        misread=wrong or bool(readings),
    )


def believed(
    scans: Sequence[Scan],
    seen: Sequence[Seen],
    observed: Sequence[Observations],
    prior: Prior,
) -> tuple[Solution, bool]:
    """The joint solution with the status and the messages that its residuals, the
    stated sides and what is known of the mount leave it, and whether these speak
    against it.

    Raises UnobservableError where measurements are fewer than unknowns.
    """
    mount = prior.mount
    starts = [(mount.rotation, mount.translation)] if mount else []
    alone = solve(observed, replace(prior, mount=None), starts=starts)
    solution, doubted = plausibility.check(alone)
    messages, against = [], ""
    if mount and np.isfinite(mount.sd).any():  # else a start, no more
        if solution.status != "ok":
            both, wrong = plausibility.check(solve(observed, prior, starts=starts))
            if not (wrong or contradiction(both, mount)):
                solution, doubted = both, False
                messages = rests_on(both, mount)
        if not messages and solution.status != "unobservable":
            against = contradiction(solution, mount)
    remarks, wrong_side = remarks_on_targets(scans, seen, solution)
    status = solution.status
    if status == "ok" and (wrong_side or against):
        status = "weak"
    messages += [against] * bool(against) + [*solution.messages, *remarks]
    solution = replace(solution, status=status, messages=tuple(messages))
    return solution, doubted or wrong_side or bool(against)


def mount_of(
    scans: Sequence[Scan],
    guess: ArrayLike | RigidTransform | None,
    guess_sd: Sequence[float],
) -> Mount | None:
    """What is known of the mount: a guess, or the first that a scan has."""
    for scan in scans:
        if guess is None and scan.guess is not None:
            guess, guess_sd = scan.guess, scan.guess_sd
    if guess is None:
        return None
    if isinstance(guess, Scan):
        raise TypeError("guess is a Scan; expected several scans as one list")
    if isinstance(guess, RigidTransform):
        guess = guess.as_matrix()
    T = check_array("guess", guess, (4, 4))
    check_rigid("guess", T[None])
    check_array("guess_sd", guess_sd, (2,), finite=False)
    if not min(guess_sd) > 0:
        raise ValueError(f"guess_sd is {guess_sd}; expected mm and degrees above 0")
    sd = np.repeat([guess_sd[0], np.radians(guess_sd[1])], 3)
    return Mount(T[:3, :3], T[:3, 3], sd)


def by_scan(scans: Sequence[Scan], sentences: Sequence[Iterable[str]]) -> list[str]:
    """The sentences on each scan, with its name before them where there are several."""
    pairs = zip(names(scans), sentences, strict=True)
    return [name + sentence for name, of_scan in pairs for sentence in of_scan]


def remarks_on_targets(
    scans: Sequence[Scan], seen: Sequence[Seen], solution: Solution
) -> tuple[list[str], bool]:
    """Targets that the solution puts on the other side of the scan plane than the scan
    states, in words, and whether they speak against the solution: one pose may be in
    error, but not most of them.
    """
    remarks, wrong = [], False
    parts = zip(
        names(scans),
        scans,
        seen,
        solution.problem.observations,
        solution.placements,
        strict=True,
    )
    for name, scan, entry, observed, target in parts:
        R, p = observed.R_flange[0], observed.T_flange[0]
        origins = carry(R, p, solution.translation)
        stated = scan.side[entry.poses]
        other = stated * target.sides(R @ solution.rotation, origins) < 0
        if other.any():
            labels = listed([scan.labels[i] for i in entry.poses[other]])
            remarks.append(
                f"{name}the {scan.kind}'s centre lies on the other side of the scan "
                f"plane than stated for pose {labels}; check side, x and z of the "
                "profiles, or turn the sensor's y axis round"
            )
            wrong |= bool(2 * other.sum() > np.count_nonzero(stated))
    return remarks, wrong


def check_scans(scans: Sequence[Scan]) -> None:
    """Refuse what is no scan, with TypeError, and scans of several mounts or delays."""
    if not scans:
        raise ScanError("no scans given; expected at least one")
    for scan in scans:
        check_type("scans", scan, Scan)
    if len({scan.mount for scan in scans}) > 1:
        raise ScanError(
            "some scans are eye-in-hand and others eye-to-hand; expected one mount"
        )
    delays = {scan.delay_ms for scan in scans if scan.log}
    if len(delays) > 1:
        words = " and ".join("none" if one is None else f"{one:g}" for one in delays)
        raise ScanError(f"scans state a delay_ms of {words}; expected one")


def check_different(scans: Sequence[Scan]) -> None:
    """Refuse a measurement that is there twice, by its values and its pose: it would
    count as a new one.

    Raises ScanError.
    """
    first_of: dict[str, str] = {}
    for number, scan in enumerate(scans, 1):
        title = f"scan {number} ({scan.title or scan.kind})"
        for label, known in zip(scan.labels, fingerprints(scan), strict=True):
            name = f"pose {label} of {title}"
            first = first_of.setdefault(known, name)
            if known and first != name:
                raise ScanError(
                    f"{name} holds the same measurement as {first}; "
                    "expected each measurement once"
                )
