"""Synthetic scans: a specification in, a scan out, with the truth that made it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator, default_rng

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import Frames, homogeneous, inverse
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.scan import MEASURED, MOUNTS, Scan, size_rules
from profilecal.scan.tables import ScanError, naming
from profilecal.scan.toml import (
    Count,
    Entries,
    check_entries,
    entries_of,
    number,
    one_of,
    whole,
)
from profilecal.simulation.robot import Robot, Scanner, actual_poses, revisited
from profilecal.simulation.scene import Scene, Setup, random_scene
from profilecal.simulation.sweeps import Motion, Sweep, drive, random_sweeps
from profilecal.targets import TARGETS
from profilecal.targets.target import Target

NAMES = [convention.name for convention in CONVENTIONS]
# it sees a whole disk of 50 mm radius
WIDE = Scanner(near=40.0, far=260.0, near_width=100.0, far_width=220.0)
USUAL_NOISE = Noise(profile_mm=0.05)


@dataclass(frozen=True)
class Spec:
    """What to simulate. Everything that is left out of a specification file has these
    defaults.
    """

    kind: Annotated[str, one_of(TARGETS)] = "edge"
    title: str = ""
    seed: Annotated[int, whole(0, 1_000_000)] = 1
    # which of several scans of the same scanner, target and arm
    scan: Count = 1
    # which of the target's tables; empty: the last, its points, chords or arcs if it
    # has such
    measured: str = ""
    mount: Annotated[str, one_of(MOUNTS)] = Scan.mount
    convention: Annotated[str, one_of(NAMES)] = NAMES[0]
    specimen: str = ""  # which body raw profiles show; empty: the target's usual one
    # flange orientations; 0: what the kind needs
    groups: int = 0
    positions: int = 0  # in each
    # the flange turns by up to this
    spread_deg: Annotated[float, number(0, 180)] = 30.0
    # measurements at each stop, while the robot stands still
    repeats: Count = 1
    noise: Noise = USUAL_NOISE
    robot: Robot = field(default_factory=Robot)
    scanner: Scanner = WIDE
    motion: Annotated[Motion | None, Motion] = None  # None: stops for each profile
    # of the target, mm, entries by their names; left out: as usual for it
    sizes: dict[str, float] = field(default_factory=dict)

    @property
    def to_hand(self) -> bool:
        """Whether the scanner is fixed, and the target on the flange."""
        return self.mount == "eye-to-hand"

    def __post_init__(self) -> None:
        target = TARGETS[self.kind]
        usual = zip(target.size_names, target.usual_sizes, strict=True)
        vars(self)["sizes"] = dict(usual) | self.sizes

    def scene(self, rng: Generator) -> Scene:
        """The target, and poses that see it."""
        return random_scene(
            self.kind,
            rng,
            groups=self.groups,
            positions=self.positions,
            sizes=tuple(self.sizes.values()),
            spread_deg=self.spread_deg,
            steering_mm=self.noise.steering_mm,
        )

    def sweeps(self, scene: Scene, motion: Motion, rng: Generator) -> list[Sweep]:
        """The sweeps of its motion."""
        return random_sweeps(scene, motion, self.spread_deg, rng)


@dataclass(frozen=True, eq=False)
class Truth:
    """What made a simulated scan."""

    # (4, 4) mm, the sensor in the flange frame (eye-to-hand: in the base frame)
    pose: ndarray
    target: Target  # where it stands in the base frame (eye-to-hand: the flange frame)


def simulate(kind: str = "edge", seed: int = 1, **entries: Any) -> tuple[Scan, Truth]:
    """A scan that a robot and a scanner with errors would record, and its truth.

    Parameters
    ----------
    kind : str
        The target: "edge", "disk", "ball", "plane", "point" or "rod".
    seed : int
        The same seed gives the same scan.
    **entries
        Other entries of a specification, as in a file for ``profilecal simulate``:
        ``measured="profiles"``, ``mount``, ``groups``, ``positions``, ``spread_deg``,
        ``repeats``, ``radius`` in mm, and the tables ``noise``, ``robot``, ``scanner``
        and ``motion`` as dictionaries, such as ``motion={"pattern": "weave"}`` or
        ``noise={"profile_mm": 0.1, "position_mm": 0.05}``.

    Returns
    -------
    scan : Scan
        What would be recorded.
    truth : Truth
        The sensor's pose and the target's place.

    Raises
    ------
    ScanError
        For an entry that there is not, or a value that it cannot have.

    See Also
    --------
    calibrate : find the sensor's pose again.
    write_scan : write the scan as a folder.

    Examples
    --------
    >>> import profilecal as pc
    >>> scan, truth = pc.simulate("disk", seed=1, groups=4, positions=20)
    >>> scan
    Scan(disk, radius 50 mm, 80 poses of 4 orientations, chords, eye-in-hand)
    >>> truth.pose.shape
    (4, 4)
    """
    said = {"kind": kind, "seed": seed} | entries
    scan = simulate_scan(read_spec(said, "simulate"))
    return scan, truth_of(scan)


def truth_of(scan: Scan) -> Truth:
    """The truth that a simulated scan carries."""
    truth = scan.truth
    place = {name: np.array(value) for name, value in truth["target"].items()}
    pose = np.array(truth[f"T_{MOUNTS[scan.mount]}_sensor"])
    return Truth(pose, scan.target(**place))


def read_spec(
    said: Mapping[str, Any],
    path: str | Path,
    made: type[Spec] = Spec,
) -> Any:
    """A specification `made` of the content of a TOML file `path`: Spec's fields, or
    those of another dataclass that goes on from it, and the target's sizes.

    Raises ScanError.
    """
    kind = said.get("kind", Spec.kind)
    target, of_target = TARGETS.get(str(kind), Target), size_rules(kind)
    rules = entries_of(made) | of_target
    del rules["sizes"]
    rules["measured"] = one_of(target.tables)
    rules["specimen"] = one_of(target.specimens)
    check_entries(path, said, rules)
    if "motion" in said and not target.across:
        raise ScanError(f"{path}: a {kind} is not swept; leave [motion] out")
    noise = vars(USUAL_NOISE) | said.get("noise", {})
    # the scanner's noise is what [noise] says, unless [scanner] says otherwise
    noisy = vars(WIDE) | {"noise_mm": noise["profile_mm"]}
    scanner = noisy | said.get("scanner", {})
    with naming(path):
        entries = {
            name: rules[name](**value) if isinstance(value, Mapping) else value
            for name, value in {**said, "noise": noise, "scanner": scanner}.items()
        }
        sizes = {name: entries.pop(name) for name in of_target if name in said}
        return made(**entries, sizes=sizes)


@naming("simulation")
def simulate_scan(spec: Spec) -> Scan:
    """The scan that a robot with these errors and a scanner with this noise would
    record, and its truth.

    Raises ScanError where it shows nothing, for poses or speeds that no robot has, and
    for errors that would change nothing.
    """
    check_effects(spec)
    rng, motion = default_rng(spec.seed), spec.motion
    scene = spec.scene(rng)
    if spec.scan > 1:
        rng = default_rng(np.append(spec.seed, spec.scan))
    if not motion:
        return record(scene, taken(scene, spec, rng), spec, rng)
    # stops are on any ways, not in the middle, where a ball's side is open
    to_stops = replace(motion, pattern="random", sweeps=motion.stops)
    stops = [
        way.at(way.seconds * rng.uniform(0.1, 0.4, 1) * rng.choice([-1, 1]))
        for way in random_sweeps(scene, to_stops, spec.spread_deg, rng)
    ]
    said, flange = drive(
        scene,
        motion,
        spec.noise,
        rng,
        sweeps=spec.sweeps(scene, motion, rng),
        stops=stops,
        to_hand=spec.to_hand,
    )
    return scan_from(scene, flange, said, spec, rng)


def check_effects(spec: Spec) -> None:
    """Refuse errors that a robot may have and a simulation of this scan leaves out."""
    noise = spec.noise
    unused = {"accuracy_mm": noise.accuracy_mm, "accuracy_deg": noise.accuracy_deg}
    if spec.motion:
        unused |= vars(spec.robot) | {"repeats": spec.repeats - 1}
    if not TARGETS[spec.kind].steered:
        unused["steering_mm"] = noise.steering_mm
    for name, size in unused.items():
        if size:
            raise ScanError(f"{name} has no effect in this simulation; leave it out")


def taken(scene: Scene, spec: Spec, rng: Generator) -> Frames:
    """Where the flange is, (P, 3, 3), (P, 3) mm, whenever the robot is at the poses of
    a scene.
    """
    R, T = scene.poses
    group = scene.observations.labels[:: T.shape[1]]
    R, T = actual_poses(R, T, spec.noise, rng, group, spec.to_hand)
    arm = default_rng(np.append(spec.seed, 1))
    return spec.robot.built(R.reshape(-1, 3, 3), T.reshape(-1, 3), arm)


def record(scene: Scene, poses: Frames, spec: Spec, rng: Generator) -> Scan:
    """The scan of a scene by a robot that takes its flange to `poses` (P, 3, 3), (P,
    3), mm, and measures as often as `spec` repeats it. Raises ScanError where it shows
    nothing.
    """
    R, T = revisited(*poses, spec.noise, rng)
    stop = np.arange(len(T)).repeat(spec.repeats)
    said = said_at(scene, stop, spec)
    return scan_from(scene, (R[stop], T[stop]), said, spec, rng)


def said_at(scene: Scene, stop: ndarray, spec: Spec) -> Entries:
    """What the robot says of its stops (n,) at the poses of a scene, by their numbers:
    entries of a Scan.
    """
    seen = scene.observations
    R, T = seen.R_flange[0, stop], seen.T_flange[0, stop]
    if spec.to_hand:
        R, T = inverse(R, T)
    labels, again = scene.labels, range(1, spec.repeats + 1)
    if spec.repeats > 1:
        labels = tuple(f"{label}m{k}" for label in labels for k in again)
    return {"labels": labels, "R_base_flange": R, "p_base_flange": T}


def scan_from(
    setup: Setup, flange: Frames, said: Entries, spec: Spec, rng: Generator
) -> Scan:
    """The scan of what is seen where the flange is, (P, 3, 3), (P, 3) mm, while the
    robot says where it is: entries of a Scan.

    Eye-to-hand is the same measurement with the roles of base and flange exchanged.
    """
    target, noise = setup.target, spec.noise
    planes = setup.planes(*(inverse(*flange) if spec.to_hand else flange))
    measured = spec.measured or target.tables[-1]
    if measured == "profiles":
        body = spec.specimen or target.specimens[0]
        chains = target.outline(body, *planes, setup.facing[:, 2])
        rows = [spec.scanner.profile(chain, rng) for chain in chains]
    else:
        exact = target.meet(*planes).reshape(-1, 1, len(MEASURED[measured]))
        rows = [*(exact + noise.profile_mm * rng.normal(size=exact.shape))]
    values = [seen[np.isfinite(seen).all(axis=1)] for seen in rows]
    if not any(map(len, values)):
        raise ScanError(
            "from none of these poses is anything seen: "
            "look at [scanner], [motion] and, of a plan, [guess]"
        )
    pose = homogeneous(setup.R_sensor, setup.T_sensor)
    truth = {
        "seed": np.array(spec.seed).tolist(),
        f"T_{MOUNTS[spec.mount]}_sensor": pose.tolist(),
        "target": {name: np.array(v).tolist() for name, v in vars(target).items()},
    }
    if spec.motion:
        truth["delay_ms"] = spec.motion.delay_ms
    return Scan(
        kind=target.kind,
        measured=measured,
        values=tuple(values),
        sizes=spec.sizes,
        # unknown in motion
        side=target.sides(*planes) * np.isnan(said.get("times", np.nan)),
        noise={name: sd for name, sd in vars(noise).items() if sd},
        mount=spec.mount,
        title=spec.title or f"simulated {spec.kind}",
        convention=spec.convention,
        truth=truth,
        **said,
    )
