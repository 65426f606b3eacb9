"""What is known before a plan, from a specification or from a scan."""

from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.noise import ROBOT
from profilecal.geometry.poses import Frames, nearest_rotation
from profilecal.joint.prior import prior_from
from profilecal.profiles.points import present
from profilecal.scan.scan import Scan, ScanError
from profilecal.simulation.robot import Scanner
from profilecal.simulation.spec import scan_from
from profilecal.targets import TARGETS
from profilecal.targets.observations import Observations
from profilecal_tool.plan.candidates import draw, off_square
from profilecal_tool.plan.scan_model import Limits, ScanModel
from profilecal_tool.plan.specification import PlannedSpec


def model_of_spec(
    spec: PlannedSpec, stated: dict[str, float], rng: np.random.Generator
) -> ScanModel:
    """What a specification with a guess says.

    `stated`: its [noise]; robot errors that it leaves out are as usual. How well raw
    profiles show the target is looked up in a few simulated ones. Raises ScanError
    without a guess, and where these do not show the target.
    """
    profile_mm = spec.noise.profile_mm
    if not profile_mm:
        raise ScanError("profile_mm is 0 in [noise]; a plan needs the scanner's noise")
    measured = spec.measured or TARGETS[spec.kind].tables[-1]
    if measured == "arcs":
        # An error of centre and radius is as one of three points that are a third of a
        # turn apart.
        profile_mm *= np.sqrt(2)
    prior = prior_from(stated)
    model = ScanModel(
        **vars(spec.setup()),
        scanner=spec.scanner,
        noise=replace(prior.scales, profile_mm=profile_mm),
        systematic=prior.systematic,
        to_hand=spec.to_hand,
        measured=measured,
        guess=spec.guess,
    )
    if measured == "profiles":
        R, T = draw(model, 24, rng)
        flange = model.in_base(R, T)
        said = {
            "R_base_flange": flange[0],
            "p_base_flange": flange[1],
            "labels": tuple(map(str, range(len(T)))),
        }
        scan = scan_from(model, flange, said, spec, rng)
        features = observe(scan, 1)
        noise = replace(model.noise, profile_mm=features.typical_mm)
        typical = typical_of(as_observations(scan, features, features.typical_mm))
        model = replace(model, noise=noise, **typical)
    # the trial poses show what is usual; they are not driven, and need no box
    return replace(model, limits=spec.plan)


def typical_of(observed: Observations) -> dict:
    """What typical profiles show: the `count` of points and their `covariance`, entries
    of `ScanModel`.
    """
    count, covariance = observed.points.shape[2], observed.covariance
    if covariance is not None:
        if observed.on_curve:
            covariance = np.full(count, np.median(covariance))
        else:
            covariance = covariance[0].mean(axis=0)
    return {"count": count, "covariance": covariance}


def model_of_scan(found: Calibration) -> tuple[ScanModel, Frames]:
    """What the one scan of a calibration says.

    Returns what it says of sensor, target and robot, which may go on from there; and
    the poses R (P, 3, 3), T (P, 3) that the calibration used. Raises ScanError where it
    leaves the sensor pose open or is misread.
    """
    # an "ok" answer has paid for what speaks against it by a larger covariance
    refuted = found.misread and found.status != "ok"
    if refuted or not found.is_known:
        raise ScanError(
            "the scan leaves the mount open, or contradicts itself: profilecal "
            "calibrate says how; else plan from a SPEC.toml whose [guess] states it "
            "roughly"
        )
    solution = found.solution
    (scan,), (observed,), (kept,) = found.scans, found.observed, solution.kept
    R, T = observed.R_flange[0][kept], observed.T_flange[0][kept]
    prior = solution.prior
    # where no pose is repeated, the errors of a visit are part of those of a pose
    sizes = dict.fromkeys(ROBOT, 0.0)
    for size in solution.error_sizes.sizes:
        usual = getattr(prior.scales, size.name)
        sizes[size.name] = size.middle if size.from_data else usual
    sizes["profile_mm"] = solution.noise_mm
    model = ScanModel(
        solution.placements[0],
        facing=nearest_rotation((R @ solution.rotation).mean(axis=0)),
        R_sensor=solution.rotation,
        T_sensor=solution.translation,
        scanner=scanner_of(scan, observed),
        noise=prior.scales.of_sizes(sizes),
        systematic=prior.systematic,
        to_hand=observed.eye_to_hand,
        measured=scan.measured,
        doubted=found.misread,
        **typical_of(observed),
    )

    reach_mm = 200.0  # beyond the poses of a scan, the robot is believed to reach
    _, flange = model.in_base(R, T)
    limits = Limits(
        low=flange.min(axis=0) - reach_mm,
        high=flange.max(axis=0) + reach_mm,
        extent_mm=max(20.0, off_square(model, R, T)[2].max()),
    )
    return replace(model, limits=limits), (R, T)


def scanner_of(scan: Scan, observed: Observations) -> Scanner:
    """A scanner that sees 10 mm farther than this one was seen to see.

    Its width changes evenly with the depth: of the fields of view that hold all points
    it has the one that is narrowest in the middle.
    """
    more_mm = 10
    seen = scan.values if scan.measured == "profiles" else observed.points[0]
    points = np.concatenate(seen)
    x, z = points[present(points)].T
    near, far = max(z.min() - more_mm, 1.0), z.max() + more_mm
    share = (z - near) / (far - near)
    # half the width, which is linear in z, is |x| or more
    rows = np.stack([share - 1, -share], axis=1)
    half = linprog([1, 1], rows, -np.abs(x)).x + more_mm
    return Scanner(near=near, far=far, near_width=2 * half[0], far_width=2 * half[1])
