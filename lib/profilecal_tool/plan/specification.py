"""Specifications of plans: a guess in place of the truth, limits, poses in a file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.poses import inverse, rotation_from_xyz_angles, rotations
from profilecal.scan.folder import read_header, read_poses
from profilecal.scan.scan import ScanError
from profilecal.scan.toml import number, numbers, whole
from profilecal.simulation.scene import Scene, Setup, in_unit_ball
from profilecal.simulation.spec import Spec, read_spec
from profilecal.simulation.sweeps import Sweep, straight
from profilecal.targets import TARGETS

Vector = Annotated[Sequence[float], numbers(3)]
Margin = Annotated[float, number(0, 90)]
LEAST = 100  # candidates from which a plan can still choose


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
        self, kind: str, sizes: Sequence[float], rng: Generator | None = None
    ) -> Setup:
        """What is guessed; with `rng` a truth that the guess is wrong about by no more
        than its margins.
        """
        target = TARGETS[kind]
        y, z = np.array(self.axis), -np.array(self.up)
        x = np.cross(y, z)
        if abs(target.stance[1, 2]) > 0.5:  # its own direction is the sensor's y
            z = np.cross(x, y)
        else:
            y = np.cross(z, x)
        looking = np.stack([x, y, z], axis=1)
        looking = looking / np.linalg.norm(looking, axis=0)
        wrong = in_unit_ball(rng, 4) if rng else np.zeros((4, 3))
        shift, turn, moved, turned = self.margins[:, None] * wrong
        facing = rotations(turned) @ looking
        placed = target.at(self.target + moved, facing @ target.stance, sizes)
        R_sensor = rotation_from_xyz_angles(np.radians(self.mount[3:]))
        return Setup(placed, facing, R_sensor @ rotations(turn), self.mount[:3] + shift)


def are_zones(value: object) -> bool:
    """Whether an entry is a list of zones."""
    has_four, _ = numbers(4)
    return isinstance(value, list) and all(
        has_four(zone) and zone[3] > 0 for zone in value
    )


ZONES = are_zones, "a list of zones, each x, y, z and a radius above 0"


@dataclass(frozen=True)
class Limits:
    """What is asked of a plan, and where the robot may go: the table [plan]."""

    # so many; 0: as many as `until` takes, and `most` at most
    poses: Annotated[int, whole(0, 1000)] = 0
    most: Annotated[int, whole(1, 1000)] = 100
    # to choose among: of twice as many in twice the time, plans are 2 % better
    candidates: Annotated[int, whole(LEAST, 100_000)] = 2000
    # standard deviations that are good enough, mm and degrees; empty: as usual
    until: Annotated[Sequence[float], numbers(2)] = ()
    # of the flange's positions in the base frame, mm
    low: Vector = (-np.inf,) * 3
    high: Vector = (np.inf,) * 3
    # of the direction of view against looking at the target squarely
    tilt_deg: Annotated[float, number(0, 80)] = 30.0
    # about the direction of view
    spin_deg: Annotated[float, number(0, 180)] = 45.0
    # how far from the guess an edge, a rod or a face is seen, to either side
    extent_mm: Annotated[float, number(0, 1000)] = 50.0
    # zones x, y, z, radius: where neither flange nor sensor may be
    avoid: Annotated[Sequence[Sequence[float]], ZONES] = ()

    def __post_init__(self) -> None:
        if not all(0 < value < np.inf for value in self.until):
            raise ValueError(
                f"until is {list(self.until)}; expected mm and degrees, both positive"
            )
        for axis, low, high in zip("xyz", self.low, self.high, strict=True):
            if low >= high:
                raise ValueError(
                    f"the box is empty along {axis}: "
                    f"low is {low:g} and high is {high:g} mm"
                )


@dataclass(frozen=True)
class PlannedSpec(Spec):
    """What to simulate, where sensor and target are guessed."""

    guess: Annotated[Guess | None, Guess] = None
    # a file poses.csv that says where the robot goes; then sensor and target are where
    # the guess has them, but for its margins
    poses: str = ""
    plan: Limits = Limits()

    def setup(self, rng: Generator | None = None) -> Setup:
        """What is guessed, or with `rng` a truth, as `Guess.setup` has them. Raises
        ScanError without a guess.
        """
        if self.guess is None:
            raise ScanError(
                "a plan needs [guess]: roughly where sensor (mount) and target are"
            )
        return self.guess.setup(self.kind, tuple(self.measures.values()), rng)

    def scene(self, rng: Generator) -> Scene:
        """A truth, and the poses of the file."""
        if not self.poses:
            return super().scene(rng)
        setup = self.setup(rng)
        said, R, T = planned_poses(self.poses, self.to_hand)
        if setup.target.steered:  # by the operator, as far as this takes
            R_view, T_view = setup.planes(R, T)
            across = R_view[..., 1]
            off = np.vecdot(setup.target.frame[0] - T_view, across)
            off = off - self.noise.steering_mm * rng.normal(size=len(T))
            T = T + off[:, None] * across
        return Scene.of(setup, (R, T[:, None]), said["labels"], said["group"])

    def sweeps(self, scene: Scene) -> list[Sweep]:
        """Straight ones between two poses of the file at a time. Raises ScanError for
        a file of others.
        """
        if not (self.poses and self.motion):
            return []
        (R,), (T,) = scene.observations.R_flange, scene.observations.T_flange
        begin, end = T[::2], T[1::2]
        if len(begin) != len(end) or (begin == end).all(axis=1).any():
            raise ScanError(
                f"{self.poses}: expected two rows for each sweep, where it begins and "
                "where it ends"
            )
        return straight(scene, R, T, self.motion.speed)


def read_specification(said: dict[str, Any], path: str | Path) -> PlannedSpec:
    """A specification from the content of a TOML file `path`, which may have a guess,
    planned poses and the table [plan]. Raises ScanError.
    """
    spec = read_spec(said, path, PlannedSpec)
    poses = Path(path).parent / spec.poses
    return replace(spec, poses=str(poses)) if spec.poses else spec


def planned_poses(
    place: str | Path, to_hand: bool
) -> tuple[dict[str, Any], ndarray, ndarray]:
    """What a table of poses says, or that of a scan folder, as `scan.folder.read_poses`
    has it; and R (P, 3, 3), T (P, 3) as the calibration takes them. Raises ScanError.
    """
    place, scale = Path(place), 1.0
    if place.is_dir():
        _, scale = read_header(place / "scan.toml")
        place = place / "poses.csv"
    said = read_poses(place, scale)
    pose = said["R_base_flange"], said["p_base_flange"]
    return said, *(inverse(*pose) if to_hand else pose)
