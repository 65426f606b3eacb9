"""Synthetic scans: a specification in, a scan folder's content out, with the truth that made it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import carry, homogeneous, inverse
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.folder import MOUNTS, length_rules
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.toml import TABLE, TEXT, check_entries, number, one_of, whole
from profilecal.simulate.robot import Robot, Scanner, actual_poses
from profilecal.simulate.scene import GUESS, Guess, Scene, planned_scene, random_scene, read_guess
from profilecal.targets import TARGETS

WIDE = Scanner(near=40.0, far=260.0, near_width=100.0, far_width=220.0)  # sees a whole disk of 50 mm radius


@dataclass(frozen=True)
class Spec:
    """What to simulate. Everything that is left out of a specification file has these defaults."""

    kind: str = "edge"
    title: str = ""
    seed: int = 1
    measured: str = ""  # which of the target's tables; empty: the last, its points, chords or arcs if it has such
    mount: str = "eye-in-hand"
    convention: str = "quaternion"
    sizes: dict[str, float] = field(default_factory=dict)  # the target's lengths, mm; left out: as usual for it
    specimen: str = ""  # which body raw profiles show; empty: the target's usual one
    groups: int = 0  # flange orientations; 0: what the kind needs
    positions: int = 0  # in each
    spread_deg: float = 30.0  # the flange turns by up to this
    repeats: int = 1  # measurements at each stop, while the robot stands still
    poses: str = ""  # a file poses.csv that says where the robot goes; empty: groups, positions and so on do
    guess: Guess | None = None  # where sensor and target are if there is such a file, but for the guess's margins
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
        "scanner": {f.name: number() for f in fields(Scanner)} | {"points": whole(1), "quantum": number(1e-6)},
        "guess": GUESS,
        "plan": TABLE,
    } | length_rules(kind)


def read_spec(entries: dict, path="specification") -> Spec:
    """A specification from the content of a TOML file `path`: Spec's fields, the target's lengths, [noise], [robot],
    [scanner] and [guess]; [plan] is left to `profilecal plan`. Raises ScanError."""
    entries = {"kind": Spec.kind} | entries
    check_entries(path, {"kind": entries["kind"]}, {"kind": one_of(TARGETS)})
    check_entries(path, entries, rules_for(entries["kind"]))
    entries.pop("plan", None)
    guess = read_guess(entries.pop("guess"), path) if "guess" in entries else None
    noise = replace(Spec().noise, **entries.pop("noise", {}))
    scanner = replace(WIDE, **{"noise_mm": noise.profile_mm} | entries.pop("scanner", {}))
    robot = Robot(**entries.pop("robot", {}))
    sizes = {name: entries.pop(name) for name in TARGETS[entries["kind"]].lengths if name in entries}
    spec = Spec(**entries, noise=noise, robot=robot, scanner=scanner, sizes=sizes, guess=guess)
    if spec.poses and guess is None:
        raise ScanError(f"{path}: poses are given, but no [guess]; expected roughly where sensor and target are")
    return replace(spec, poses=str(Path(path).parent / spec.poses)) if spec.poses else spec


def simulate_scan(spec: Spec) -> Scan:
    """The scan that a robot with these errors and a scanner with this noise would record, and its truth."""
    return simulate_scans([spec])[0]


def simulate_scans(specs: Sequence[Spec]) -> list[Scan]:
    """One scan for each specification, of targets that stand in the same place one after the other: by one sensor from
    the same poses, where the robot errs alike but for what is fresh at each visit. The first says where and how."""
    first = specs[0]
    rng = np.random.default_rng(first.seed)
    scene = scene_of(first, rng)
    shared = scene.observations.group if first.poses else slice(None)
    actual = actual_poses(scene.poses, first.noise, rng, shared, first.mount == "eye-to-hand")
    poses = first.robot.built(*(part.reshape(-1, *part.shape[2:]) for part in actual), rng)
    return [record(scene.showing(spec.kind, sizes_of(spec)), poses, spec, first.robot, rng) for spec in specs]


def scene_of(spec: Spec, rng: np.random.Generator) -> Scene:
    """The target and the poses of a specification."""
    sizes, steering_mm = sizes_of(spec), spec.noise.steering_mm
    if spec.poses:
        return planned_scene(spec.kind, sizes, spec.guess, spec.poses, spec.mount == "eye-to-hand", steering_mm, rng)
    shape = {"groups": spec.groups, "positions": spec.positions, "spread_deg": spec.spread_deg}
    return random_scene(spec.kind, rng, sizes=sizes, steering_mm=steering_mm, **shape)


def sizes_of(spec: Spec) -> tuple[float, ...]:
    """The target's lengths, mm."""
    target = TARGETS[spec.kind]
    usual = dict(zip(target.lengths, target.sizes, strict=True))
    return tuple((usual | spec.sizes).values())


