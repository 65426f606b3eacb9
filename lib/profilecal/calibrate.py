"""From a user's scans to a sensor pose with its evidence: observations, joint solution, and what to tell the user."""

from collections import Counter
from dataclasses import asdict, dataclass, replace
from textwrap import shorten

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

from profilecal import joint, two_phase
from profilecal.checks import UnobservableError
from profilecal.doubts import LARGEST_ERROR_MM, LARGEST_REJECTED, judge
from profilecal.features import find_features
from profilecal.observability import LEAST_TURN_DEG, RANK, name_axis, name_direction, turns
from profilecal.poses import xyz_angles_from_rotation
from profilecal.scan import Scan, ScanError
from profilecal.simulate import Noise

FROM_PROFILES = "from the profiles themselves"
METHODS = ("joint", "closed-form")
LEAST_POSES = 3
FINEST_MM = 1e-4  # of features: points exactly on a line have no scatter to tell their noise by
ROUNDS = 6  # of estimating robot errors; two or three are usual
FALSE_ALARM = 0.01  # the chance that `check` doubts any pose of a good scan


@dataclass(frozen=True)
class Seen:
    """What a scan shows of its target."""

    poses: np.ndarray  # (k,) indices of those that saw it
    points: np.ndarray  # (k, m, 2) what they saw, mm
    covariance: np.ndarray | None = None  # of it by the profiles themselves, mm², as `joint.Observations` has it
    shared_mm: float = 0.0  # the part of its error that poses of one orientation share
    remarks: tuple[str, ...] = ()  # why the other poses did not see it, and what else there is to say

    @property
    def measured(self) -> bool:
        """Whether the profiles tell the noise."""
        return self.covariance is not None


@dataclass(frozen=True)
class Calibration:
    """A sensor pose from scans, or the reason why there is none. `to_json` is the contract with programs."""

    scans: tuple[Scan, ...]
    seen: tuple[np.ndarray, ...]  # for each scan, indices of the poses from which the target was found
    observed: tuple[joint.Observations, ...]  # for each scan, what was seen from them
    solution: joint.Solution | None  # None: fewer measurements than unknowns
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
            solution = two_phase.solve(observed[0], noise, scans[0].side[poses[0]], rng)
            if reference:
                solution = replace(solution, noise_source="estimated", noise_how=FROM_PROFILES)
        elif reference:
            solution = solve_profiles(observed, replace(noise, profile_mm=reference), starts, estimating)
        else:
            solution = joint.solve(observed, noise, starts=starts)
    except UnobservableError as error:
        return Calibration(scans, poses, observed, None, (*messages, str(error)), method)
    if method == "joint":
        solution = judge(observed, solution, estimating, any("orientation_deg" in scan.noise for scan in scans))
    sides, most = wrong_sides(scans, poses, solution)
    if most and solution.status == "ok":
        solution = replace(solution, status="weak")
    messages += [*solution.messages, *sides]
    return Calibration(scans, poses, observed, solution, tuple(messages), method)


def names(scans) -> list[str]:
    """What to put before a word on one of several scans: its title."""
    return [f"{scan.title or scan.kind}: " if len(scans) > 1 else "" for scan in scans]


def check_different(scans) -> None:
    """Raise ScanError where a measurement is there twice: it would count as a new one."""
    known = {}
    for name, scan in zip(names(scans), scans, strict=True):
        for label, T, values in zip(scan.labels, scan.T_base_flange, scan.values, strict=True):
            key = (T.tobytes(), values.tobytes())
            if np.isfinite(values).any() and known.setdefault(key, name + label) != name + label:
                raise ScanError(f"{name}{label}: the same measurement as {known[key]}; expected different ones")


def target_seen(scan: Scan) -> Seen:
    """`observations` of a scan. Raises ScanError where there are too few."""
    seen = observations(scan)
    if len(seen.poses) < LEAST_POSES:
        name = scan.title or f"the {scan.kind}"
        why = "; ".join(remark.rsplit(": ", 1)[0] for remark in seen.remarks)
        raise ScanError(
            f"{name}: the target was found from {len(seen.poses)} poses; expected {LEAST_POSES} or more"
            + (f" ({shorten(why, 300)})" if why else "")
        )
    return seen


