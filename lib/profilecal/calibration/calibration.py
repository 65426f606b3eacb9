"""From a user's scans to a sensor pose with its evidence: observations, joint solution,
and what to tell the user.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from profilecal.calibration import plausibility
from profilecal.calibration.observe import names, observe_all, stated_noise
from profilecal.calibration.other_conventions import better_readings
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.observability import name_direction
from profilecal.geometry.poses import carry
from profilecal.joint.prior import prior_from
from profilecal.joint.solution import Solution
from profilecal.joint.solve import solve
from profilecal.scan.scan import Scan, ScanError
from profilecal.targets.observations import Observations


@dataclass(frozen=True)
class Calibration:
    """A sensor pose from scans, or the reason why there is none. `to_json` is the
    contract with programs.
    """

    scans: tuple[Scan, ...]
    # for each scan, indices of the poses from which the target was found
    seen: tuple[np.ndarray, ...]
    observed: tuple[Observations, ...]  # for each scan, what was seen from them
    solution: Solution | None = None  # None: fewer measurements than unknowns
    messages: tuple[str, ...] = ()  # sentences a person can act on
    # the data contradict what is stated, as `messages` say: more poses would not mend
    # it
    misread: bool = False

    @property
    def status(self) -> str:
        """ "ok", "weak" or "unobservable"."""
        return self.solution.status if self.solution else "unobservable"

    @property
    def frame(self) -> str:
        """The one that the sensor's pose is in: "flange", or "base" where the scanner
        stands still.
        """
        return "flange" if self.scans[0].mount == "eye-in-hand" else "base"

    def labels(self, rejected: bool) -> list[str]:
        """Of the poses used or rejected."""
        if not self.solution:
            return []
        pairs = zip(self.labels_by_scan(), self.solution.rejected, strict=True)
        return [
            label
            for labels, bad in pairs
            for label, b in zip(labels, bad, strict=True)
            if b == rejected
        ]

    def labels_by_scan(self) -> list[list[str]]:
        """Of the poses from which the target was found; with the scan's title before
        them where there are several.
        """
        triples = zip(names(self.scans), self.scans, self.seen, strict=True)
        return [
            [before + scan.labels[i] for i in seen] for before, scan, seen in triples
        ]

    def to_json(self) -> dict:
        """The object that `profilecal calibrate --json` prints; data/README.md says
        what each entry is.
        """
        s, known, frame = self.solution, self.status != "unobservable", self.frame
        observability, targets = None, None
        if s:
            observability = {
                "singular_values": (
                    1 / np.maximum(s.observability.sd, np.finfo(float).eps)
                ).tolist(),
                "worst_direction": name_direction(
                    s.observability.directions[0], s.rotation, frame
                ),
            }
            targets = [
                {"kind": scan.kind}
                | {
                    key: np.asarray(value).tolist()
                    for key, value in asdict(target).items()
                }
                for scan, target in zip(self.scans, s.placements, strict=True)
            ]
            targets = targets[0] if len(targets) == 1 else targets
            sd = np.sqrt(np.diag(in_mm_deg(s.covariance))).tolist()
        return {
            "status": self.status,
            f"T_{frame}_sensor": s.pose.tolist() if known else None,
            "covariance": in_mm_deg(s.covariance).tolist() if known else None,
            "covariance_total": in_mm_deg(s.covariance_total).tolist()
            if known
            else None,
            "translation_sd_mm": sd[:3] if known else None,
            "rotation_sd_deg": sd[3:] if known else None,
            **{
                name: getattr(s, name, None)
                for name in ("rms_mm", "chi2_per_dof", "noise_mm", "noise_source")
            },
            "poses_used": self.labels(rejected=False),
            "poses_rejected": self.labels(rejected=True),
            "observability": observability,
            "method": "joint",
            "target": targets,
            "messages": list(self.messages),
        }


def calibrate(scans, guess=None) -> Calibration:
    """The sensor pose from one scan or several of one sensor; no solution where
    measurements are fewer than unknowns.

    `guess`: a mount pose (4, 4), mm, to start from besides a search over all
    orientations. Raises ScanError for scans that do not belong together or hold too
    little.

    >>> from profilecal.simulation.spec import Spec, simulate_scan
    >>> scan = simulate_scan(Spec(kind="disk", groups=6, positions=10))
    >>> found = calibrate([scan])
    >>> found.status
    'ok'
    >>> off = found.solution.pose - scan.truth["T_flange_sensor"]
    >>> bool(np.abs(off[:3, 3]).max() < 0.5)  # mm
    True
    """
    scans = tuple(scans)
    if len({scan.mount for scan in scans}) > 1:
        raise ScanError(
            "some scans are eye-in-hand and others eye-to-hand; expected one mount"
        )
    stated = stated_noise(scans)
    check_different(scans)
    seen, observed, features_mm = observe_all(scans)
    prior = prior_from(stated, features_mm, max(entry.shared_mm for entry in seen))
    solution, doubted, wrong = None, False, False
    try:
        solution = solve(
            observed,
            prior,
            starts=[] if guess is None else [(guess[:3, :3], guess[:3, 3])],
        )
        solution, doubted = plausibility.check(solution)
        remarks, wrong = remarks_on_targets(scans, seen, solution)
        if wrong and solution.status == "ok":
            solution = replace(solution, status="weak")
        messages = [*solution.messages, *remarks]
    except UnobservableError as error:
        messages = [str(error)]

    def by_scan(sentences) -> list[str]:
        return [
            name + said
            for name, own in zip(names(scans), sentences, strict=True)
            for said in own
        ]

    notes = by_scan(entry.remarks for entry in seen)
    readings = (
        []
        if solution and solution.status == "ok"
        else by_scan(map(better_readings, scans, seen))
    )
    messages = [*readings, *notes] if readings else [*notes, *messages]
    poses = tuple(entry.poses for entry in seen)
    return Calibration(
        scans,
        poses,
        observed,
        solution,
        tuple(messages),
        misread=doubted or wrong or bool(readings),
    )


def in_mm_deg(covariance) -> np.ndarray:
    """A covariance (6, 6) of δ with the rotation vector in degrees."""
    units = np.repeat([1, 180 / np.pi], 3)
    return covariance * units[:, None] * units


def remarks_on_targets(scans, seen, solution: Solution) -> tuple[list[str], bool]:
    """Targets that the solution puts on the other side of the scan plane than the scan
    states, in words, and whether they speak against the solution: one pose may be in
    error, but not most of them.
    """
    remarks, wrong = [], False
    for name, scan, entry, target in zip(
        names(scans), scans, seen, solution.placements, strict=True
    ):
        if scan.side is None:
            continue
        stated, (R, T) = scan.side[entry.poses], scan.base_flange(entry.poses)
        other = (
            stated
            * target.sides(R @ solution.rotation, carry(R, T, solution.translation))
            < 0
        )
        if other.any():
            labels = ", ".join(scan.labels[i] for i in entry.poses[other])
            remarks.append(
                f"{name}the {scan.kind}'s centre lies on the other side of the scan plane than stated for pose "
                f"{labels}; check side, x and z of the profiles, or turn the sensor's y axis round"
            )
            wrong |= bool(2 * other.sum() > np.count_nonzero(stated))
    return remarks, wrong


def check_different(scans) -> None:
    """Raise ScanError where a measurement is there twice, by its values and its pose:
    it would count as a new one.
    """
    known, titles = (
        {},
        [
            f"scan {number} ({scan.title or scan.kind})"
            for number, scan in enumerate(scans, 1)
        ],
    )
    for title, scan in zip(titles, scans, strict=True):
        # not -0
        poses = np.dstack([scan.R_base_flange, scan.p_base_flange]).round(3) + 0.0
        for label, pose, values in zip(scan.labels, poses, scan.values, strict=True):
            valid, name = (
                values[np.isfinite(values).all(axis=1)],
                f"pose {label} of {title}",
            )
            if (
                len(valid)
                and known.setdefault((pose.tobytes(), valid.tobytes()), name) != name
            ):
                first = known[pose.tobytes(), valid.tobytes()]
                raise ScanError(
                    f"{name} holds the same measurement as {first}; expected each measurement once"
                )
