"""What is known before a plan: from a specification, or from a scan and its answer."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy.optimize import linprog

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.observe import as_observations, observe
from profilecal.geometry.poses import carry, nearest_rotation
from profilecal.joint.prior import prior_from
from profilecal.scan.scan import Scan
from profilecal.scan.tables import ScanError
from profilecal.simulation.robot import Scanner
from profilecal.simulation.spec import scan_from
from profilecal.targets.observations import Observations
from profilecal_tool.plan.candidates import draw, off_square
from profilecal_tool.plan.scan_model import ScanModel
from profilecal_tool.plan.specification import Limits, PlannedSpec

TRIED = 24  # poses, to see what a finder makes of raw profiles
BOX_MM = 200.0  # beyond the poses of a scan
EXTENT_MM = 20.0  # at least, of the target that a scan saw
BESIDE_MM = 10.0  # a scanner sees so much more than it did


def model_of_spec(
    spec: PlannedSpec, stated: dict[str, float], rng: Generator
) -> ScanModel:
    """What a specification with a guess says, but for its limits.

    `stated`: its [noise]; robot errors that it leaves out are as usual. How well raw
    profiles show the target is looked up in a few simulated ones. Raises ScanError
    without a guess, and where these do not show the target.
    """
    setup, profile_mm = spec.setup(), spec.noise.profile_mm
    if not profile_mm:
        raise ScanError("profile_mm is 0 in [noise]; a plan needs the scanner's noise")
    measured = spec.measured or setup.target.tables[-1]
    if measured == "arcs":
        # An error of centre and radius is as one of three points that are a third of a
        # turn apart.
        profile_mm *= np.sqrt(2)
    prior = prior_from(stated)
    model = ScanModel(
        **vars(setup),
        scanner=spec.scanner,
        noise=replace(prior.scales, profile_mm=profile_mm),
        systematic=prior.systematic,
        to_hand=spec.to_hand,
        measured=measured,
        guess=spec.guess,
    )
    if measured == "profiles":
        R, p = model.in_base(*draw(model, TRIED, rng))
        labels = [*map(str, range(TRIED))]
        said = {"labels": labels, "R_base_flange": R, "p_base_flange": p}
        scan = scan_from(setup, (R, p), said, spec, rng)
        seen = observe(scan, 1)
        typical = typical_of(as_observations(scan, seen, seen.typical_mm))
        noise = replace(model.noise, profile_mm=seen.typical_mm)
        model = replace(model, noise=noise, **typical)
    return model


def typical_of(observed: Observations) -> dict[str, Any]:
    """What typical profiles show: the `count` of points and their `covariance`, entries
    of `ScanModel`.
    """
    count, covariance = observed.points.shape[2], observed.covariance
    if covariance is not None:
        covariance = covariance.mean(axis=1, keepdims=True)
        if observed.on_curve:
            covariance[:] = np.median(observed.covariance)
    return {"count": count, "covariance": covariance}


def model_of_scan(found: Calibration) -> ScanModel:
    """What the calibration of one scan says of sensor, target and robot. Further poses
    may go where those are that it kept. Raises ScanError where it leaves the sensor
    pose open or is misread.
    """
    # an "ok" answer has paid for what speaks against it by a larger covariance
    if not found.is_known or (found.misread and found.status != "ok"):
        raise ScanError(
            "the scan leaves the mount open, or contradicts itself: profilecal "
            "calibrate says how; else plan from a SPEC.toml whose [guess] states it "
            "roughly"
        )
    solution, (scan,), (seen,) = found.solution, found.scans, found.observed
    observed = seen.keep(solution.kept[0])
    R, T = observed.R_flange[0], observed.T_flange[0]
    R_view, T_view = R @ solution.rotation, carry(R, T, solution.translation)
    target = solution.placements[0]
    model = ScanModel(
        target=target,
        facing=nearest_rotation(R_view.mean(axis=0)),
        R_sensor=solution.rotation,
        T_sensor=solution.translation,
        scanner=scanner_of(scan, target.points_seen(R_view, T_view, 5)),
        noise=solution.noise.of_sizes(solution.error_sizes.of_robot),
        systematic=solution.prior.systematic,
        to_hand=observed.eye_to_hand,
        measured=scan.measured,
        before=(R, T),
        doubted=found.misread,
        **typical_of(seen),
    )
    _, flange = model.in_base(R, T)
    _, _, aside = off_square(model, R, T)
    limits = Limits(
        low=flange.min(axis=0) - BOX_MM,
        high=flange.max(axis=0) + BOX_MM,
        extent_mm=max(EXTENT_MM, aside.max()),
    )
    return replace(model, limits=limits)


def scanner_of(scan: Scan, seen: ndarray) -> Scanner:
    """A scanner that sees a little more than one did, which saw points (..., 2) of the
    target, or raw profiles: of all views whose half width grows evenly from a to b and
    holds what was seen, |x| ≤ (1 - s) a + s b at the share s of the depth, the one of
    the least a + b.
    """
    if scan.measured == "profiles":
        seen = np.concatenate(scan.values)
    x, z = seen[np.isfinite(seen).all(axis=-1)].T
    near, far = max(z.min() - BESIDE_MM, 1.0), z.max() + BESIDE_MM
    share = (z - near) / (far - near)
    at_least = np.stack([share - 1, -share], axis=1)
    widths = 2 * (linprog([1, 1], at_least, -np.abs(x)).x + BESIDE_MM)
    return Scanner(near, far, *widths)
