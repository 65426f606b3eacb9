"""Scenes: a target, a scanner on a flange, and random poses from which it sees it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.poses import Frames, carry, directions, rotations
from profilecal.targets import TARGETS
from profilecal.targets.observations import Observations
from profilecal.targets.state import State
from profilecal.targets.target import Target, Views

STANDOFF = 100.0  # mm, depth of the target's middle in the scan


@dataclass(frozen=True)
class Setup:
    """A target and a sensor where they are.

    The frames are those of the joint solution: eye-to-hand, "flange" is the base and
    "base" the flange.
    """

    target: Target
    # (3, 3) a sensor frame that looks at it squarely, z away from the scanner
    facing: ndarray
    R_sensor: ndarray  # (3, 3) on the flange
    T_sensor: ndarray  # (3,) mm

    @property
    def state(self) -> State:
        """The unknowns, a batch of one."""
        placed = tuple(part[None] for part in self.target.frame)
        return State(self.R_sensor[None], self.T_sensor[None], (placed,))

    def planes(self, R: ndarray, T: ndarray) -> Frames:
        """Sensor frames (P, 3, 3), (P, 3) mm, at such poses of the flange."""
        return R @ self.R_sensor, carry(R, T, self.T_sensor)

    def flange(self, R_view: ndarray, T_view: ndarray) -> Frames:
        """Poses of the flange that bring the sensor to frames (P, 3, 3), (P, 3)."""
        R = R_view @ self.R_sensor.T
        return R, T_view - R @ self.T_sensor


@dataclass(frozen=True)
class Scene(Setup):
    """What a perfect scanner sees of a target, and the truth behind it.

    Observations and truth may be a batch, of which all else is the first problem's.
    """

    # (G, 3, 3), (G, N, 3) that the robot reports, in the frames of `Setup`
    poses: Frames
    labels: tuple[str, ...]  # of them
    observations: Observations  # without noise
    truth: State

    @classmethod
    def of(
        cls,
        setup: Setup,
        poses: Frames,
        labels: Sequence[str],
        group: ndarray,
        count: int = 40,
    ) -> "Scene":
        """What is seen of a setup; `group` (P,) as `Observations` have it, `count`
        points of a curve.
        """
        target, (R, T) = setup.target, poses
        R, T = R.repeat(T.shape[1], axis=0), T.reshape(-1, 3)
        points = target.points_seen(*setup.planes(R, T), count)
        seen = Observations(
            kind=target.kind,
            R_flange=R[None],
            T_flange=T[None],
            points=points[None],
            sizes=target.sizes,
            group=group,
        )
        return cls(
            **vars(setup),
            poses=poses,
            labels=tuple(labels),
            observations=seen,
            truth=setup.state,
        )

    def noisy(
        self, sigma_mm: float, rng: Generator, trials: int | None = None
    ) -> Observations:
        """The observations with isotropic noise in the scan plane, fresh in each of
        `trials` copies.
        """
        exact = self.observations.points
        size = trials or len(exact), *exact.shape[1:]
        points = exact + sigma_mm * rng.normal(size=size)
        return replace(self.observations, points=points)


def random_scene(
    kind: str,
    rng: Generator,
    *,
    mount: tuple | None = None,
    groups: int | None = None,
    positions: int | None = None,
    sizes: tuple | None = None,
    spread_deg: float = 30.0,
    one_way: bool = False,
    axis: ndarray | None = None,
    about_target: bool = False,
    count: int = 40,
    steering_mm: float = 0.0,
) -> Scene:
    """A sensor anywhere within 150 mm of the flange along each axis, and turned by up
    to 104° about each, or at `mount`, (3, 3), (3,) mm; the target in front of the robot
    and in view.

    Each of the `groups` turns from a first orientation by up to `spread_deg`, about any
    axis, about `axis` (3,) of the base, or, `about_target`, about the target's own z.
    Inside a group of `positions` the sensor moves in the base's axes, or with the
    flange's if that suits the target; `one_way` and `steering_mm`: see `Views`.
    `count`: points of a curve.
    """
    target = TARGETS[kind]
    shape = G, N = groups or target.groups, positions or target.positions
    sizes = sizes or target.usual_sizes
    if mount is None:
        turn = rng.uniform(-np.pi, np.pi, 3) / np.sqrt(3)
        mount = rotations(turn), rng.uniform(-150, 150, 3)
    first = rotations(rng.uniform(-1.5, 1.5, 3))
    origin = rng.uniform([600, -300, -100], [1200, 300, 500])
    facing = first @ rotations(np.radians(30) * rng.uniform(-1, 1, 3))
    axes = facing @ target.stance
    setup = Setup(target.at(origin, axes, sizes), facing, *mount)

    if about_target:
        axis = axes[:, 2]
    turns = in_unit_ball(rng, G) if axis is None else rng.uniform(-1, 1, (G, 1)) * axis
    R_view = rotations(np.radians(spread_deg) * turns) @ first
    views = Views(shape, sizes, facing[:, 2] @ R_view, one_way, steering_mm)
    moving = R_view if target.with_tool else first
    middle = origin - STANDOFF * R_view[:, None, :, 2]
    T_view = middle - target.offsets(views, rng) @ moving.mT
    R, T = setup.flange(R_view[:, None], T_view)
    labels = [f"g{g + 1}p{p + 1}" for g, p in np.ndindex(shape)]
    return Scene.of(setup, (R[:, 0], T), labels, np.arange(G).repeat(N), count)


def in_unit_ball(rng: Generator, count: int) -> ndarray:
    """Points (count, 3), uniform in the unit ball."""
    return directions(rng, (count,)) * np.cbrt(rng.uniform(size=(count, 1)))
