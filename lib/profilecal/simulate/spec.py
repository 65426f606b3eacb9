"""Synthetic scans: a specification in, a scan folder's content out, with the truth that made it."""

from dataclasses import asdict, dataclass, field, fields, replace

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import homogeneous, inverse
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.folder import MOUNTS
from profilecal.scan.scan import Scan, ScanError
from profilecal.simulate.plan import actual_poses, scan_planes
from profilecal.simulate.scanner import Scanner
from profilecal.simulate.scene import Scene, random_scene
from profilecal.targets import TARGETS

WIDE = Scanner(near=40.0, far=260.0, near_width=100.0, far_width=220.0)  # sees a whole disk of 50 mm radius
ELSEWHERE = ("noise", "scanner", "sizes")  # fields of Spec that are no entries of their own


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
    motion: str = "space"  # inside a group, anywhere ("space") or along an "arc", where the target leaves a choice
    frame: str = "base"  # edge: translations in the axes of the "base" or the "tool"
    noise: Noise = field(default_factory=lambda: Noise(profile_mm=0.05))
    scanner: Scanner = WIDE

    def __post_init__(self):
        _choose("kind", self.kind, TARGETS)
        target = TARGETS[self.kind]
        _choose("mount", self.mount, MOUNTS)
        _choose("measured", self.measured, ("", *target.tables))
        _choose("specimen", self.specimen, ("", *target.specimens))
        _choose("motion", self.motion, ("space", "arc"))
        _choose("frame", self.frame, ("base", "tool"))
        _choose("convention", self.convention, [c.name for c in CONVENTIONS])
        for name in self.sizes:
            _choose("a size", name, target.lengths)


def _choose(name: str, value, choices) -> None:
    if value not in choices:
        raise ScanError(f"{name} is {value!r}; expected one of {', '.join(filter(None, choices))}")


def read_spec(entries: dict) -> Spec:
    """A specification from the content of a TOML file: Spec's fields, the target's lengths, [noise] and [scanner].

    Raises ScanError."""
    noise = _filled(Noise(profile_mm=0.05), entries.pop("noise", {}), "[noise]")
    scanner = _filled(replace(WIDE, noise_mm=noise.profile_mm), entries.pop("scanner", {}), "[scanner]")
    kind = entries.get("kind", Spec.kind)
    lengths = TARGETS[kind].lengths if isinstance(kind, str) and kind in TARGETS else ()
    sizes = {name: entries.pop(name) for name in lengths if name in entries}
    for name, value in sizes.items():
        _check(name, value, float, "the specification")
    return replace(_filled(Spec(), entries, "the specification"), noise=noise, scanner=scanner, sizes=sizes)


def _filled(default, entries: dict, where: str):
    known = {f.name: type(getattr(default, f.name)) for f in fields(default) if f.name not in ELSEWHERE}
    for key, value in entries.items():
        if key not in known:
            raise ScanError(f"unknown entry {key!r} in {where}; there are {', '.join(known)}")
        _check(key, value, known[key], where)
    return replace(default, **entries)


def _check(key: str, value, kind: type, where: str) -> None:
    expected = (int, float) if kind is float else kind
    if not isinstance(value, expected) or isinstance(value, bool) or (not isinstance(value, str) and value < 0):
        raise ScanError(f"{key} is {value!r} in {where}; expected {kind.__name__}, zero or more")


def simulate_scan(spec: Spec) -> Scan:
    """The scan that a robot with these errors and a scanner with this noise would record, and its truth."""
    rng = np.random.default_rng(spec.seed)
    target = TARGETS[spec.kind]
    usual = dict(zip(target.lengths, target.sizes, strict=True))
    sizes = tuple((usual | spec.sizes).values())
    scene = random_scene(
        spec.kind,
        rng,
        groups=spec.groups,
        positions=spec.positions,
        sizes=sizes,
        spread_deg=spec.spread_deg,
        motion=spec.motion,
        frame=spec.frame,
        steering_mm=spec.noise.steering_mm,
    )
    (R_sensor,), (T_sensor,) = scene.truth.rotation, scene.truth.translation
    actual = scan_planes(R_sensor, T_sensor, *actual_poses(scene.poses, spec.noise, rng))
    planes = tuple(part.reshape(-1, *part.shape[2:]) for part in actual)
    measured = spec.measured or target.tables[-1]
    if measured == "profiles":
        values = raw_profiles(scene, planes, spec, rng)
    else:
        seen = scene.target.meet(*planes).reshape(len(planes[0]), 1, -1)
        values = list(seen + spec.noise.profile_mm * rng.normal(size=seen.shape))
    G, N = scene.poses.positions.shape[:2]
    R, T = scene.observations.R_flange[0], scene.observations.T_flange[0]
    to_hand = spec.mount == "eye-to-hand"  # the same measurement with the roles of base and flange exchanged
    R, T = inverse(R, T) if to_hand else (R, T)
    return Scan(
        kind=spec.kind,
        labels=tuple(f"g{g + 1}p{n + 1}" for g in range(G) for n in range(N)),
        R_base_flange=R,
        T_base_flange=T,
        measured=measured,
        values=tuple(v[np.isfinite(v).all(axis=1)] for v in values),
        sizes=sizes,
        side=scene.target.sides(*planes),
        group=scene.observations.group,
        noise={name: value for name, value in asdict(spec.noise).items() if value},
        mount=spec.mount,
        title=spec.title or f"simulated {spec.kind}, {G} orientations x {N} positions",
        convention=spec.convention,
        truth={
            "seed": spec.seed,
            "T_base_sensor" if to_hand else "T_flange_sensor": homogeneous(R_sensor, T_sensor).tolist(),
            "target": {name: np.asarray(value).tolist() for name, value in asdict(scene.target).items()},
        },
    )


def raw_profiles(scene: Scene, planes, spec: Spec, rng) -> list[np.ndarray]:
    """Profiles (points, 2) in mm, one for each scan plane (P, 3, 3), (P, 3)."""
    specimen = spec.specimen or scene.target.specimens[0]
    outlines = scene.target.outline(specimen, *planes, scene.facing[:, 2])
    return [spec.scanner.decode(spec.scanner.count(outline, rng)) for outline in outlines]
