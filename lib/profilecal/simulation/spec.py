"""Synthetic scans: a specification in, a scan out, with the truth that made it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import Frames, homogeneous, inverse
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.scan import MEASURED, MOUNTS, Scan, length_rules
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
from profilecal.simulation.sweeps import Motion, Sweep, drive, resting, sweeps_of
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
    # the target's lengths, mm, entries by their names; left out: as usual for it
    sizes: dict[str, float] = field(default_factory=dict)

    @property
    def to_hand(self) -> bool:
        """Whether the scanner is fixed, and the target on the flange."""
        return self.mount == "eye-to-hand"

    @property
    def measures(self) -> dict[str, float]:
        """The target's lengths by name, mm."""
        target = TARGETS[self.kind]
        return dict(zip(target.lengths, target.sizes, strict=True)) | self.sizes

    def scene(self, rng: Generator) -> Scene:
        """The target, and poses that see it."""
        return random_scene(
            self.kind,
            rng,
            sizes=tuple(self.measures.values()),
            groups=self.groups,
            positions=self.positions,
            spread_deg=self.spread_deg,
            steering_mm=self.noise.steering_mm,
        )

    def sweeps(self, scene: Scene, motion: Motion, rng: Generator) -> list[Sweep]:
        """The sweeps of its motion."""
        return sweeps_of(scene, motion, self.spread_deg, rng)


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
    entries = scan.truth["target"]
    fields_of_target = {name: np.array(value) for name, value in entries.items()}
    return Truth(
        pose=np.array(scan.truth[pose_name(scan.mount)]),
        target=scan.target(**fields_of_target),
    )


def pose_name(mount: str) -> str:
    """What the sensor's pose is called in files."""
    return f"T_{MOUNTS[mount]}_sensor"


def read_spec(
    said: Mapping[str, Any],
    path: str | Path,
    made: type[Spec] = Spec,
) -> Any:
    """A specification `made` of the content of a TOML file `path`: Spec's fields, or
    those of another dataclass that goes on from it, and the target's lengths.

    Raises ScanError.
    """
    entries = {"kind": Spec.kind} | dict(said)
    check_entries(path, {"kind": entries["kind"]}, {"kind": one_of(TARGETS)})
    target = TARGETS[entries["kind"]]
    if "motion" in entries and not target.across:
        raise ScanError(f"{path}: a {target.kind} is not swept; leave [motion] out")
    lengths = length_rules(target.kind)
    known = entries_of(made) | {
        "measured": one_of(target.tables),
        "specimen": one_of(target.specimens),
    }
    del known["sizes"]
    check_entries(path, entries, known | lengths)
    usual = made()
    sizes = {name: entries.pop(name) for name in lengths if name in entries}
    noise_mm = entries.get("noise", {}).get("profile_mm", usual.noise.profile_mm)
    entries["scanner"] = {"noise_mm": noise_mm} | entries.get("scanner", {})
    with naming(path):
        for name, value in entries.items():
            if isinstance(value, Mapping):
                table = getattr(usual, name)
                entries[name] = (
                    replace(table, **value) if table else known[name](**value)
                )
        return made(**entries, sizes=sizes)


@naming("simulation")
def simulate_scan(spec: Spec) -> Scan:
    """The scan that a robot with these errors and a scanner with this noise would
    record, and its truth.

    Raises ScanError where it shows nothing, for poses or speeds that no robot has, and
    for errors that would change nothing.
    """
    check_effects(spec)
    rng = np.random.default_rng(spec.seed)
    scene = spec.scene(rng)
    if spec.scan > 1:  # its errors are others than those of the first
        rng = np.random.default_rng(np.append(spec.seed, spec.scan))
    motion = spec.motion
    if motion is None:
        return record(scene, taken(scene, spec, rng), spec, rng)
    said, flange = drive(
        scene,
        motion,
        spec.noise,
        rng,
        stops=resting(scene, motion, spec.spread_deg, rng),
        sweeps=spec.sweeps(scene, motion, rng),
        to_hand=spec.to_hand,
    )
    scan = scan_from(scene, flange, said, spec, rng)
    scan.truth["delay_ms"] = motion.delay_ms
    return scan


