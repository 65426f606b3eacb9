"""What a scan lacks: the next best poses, from the scan and its answer alone."""

from dataclasses import replace

import numpy as np

from profilecal.calibrate.calibration import Calibration
from profilecal.calibrate.observe import Seen, as_observations, stated_noise
from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import inverse, nearest_rotation
from profilecal.joint.descent import settle_targets
from profilecal.joint.noise import prior_from
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.plan.candidates import Limits, aside
from profilecal.plan.plan import Wishes, design
from profilecal.plan.setup import Part, Setup
from profilecal.scan.scan import Scan, ScanError
from profilecal.simulate.guess import Margins
from profilecal.simulate.scanner import Scanner
from profilecal.targets import TARGETS
from profilecal.targets.target import Target

ROUND_MM = 10.0  # beyond what was seen, the scanner is believed to see
REACH_MM = 200.0  # beyond the poses of the scan, the robot is believed to reach
LEAST_EXTENT_MM = 20.0
FEW = {"candidates": 300, "polishes": 0}  # a plan that is done in about a second
FEW_POSES = 8
OPEN = "the scan leaves the mount open: state it roughly in the [guess] of a SPEC.toml, and plan with --after"


def setup_of_scan(found: Calibration) -> tuple[Setup, Limits, Part]:
    """What the first scan of a calibration says of sensor, target and robot; where the robot may go from there; and the
    poses that it used. Raises ScanError where there is no solution."""
    s, scan, observed = found.solution, found.scans[0], found.observed[0]
    if s is None:
        raise ScanError("the scan holds fewer measurements than unknowns; plan from a specification with [guess]")
    kept = s.kept[0]
    R, T = observed.R_flange[0][kept], observed.T_flange[0][kept]
    level = prior_from(stated_noise(found.scans))
    robot = {name: getattr(level.prior.scales, name) for name in ROBOT}
    if s.level.found:
        sizes = s.level.found.sizes[1:]
        part_of_others = {*ROBOT} - {size.name for size in sizes}  # where no pose is repeated, the errors of a visit
        robot |= {size.name: size.middle for size in sizes if size.from_data and size.name in ROBOT}
        robot |= dict.fromkeys(part_of_others, 0.0)
    setup = Setup(
        target=s.placements[0],
        facing=nearest_rotation((R @ s.rotation).mean(axis=0)),
        R_sensor=s.rotation,
        T_sensor=s.translation,
        scanner=scanner_of(scan, observed),
        noise=replace(s.noise, **robot),
        systematic=level.systematic,
        to_hand=observed.eye_to_hand,
        measured=scan.measured,
        covariance=typical_covariance(observed),
        margins=Margins(0, 0, 0, 0),
        count=observed.points.shape[2],
    )
    flange = inverse(R, T)[1] if setup.to_hand else T
    limits = Limits(
        low=tuple(flange.min(axis=0) - REACH_MM),
        high=tuple(flange.max(axis=0) + REACH_MM),
        tilt_deg=25.0,
        spin_deg=45.0,
        extent_mm=max(LEAST_EXTENT_MM, float(aside(setup, R, T).max())),
    )
    return setup, limits, (setup, R, T)


def typical_covariance(observed: Observations) -> np.ndarray | None:
    """Of what a pose of a scan shows, as `Setup` has it."""
    covariance = observed.covariance
    if covariance is None:
        return None
    return np.full(observed.points.shape[2], np.median(covariance)) if observed.on_curve else covariance[0].mean(axis=0)


def other_target(setup: Setup, scan: Scan, seen: Seen) -> Setup:
    """Of the same sensor and robot: over the target of a scan, `seen` there, which stands where a sensor mounted as the
    setup has it sees it."""
    profile_mm = seen.typical_mm or setup.noise.profile_mm
    observed = as_observations(scan, seen, seen.typical_mm)
    noise, R = replace(setup.noise, profile_mm=profile_mm), observed.R_flange[0]
    placed = settle_targets(Problem([observed], noise), setup.R_sensor[None], setup.T_sensor[None])
    ((origin, axes),) = placed.placements
    return replace(
        setup,
        target=TARGETS[scan.kind].at(origin[0], axes[0], scan.sizes),
        facing=nearest_rotation((R @ setup.R_sensor).mean(axis=0)),
        noise=noise,
        measured=scan.measured,
        covariance=typical_covariance(observed),
        count=observed.points.shape[2],
    )


def apart(target: Target, other: Target) -> float:
    """How far another target is from one, mm, in the directions in which it may be moved."""
    (origin, axes), (there, _) = target.frame, other.frame
    return float(np.linalg.norm(((there - origin) @ axes)[["xyz".index(axis) for axis in target.shifts]]))


def scanner_of(scan, observed) -> Scanner:
    """A scanner that sees as far as this one was seen to see."""
    points = np.concatenate(scan.values)[:, :2] if scan.measured == "profiles" else observed.points[0].reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    (_, near), (_, far) = points.min(axis=0) - ROUND_MM, points.max(axis=0) + ROUND_MM
    width = 2 * (np.abs(points[:, 0]).max() + ROUND_MM)
    return Scanner(near=max(near, 1.0), far=far, near_width=width, far_width=width)


def mending(found: Calibration, folder, rng: np.random.Generator) -> str:
    """The plan that would mend the answer of the scan `folder` that its motions leave weak or open, in a sentence; ""
    if there is none."""
    s = found.solution
    if s is None or found.misread or s.observability.status == "ok" or len(found.scans) > 1:
        return ""
    try:
        setup, limits, before = setup_of_scan(found)
        plan = design(setup, Wishes(most=FEW_POSES, limits=limits), rng, [before], **FEW)
    except ScanError:
        return ""
    p = plan.predicted
    if p.spectrum.status != "ok":
        return ""
    said = f"{len(plan.T)} more poses would mend it, predicted: {p.mm:.2g} mm, {p.deg:.2g}°"
    if is_open(found):
        return (
            f"{said}; roughly measure the mount, then profilecal plan SPEC.toml NEW-FOLDER --after {folder} writes them"
        )
    return f"{said}; profilecal plan {folder} NEW-FOLDER writes them"


def is_open(found: Calibration) -> bool:
    """Whether a hand measurement tells more of the mount than the scan."""
    return not found.solution.observability.sd[0] < 1
