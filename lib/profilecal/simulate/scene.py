"""Scenes: a target, a scanner on a flange, and poses from which it sees the target; random ones, and those of a rough
guess of where everything is, off by as much as the guess may be wrong.
"""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from profilecal.geometry.poses import carry, inverse, rotation_from_xyz_angles, rotations
from profilecal.joint.observations import Observations, State
from profilecal.scan.folder import SCALE, read_header, read_poses
from profilecal.scan.scan import ScanError
from profilecal.scan.toml import check_entries, number, numbers
from profilecal.simulate.robot import Poses
from profilecal.targets import TARGETS
from profilecal.targets.target import Target

STANDOFF = 100.0  # mm, depth of the target's middle in the scan


@dataclass(frozen=True)
class Scene:
    """What a perfect scanner sees of a target, and the truth behind it; a batch of problems along the first axis."""

    target: Target  # of the first problem
    facing: np.ndarray  # (3, 3) a sensor frame that looks at it squarely; its z points away from the scanner
    poses: Poses  # (G, N) that the robot reports, of the first problem
    observations: Observations  # without noise
    truth: State
    labels: tuple[str, ...] = ()  # of the poses, where they have any

    def showing(self, kind: str, sizes: tuple[float, ...]) -> "Scene":
        """Another target in the same place, without observations of it; the same scene where it is there already."""
        if (kind, sizes) == (self.target.kind, self.observations.sizes):
            return self
        target = TARGETS[kind]
        return replace(self, target=target.at(self.target.frame[0], self.facing @ target.stance, sizes))

    def noisy(self, sigma_mm: float, rng: np.random.Generator, trials: int | None = None) -> Observations:
        """The observations with isotropic noise in the scan plane, fresh in each of `trials` copies."""
        points = self.observations.points
        shape = points.shape if trials is None else (trials, *points.shape[1:])
        return replace(self.observations, points=points + sigma_mm * rng.normal(size=shape))


def random_scene(
    kind: str,
    rng: np.random.Generator,
    *,
    mount: tuple | None = None,
    groups: int | None = None,
    positions: int | None = None,
    sizes: tuple | None = None,
    spread_deg: float = 30.0,
    motion: str = "space",
    frame: str = "base",
    axis: np.ndarray | str | None = None,
    count: int = 40,
    steering_mm: float = 0.0,
) -> Scene:
    """A sensor anywhere within 150 mm of the flange along each axis, at any orientation (or at `mount`: R (3, 3),
    T (3,) mm), the target in front of the robot and in view.

    The sensor's first orientation is random; each of the `groups` turns from it by up to `spread_deg`, about any axis,
    about `axis` (3,) of the base, or about the target's own z ("target"). Inside a group of `positions` it moves in
    the base's axes ("base") or with the flange ("tool"), `motion` and `steering_mm` as the target's
    `offsets` have them. `count`: points of a curve. What is left out is as usual for the target.
    """
    target = TARGETS[kind]
    shape = G, N = groups or target.groups, positions or target.positions
    sizes = sizes or target.sizes
    R_sensor, T_sensor = mount or (rotations(rng.uniform(-np.pi, np.pi, 3) / np.sqrt(3)), rng.uniform(-150, 150, 3))
    first, middle = rotations(rng.uniform(-1.5, 1.5, 3)), rng.uniform([600, -300, -100], [1200, 300, 500])
    facing = first @ rotations(np.radians(30) * rng.uniform(-1, 1, 3))
    axes = facing @ target.stance
    placed = target.at(middle, axes, sizes)

    if axis is None:
        turn = in_unit_ball(rng, G)
    else:
        turn = rng.uniform(-1, 1, (G, 1)) * (axes[:, 2] if isinstance(axis, str) else axis)
    turned = rotations(np.radians(spread_deg) * turn) @ first
    moved = target.offsets(shape, motion, facing[:, 2] @ turned, sizes, steering_mm, rng)
    moved = moved @ (np.swapaxes(turned, 1, 2) if frame == "tool" or target.with_tool else first.T)
    origin = middle - STANDOFF * turned[:, None, :, 2] - moved
    R_flange = turned @ R_sensor.T
    poses = Poses(R_flange, origin - (R_flange @ T_sensor)[:, None])

    R, T = np.repeat(R_flange, N, axis=0), poses.positions.reshape(-1, 3)
    points = placed.points_seen(R @ R_sensor, T + R @ T_sensor, count)
    seen = Observations(kind, R[None], T[None], points[None], sizes, np.repeat(np.arange(G), N))
    truth = State(R_sensor[None], T_sensor[None], (tuple(part[None] for part in placed.frame),))
    return Scene(placed, facing, poses, seen, truth)