def check_effects(spec: Spec) -> None:
    """Refuse errors that a robot may have and a simulation of this scan leaves out."""
    sizes = vars(spec.noise) | vars(spec.robot) | {"repeats": spec.repeats - 1}
    idle = ["accuracy_mm", "accuracy_deg"]
    if spec.motion:
        idle += ["joint_deg", "link_mm", "repeats"]
    if not TARGETS[spec.kind].steered:
        idle.append("steering_mm")
    for name in idle:
        if sizes[name]:
            raise ScanError(f"{name} has no effect in this simulation; leave it out")


def taken(scene: Scene, spec: Spec, rng: Generator) -> Frames:
    """Where the flange is, (P, 3, 3), (P, 3) mm, whenever the robot is at the poses of
    a scene.
    """
    # numbers of the groups, each at the first of its positions
    shared = scene.observations.labels[:: scene.poses[1].shape[1]]
    actual = actual_poses(*scene.poses, spec.noise, rng, shared, spec.to_hand)
    R, T = (part.reshape(-1, *part.shape[2:]) for part in actual)
    return spec.robot.built(R, T, np.random.default_rng(np.append(spec.seed, 0)))


def record(scene: Scene, poses: Frames, spec: Spec, rng: Generator) -> Scan:
    """The scan of a scene by a robot that takes its flange to `poses` (P, 3, 3), (P,
    3), mm. Raises ScanError where it shows nothing.
    """
    # what is measured again at a stop has the error of the same visit
    visit = np.repeat(np.arange(len(scene.labels)), spec.repeats)
    R_actual, T_actual = revisited(*poses, spec.noise, rng)
    visited = scene.observations.keep(visit)
    R, T = visited.R_flange[0], visited.T_flange[0]
    if spec.to_hand:
        R, T = inverse(R, T)
    again = [f"m{k + 1}" for k in range(spec.repeats)] if spec.repeats > 1 else [""]
    said = {
        "labels": tuple(name + suffix for name in scene.labels for suffix in again),
        "R_base_flange": R,
        "p_base_flange": T,
        "group": visited.labels,
    }
    return scan_from(scene, (R_actual[visit], T_actual[visit]), said, spec, rng)


def scan_from(
    setup: Setup, flange: Frames, said: Entries, spec: Spec, rng: Generator
) -> Scan:
    """The scan of what is seen where the flange is, (P, 3, 3), (P, 3) mm, while the
    robot says where it is: entries of a Scan.

    Eye-to-hand is the same measurement with the roles of base and flange exchanged.
    """
    target = setup.target
    planes = setup.planes(*(inverse(*flange) if spec.to_hand else flange))
    measured = spec.measured or target.tables[-1]
    if measured == "profiles":
        specimen = spec.specimen or target.specimens[0]
        outlines = target.outline(specimen, *planes, setup.facing[:, 2])
        seen = [spec.scanner.profile(outline, rng) for outline in outlines]
    else:
        exact = target.meet(*planes).reshape(-1, 1, len(MEASURED[measured]))
        seen = [*(exact + spec.noise.profile_mm * rng.normal(size=exact.shape))]
    values = tuple(rows[np.isfinite(rows).all(axis=1)] for rows in seen)
    if not any(map(len, values)):
        raise ScanError(
            "from none of these poses is anything in the scanner's range: "
            "look at [guess] and [scanner]"
        )
    side = target.sides(*planes)
    if "times" in said:
        side = np.where(np.isnan(said["times"]), side, 0)
    noise = {name: value for name, value in vars(spec.noise).items() if value}
    placed = vars(target)
    truth = {
        "seed": np.asarray(spec.seed).tolist(),
        pose_name(spec.mount): homogeneous(setup.R_sensor, setup.T_sensor).tolist(),
        "target": {name: np.asarray(value).tolist() for name, value in placed.items()},
    }
    return Scan(
        kind=spec.kind,
        sizes=target.measures,
        noise=noise,
        mount=spec.mount,
        title=spec.title or f"simulated {spec.kind}",
        convention=spec.convention,
        measured=measured,
        values=values,
        side=side,
        truth=truth,
        **said,
    )