def solve_profiles(observed, noise: Noise, starts, estimating: bool) -> joint.Solution:
    """The joint solution from features of raw profiles, whose noise is known from the profiles themselves.

    What that noise does not explain is the robot's: all points of a profile share the error of its pose. `estimating`:
    nobody states it, so it is estimated, as a position error of each pose.
    """
    how = FROM_PROFILES
    if not estimating:
        solution = joint.solve(observed, noise, starts=starts)
    else:
        solution = joint.solve(observed, replace(noise, profile_mm=0.0), starts=starts)
        for _ in range(ROUNDS):
            before, noise = noise.position_mm, likeliest_noise(observed, noise, solution)
            start = (solution.rotation, solution.translation)
            absurd = noise.position_mm > LARGEST_ERROR_MM
            solution = joint.solve(observed, noise, starts=[start], robust=not absurd, searching=False)
            absurd |= np.concatenate(solution.rejected).mean() > LARGEST_REJECTED
            if abs(noise.position_mm - before) < 0.02 * noise.position_mm or absurd:
                break
        if noise.position_mm > 0.1 * noise.profile_mm:
            how += f", and a robot position error of {noise.position_mm:.2g} mm at each pose, from the residuals"
    return replace(solution, noise_source="estimated", noise_how=how)


def has_robot_errors(noise: Noise) -> bool:
    """Whether any are stated."""
    return bool(noise.position_mm or noise.orientation_deg or noise.group_position_mm or noise.group_orientation_deg)


def likeliest_noise(observed, noise: Noise, solution: joint.Solution) -> Noise:
    """The noise with the profile and robot position errors that make the residuals of the poses kept most likely.

    A pose's position error moves all its points together, the scanner's noise each by itself. Where poses have a point
    or two only, the two cannot be told apart and the scanner's is kept. What fitting the unknowns took out of the
    residuals is allowed for: restricted maximum likelihood (Patterson and Thompson 1971).
    """
    problem = joint.Problem(observed, noise)
    state = solution.state
    shared, lever, own, count, start = [], [], 0.0, 0, 6
    for term, placement, bad in zip(problem.terms, state.placements, solution.rejected, strict=True):
        z, present = term.linearise(state, placement, True, with_robot=True)
        z = term.in_units_of_noise(z, np.ones((1, 1, 1)))[0][..., ~bad].transpose(2, 1, 0)  # (P, K, columns)
        Jr = np.zeros((*z.shape[:2], problem.n + 1))
        Jr[..., np.r_[0:6, start : start + term.n, problem.n]] = z[..., : 7 + term.n]
        U, size, _ = np.linalg.svd(z[..., -6:-3], full_matrices=False)  # by the position of the flange
        along = np.einsum("pki,pkn->pin", U, Jr)
        shared.append(along.reshape(-1, problem.n + 1))
        lever.append(size.ravel())
        own += np.einsum("pkn,pkm->nm", Jr, Jr) - np.einsum("pin,pim->nm", along, along)
        count += Jr[..., 0].size - size.size - (0 if present is None else np.sum(~present[0][:, ~bad]))
        start += term.n
    shared, lever = np.concatenate(shared), np.concatenate(lever)
    many = count > len(lever)

    units = np.append(joint.units_by_hand(problem), 1.0)
    own, shared = own * units[:, None] * units, shared * units
    values, vectors = np.linalg.eigh((own + shared.T @ shared)[:-1, :-1])
    known = vectors[:, values > RANK * values[-1]]

    def unlikely(levels):
        profile = np.exp(2 * levels[1]) if many else noise.profile_mm**2
        variance = profile + np.exp(2 * levels[0]) * lever**2
        M = own / profile + (shared.T / variance) @ shared
        A, b = known.T @ M[:-1, :-1] @ known, known.T @ M[:-1, -1]
        chi2 = M[-1, -1] - b @ np.linalg.solve(A, b)
        return chi2 + np.log(variance).sum() + count * np.log(profile) + np.linalg.slogdet(A)[1]

    start = np.log([np.sqrt(np.mean(shared[:, -1] ** 2) + 1e-12), noise.profile_mm])
    found = np.exp(minimize(unlikely, start if many else start[:1], method="Nelder-Mead", options={"xatol": 1e-3}).x)
    return replace(noise, profile_mm=float(found[1]) if many else noise.profile_mm, position_mm=float(found[0]))


