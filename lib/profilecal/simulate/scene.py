"""Random scenes: a target, a scanner somewhere on a flange, and poses from which it sees the target."""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.geometry.poses import rotations
from profilecal.joint.observations import Observations, State
from profilecal.simulate.poses import Poses
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
