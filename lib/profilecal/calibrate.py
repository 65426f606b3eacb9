"""From a user's scans to a sensor pose with its evidence: observations, joint solution, and what to tell the user."""

from collections import Counter
from dataclasses import asdict, dataclass

import numpy as np
from scipy.stats import chi2

from profilecal import joint
from profilecal.checks import UnobservableError
from profilecal.features import find_features
from profilecal.observability import LEAST_TURN_DEG, name_axis, name_direction, turns
from profilecal.poses import xyz_angles_from_rotation
from profilecal.scan import Scan, ScanError
from profilecal.simulate import Noise

LEAST_POSES = 3
FALSE_ALARM = 0.01  # the chance that `check` doubts any pose of a good scan


@dataclass(frozen=True)
class Calibration:
    """A sensor pose from scans, or the reason why there is none. `to_json` is the contract with programs."""

    scans: tuple[Scan, ...]
    seen: tuple[np.ndarray, ...]  # for each scan, indices of the poses from which the target was found
    observed: tuple[joint.Observations, ...]  # for each scan, what was seen from them
    solution: joint.Solution | None  # None: fewer measurements than unknowns
    messages: tuple[str, ...]  # sentences a person can act on

    @property
    def status(self) -> str:
        """ "ok", "weak" or "unobservable"."""
        return self.solution.status if self.solution else "unobservable"

    def labels(self, rejected: bool) -> list[str]:
        """Of the poses used or rejected; with the scan's title before them where there are several scans."""
        names = []
        if not self.solution:
            return names
        for scan, seen, bad in zip(self.scans, self.seen, self.solution.rejected, strict=True):
            before = f"{scan.title or scan.kind}: " if len(self.scans) > 1 else ""
            names += [before + scan.labels[i] for i, b in zip(seen, bad, strict=True) if b == rejected]
        return names

    def to_json(self) -> dict:
        """The object that `profilecal calibrate --json` prints; data/README.md says what each entry is."""
        s, known = self.solution, self.status != "unobservable"
        frame = "flange" if self.scans[0].mount == "eye-in-hand" else "base"
        observability, targets = None, None
        if s:
            observability = {
                "singular_values": (1 / s.observability.sd).tolist(),
                "worst_direction": name_direction(s.observability.directions[0], s.rotation, frame),
            }
            targets = [
                {"kind": scan.kind} | {key: np.asarray(value).tolist() for key, value in asdict(target).items()}
                for scan, target in zip(self.scans, s.placements, strict=True)
            ]
            targets = targets[0] if len(targets) == 1 else targets
        return {
            "status": self.status,
            f"T_{frame}_sensor": s.T_flange_sensor.tolist() if known else None,
            "covariance": s.covariance_mm_deg.tolist() if known else None,
            "translation_sd_mm": s.translation_sd_mm.tolist() if known else None,
            "rotation_sd_deg": s.rotation_sd_deg.tolist() if known else None,
            "rms_mm": s.rms_mm if s else None,
            "chi2_per_dof": s.chi2_per_dof if s else None,
            "noise_mm": s.noise_mm if s else None,
            "noise_source": s.noise_source if s else None,
            "poses_used": self.labels(rejected=False),
            "poses_rejected": self.labels(rejected=True),
            "observability": observability,
            "method": "joint",
            "target": targets,
            "messages": list(self.messages),
        }


def calibrate(scans, guess=None) -> Calibration:
    """The sensor pose from one scan or several of one sensor, with its covariance.

    `guess`: a mount pose (4, 4), mm, to start from besides a search over all orientations.

    Raises ScanError for scans that do not belong together or hold too little, UnobservableError for fewer
    measurements than unknowns.
    """
    scans = tuple(scans)
    if len({scan.mount for scan in scans}) > 1:
        raise ScanError("some scans are eye-in-hand and others eye-to-hand; expected one mount")
    observed, seen, messages = [], [], []
    for scan in scans:
        poses, points, reasons = observations(scan)
        messages += [*scan.warnings, *reasons]
        if len(poses) < LEAST_POSES:
            name = scan.title or f"the {scan.kind}"
            raise ScanError(f"{name}: the target was found from {len(poses)} poses; expected {LEAST_POSES} or more")
        seen.append(poses)
        observed.append(as_observations(scan, poses, points))
    starts = [] if guess is None else [(guess[:3, :3], guess[:3, 3])]
    try:
        solution = joint.solve(observed, shared_noise(scans), starts=starts)
    except UnobservableError as error:
        return Calibration(scans, tuple(seen), tuple(observed), None, (*messages, str(error)))
    messages += [*solution.messages, *wrong_sides(scans, seen, solution)]
    return Calibration(scans, tuple(seen), tuple(observed), solution, tuple(messages))


