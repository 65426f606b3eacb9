"""Random scenes of the edge paper: an edge, a scanner on a robot that follows a plan, and what the scanner sees."""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import directions, random_turns
from profilecal.joint.observations import Observations
from profilecal.papers.edge_plan import EdgePlan, plan_edge
from profilecal.simulate.poses import Poses, actual_poses, scan_planes
from profilecal.simulate.scanner import Scanner
from profilecal.targets.ball import Ball
from profilecal.targets.edge import Edge


def sense_edge(edge: Edge, R_sensor, T_sensor, poses: Poses, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Edge points (..., G, N, 2), x and z in the sensor frame, mm, that a scanner on the flange reports.

    R_sensor (..., 3, 3), T_sensor (..., 3), mm, the edge and the poses may share leading axes, one entry a scene.
    """
    planes = scan_planes(R_sensor, T_sensor, *actual_poses(poses, noise, rng))
    seen = Edge(edge.point[..., None, None, :], edge.direction[..., None, None, :]).meet(*planes)
    return seen + noise.profile_mm * rng.normal(size=seen.shape)


@dataclass(frozen=True)
class EdgeScene:
    """An edge, a scanner on a flange, the poses that the robot reports and what the scanner sees."""

    edge: Edge
    R_sensor: np.ndarray  # (..., 3, 3)
    T_sensor: np.ndarray  # (..., 3) mm
    poses: Poses
    points: np.ndarray  # (..., G, N, 2) mm


def edge_scenes(plan: EdgePlan, noise: Noise, rng: np.random.Generator, shape=()) -> EdgeScene:
    """Random scenes, `shape` of them: any edge 1 m in front of the robot, any mount within 150 mm of the flange.

    The entries of `noise` may be arrays (S, 1, 1, 1), one for each of S scenes.
    """
    edge = Edge(np.array([1000.0, 0.0, 300.0]) + rng.uniform(-100, 100, (*shape, 3)), directions(rng, shape))
    R_sensor = random_turns(rng, shape, np.pi)
    T_sensor = rng.uniform(50, 150, (*shape, 1)) * directions(rng, shape)
    poses = plan_edge(plan, edge, R_sensor, T_sensor, rng)
    return EdgeScene(edge, R_sensor, T_sensor, poses, sense_edge(edge, R_sensor, T_sensor, poses, noise, rng))


def edge_profiles(scene: EdgeScene, specimen: str, scanner: Scanner, noise: Noise, rng) -> np.ndarray:
    """Raw profiles (G, N, points, 2), mm, of one scene whose edge is that of a specimen.

    `noise` gives the robot's errors; the scanner has its own.
    """
    rotation, origin = scan_planes(scene.R_sensor, scene.T_sensor, *actual_poses(scene.poses, noise, rng))
    away = rotation.mean(axis=(0, 1))[:, 2]
    outline = scene.edge.outline(specimen, rotation, origin, away)
    return scanner.decode(scanner.count(outline, rng))


def ball_points(ball: Ball, R_sensor, T_sensor, poses: Poses, noise: Noise, rng, count: int = 40) -> np.ndarray:
    """Points (..., G, N, count, 2) on a ball, x and z in the sensor frame, mm, that a scanner on the flange reports.

    Each profile is the arc of up to 60° to either side of the point nearest to the scanner.
    """
    planes = scan_planes(R_sensor, T_sensor, *actual_poses(poses, noise, rng))
    x, z, r = np.moveaxis(Ball(ball.centre[..., None, None, :], ball.radius).meet(*planes), -1, 0)[..., None]
    angle = np.linspace(-np.pi / 3, np.pi / 3, count)
    seen = np.stack([x + r * np.sin(angle), z - r * np.cos(angle)], axis=-1)
    return seen + noise.profile_mm * rng.normal(size=seen.shape)


def observations_of(scene: EdgeScene) -> Observations:
    """Simulated edge scenes, with or without a batch axis, as observations."""
    G, N = scene.points.shape[-3:-1]
    batch = scene.points.shape[:-3] or (1,)
    R = np.repeat(scene.poses.rotations, N, axis=-3).reshape(*batch, G * N, 3, 3)
    T, points = scene.poses.positions.reshape(*batch, G * N, 3), scene.points.reshape(*batch, G * N, 1, 2)
    return Observations("edge", R, T, points, group=np.repeat(np.arange(G), N))


def second_edge(plan: EdgePlan, noise: Noise, planted, rng: np.random.Generator, offset_mm: float = 10.0):
    """Edge scenes whose points of the groups and positions `planted` (..., G, N) lie on a parallel edge, `offset_mm`
    away: the scenes with their points replaced."""
    shape = np.shape(planted)[:-2]
    scene = edge_scenes(plan, noise, rng, shape)
    across = np.cross(scene.edge.direction, directions(rng, shape))
    across = offset_mm * across / np.linalg.norm(across, axis=-1, keepdims=True)
    other = Edge(scene.edge.point + across, scene.edge.direction)
    wrong = sense_edge(other, scene.R_sensor, scene.T_sensor, scene.poses, noise, rng)
    return replace(scene, points=np.where(planted[..., None], wrong, scene.points))
