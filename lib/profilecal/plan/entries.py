"""What a specification says of a plan: what is wished for, and what is known beforehand."""

from dataclasses import asdict, fields, replace

import numpy as np

from profilecal.calibrate.observe import covariances
from profilecal.geometry.noise import ROBOT, Noise
from profilecal.joint.noise import prior_from
from profilecal.plan.candidates import Limits, inverse_mount, random_views, refused
from profilecal.plan.design import CRITERIA
from profilecal.plan.plan import Wishes
from profilecal.plan.setup import Setup
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import shown
from profilecal.scan.toml import is_number
from profilecal.simulate.poses import Poses
from profilecal.simulate.scene import Scene
from profilecal.simulate.spec import Spec, raw_profiles, sizes_of
from profilecal.targets import TARGETS
from profilecal.targets.target import find_features

SAMPLE = 24  # simulated profiles that tell how well their features are known
LISTS = {"until": 2, "low": 3, "high": 3}


def read_wishes(entries: dict) -> Wishes:
    """From the content of a specification. Raises ScanError."""
    entries = entries.get("plan", {})
    if not isinstance(entries, dict):
        raise ScanError(f"plan is {shown(entries)} in the specification; expected a table [plan]")
    known = {f.name: getattr(Wishes(), f.name) for f in fields(Wishes) if f.name != "limits"} | asdict(Limits())
    for name, value in entries.items():
        if name not in known:
            raise ScanError(f"unknown entry {name!r} in [plan]; there are {', '.join(known)}")
        if name == "avoid":
            good = isinstance(value, list) and all(is_list(zone, 4) for zone in value)
            expected = "a list of zones, each of four numbers: x, y, z, radius"
        elif name in LISTS:
            good, expected = is_list(value, LISTS[name]), f"{LISTS[name]} numbers"
        elif name == "criterion":
            good, expected = isinstance(value, str), f"one of {', '.join(CRITERIA)}"
        else:
            whole = name not in ("poses", "most") or isinstance(value, int)
            good, expected = is_number(value) and whole and 0 <= value <= 1000, "a number, zero or more"
        if not good:
            raise ScanError(f"{name} is {shown(value)} in [plan]; expected {expected}")
    given = {k: tuple(map(tuple, v)) if k == "avoid" else tuple(v) if k in LISTS else v for k, v in entries.items()}
    limits = Limits(**{f.name: given.pop(f.name) for f in fields(Limits) if f.name in given})
    if not 0 <= limits.tilt_deg <= 80 or not 0 <= limits.spin_deg <= 180:
        raise ScanError("tilt_deg is 0 to 80 and spin_deg 0 to 180 in [plan]")
    return Wishes(**given, limits=limits)


def is_list(value, length: int) -> bool:
    """Whether a value of a TOML file is a list of so many finite numbers."""
    return isinstance(value, list) and len(value) == length and all(map(is_number, value)) and np.isfinite(value).all()


def setup_of(spec: Spec, stated: dict[str, float], rng: np.random.Generator) -> Setup:
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
    robot = {name: getattr(level.prior.scales, name) for name in ROBOT}
    setup = Setup(
        target=spec.guess.placed(spec.kind, sizes_of(spec)),
        facing=spec.guess.facing(spec.kind),
        R_sensor=spec.guess.sensor[0],
        T_sensor=spec.guess.sensor[1],
        scanner=spec.scanner,
        noise=Noise(profile_mm=profile_mm, steering_mm=spec.noise.steering_mm, **robot),
        systematic=level.systematic,
        to_hand=spec.mount == "eye-to-hand",
        measured=measured,
        margins=spec.guess.margins,
    )
    return with_features(setup, spec, rng) if measured == "profiles" else setup


def with_features(setup: Setup, spec: Spec, rng: np.random.Generator) -> Setup:
    """The setup with the covariance that features of its raw profiles have, an average over a few simulated ones."""
    views = random_views(setup, Limits(), 10 * SAMPLE, rng)
    good = refused(setup, Limits(), *inverse_mount(setup, *views)) == ""
    if good.sum() < 3:
        return setup  # the plan will say that nothing is in view
    planes = [part[good][:SAMPLE] for part in views]
    nowhere = Poses(np.empty((0, 3, 3)), np.empty((0, 1, 3)))
    profiles = raw_profiles(Scene(setup.target, setup.facing, nowhere, None, None), planes, spec, rng)
    found = [f for f in find_features(setup.target, profiles, setup.sizes) if f.found]
    if not found:
        raise ScanError(f"no {spec.kind} is found in simulated profiles; look at [scanner] and the target's sizes")
    on_curve, count = setup.target.points is None, int(np.median([len(feature.points) for feature in found]))
    each = [covariances([feature], len(feature.points), on_curve)[0] for feature in found]
    if on_curve:
        unit, covariance = np.mean([variance.mean() for variance in each]), np.ones(count)
    else:
        covariance = np.mean(each, axis=0)
        unit = np.trace(covariance) / len(covariance)
        covariance = covariance / unit
    noise = replace(setup.noise, profile_mm=float(np.sqrt(unit)))
    return replace(setup, covariance=covariance, noise=noise, count=count)
