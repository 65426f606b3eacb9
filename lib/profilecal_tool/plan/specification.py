"""Specifications of plans: a guess in place of the truth, and poses in a file."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.poses import inverse, rotation_from_xyz_angles, rotations
from profilecal.scan.folder import read_header, read_poses
from profilecal.scan.scan import Scan
from profilecal.scan.toml import number, numbers
from profilecal.simulation.robot import Poses
from profilecal.simulation.scene import Scene, Setup, in_unit_ball
from profilecal.simulation.spec import (
    Spec,
    errors_of,
    read_spec,
    record_sweeps,
    recorded,
    simulate_scan,
    sizes_of,
)
from profilecal.simulation.sweeps import Sweep
from profilecal.targets import TARGETS

Vector = Annotated[Sequence[float], numbers(3)]
Margin = Annotated[float, number(0, 90)]
MARGINS = ("mount_mm", "mount_deg", "target_mm", "target_deg")


@dataclass(frozen=True)
class Guess:
    """Roughly where the sensor is on the flange and the target in the base frame;
    eye-to-hand: the sensor in the base, the target on the flange.

    And by how much that may be wrong, at most, in any direction.
    """

    # X Y Z mm, W P R degrees, R = Rz(R) Ry(P) Rx(W)
    mount: Annotated[Sequence[float], numbers(6)]
    target: Vector  # mm, its origin
    # along an edge or a rod; for others, across the laser line
    axis: Vector = (0.0, 1.0, 0.0)
    # from the target towards the scanner; a face's or a disk's normal
    up: Vector = (0.0, 0.0, 1.0)
    mount_mm: Margin = 5.0
    mount_deg: Margin = 3.0
    target_mm: Margin = 5.0
    target_deg: Margin = 3.0

    def __post_init__(self) -> None:
        across = np.linalg.norm(np.cross(self.axis, self.up))
        if across <= 1e-3 * np.linalg.norm(self.axis) * np.linalg.norm(self.up):
            raise ValueError(
                "axis and up in [guess] are parallel or zero; expected axis across up"
            )

    @property
    def margins(self) -> ndarray:
        """By how much a shift and a turn of the sensor, then of the target, may be
        wrong, (4,) mm and rad.
        """
        mount_rad, target_rad = np.radians([self.mount_deg, self.target_deg])
        return np.array([self.mount_mm, mount_rad, self.target_mm, target_rad])

    def setup(
        self,
        kind: str,
        sizes: Sequence[float],
        rng: Generator | None = None,
    ) -> Setup:
        """What is guessed; with `rng` a truth that the guess is wrong about by no more
        than its margins.
        """
        target = TARGETS[kind]
        y = np.array(self.axis)
        z = -np.array(self.up)
        if abs(target.stance[1, 2]) > 0.5:
            # the target's own direction is the sensor's y
            z = z - (z @ y) / (y @ y) * y
        else:
            y = y - (y @ z) / (z @ z) * z
        y, z = y / np.linalg.norm(y), z / np.linalg.norm(z)
        facing = np.stack([np.cross(y, z), y, z], axis=1)
        R_sensor = rotation_from_xyz_angles(np.radians(self.mount[3:]))
        wrong = in_unit_ball(rng, 4) if rng else np.zeros((4, 3))
        shift, turn, moved, turned = self.margins[:, None] * wrong
        facing = rotations(turned) @ facing
        placed = target.at(self.target + moved, facing @ target.stance, sizes)
        return Setup(placed, facing, R_sensor @ rotations(turn), self.mount[:3] + shift)


@dataclass(frozen=True)
class PlannedSpec(Spec):
    """What to simulate, where sensor and target are guessed."""

    guess: Annotated[Guess | None, Guess] = None
    # a file poses.csv that says where the robot goes; then sensor and target are where
    # the guess has them, but for its margins
    poses: str = ""
    plan: dict = field(default_factory=dict)  # for `read_plan`

    def __post_init__(self) -> None:
        if self.poses and self.guess is None:
            expected = "expected roughly where sensor and target are"
            raise ValueError(f"poses are given, but no [guess]; {expected}")


def read_specification(said: dict[str, Any], path: str | Path) -> PlannedSpec:
    """A specification from the content of a TOML file `path`, which may have a guess,
    planned poses and the table [plan]. Raises ScanError.
    """
    spec = read_spec(said, path, PlannedSpec)
    poses = Path(path).parent / spec.poses
    return replace(spec, poses=str(poses)) if spec.poses else spec


def simulate_specification(spec: PlannedSpec) -> Scan:
    """The scan that a robot and a scanner with errors would record.

    Raises ScanError where it shows nothing.
    """
    if not spec.poses or not spec.guess:
        return simulate_scan(spec)
    rng = np.random.default_rng(spec.seed)
    setup = spec.guess.setup(spec.kind, sizes_of(spec), rng)
    rng = errors_of(spec, rng)
    if spec.motion:
        to_hand = spec.mount == "eye-to-hand"
        sweeps = planned_sweeps(spec.poses, setup, spec.motion.speed, to_hand)
        return record_sweeps(setup, spec, rng, sweeps)
    return recorded(planned_scene(spec, setup, rng), spec, rng)


def planned_scene(spec: PlannedSpec, setup: Setup, rng: Generator) -> Scene:
    """The scene of a plan's poses; where the operator steers, those that this takes."""
    plan = planned_poses(spec.poses, spec.mount == "eye-to-hand")
    R, T = plan["R"], plan["T"]
    if setup.target.steered:
        R_view, origin = setup.planes(R, T)
        across = R_view[..., 1]
        off = np.sum((setup.target.frame[0] - origin) * across, axis=1)
        off = off - spec.noise.steering_mm * rng.normal(size=len(T))
        T = T + off[:, None] * across
    return Scene.of(setup, Poses(R, T[:, None]), plan["labels"], plan["group"])


def planned_sweeps(path: str, setup: Setup, speed: float, to_hand: bool) -> list[Sweep]:
    """The straight sweeps of a plan at a speed, mm/s, as a sensor makes them that is
    where `setup` has it: two poses of the table are the ends of one. Raises ScanError.
    """
    plan = planned_poses(path, to_hand)
    return straight_sweeps(setup, plan["R"], plan["T"], speed)


def straight_sweeps(setup: Setup, R: ndarray, T: ndarray, speed: float) -> list[Sweep]:
    """The sweeps between flange poses (2 n, 3, 3), (2 n, 3), two of each."""
    R_view, T_view = setup.planes(R, T)
    ends = T_view.reshape(-1, 2, 3)
    sweeps = []
    for facing, (begin, end) in zip(R_view[::2], ends, strict=True):
        half = float(np.linalg.norm(end - begin)) / 2
        along = (end - begin) / (2 * half)
        sweeps.append(Sweep((begin + end) / 2, facing, along, speed, half))
    return sweeps


def planned_poses(place: str | Path, to_hand: bool) -> dict[str, Any]:
    """What a table of poses says, or that of a scan folder, as `scan.folder.read_poses`
    has it; R and T as the calibration takes them.

    Raises ScanError.
    """
    place, scale = Path(place), 1.0
    if place.is_dir():
        _, scale = read_header(place / "scan.toml")
        place = place / "poses.csv"
    found = read_poses(place, scale)
    R, T = found["R_base_flange"], found["p_base_flange"]
    if to_hand:
        R, T = inverse(R, T)
    return found | {"R": R, "T": T}
