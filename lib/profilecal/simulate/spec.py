"""Synthetic scans: a specification in, a scan folder's content out, with the truth that made it."""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import homogeneous, rotations
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.folder import MOUNTS
from profilecal.scan.scan import Scan, ScanError
from profilecal.simulate.plan import Poses, actual_poses
from profilecal.simulate.scanner import Scanner
from profilecal.simulate.scene import RADIUS, STANDOFF, offsets
from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.edge import SPECIMENS, Edge
from profilecal.targets.plane import Plane
from profilecal.targets.point import Point

SIZES = {"edge": (25, 10), "disk": (4, 40), "ball": (10, 4), "plane": (12, 3), "point": (20, 1)}  # groups, positions


MEASURED = {"edge": "points", "disk": "chords", "ball": "arcs", "plane": "profiles", "point": "points"}


WIDE = Scanner(near=40.0, far=260.0, near_width=100.0, far_width=220.0)  # sees a whole disk of 50 mm radius


BELOW_MM = 20.0  # of a disk or ball, a table


@dataclass(frozen=True)
class Spec:
    """What to simulate. Everything that is left out of a specification file has these defaults."""

    kind: str = "edge"
    title: str = ""
    seed: int = 1
    measured: str = ""  # profiles, or points, chords, arcs; empty: what the kind has
    mount: str = "eye-in-hand"
    convention: str = "quaternion"
    radius: float = 0.0  # mm, of disk and ball; 0: 50 and 25
    specimen: str = "parallel bar"  # edge: which one raw profiles show
    groups: int = 0  # flange orientations; 0: what the kind needs
    positions: int = 0  # in each
    spread_deg: float = 30.0  # the flange turns by up to this
    motion: str = "space"  # edge: inside a group, anywhere ("space") or along an "arc"
    frame: str = "base"  # edge: translations in the axes of the "base" or the "tool"
    noise: Noise = field(default_factory=lambda: Noise(profile_mm=0.05))
    scanner: Scanner = WIDE

    def __post_init__(self):
        known = {"kind": MEASURED, "mount": MOUNTS, "specimen": SPECIMENS, "motion": ("space", "arc")}
        known |= {"frame": ("base", "tool"), "convention": [c.name for c in CONVENTIONS]}
        known["measured"] = ("", "profiles", MEASURED.get(self.kind))
        for name, choices in known.items():
            value = getattr(self, name)
            if value not in choices:
                names = ", ".join(filter(None, choices))
                raise ScanError(f"{name} is {value!r}; expected one of {names}")


def read_spec(entries: dict) -> Spec:
    """A specification from the content of a TOML file: Spec's fields, [noise] and [scanner]. Raises ScanError."""
    noise = _filled(Noise(profile_mm=0.05), entries.pop("noise", {}), "[noise]")
    scanner = _filled(replace(WIDE, noise_mm=noise.profile_mm), entries.pop("scanner", {}), "[scanner]")
    return replace(_filled(Spec(), entries, "the specification"), noise=noise, scanner=scanner)


def _filled(default, entries: dict, where: str):
    known = {f.name: type(getattr(default, f.name)) for f in fields(default) if f.name not in ("noise", "scanner")}
    for key, value in entries.items():
        if key not in known:
            raise ScanError(f"unknown entry {key!r} in {where}; there are {', '.join(known)}")
        expected = (int, float) if known[key] is float else known[key]
        if not isinstance(value, expected) or isinstance(value, bool) or (not isinstance(value, str) and value < 0):
            raise ScanError(f"{key} is {value!r} in {where}; expected {known[key].__name__}, zero or more")
    return replace(default, **entries)