def record(scene: Scene, poses, spec: Spec, robot: Robot, rng: np.random.Generator) -> Scan:
    """The scan of a scene by a robot that takes its flange to `poses` (P, 3, 3), (P, 3), mm."""
    (R_sensor,), (T_sensor,) = scene.truth.rotation, scene.truth.translation
    which = np.repeat(np.arange(len(poses[1])), spec.repeats)
    R_actual, T_actual = (part[which] for part in robot.visiting(*poses, spec.noise, rng))
    to_hand = spec.mount == "eye-to-hand"  # the same measurement with the roles of base and flange exchanged
    if to_hand:
        R_actual, T_actual = inverse(R_actual, T_actual)
    planes = R_actual @ R_sensor, carry(R_actual, T_actual, T_sensor)
    measured = spec.measured or scene.target.tables[-1]
    if measured == "profiles":
        values = raw_profiles(scene, planes, spec, rng)
    else:
        seen = scene.target.meet(*planes).reshape(len(which), 1, -1)
        values = list(seen + spec.noise.profile_mm * rng.normal(size=seen.shape))
    R, T = scene.observations.R_flange[0, which], scene.observations.T_flange[0, which]
    R, T = inverse(R, T) if to_hand else (R, T)
    return Scan(
        kind=spec.kind,
        labels=labels(scene.labels or numbered(scene.poses.positions.shape[:2]), spec.repeats),
        R_base_flange=R,
        T_base_flange=T,
        measured=measured,
        values=tuple(v[np.isfinite(v).all(axis=1)] for v in values),
        sizes=sizes_of(spec),
        side=scene.target.sides(*planes),
        group=scene.observations.group[which],
        noise={name: value for name, value in asdict(spec.noise).items() if value},
        mount=spec.mount,
        title=spec.title or title(spec, scene),
        convention=spec.convention,
        truth={
            "seed": spec.seed,
            "T_base_sensor" if to_hand else "T_flange_sensor": homogeneous(R_sensor, T_sensor).tolist(),
            "target": {name: np.asarray(value).tolist() for name, value in asdict(scene.target).items()},
        },
    )


def title(spec: Spec, scene: Scene) -> str:
    """What a scan is, where the specification does not call it otherwise."""
    G, N = scene.poses.positions.shape[:2]
    often = f", {spec.repeats} times" if spec.repeats > 1 else ""
    poses = f"{G} planned poses" if spec.poses else f"{G} orientations x {N} positions"
    return f"simulated {spec.kind}, {poses}{often}"


def numbered(shape) -> list[str]:
    """Labels of poses in the order of `shape` (groups, positions)."""
    return [f"g{g + 1}p{n + 1}" for g in range(shape[0]) for n in range(shape[1])]


def labels(names, repeats: int) -> tuple[str, ...]:
    """Of measurements from poses that have `names`."""
    return tuple(names) if repeats == 1 else tuple(f"{name}m{k + 1}" for name in names for k in range(repeats))


def raw_profiles(scene, planes, spec: Spec, rng) -> list[np.ndarray]:
    """Profiles (points, 2) in mm, one for each scan plane (P, 3, 3), (P, 3)."""
    specimen = spec.specimen or scene.target.specimens[0]
    outlines = scene.target.outline(specimen, *planes, scene.facing[:, 2])
    return [spec.scanner.profile(outline, rng) for outline in outlines]
