"""Where the scanner and the target are, roughly, before any calibration; and a scene that is off by as much."""

from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from profilecal.geometry.poses import carry, inverse, rotation_from_xyz_angles, rotations
from profilecal.joint.observations import Observations, State
from profilecal.scan.folder import SCALE, read_header, read_poses
from profilecal.scan.scan import ScanError
from profilecal.scan.toml import check_entries, number, numbers
from profilecal.simulate.poses import Poses
from profilecal.simulate.scene import Scene, in_unit_ball
from profilecal.targets import TARGETS
from profilecal.targets.target import Target


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
    check_entries(path, entries, GUESS, "guess")
    for name in ("mount", "target"):
        if name not in entries:
            raise ScanError(f"{path}: {name} is missing in [guess]; expected roughly where it is")
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
        header = place / "scan.toml"
        scale = SCALE[read_header(header)["units"]] if header.exists() else 1.0
        found = read_poses(place / "poses.csv", scale)
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
