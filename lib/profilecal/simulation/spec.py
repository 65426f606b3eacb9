"""Synthetic scans: a specification in, a scan folder's content out, with the truth that
made it.
"""

from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import homogeneous, inverse
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.folder import MOUNTS, SCALE, length_rules, read_header, read_poses
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.toml import TABLE, TEXT, check_entries, number, one_of, whole
from profilecal.simulation.robot import Poses, Robot, Scanner, actual_poses
from profilecal.simulation.scene import (
    GUESS,
    Guess,
    Scene,
    Setup,
    random_scene,
    read_guess,
)
from profilecal.targets import TARGETS

# sees a whole disk of 50 mm radius
WIDE = Scanner(near=40.0, far=260.0, near_width=100.0, far_width=220.0)


@dataclass(frozen=True)
class Spec:
    """What to simulate. Everything that is left out of a specification file has these
    defaults.
    """

    kind: str = "edge"
    title: str = ""
    seed: int = 1
    # which of the target's tables; empty: the last, its points, chords or arcs if it
    # has such
    measured: str = ""
    mount: str = "eye-in-hand"
    convention: str = "quaternion"
    # the target's lengths, mm; left out: as usual for it
    sizes: dict[str, float] = field(default_factory=dict)
    specimen: str = ""  # which body raw profiles show; empty: the target's usual one
    groups: int = 0  # flange orientations; 0: what the kind needs
    positions: int = 0  # in each
    spread_deg: float = 30.0  # the flange turns by up to this
    repeats: int = 1  # measurements at each stop, while the robot stands still
    # a file poses.csv that says where the robot goes; empty: groups, positions and so
    # on do
    poses: str = ""
    guess: Guess | None = (
        # where sensor and target are if there is such a file, but for the guess's
        # margins
        None
    )
    noise: Noise = field(default_factory=lambda: Noise(profile_mm=0.05))
    robot: Robot = field(default_factory=Robot)
    scanner: Scanner = WIDE


def rules_for(kind: str) -> dict:
    """What a specification for a kind of target may say."""
    target = TARGETS[kind]
    return {
        "kind": one_of(TARGETS),
        "title": TEXT,
        "seed": whole(),
        "measured": one_of(target.tables),
        "mount": one_of(MOUNTS),
        "convention": one_of(convention.name for convention in CONVENTIONS),
        "specimen": one_of(target.specimens),
        "groups": whole(0, 10_000),
        "positions": whole(0, 10_000),
        "spread_deg": number(0, 180),
        "repeats": whole(1, 1000),
        "poses": TEXT,
        "noise": {f.name: number(0, 100) for f in fields(Noise)},
        "robot": {f.name: number(0, 100) for f in fields(Robot)},
        "scanner": {f.name: number() for f in fields(Scanner)}
        | {"points": whole(1), "quantum": number(1e-6)},
        "guess": GUESS,
        "plan": TABLE,
    } | length_rules(kind)


def read_spec(entries: dict, path="specification") -> Spec:
    """A specification from the content of a TOML file `path`: Spec's fields, the
    target's lengths, [noise], [robot], [scanner] and [guess]; [plan] is left to
    `profilecal plan`. Raises ScanError.
    """
    entries = {"kind": Spec.kind} | entries
    check_entries(path, {"kind": entries["kind"]}, {"kind": one_of(TARGETS)})
    check_entries(path, entries, rules_for(entries["kind"]))
    entries.pop("plan", None)
    guess = read_guess(entries.pop("guess"), path) if "guess" in entries else None
    noise = replace(Spec().noise, **entries.pop("noise", {}))
    scanner = replace(
        WIDE, **{"noise_mm": noise.profile_mm} | entries.pop("scanner", {})
    )
    if (
        not 0 <= scanner.near < scanner.far
        or min(scanner.near_width, scanner.far_width) <= 0
    ):
        raise ScanError(
            f"{path}: in [scanner] expected 0 <= near < far, near_width > 0 and far_width > 0"
        )
    robot = Robot(**entries.pop("robot", {}))
    sizes = {
        name: entries.pop(name)
        for name in TARGETS[entries["kind"]].lengths
        if name in entries
    }
    spec = Spec(
        **entries, noise=noise, robot=robot, scanner=scanner, sizes=sizes, guess=guess
    )
    if spec.poses and guess is None:
        raise ScanError(
            f"{path}: poses are given, but no [guess]; expected roughly where sensor and target are"
        )
    return (
        replace(spec, poses=str(Path(path).parent / spec.poses)) if spec.poses else spec
    )


def simulate_scan(spec: Spec) -> Scan:
    """The scan that a robot with these errors and a scanner with this noise would
    record, and its truth. Raises ScanError where it shows nothing.
    """
    rng = np.random.default_rng(spec.seed)
    scene = scene_of(spec, rng)
    scan = record(scene, taken(scene, spec, rng), spec, rng)
    if not any(map(len, scan.values)):
        raise ScanError(
            "from none of these poses is anything in the scanner's range: look at [guess] and [scanner]"
        )
    return scan