def observations(scan: Scan) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Indices of the poses that saw the target, what they saw (poses, m, 2), and why the others did not."""
    if scan.measured == "profiles":
        found = find_features(scan.kind, scan.values, scan.radius)
        why = [f"pose {label} left out: {f.reason}" for label, f in zip(scan.labels, found, strict=True) if f.reason]
        poses = np.flatnonzero([not f.reason for f in found])
        most = max((len(found[i].points) for i in poses), default=1)
        points = np.full((len(poses), most, 2), np.nan)
        for row, i in enumerate(poses):
            points[row, : len(found[i].points)] = found[i].points
        return poses, points, why

    rows = [values[np.isfinite(values).all(axis=1)] for values in scan.values]
    poses = np.flatnonzero([len(r) > 0 for r in rows])
    missed = [label for label, r in zip(scan.labels, rows, strict=True) if not len(r)]
    why = [f"no {scan.measured[:-1]} from pose {', '.join(missed)}"] if missed else []
    values = np.concatenate([rows[i][:1] for i in poses]) if len(poses) else np.empty((0, 4))
    if scan.measured == "chords":
        tips = values.reshape(-1, 2, 2)
        return poses, np.take_along_axis(tips, np.argsort(tips[..., :1], axis=1), axis=1), why
    if scan.measured == "arcs":
        return poses, circle_points(values), why
    return poses, values[:, None, :], why


def circle_points(circles) -> np.ndarray:
    """Three points (n, 3, 2) a third of a turn apart on circles (n, 3) x, z, r: they stand for centre and radius."""
    angle = np.radians([90, 210, 330])
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return circles[:, None, :2] + circles[:, None, 2:] * around


def as_observations(scan: Scan, poses, points) -> joint.Observations:
    """What the joint calibration takes of one scan."""
    R, T = scan.R_base_flange[poses], scan.T_base_flange[poses]
    if scan.mount == "eye-to-hand":
        R = R.transpose(0, 2, 1)
        T = -np.einsum("nab,nb->na", R, T)
    group = scan.group[poses] if scan.group is not None else None
    return joint.Observations(
        scan.kind, R[None], T[None], points[None], scan.radius, group, scan.mount == "eye-to-hand"
    )


def shared_noise(scans) -> Noise:
    """The noise that the scans state; they speak of one scanner and one robot.

    `profile_mm` is the noise of a profile's points. How well a circle fits is another matter, so that with arcs it is
    left to be estimated.
    """
    stated = {}
    for scan in scans:
        for name, value in scan.noise.items():
            if stated.setdefault(name, value) != value:
                raise ScanError(f"noise {name} is {stated[name]:g} in one scan and {value:g} in another; expected one")
    if any(scan.measured == "arcs" for scan in scans):
        stated.pop("profile_mm", None)
    return Noise(**stated)


def wrong_sides(scans, seen, solution: joint.Solution) -> list[str]:
    """Says so where a ball's centre lies on the other side of the scan plane than the scan states."""
    messages = []
    for scan, poses, target in zip(scans, seen, solution.placements, strict=True):
        if scan.kind == "ball" and scan.mount == "eye-in-hand":
            R, T = scan.R_base_flange[poses], scan.T_base_flange[poses]
            in_flange = np.einsum("nab,na->nb", R, target.centre - T) - solution.translation
            y = in_flange @ solution.rotation[:, 1]
            other = [scan.labels[i] for i, side in zip(poses, scan.side[poses] * y, strict=True) if side < 0]
            if other:
                messages.append(
                    f"the ball's centre lies on the other side of the scan plane than stated for pose {', '.join(other)}; "
                    "check the column side, or turn the sensor's y axis round"
                )
    return messages


