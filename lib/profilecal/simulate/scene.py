"""Random scenes for noise studies of the joint calibration: what an ideal scanner sees of each target, pose by pose."""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import directions, rotations
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.state import State
from profilecal.joint.terms import target_at
from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.edge import Edge
from profilecal.targets.plane import Plane
from profilecal.targets.point import Point

STANDOFF = 100.0  # mm, depth of the target's middle in the scan


GROUPS = {"edge": (25, 10), "disk": (4, 100), "ball": (8, 4), "plane": (12, 3), "point": (20, 1)}


RADIUS = {"disk": 50.0, "ball": 25.0}


@dataclass(frozen=True)
class Scene:
    """Noise-free observations (one batch entry for each scene) and the truth behind them."""

    observations: Observations
    truth: State

    def target(self):
        """The target of the first scene."""
        return target_at(self.observations, *(entry[0] for entry in self.truth.placements[0]))

    def noisy(self, sigma_mm: float, rng: np.random.Generator, trials: int | None = None) -> Observations:
        """The observations with isotropic noise in the scan plane, fresh in each of `trials` copies."""
        points = self.observations.points
        shape = points.shape if trials is None else (trials, *points.shape[1:])
        return replace(self.observations, points=points + sigma_mm * rng.normal(size=shape))


def offsets(
    kind: str, motion: str, groups: int, positions: int, steering: float, normals, rng: np.random.Generator
) -> np.ndarray:
    """Where the target's middle is in the scans, from depth STANDOFF, sensor frame, (groups, positions, 3), mm.

    `normals` (groups, 3): the disk's, in the sensor frames.
    """
    shape = (groups, positions)
    if kind == "disk":
        # half-way between the scan plane's normal and the disk's, to either side: what suits the disk method best
        way = normals + np.where(np.arange(groups) % 2, -1, 1)[:, None] * np.array([0.0, 1.0, 0.0])
        way = way / way[:, 1:2]
        if motion == "equal":
            way[:] = way[0]
        return np.linspace(-0.64, 0.64, positions)[:, None] * RADIUS["disk"] * way[:, None]
    if kind == "ball":
        y = RADIUS["ball"] * rng.uniform(-0.7, 0.7, shape)
        return np.stack([rng.uniform(-10, 10, shape), y, rng.uniform(-10, 10, shape)], axis=-1)
    if kind == "point":
        return np.stack(
            [rng.uniform(-25, 25, shape), steering * rng.normal(size=shape), rng.uniform(-25, 25, shape)], axis=-1
        )
    if motion == "arc":  # of 25 mm radius and 90°, in a plane at 45° to the sensor's y and x axes
        angle = np.linspace(-np.pi / 4, np.pi / 4, positions) + rng.uniform(0, 2 * np.pi)
        arc = 25 * (np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        arc -= arc.mean(axis=0)
        u, v = np.array([1.0, 1.0, 0.0]) / np.sqrt(2), np.array([0.0, 0.0, 1.0])
        return np.broadcast_to(arc[:, :1] * u + arc[:, 1:] * v, (*shape, 3)) + 0.0
    return 25 * np.cbrt(rng.uniform(size=(*shape, 1))) * directions(rng, shape)


def random_scene(
    kind: str,
    rng: np.random.Generator,
    *,
    mount: tuple | None = None,
    groups: int | None = None,
    positions: int | None = None,
    spread_deg: float = 30.0,
    motion: str = "space",
    frame: str = "base",
    axis: np.ndarray | str | None = None,
    count: int = 40,
    steering_mm: float = 0.0,
) -> Scene:
    """One scene: a sensor anywhere on the flange (or at `mount`: R (3, 3), T (3,) mm), the target in view.

    The sensor's first orientation is random; each group turns from it by up to `spread_deg`, about random axes, about
    `axis` (3,) of the base, or about the target's own direction ("target"); inside a group it moves in the base's axes
    ("base") or with the flange ("tool").
    `motion` there is "arc" or anywhere in a ball of 25 mm ("space"); for disks, "equal" is one direction in all scans.
    """
    G, N = groups or GROUPS[kind][0], positions or GROUPS[kind][1]
    R, t = mount or (rotations(np.pi * directions(rng, ()) * rng.uniform()), rng.uniform(-150, 150, 3))
    first, middle = rotations(np.pi * rng.uniform() * directions(rng, ())), rng.uniform(-300, 300, 3)
    facing = first @ rotations(np.radians(30) * rng.uniform(-1, 1, 3))
    if axis is not None:
        axis = facing[:, 1 if kind == "edge" else 2] if isinstance(axis, str) else axis
    angle = np.radians(spread_deg) * rng.uniform(-1, 1, (G, 1))
    turned = rotations(angle * (directions(rng, (G,)) if axis is None else axis)) @ first
    moved = offsets(kind, motion, G, N, steering_mm, facing[:, 2] @ turned, rng)
    moved = moved @ (np.swapaxes(turned, 1, 2) if frame == "tool" or kind in ("disk", "ball", "point") else first.T)
    rotation = np.repeat(turned, N, axis=0)
    origin = middle - STANDOFF * rotation[:, :, 2] - moved.reshape(-1, 3)

    placement, points = look(kind, facing, middle, rotation, origin, count)
    R_flange = rotation @ R.T
    observations = Observations(
        kind, R_flange[None], (origin - R_flange @ t)[None], points[None], RADIUS.get(kind), np.repeat(np.arange(G), N)
    )
    return Scene(observations, State(R[None], t[None], ((placement[0][None], placement[1][None]),)))


def look(kind, facing, middle, rotation, origin, count):
    """The target in a sensor frame that faces it, edges along y and normals along z: its placement, and what scan
    planes (P) see of it, (P, m, 2)."""
    if kind == "edge":
        direction = facing[:, 1]
        return (middle, direction), Edge(middle, direction).meet(rotation, origin)[:, None]
    if kind == "disk":
        normal = facing[:, 2]
        return (middle, normal), Disk(middle, normal, RADIUS[kind]).meet(rotation, origin)
    if kind == "point":
        return (middle, np.zeros(3)), Point(middle).meet(rotation, origin)[:, None]
    if kind == "plane":
        normal = facing[:, 2]
        nearest, along = np.moveaxis(Plane(middle, normal).meet(rotation, origin), 1, 0)
        x = np.linspace(-20, 20, count)
        return (middle, normal), nearest[:, None] + ((x[:, None] - nearest[:, None, :1]) / along[:, None, :1]) * along[
            :, None
        ]
    circle = Ball(middle, RADIUS[kind]).meet(rotation, origin)
    angle = np.radians(np.linspace(-50, 50, count))
    arc = np.stack([np.sin(angle), -np.cos(angle)], axis=-1)
    return (middle, np.zeros(3)), circle[:, None, :2] + circle[:, None, 2:] * arc


def stack(scenes) -> Scene:
    """Scenes of one kind and size as a batch."""
    first = scenes[0].observations
    batch = {
        name: np.concatenate([getattr(s.observations, name) for s in scenes])
        for name in ("R_flange", "T_flange", "points")
    }
    placements = tuple(np.concatenate([s.truth.placements[0][i] for s in scenes]) for i in (0, 1))
    truth = State(
        np.concatenate([s.truth.rotation for s in scenes]),
        np.concatenate([s.truth.translation for s in scenes]),
        (placements,),
    )
    return Scene(replace(first, **batch), truth)


def start_at(seen: Observations, R_sensor, T_sensor) -> State:
    """Sensor poses (B, 3, 3), (B, 3) with the target placed where they see it."""
    return Problem([seen], Noise(1.0)).place(R_sensor, T_sensor)