def observations(scan: Scan) -> Seen:
    """The target as a scan's profiles show it, or as the points, chords or arcs that it holds."""
    if scan.measured == "profiles":
        found = find_features(scan.kind, scan.values, scan.radius)
        reasons = {}
        for label, feature in zip(scan.labels, found, strict=True):
            if feature.reason:
                reasons.setdefault(feature.reason, []).append(label)
        why = [f"{len(labels)} left out, {reason}: {', '.join(labels)}" for reason, labels in reasons.items()]
        poses = np.flatnonzero([not f.reason for f in found])
        most = max((len(found[i].points) for i in poses), default=1)
        points = np.full((len(poses), most, 2), np.nan)
        for row, i in enumerate(poses):
            points[row, : len(found[i].points)] = found[i].points
        covariance, shared = covariances(scan.kind, [found[i] for i in poses], most), 0.0
        if any(f.shape == "tip" for f in found):
            shared = typical(scan.kind, covariance)
            why.append(
                "edge points are tips of a blade, which the scanner sees beside the edge by an amount that depends on "
                f"the orientation: {shared:.2g} mm for each are counted in; corners and ends of flat faces are better"
            )
        return Seen(poses, points, covariance, shared, tuple(why))

    rows = [values[np.isfinite(values).all(axis=1)] for values in scan.values]
    poses = np.flatnonzero([len(r) > 0 for r in rows])
    missed = [label for label, r in zip(scan.labels, rows, strict=True) if not len(r)]
    why = (f"no {scan.measured[:-1]} from pose {', '.join(missed)}",) if missed else ()
    values = np.concatenate([rows[i][:1] for i in poses]) if len(poses) else np.empty((0, 4))
    if scan.measured == "chords":
        tips = values.reshape(-1, 2, 2)
        points = np.take_along_axis(tips, np.argsort(tips[..., :1], axis=1), axis=1)
    elif scan.measured == "arcs":
        points = circle_points(values)
    else:
        points = values[:, None, :]
    return Seen(poses, points, remarks=why)


def covariances(kind: str, found, most: int) -> np.ndarray:
    """Of `most` points of each feature, mm², as `joint.Observations` has them: arcs' and lines' are independent and as
    uncertain in every direction, chords have tips on one line."""
    if kind in ("ball", "plane"):
        variance = np.ones((len(found), most))
        for row, feature in zip(variance, found, strict=True):
            row[: len(feature.points)] = np.trace(feature.covariance, axis1=1, axis2=2) / 2 + FINEST_MM**2
        return variance
    covariance = np.zeros((len(found), most, 2, most, 2))
    for pairs, feature in zip(covariance, found, strict=True):
        for k in range(most):
            pairs[k, :, k] = feature.covariance[k] + FINEST_MM**2 * np.eye(2)
        if feature.between is not None:
            pairs[0, :, 1], pairs[1, :, 0] = feature.between, feature.between.T
    return covariance.reshape(len(found), 2 * most, 2 * most)


def typical(kind: str, covariance) -> float:
    """The standard deviation of a coordinate of most poses' features, mm."""
    variance = covariance if kind in ("ball", "plane") else np.diagonal(covariance, axis1=1, axis2=2)
    return float(np.median(np.sqrt(variance.mean(axis=1))))


def circle_points(circles) -> np.ndarray:
    """Three points (n, 3, 2) a third of a turn apart on circles (n, 3) x, z, r: they stand for centre and radius."""
    angle = np.radians([90, 210, 330])
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return circles[:, None, :2] + circles[:, None, 2:] * around


def as_observations(scan: Scan, seen: Seen, reference: float = 0.0) -> joint.Observations:
    """What the joint calibration takes of one scan, its covariance in units of the noise `reference`, mm."""
    R, T = scan.R_base_flange[seen.poses], scan.T_base_flange[seen.poses]
    if scan.mount == "eye-to-hand":
        R = R.transpose(0, 2, 1)
        T = -np.einsum("nab,nb->na", R, T)
    group = scan.group[seen.poses] if scan.group is not None else None
    covariance = seen.covariance[None] / reference**2 if seen.measured and reference else None
    to_hand = scan.mount == "eye-to-hand"
    return joint.Observations(scan.kind, R[None], T[None], seen.points[None], scan.radius, group, to_hand, covariance)


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


def wrong_sides(scans, seen, solution: joint.Solution) -> tuple[list[str], bool]:
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


def check(scan: Scan) -> list[str]:
    """What a scan holds, in lines for people: convention, groups, noise and outliers known before any calibration."""
    seen = observations(scan)
    poses, P, groups = seen.poses, len(scan.labels), scan.group.max() + 1
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
        observed = as_observations(scan, seen)
        noise, freedom = joint.affine_noise(observed)
        if freedom:
            lines.append(f"noise          {noise:.3g} mm inside groups, from {freedom} degrees of freedom")
            lines += [
                f"note           pose {scan.labels[poses[i]]} does not fit its group" for i in affine_outliers(observed)
            ]
        else:
            lines.append("noise          unknown before the calibration: groups have too few poses (5 or more each)")
    return [*lines, *(f"note           {text}" for text in (*scan.warnings, *seen.remarks))]


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