def check(scan: Scan) -> list[str]:
    """What a scan holds, in lines for people: convention, groups, noise and outliers known before any calibration."""
    poses, points, reasons = observations(scan)
    P, groups = len(scan.labels), scan.group.max() + 1
    reach = np.linalg.norm(scan.T_base_flange, axis=1)
    angles, axis = turns(scan.R_base_flange)
    lines = [
        f"target         {scan.kind}" + (f", radius {scan.radius:g} mm" if scan.radius else ""),
        f"poses          {P}, {scan.mount}, orientation as {scan.convention}; {len(poses)} show the target",
        f"positions      {reach.min():.0f} to {reach.max():.0f} mm from the base",
        f"groups         {groups} of one orientation, {'given' if scan.group_given else 'found'}: "
        + ", ".join(f"{count} of {size} poses" for size, count in Counter(np.bincount(scan.group).tolist()).items()),
        f"turns          {angles[0]:.3g}, {angles[1]:.3g}, {angles[2]:.3g}° about the flange's axes, "
        f"least about {name_axis(axis, 'flange')}",
    ]
    if angles[2] < LEAST_TURN_DEG:
        lines.append("note           add poses tilted by 15° or more about two axes, or something stays unknown")
    if scan.kind in ("edge", "point") and len(poses):
        seen = as_observations(scan, poses, points)
        noise, freedom = joint.affine_noise(seen)
        if freedom:
            lines.append(f"noise          {noise:.3g} mm inside groups, from {freedom} degrees of freedom")
            lines += [
                f"note           pose {scan.labels[poses[i]]} does not fit its group" for i in affine_outliers(seen)
            ]
        else:
            lines.append("noise          unknown before the calibration: groups have too few poses (5 or more each)")
    return [*lines, *(f"note           {text}" for text in (*scan.warnings, *reasons))]


def affine_outliers(observations: joint.Observations) -> list[int]:
    """Poses whose point does not fit its group, by the relation that needs no calibration.

    Inside a group the sensed point of an edge or a marked point is an affine function of the flange position. The pose
    that fits worst is taken out as long as chance does not explain it; a whole group on a wrong edge is not seen.
    """
    noise = joint.affine_noise(observations)[0]
    points, bad = observations.points[0, :, 0], []
    limit = chi2.isf(FALSE_ALARM / len(points), 2)
    for label in np.unique(observations.group):
        rows = np.flatnonzero(observations.group == label)
        while len(rows) > 3:
            T = observations.T_flange[0, rows]
            U, s, _ = np.linalg.svd(T - T.mean(axis=0), full_matrices=False)
            basis = np.column_stack([np.full(len(rows), len(rows) ** -0.5), U[:, s > 1e-3 * s.max()]])
            left = points[rows] - basis @ (basis.T @ points[rows])
            free = 1 - np.sum(basis**2, axis=1)
            if len(rows) <= basis.shape[1] or free.min() < 1e-6:
                break
            size = np.sum(left**2, axis=1) / free / noise**2
            if size.max() < limit:
                break
            bad.append(int(rows[size.argmax()]))
            rows = np.delete(rows, size.argmax())
    return sorted(bad)


def to_text(found: Calibration) -> str:
    """What `profilecal calibrate` prints for people."""
    s, lines = found.solution, [f"status         {found.status}"]
    if found.status != "unobservable":
        frame = "flange" if found.scans[0].mount == "eye-in-hand" else "base"
        W, P, R = np.degrees(xyz_angles_from_rotation(s.rotation))
        W = (W + 180) % 360 - 180
        tx, ty, tz = s.translation
        lines += [
            f"translation    {tx:.3f}  {ty:.3f}  {tz:.3f} mm, of the sensor's origin in the {frame} frame",
            f"rotation       {W:.4f}  {P:.4f}  {R:.4f}°, R = Rz({R:.4f}) Ry({P:.4f}) Rx({W:.4f})",
            "one sd         "
            + "  ".join(f"{v:.2g}" for v in s.translation_sd_mm)
            + " mm along and "
            + "  ".join(f"{v:.2g}" for v in s.rotation_sd_deg)
            + "° about the sensor's x, y, z",
        ]
    if s:
        rejected = found.labels(rejected=True)
        lines += [
            f"residuals      {s.rms_mm:.3g} mm rms, χ²/dof {s.chi2_per_dof:.3g}",
            f"noise          {s.noise_mm:.3g} mm, {s.noise_how}",
            f"poses          {len(found.labels(rejected=False))} used, {len(rejected)} rejected"
            + (f": {', '.join(rejected)}" if rejected else ""),
        ]
    return "\n".join([*lines, *(f"note           {message}" for message in found.messages)])