def in_unit_ball(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points (count, 3), uniform in the unit ball."""
    vectors = rng.normal(size=(count, 3))
    return vectors * np.cbrt(rng.uniform(size=(count, 1))) / np.linalg.norm(vectors, axis=1, keepdims=True)


def stack(scenes) -> Scene:
    """Scenes of one kind and size as a batch."""
    first, *others = scenes
    names = ("R_flange", "T_flange", "points")
    batch = {name: np.concatenate([getattr(s.observations, name) for s in scenes]) for name in names}
    truth = first.truth.join(*(scene.truth for scene in others))
    return replace(first, observations=replace(first.observations, **batch), truth=truth)


@dataclass(frozen=True)
class Margins:
    """By how much a rough guess may be wrong, at most, in any direction."""

    mount_mm: float = 5.0
    mount_deg: float = 3.0
    target_mm: float = 5.0
    target_deg: float = 3.0


@dataclass(frozen=True)
class Guess:
    """Roughly where the sensor is on the flange and the target in the base frame; eye-to-hand: the sensor in the base,
    the target on the flange."""

    mount: tuple[float, ...] = ()  # X Y Z mm, W P R degrees, R = Rz(R) Ry(P) Rx(W)
    target: tuple[float, ...] = ()  # mm, its origin
    axis: tuple[float, ...] = (0.0, 1.0, 0.0)  # along an edge or a rod; for others, across the laser line
    up: tuple[float, ...] = (0.0, 0.0, 1.0)  # from the target towards the scanner; a face's or a disk's normal
    margins: Margins = field(default_factory=Margins)

    @property
    def sensor(self) -> tuple[np.ndarray, np.ndarray]:
        """R (3, 3) and T (3,), mm."""
        return rotation_from_xyz_angles(np.radians(self.mount[3:])), np.array(self.mount[:3])

    def facing(self, kind: str) -> np.ndarray:
        """A sensor frame (3, 3) that looks at the target squarely."""
        y, z = np.array(self.axis, float), -np.array(self.up, float)
        if abs(TARGETS[kind].stance[1, 2]) > 0.5:  # the target's own direction is the sensor's y
            z = z - (z @ y) / (y @ y) * y
        else:
            y = y - (y @ z) / (z @ z) * z
        y, z = y / np.linalg.norm(y), z / np.linalg.norm(z)
        return np.stack([np.cross(y, z), y, z], axis=1)

    def placed(self, kind: str, sizes) -> Target:
        """The target there."""
        return TARGETS[kind].at(np.array(self.target, float), self.facing(kind) @ TARGETS[kind].stance, sizes)


GUESS = {"mount": numbers(6), "target": numbers(3), "axis": numbers(3), "up": numbers(3)}
GUESS |= {f.name: number(0, 90) for f in fields(Margins)}


def read_guess(entries: dict, path="the specification") -> Guess:
    """A guess from the table [guess] of a specification. Raises ScanError."""
    check_entries(path, entries, GUESS, "guess", needed=("mount", "target"))
    margins = {f.name: entries[f.name] for f in fields(Margins) if f.name in entries}
    places = {name: tuple(value) for name, value in entries.items() if name not in margins}
    guess = Guess(**places, margins=Margins(**margins))
    if np.linalg.norm(np.cross(guess.axis, guess.up)) < 1e-3 * np.linalg.norm(guess.axis) * np.linalg.norm(guess.up):
        raise ScanError(f"{path}: axis and up in [guess] are parallel or zero; expected axis across up")
    return guess


def off_by(guess: Guess, kind: str, sizes, rng: np.random.Generator) -> tuple:
    """A truth that the guess is wrong about by no more than its margins: the sensor's R and T, the target, `facing`."""
    (R, T), facing, margins = guess.sensor, guess.facing(kind), guess.margins
    shift, turn, moved, turned = in_unit_ball(rng, 4)
    R = R @ rotations(np.radians(margins.mount_deg) * turn)
    facing = rotations(np.radians(margins.target_deg) * turned) @ facing
    origin = np.array(guess.target) + margins.target_mm * moved
    return R, T + margins.mount_mm * shift, TARGETS[kind].at(origin, facing @ TARGETS[kind].stance, sizes), facing


def planned_poses(place, to_hand: bool) -> dict:
    """What a table of poses says, or that of a scan folder, as `scan.folder.read_poses` has it; R and T as the
    calibration takes them. Raises ScanError."""
    place = Path(place)
    if place.is_dir():
        found = read_poses(place / "poses.csv", SCALE[read_header(place / "scan.toml")["units"]])
    else:
        found = read_poses(place, 1.0)
    R, T = found["R_base_flange"], found["T_base_flange"]
    return found | dict(zip("RT", inverse(R, T) if to_hand else (R, T), strict=True))


def planned_scene(
    kind: str,
    sizes,
    guess: Guess,
    place,
    to_hand: bool,
    steering_mm: float,
    rng: np.random.Generator,
) -> Scene:
    """The poses of a plan, and a sensor and a target that are where the guess has them, but for its margins; where
    the operator steers, by `steering_mm` well, the poses that this takes."""
    plan = planned_poses(place, to_hand)
    R_sensor, T_sensor, target, facing = off_by(guess, kind, sizes, rng)
    R, T = plan["R"], plan["T"]
    if target.steered:
        y = (R @ R_sensor)[..., 1]
        off = np.sum((target.frame[0] - carry(R, T, T_sensor)) * y, axis=1) - steering_mm * rng.normal(size=len(T))
        T = T + off[:, None] * y
    points = target.points_seen(R @ R_sensor, carry(R, T, T_sensor), 40)
    seen = Observations(kind, R[None], T[None], points[None], sizes, plan["group"])
    truth = State(R_sensor[None], T_sensor[None], (tuple(part[None] for part in target.frame),))
    return Scene(target, facing, Poses(R, T[:, None]), seen, truth, plan["labels"])
