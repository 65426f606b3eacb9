"""From a user's scans to a sensor pose with its evidence: observations, joint solution, and what to tell the user."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from profilecal.calibrate.doubts import LARGEST_ERROR_MM, LARGEST_REJECTED, judge
from profilecal.calibrate.observe import FROM_PROFILES, as_observations, names, target_seen, typical
from profilecal.closed_form.solve import solve_in_closed_form
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import xyz_angles_from_rotation
from profilecal.joint.noise import likeliest_noise
from profilecal.joint.observability import name_direction
from profilecal.joint.observations import Observations
from profilecal.joint.solution import Solution
from profilecal.joint.solve import solve
from profilecal.scan.scan import Scan, ScanError

METHODS = ("joint", "closed-form")


ROUNDS = 6  # of estimating robot errors; two or three are usual


@dataclass(frozen=True)
class Calibration:
    """A sensor pose from scans, or the reason why there is none. `to_json` is the contract with programs."""

    scans: tuple[Scan, ...]
    seen: tuple[np.ndarray, ...]  # for each scan, indices of the poses from which the target was found
    observed: tuple[Observations, ...]  # for each scan, what was seen from them
    solution: Solution | None  # None: fewer measurements than unknowns
    messages: tuple[str, ...]  # sentences a person can act on
    method: str = "joint"

    @property
    def status(self) -> str:
        """ "ok", "weak" or "unobservable"."""
        return self.solution.status if self.solution else "unobservable"

    def labels(self, rejected: bool) -> list[str]:
        """Of the poses used or rejected."""
        if not self.solution:
            return []
        pairs = zip(self.labels_by_scan(), self.solution.rejected, strict=True)
        return [label for labels, bad in pairs for label, b in zip(labels, bad, strict=True) if b == rejected]

    def labels_by_scan(self) -> list[list[str]]:
        """Of the poses from which the target was found; with the scan's title before them where there are several."""
        triples = zip(names(self.scans), self.scans, self.seen, strict=True)
        return [[before + scan.labels[i] for i in seen] for before, scan, seen in triples]

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
            "method": self.method,
            "target": targets,
            "messages": list(self.messages),
        }


def calibrate(scans, guess=None, method: str = "joint", rng: np.random.Generator | None = None) -> Calibration:
    """The sensor pose from one scan or several of one sensor, with its covariance.

    `guess`: a mount pose (4, 4), mm, to start from besides a search over all orientations. `method`: "joint", or
    "closed-form" for what the papers make of one scan; its covariance needs `rng`.

    Raises ScanError for scans that do not belong together or hold too little. Fewer measurements than unknowns give a
    Calibration without a solution.
    """
    scans = tuple(scans)
    if method not in METHODS:
        raise ScanError(f"method is {method!r}; expected {' or '.join(METHODS)}")
    if method == "closed-form" and (len(scans) > 1 or guess is not None):
        raise ScanError("the closed form takes one scan and no guess; the method joint takes more")
    if len({scan.mount for scan in scans}) > 1:
        raise ScanError("some scans are eye-in-hand and others eye-to-hand; expected one mount")
    noise = shared_noise(scans)
    check_different(scans)
    seen = tuple(target_seen(scan) for scan in scans)
    poses = tuple(entry.poses for entry in seen)
    said = [(name, m) for name, scan in zip(names(scans), scans, strict=True) for m in scan.warnings]
    said += [(name, m) for name, entry in zip(names(scans), seen, strict=True) for m in entry.remarks]
    messages = [name + message for name, message in said]
    reference = next((typical(s.kind, e.covariance) for s, e in zip(scans, seen, strict=True) if e.measured), 0.0)
    observed = tuple(as_observations(s, e, reference) for s, e in zip(scans, seen, strict=True))
    starts = [] if guess is None else [(guess[:3, :3], guess[:3, 3])]
    estimating = bool(reference) and not has_robot_errors(noise)
    shared_mm = max(entry.shared_mm for entry in seen)
    noise = replace(noise, group_position_mm=float(np.hypot(noise.group_position_mm, shared_mm)))
    try:
        if method == "closed-form":
            noise = replace(noise, profile_mm=reference or noise.profile_mm)
            solution = solve_in_closed_form(observed[0], noise, scans[0].side[poses[0]], rng)
            if reference:
                solution = replace(solution, noise_source="estimated", noise_how=FROM_PROFILES)
        elif reference:
            solution = solve_profiles(observed, replace(noise, profile_mm=reference), starts, estimating)
        else:
            solution = solve(observed, noise, starts=starts)
    except UnobservableError as error:
        return Calibration(scans, poses, observed, None, (*messages, str(error)), method)
    if method == "joint":
        solution = judge(observed, solution, estimating, any("orientation_deg" in scan.noise for scan in scans))
    sides, most = wrong_sides(scans, poses, solution)
    if most and solution.status == "ok":
        solution = replace(solution, status="weak")
    messages += [*solution.messages, *sides]
    return Calibration(scans, poses, observed, solution, tuple(messages), method)