def scene_of(spec: Spec, rng: np.random.Generator) -> Scene:
    """The target and the poses of a specification: random ones, or those of a plan, and
    a sensor and a target that are where the guess has them, but for its margins. Where
    the operator steers, the poses that this takes.
    """
    sizes = sizes_of(spec)
    if not spec.poses:
        shape = {
            "groups": spec.groups,
            "positions": spec.positions,
            "spread_deg": spec.spread_deg,
        }
        return random_scene(
            spec.kind, rng, sizes=sizes, steering_mm=spec.noise.steering_mm, **shape
        )
    plan = planned_poses(spec.poses, spec.mount == "eye-to-hand")
    setup = spec.guess.setup(spec.kind, sizes, rng)
    R, T = plan["R"], plan["T"]
    if setup.target.steered:
        R_view, origin = setup.planes(R, T)
        y = R_view[..., 1]
        off = np.sum(
            (setup.target.frame[0] - origin) * y, axis=1
        ) - spec.noise.steering_mm * rng.normal(size=len(T))
        T = T + off[:, None] * y
    return Scene.of(setup, Poses(R, T[:, None]), plan["labels"], plan["group"])


def planned_poses(place, to_hand: bool) -> dict:
    """What a table of poses says, or that of a scan folder, as `scan.folder.read_poses`
    has it; R and T as the calibration takes them. Raises ScanError.
    """
    place, scale = Path(place), 1.0
    if place.is_dir():
        place, scale = (
            place / "poses.csv",
            SCALE[read_header(place / "scan.toml")["units"]],
        )
    found = read_poses(place, scale)
    R, T = found["R_base_flange"], found["p_base_flange"]
    return found | dict(zip("RT", inverse(R, T) if to_hand else (R, T), strict=True))


def sizes_of(spec: Spec) -> tuple[float, ...]:
    """The target's lengths, mm."""
    target = TARGETS[spec.kind]
    usual = dict(zip(target.lengths, target.sizes, strict=True))
    return tuple((usual | spec.sizes).values())


def taken(
    scene: Scene, spec: Spec, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Where the flange is, (P, 3, 3), (P, 3) mm, whenever the robot is at the poses of
    a scene.
    """
    shared = scene.observations.group if spec.poses else slice(None)
    actual = actual_poses(
        scene.poses, spec.noise, rng, shared, spec.mount == "eye-to-hand"
    )
    return spec.robot.built(
        *(part.reshape(-1, *part.shape[2:]) for part in actual), rng
    )


def record(scene: Scene, poses, spec: Spec, rng: np.random.Generator) -> Scan:
    """The scan of a scene by a robot that takes its flange to `poses` (P, 3, 3), (P,
    3), mm.
    """
    which = np.repeat(np.arange(len(scene.labels)), spec.repeats)
    R_actual, T_actual = (
        part[which] for part in spec.robot.visiting(*poses, spec.noise, rng)
    )
    # the same measurement with the roles of base and flange exchanged
    to_hand = spec.mount == "eye-to-hand"
    planes = scene.planes(
        *(inverse(R_actual, T_actual) if to_hand else (R_actual, T_actual))
    )
    measured = spec.measured or scene.target.tables[-1]
    if measured == "profiles":
        values = raw_profiles(scene, planes, spec, rng)
    else:
        seen = scene.target.meet(*planes).reshape(len(which), 1, -1)
        values = list(seen + spec.noise.profile_mm * rng.normal(size=seen.shape))
    R, T = scene.observations.R_flange[0, which], scene.observations.T_flange[0, which]
    R, T = inverse(R, T) if to_hand else (R, T)
    again = [f"m{k + 1}" for k in range(spec.repeats)] if spec.repeats > 1 else [""]
    return Scan(
        kind=spec.kind,
        labels=tuple(name + number for name in scene.labels for number in again),
        R_base_flange=R,
        p_base_flange=T,
        measured=measured,
        values=tuple(v[np.isfinite(v).all(axis=1)] for v in values),
        sizes=scene.sizes,
        side=scene.target.sides(*planes),
        group=scene.observations.group[which],
        noise={name: value for name, value in asdict(spec.noise).items() if value},
        mount=spec.mount,
        title=spec.title or f"simulated {spec.kind}",
        convention=spec.convention,
        truth={
            "seed": spec.seed,
            "T_base_sensor" if to_hand else "T_flange_sensor": homogeneous(
                scene.R_sensor, scene.T_sensor
            ).tolist(),
            "target": {
                name: np.asarray(value).tolist()
                for name, value in asdict(scene.target).items()
            },
        },
    )


def raw_profiles(
    setup: Setup, planes, spec: Spec, rng: np.random.Generator
) -> list[np.ndarray]:
    """Profiles (points, 2) in mm, one for each scan plane (P, 3, 3), (P, 3)."""
    specimen = spec.specimen or setup.target.specimens[0]
    outlines = setup.target.outline(specimen, *planes, setup.facing[:, 2])
    return [spec.scanner.profile(outline, rng) for outline in outlines]