def simulate_scan(spec: Spec) -> Scan:
    """The scan that a robot with these errors and a scanner with this noise would record, and its truth.

    The sensor sits anywhere within 150 mm of the flange along each axis, at any orientation; the target in front.
    """
    rng = np.random.default_rng(spec.seed)
    G, N = (given or usual for given, usual in zip((spec.groups, spec.positions), SIZES[spec.kind], strict=True))
    R_sensor, T_sensor = rotations(rng.uniform(-np.pi, np.pi, 3) / np.sqrt(3)), rng.uniform(-150, 150, 3)
    first, middle = rotations(rng.uniform(-1.5, 1.5, 3)), rng.uniform([600, -300, -100], [1200, 300, 500])
    facing = first @ rotations(np.radians(30) * rng.uniform(-1, 1, 3))
    radius = spec.radius or RADIUS.get(spec.kind, 0.0)

    turned = rotations(np.radians(spec.spread_deg) * _in_ball(rng, G)) @ first
    moved = offsets(spec.kind, spec.motion, G, N, spec.noise.steering_mm, facing[:, 2] @ turned, rng)
    if spec.kind in RADIUS:
        moved = moved * radius / RADIUS[spec.kind]
    with_tool = spec.frame == "tool" or spec.kind in ("disk", "ball", "point")
    moved = moved @ (np.swapaxes(turned, 1, 2) if with_tool else first.T)
    origin = middle - STANDOFF * turned[:, None, :, 2] - moved
    R_flange = turned @ R_sensor.T
    reported = Poses(R_flange, origin - (R_flange @ T_sensor)[:, None])

    R, T = actual_poses(reported, spec.noise, rng)  # where the flange really is
    R, T = R.reshape(-1, 3, 3), T.reshape(-1, 3)
    planes = R @ R_sensor, T + R @ T_sensor
    target = {
        "edge": lambda: Edge(middle, facing[:, 1]),
        "disk": lambda: Disk(middle, facing[:, 2], radius),
        "ball": lambda: Ball(middle, radius),
        "plane": lambda: Plane(middle, facing[:, 2]),
        "point": lambda: Point(middle),
    }[spec.kind]()
    measured = spec.measured or MEASURED[spec.kind]
    if measured == "profiles":
        values = raw_profiles(target, facing, planes, spec, rng)
    else:
        seen = target.meet(*planes).reshape(G * N, 1, -1)
        values = list(seen + spec.noise.profile_mm * rng.normal(size=seen.shape))
    values = [v[np.isfinite(v).all(axis=1)] for v in values]
    R_reported, T_reported = np.repeat(reported.rotations, N, axis=0), reported.positions.reshape(-1, 3)
    if spec.mount == "eye-to-hand":  # the same measurement with the roles of base and flange exchanged
        R_reported = R_reported.transpose(0, 2, 1)
        T_reported = -np.einsum("nab,nb->na", R_reported, T_reported)
    y = np.einsum("na,na->n", middle - planes[1], planes[0][:, :, 1])
    noise = {f.name: getattr(spec.noise, f.name) for f in fields(spec.noise) if getattr(spec.noise, f.name)}
    placement = {f.name: np.asarray(getattr(target, f.name)).tolist() for f in fields(target)}
    pose = "T_flange_sensor" if spec.mount == "eye-in-hand" else "T_base_sensor"
    return Scan(
        kind=spec.kind,
        labels=tuple(f"g{g + 1}p{n + 1}" for g in range(G) for n in range(N)),
        R_base_flange=R_reported,
        T_base_flange=T_reported,
        measured=measured,
        values=tuple(values),
        radius=radius or None,
        side=np.sign(y) if spec.kind == "ball" else np.zeros(G * N),
        group=np.repeat(np.arange(G), N),
        noise=noise,
        mount=spec.mount,
        title=spec.title or f"simulated {spec.kind}, {G} orientations x {N} positions",
        convention=spec.convention,
        truth={"seed": spec.seed, pose: homogeneous(R_sensor, T_sensor).tolist(), "target": placement},
    )


def _in_ball(rng, count: int) -> np.ndarray:
    """Points (count, 3), uniform in the unit ball."""
    vectors = rng.normal(size=(count, 3))
    return vectors * np.cbrt(rng.uniform(size=(count, 1))) / np.linalg.norm(vectors, axis=1, keepdims=True)


def raw_profiles(target, facing, planes, spec: Spec, rng) -> list[np.ndarray]:
    """Profiles (points, 2) in mm, one for each scan plane, whose `facing` z points away from the scanner."""
    if spec.kind == "point":
        raise ScanError("a marked point leaves no trace in a profile; leave measured out")
    if spec.kind == "edge":
        sign = np.sign(np.cross(target.direction, -facing[:, 2]) @ planes[0].mean(axis=0)[:, 0])
        outlines = Edge(target.point, sign * target.direction).outline(spec.specimen, -facing[:, 2], *planes)
    else:
        outlines = OUTLINES[spec.kind](target, facing, planes)
    return [spec.scanner.decode(spec.scanner.count(outline, rng)) for outline in outlines]


def line_at(plane: Plane, planes, x) -> np.ndarray:
    """Points (n, k, 2) at x (n, k) or (k,) of the lines in which scan planes meet a face."""
    nearest, along = np.moveaxis(plane.meet(*planes), 1, 0)
    x = np.broadcast_to(x, (len(nearest), np.shape(x)[-1]))
    z = nearest[:, None, 1] + (x - nearest[:, None, 0]) * (along[:, 1] / along[:, 0])[:, None]
    return np.stack([x, z], axis=-1)


def plane_outlines(target: Plane, facing, planes) -> np.ndarray:
    """A face that fills the field of view."""
    return line_at(target, planes, np.array([-500.0, 500.0]))


def disk_outlines(target: Disk, facing, planes) -> list[np.ndarray]:
    """A disk on top of a cylinder, above a table."""
    table = Plane(target.centre + BELOW_MM * facing[:, 2], facing[:, 2])
    tips = target.meet(*planes)
    x = np.concatenate([np.full((len(tips), 1), -500.0), tips[..., 0], np.full((len(tips), 1), 500.0)], axis=1)
    below = line_at(table, planes, x)
    whole = line_at(table, planes, np.array([-500.0, 500.0]))
    return [
        np.concatenate([b[:2], t, b[2:]]) if np.isfinite(t).all() else w
        for b, t, w in zip(below, tips, whole, strict=True)
    ]


def ball_outlines(target: Ball, facing, planes) -> list[np.ndarray]:
    """A ball above a table."""
    table = Plane(target.centre + (target.radius + BELOW_MM) * facing[:, 2], facing[:, 2])
    angle = np.radians(np.linspace(-90, 90, 721))
    around = np.stack([np.sin(angle), -np.cos(angle)], axis=-1)
    outlines = []
    for circle, base in zip(target.meet(*planes), line_at(table, planes, np.array([-500.0, 500.0])), strict=True):
        arc = circle[:2] + circle[2] * around
        if np.isfinite(circle).all():
            drop = base[0, 1] + (arc[[0, -1], 0] - base[0, 0]) / (base[1, 0] - base[0, 0]) * (base[1, 1] - base[0, 1])
            foot = np.stack([arc[[0, -1], 0], drop], axis=-1)
            outlines.append(np.concatenate([base[:1], foot[:1], arc, foot[1:], base[1:]]))
        else:
            outlines.append(base)
    return outlines


OUTLINES = {"plane": plane_outlines, "disk": disk_outlines, "ball": ball_outlines}
