"""A plan: what is wished for, the poses that serve it best, and what they will be worth."""

from dataclasses import asdict, dataclass, field, fields, replace

import numpy as np

from profilecal.calibrate.observe import covariances
from profilecal.geometry.noise import ROBOT, Noise
from profilecal.joint.noise import expect
from profilecal.joint.observability import POSE_UNITS
from profilecal.plan.candidates import AT_LIMIT, Limits, draw, inverse_mount, neighbours, random_views, refused
from profilecal.plan.design import CRITERIA, Pool, exchange, growing, shortest
from profilecal.plan.setup import Part, Prediction, Setup, blocks, information, predict, scales
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import is_number, shown
from profilecal.simulate.plan import Poses
from profilecal.simulate.scene import Scene
from profilecal.simulate.spec import Spec, raw_profiles, sizes_of
from profilecal.targets import TARGETS

CANDIDATES = 2000
POLISHES, EACH = 2, 40  # rounds of looking at that many neighbours of each pose
SAMPLE = 24  # simulated profiles that tell how well their features are known


@dataclass(frozen=True)
class Wishes:
    """What is asked of a plan: entries of the table [plan]; those of `Limits` too."""

    poses: int = 0  # 0: as many as it takes
    most: int = 100  # of those
    until: tuple[float, ...] = (0.1, 0.05)  # mm and degrees: the largest standard deviation in any direction
    criterion: str = "worst"
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self):
        if self.criterion not in CRITERIA:
            raise ScanError(f"criterion is {self.criterion!r}; expected one of {', '.join(CRITERIA)}")
        if not (0 <= self.poses <= 1000 and 1 <= self.most <= 1000):
            raise ScanError(f"poses is {self.poses}, most is {self.most}; expected 1000 at most, and one at least")
        if len(self.until) != 2 or not min(self.until) > 0:
            raise ScanError(f"until is {list(self.until)} in [plan]; expected mm and degrees, both positive")
        low, high = np.array(self.limits.low), np.array(self.limits.high)
        if (low >= high).any():
            k = int(np.argmax(low >= high))
            raise ScanError(f"the box is empty along {'xyz'[k]}: low is {low[k]:g} and high is {high[k]:g} mm")


@dataclass(frozen=True)
class Plan:
    """Poses in the order in which to go through them, and what they are predicted to give."""

    setup: Setup
    wishes: Wishes
    R: np.ndarray  # (P, 3, 3) of the flange as the joint solution has it
    T: np.ndarray  # (P, 3) mm
    predicted: Prediction  # with what was there before
    curve: list[tuple[int, float, float]]  # poses, mm and degrees: standard deviations in the worst direction

    @property
    def enough(self) -> int | None:
        """How many poses it takes until it is good enough; None if more than there are in the curve."""
        mm, deg = self.wishes.until
        return next((n for n, m, d in self.curve if m <= mm and d <= deg), None)


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
    level, profile_mm = expect(stated), spec.noise.profile_mm
    if measured == "arcs":  # errors of centre and radius, as those of three points a third of a turn apart
        profile_mm = np.sqrt(2) * profile_mm
    robot = {name: getattr(level.prior, name) for name in ROBOT}
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
    found = [f for f in setup.target.features(profiles, setup.sizes) if f.found]
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


def design(
    setup: Setup,
    wishes: Wishes,
    rng: np.random.Generator,
    after: Part | None = None,
    *,
    reference=None,
    candidates: int = CANDIDATES,
    polishes: int = POLISHES,
) -> Plan:
    """The poses that serve the wishes best, beside those that exist already, `after`.

    `reference` (6, 6): instead of a mount measured by hand, the covariance, mm and rad, that sets the units of the
    criterion. `candidates`, `polishes`: how many poses to choose from, and how often to look near those chosen.
    Raises ScanError where the limits leave too few poses.
    """
    limits = wishes.limits
    R, T = draw(setup, limits, candidates, rng, AT_LIMIT)
    known, before = scales([(setup, R, T)]), information([after]) if after else None
    pool = Pool.of(R, blocks([(setup, R, T)]), known, before, reference)
    curve, chosen = [], []
    for chosen in growing(pool, wishes.criterion, wishes.poses or wishes.most):
        curve.append((len(chosen), *largest(pool.covariance(chosen)[:6, :6])))
        if not wishes.poses and curve[-1][1] <= wishes.until[0] and curve[-1][2] <= wishes.until[1]:
            break
    for _ in range(polishes):
        near = neighbours(setup, limits, R[chosen], T[chosen], EACH, rng)
        R, T = (np.concatenate([part[chosen], more]) for part, more in zip((R, T), near, strict=True))
        pool = Pool.of(R, blocks([(setup, R, T)]), known, before, reference)
        chosen = exchange(pool, list(range(len(chosen))), wishes.criterion)
    R, T = R[chosen], T[chosen]
    order = shortest(R, T)
    R, T = R[order], T[order]
    together = [after[1:], (R, T)] if after else [(R, T)]
    predicted = predict([(setup, *(np.concatenate(part) for part in zip(*together, strict=True)))])
    curve[-1] = (len(T), predicted.mm, predicted.deg)
    return Plan(setup, wishes, R, T, predicted, curve)


def largest(scaled) -> tuple[float, float]:
    """The largest standard deviations of a translation, mm, and of a rotation, degrees, of a covariance (6, 6) in the
    units of `observability`."""
    C = scaled * POSE_UNITS[:, None] * POSE_UNITS
    mm, rad = (float(np.sqrt(np.linalg.eigvalsh(part)[-1])) for part in (C[:3, :3], C[3:, 3:]))
    return mm, float(np.degrees(rad))
