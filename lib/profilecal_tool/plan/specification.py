"""What SPEC.toml says of a plan: a rough guess of where everything is, and limits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.poses import (
    inverse,
    rotation_from_xyz_angles,
    rotations,
    unit,
)
from profilecal.scan.folder import read_header, read_poses
from profilecal.scan.tables import ScanError
from profilecal.scan.toml import Entries, number, numbers, whole
from profilecal.simulation.scene import Scene, Setup, in_unit_ball
from profilecal.simulation.spec import Spec, read_spec
from profilecal.simulation.sweeps import Motion, Sweep, straight
from profilecal.targets import TARGETS

LEAST = 100  # candidates from which a plan can still choose
Vector = Annotated[Sequence[float], numbers(3)]
Margin = Annotated[float, number(0, 90)]


def are_zones(value: Any) -> bool:
    """Whether a value is a list of [x, y, z, radius]."""
    is_zone, _ = numbers(4)
    return isinstance(value, list) and all(is_zone(z) and z[3] > 0 for z in value)


@dataclass(frozen=True)
class Guess:
    """Where sensor and target are, roughly, and how wrong that may be."""

    # X Y Z mm, W P R degrees, R = Rz(R) Ry(P) Rx(W)
    mount: Annotated[Sequence[float], numbers(6)]
    target: Vector  # mm
    axis: Vector = (0.0, 1.0, 0.0)  # the target's, or across the laser line
    up: Vector = (0.0, 0.0, 1.0)  # from the target towards the scanner
    mount_mm: Margin = 5.0
    mount_deg: Margin = 3.0
    target_mm: Margin = 5.0
    target_deg: Margin = 3.0

    def __post_init__(self) -> None:
        across = np.cross(*unit(np.array([self.axis, self.up])))
        if np.linalg.norm(across) <= 1e-3:
            raise ValueError(
                "axis and up in [guess] are parallel or zero; expected axis across up"
            )

    @property
    def margins(self) -> ndarray:
        """By how much the sensor may be shifted and turned otherwise, and the target,
        (4,), mm and rad.
        """
        turns = np.radians([self.mount_deg, self.target_deg])
        return np.array([self.mount_mm, turns[0], self.target_mm, turns[1]])

    def setup(
        self, kind: str, sizes: Sequence[float], rng: Generator | None = None
    ) -> Setup:
        """A target of this kind and a sensor where they are guessed to be, or, with an
        `rng`, anywhere within the margins.

        The sensor looks at the target squarely along z = -up and y = axis; x = y × z.
        Of the two the target's own direction is kept, the other made square to it.
        """
        target = TARGETS[kind]
        y, z = np.array(self.axis), -np.array(self.up)
        x = np.cross(y, z)
        if target.stance[1, 2]:  # its own direction is the sensor's y
            z = np.cross(x, y)
        else:
            y = np.cross(z, x)
        wrong = np.zeros((4, 3)) if rng is None else in_unit_ball(rng, 4)
        shift, turn, moved, turned = wrong * self.margins[:, None]
        facing = rotations(turned) @ unit(np.array([x, y, z])).T
        placed = target.at(self.target + moved, facing @ target.stance, sizes)
        R_sensor = rotation_from_xyz_angles(np.radians(self.mount[3:]))
        return Setup(placed, facing, R_sensor @ rotations(turn), self.mount[:3] + shift)


@dataclass(frozen=True)
class Limits:
    """How many poses are wanted, and where the robot may go."""

    # 0: as many as `until` takes
    poses: Annotated[int, whole(0, 1000)] = 0
    most: Annotated[int, whole(1, 1000)] = 100
    candidates: Annotated[int, whole(LEAST, 100_000)] = 2000
    # mm and degrees, one standard deviation in the worst direction; empty: as usual
    until: Annotated[Sequence[float], numbers(2)] = ()
    # the box for the flange, mm in the base
    low: Vector = (-np.inf,) * 3
    high: Vector = (np.inf,) * 3
    tilt_deg: Annotated[float, number(0, 80)] = 30.0
    spin_deg: Annotated[float, number(0, 180)] = 45.0
    extent_mm: Annotated[float, number(0, 1000)] = 50.0
    # where neither flange nor sensor may be
    avoid: Annotated[
        Sequence, (are_zones, "a list of zones, each x, y, z and a radius above 0")
    ] = ()

    def __post_init__(self) -> None:
        if not all(0 < sd < np.inf for sd in self.until):
            raise ValueError(
                f"until is {[*self.until]}; expected mm and degrees, both positive"
            )
        for axis, low, high in zip("xyz", self.low, self.high, strict=True):
            if low >= high:
                raise ValueError(
                    f"the box is empty along {axis}: "
                    f"low is {low:g} and high is {high:g} mm"
                )


@dataclass(frozen=True)
class PlannedSpec(Spec):
    """A specification whose poses are planned, or were."""

    guess: Annotated[Guess | None, Guess] = None
    poses: str = ""  # a file
    plan: Limits = Limits()

    def setup(self, rng: Generator | None = None) -> Setup:
        """Where everything is by the guess, as `Guess.setup` has it. Raises
        ScanError.
        """
        if self.guess is None:
            raise ScanError(
                "a plan needs [guess]: roughly where sensor (mount) and target are"
            )
        return self.guess.setup(self.kind, tuple(self.sizes.values()), rng)

    def scene(self, rng: Generator) -> Scene:
        """What is seen from the planned poses of a target that is not quite where it
        was guessed to be. An operator steers the scan plane through a marked point.
        """
        if not self.poses:
            return super().scene(rng)
        setup, said = self.setup(rng), planned_poses(self.poses)
        R, T = said["R_base_flange"], said["p_base_flange"]
        if self.to_hand:
            R, T = inverse(R, T)
        if setup.target.steered:
            R_view, T_view = setup.planes(R, T)
            y = R_view[..., 1]
            missed = self.noise.steering_mm * rng.normal(size=len(T))
            way = np.vecdot(y, setup.target.frame[0] - T_view) - missed
            T = T + way[:, None] * y
        return Scene.of(setup, (R, T[:, None]), said["labels"], said["group"])

    def sweeps(self, scene: Scene, motion: Motion, rng: Generator) -> list[Sweep]:
        """Those between the planned poses, two of each. Raises ScanError."""
        if not self.poses:
            return super().sweeps(scene, motion, rng)
        R, T = scene.poses[0], scene.poses[1][:, 0]
        if len(T) % 2 or (T[::2] == T[1::2]).all(axis=1).any():
            raise ScanError(
                f"{self.poses}: expected two rows for each sweep, where it begins and "
                "where it ends"
            )
        return straight(scene, R, T, motion.speed)


def read_specification(said: Mapping[str, Any], path: str | Path) -> PlannedSpec:
    """A specification from the content of a TOML file. Raises ScanError."""
    spec = read_spec(said, path, PlannedSpec)
    beside = spec.poses and str(Path(path).parent / spec.poses)
    return replace(spec, poses=beside)


def planned_poses(place: str | Path) -> Entries:
    """The poses of a CSV file in mm, or of a scan folder, as `read_poses` has them.
    Raises ScanError.
    """
    path, scale = Path(place), 1.0
    if path.is_dir():
        _, scale = read_header(path / "scan.toml")
        path = path / "poses.csv"
    return read_poses(path, scale)
