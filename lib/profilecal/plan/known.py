"""What is known before a scan: from a specification, or from a scan and its answer."""

from dataclasses import replace

import numpy as np

from profilecal.calibrate.calibration import Calibration
from profilecal.calibrate.observe import as_observations, observe, stated_noise
from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import inverse, nearest_rotation
from profilecal.joint.noise import prior_from
from profilecal.joint.observations import Observations
from profilecal.plan.candidates import Limits, aside, flange_at, random_views, refused
from profilecal.plan.scan_model import ScanModel
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.toml import check_entries, number, numbers, whole
from profilecal.simulate.scanner import Scanner
from profilecal.simulate.spec import Spec, sizes_of
from profilecal.targets import TARGETS

REACH_MM = 200.0  # beyond the poses of a scan, the robot is believed to reach

PLAN = {
    "poses": whole(0, 1000),
    "most": whole(1, 1000),
    "until": numbers(2),
    "low": numbers(3),
    "high": numbers(3),
    "tilt_deg": number(0, 80),
    "spin_deg": number(0, 180),
    "extent_mm": number(0, 1000),
    "avoid": (
        lambda value: isinstance(value, list) and all(numbers(4)[0](zone) for zone in value),
        "a list of zones, each of four numbers: x, y, z, radius",
    ),
}


def read_plan(table: dict, path) -> tuple[Limits, dict]:
    """The table [plan] of a specification: where the robot may go, and what is asked of `design`. Raises ScanError."""
    check_entries(path, table, PLAN, "plan")
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in table.items()}
    asked = {name: given.pop(name) for name in ("poses", "most", "until") if name in given}
    return Limits(**given), asked


def model_of_spec(spec: Spec, stated: dict[str, float], rng: np.random.Generator) -> ScanModel:
    """What a specification with a guess says. `stated`: its [noise]; robot errors that it leaves out are as usual.

    How well raw profiles show the target is looked up in a few simulated ones. Raises ScanError without a guess.
    """
    if spec.guess is None:
        raise ScanError("a plan needs [guess]: roughly where the sensor (mount) and the target are")
    if not spec.noise.profile_mm:
        raise ScanError("profile_mm is 0 in [noise]; a plan needs the scanner's noise")
    measured = spec.measured or TARGETS[spec.kind].tables[-1]
    level, profile_mm = prior_from(stated), spec.noise.profile_mm
    if measured == "arcs":  # errors of centre and radius, as those of three points a third of a turn apart
        profile_mm = np.sqrt(2) * profile_mm
    model = ScanModel(
        spec.guess.placed(spec.kind, sizes_of(spec)),
        spec.guess.facing(spec.kind),
        *spec.guess.sensor,
        scanner=spec.scanner,
        noise=replace(level.prior.scales, profile_mm=profile_mm, steering_mm=spec.noise.steering_mm),
        systematic=level.systematic,
        to_hand=spec.mount == "eye-to-hand",
        measured=measured,
        guess=spec.guess,
    )
    return with_features(model, spec, rng) if measured == "profiles" else model


def with_features(model: ScanModel, spec: Spec, rng: np.random.Generator) -> ScanModel:
    """The model with as much noise as features of its raw profiles have, in a few simulated ones. Raises ScanError
    where these do not show the target."""
    views = random_views(model, Limits(), 240, rng)
    R, T = flange_at(model, *views)
    good = np.flatnonzero(refused(model, Limits(), R, T) == "")[:24]
    if len(good) < 3:
        return model  # the plan will say that nothing is in view
    R, T = R[good], T[good]
    specimen = spec.specimen or model.target.specimens[0]
    outlines = model.target.outline(specimen, *model.planes(R, T), model.facing[:, 2])
    profiles = [spec.scanner.decode(spec.scanner.count(outline, rng)) for outline in outlines]
    scan = Scan(
        spec.kind, tuple(map(str, good)), R, T, "profiles", tuple(profiles), model.sizes, title="simulated profiles"
    )
    seen = observe(scan, 1)
    observed = as_observations(scan, seen, seen.typical_mm)
    return replace(model, noise=replace(model.noise, profile_mm=seen.typical_mm), **features_of(observed))


def features_of(observed: Observations) -> dict:
    """What typical profiles show: the `count` of points and their `covariance`, as `ScanModel` has them."""
    count, covariance = observed.points.shape[2], observed.covariance
    if covariance is not None:
        covariance = np.full(count, np.median(covariance)) if observed.on_curve else covariance[0].mean(axis=0)
    return {"count": count, "covariance": covariance}


def model_of_scan(found: Calibration) -> tuple[ScanModel, Limits, tuple[np.ndarray, np.ndarray]]:
    """What the one scan of a calibration says of sensor, target and robot; where the robot may go from there; and the
    poses R (P, 3, 3), T (P, 3) that it used. Raises ScanError where it leaves the sensor pose open."""
    s, scan, observed = found.solution, found.scans[0], found.observed[0]
    if found.status == "unobservable":
        raise ScanError("the scan leaves the mount open; plan from a SPEC.toml whose [guess] states it roughly")
    R, T = observed.R_flange[0][s.kept[0]], observed.T_flange[0][s.kept[0]]
    level = prior_from(stated_noise(found.scans))
    noise = replace(level.prior.scales, profile_mm=s.noise_mm, steering_mm=s.noise.steering_mm)
    sizes = s.level.found.sizes[1:]
    # where no pose is repeated, the errors of a visit are part of those of a pose
    noise = replace(noise, **dict.fromkeys({*ROBOT} - {size.name for size in sizes}, 0.0))
    noise = replace(noise, **{size.name: size.middle for size in sizes if size.from_data})
    model = ScanModel(
        s.placements[0],
        nearest_rotation((R @ s.rotation).mean(axis=0)),
        s.rotation,
        s.translation,
        scanner=scanner_of(scan, observed),
        noise=noise,
        systematic=level.systematic,
        to_hand=observed.eye_to_hand,
        measured=scan.measured,
        **features_of(observed),
    )
    flange = inverse(R, T)[1] if model.to_hand else T
    limits = Limits(
        low=tuple(flange.min(axis=0) - REACH_MM),
        high=tuple(flange.max(axis=0) + REACH_MM),
        extent_mm=max(20.0, float(aside(model, R, T).max())),
    )
    return model, limits, (R, T)


def scanner_of(scan: Scan, observed: Observations) -> Scanner:
    """A scanner that sees 10 mm farther than this one was seen to see."""
    points = np.concatenate(scan.values)[:, :2] if scan.measured == "profiles" else observed.points[0].reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    (_, near), (_, far) = points.min(axis=0) - 10, points.max(axis=0) + 10
    width = 2 * (np.abs(points[:, 0]).max() + 10)
    return Scanner(near=max(near, 1.0), far=far, near_width=width, far_width=width)