def check_different(scans) -> None:
    """Raise ScanError where a measurement is there twice: it would count as a new one."""
    known = {}
    for name, scan in zip(names(scans), scans, strict=True):
        for label, T, values in zip(scan.labels, scan.T_base_flange, scan.values, strict=True):
            key = (T.tobytes(), values.tobytes())
            if np.isfinite(values).any() and known.setdefault(key, name + label) != name + label:
                raise ScanError(f"{name}{label}: the same measurement as {known[key]}; expected different ones")


def solve_profiles(observed, noise: Noise, starts, estimating: bool) -> Solution:
    """The joint solution from features of raw profiles, whose noise is known from the profiles themselves.

    What that noise does not explain is the robot's: all points of a profile share the error of its pose. `estimating`:
    nobody states it, so it is estimated, as a position error of each pose.
    """
    how = FROM_PROFILES
    if not estimating:
        solution = solve(observed, noise, starts=starts)
    else:
        solution = solve(observed, replace(noise, profile_mm=0.0), starts=starts)
        for _ in range(ROUNDS):
            before, noise = noise.position_mm, likeliest_noise(observed, noise, solution)
            start = (solution.rotation, solution.translation)
            absurd = noise.position_mm > LARGEST_ERROR_MM
            solution = solve(observed, noise, starts=[start], robust=not absurd, searching=False)
            absurd |= np.concatenate(solution.rejected).mean() > LARGEST_REJECTED
            if abs(noise.position_mm - before) < 0.02 * noise.position_mm or absurd:
                break
        if noise.position_mm > 0.1 * noise.profile_mm:
            how += f", and a robot position error of {noise.position_mm:.2g} mm at each pose, from the residuals"
    return replace(solution, noise_source="estimated", noise_how=how)


def has_robot_errors(noise: Noise) -> bool:
    """Whether any are stated."""
    return bool(noise.position_mm or noise.orientation_deg or noise.group_position_mm or noise.group_orientation_deg)


def shared_noise(scans) -> Noise:
    """The noise that the scans state; they speak of one scanner and one robot.

    `profile_mm` is the noise of a profile's points. How well features of profiles and fitted arcs are known is another
    matter, which is left to be estimated.
    """
    stated = {}
    for scan in scans:
        for name, value in scan.noise.items():
            if stated.setdefault(name, value) != value:
                raise ScanError(f"noise {name} is {stated[name]:g} in one scan and {value:g} in another; expected one")
    if any(scan.measured in ("arcs", "profiles") for scan in scans):
        stated.pop("profile_mm", None)
    return Noise(**stated)


def wrong_sides(scans, seen, solution: Solution) -> tuple[list[str], bool]:
    """What to say where a ball's centre lies on the other side of the scan plane than its scan states, and whether it
    does so in most poses of any scan."""
    messages, most = [], False
    for name, scan, poses, target in zip(names(scans), scans, seen, solution.placements, strict=True):
        if scan.kind == "ball" and scan.mount == "eye-in-hand":
            R, T = scan.R_base_flange[poses], scan.T_base_flange[poses]
            in_flange = np.einsum("nab,na->nb", R, target.centre - T) - solution.translation
            y = in_flange @ solution.rotation[:, 1]
            other = [scan.labels[i] for i, side in zip(poses, scan.side[poses] * y, strict=True) if side < 0]
            most |= 2 * len(other) > np.count_nonzero(scan.side[poses])
            if other:
                messages.append(
                    f"{name}the ball's centre lies on the other side of the scan plane than stated for pose "
                    f"{', '.join(other)}; check side, x and z of the profiles, or turn the sensor's y axis round"
                )
    return messages, most


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
