"""Simulated measurements: a robot with pose errors carries a scanner with noise over a target."""

from dataclasses import dataclass

import numpy as np

from profilecal.acquisition import EdgePlan, Poses, directions, plan_edge, rotations, turns
from profilecal.scanner import Scanner
from profilecal.targets.ball import Ball
from profilecal.targets.edge import Edge


@dataclass(frozen=True)
class Noise:
    """Standard deviations of all errors; the entries that a scan folder's [noise] table has."""

    profile_mm: float = 0.0  # scanner, in x and in z
    position_mm: float = 0.0  # robot position, each axis, fresh at each pose
    orientation_deg: float = 0.0  # robot orientation, about each axis, fresh at each pose
    group_position_mm: float = 0.0  # the part of the position error that a rotation group shares
    group_orientation_deg: float = 0.0
    steering_mm: float = 0.0  # marked points: how far the operator leaves the scan plane from the point


def actual_poses(poses: Poses, noise: Noise, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Where the flange really is, rotations (..., G, N, 3, 3) and positions (..., G, N, 3), mm."""
    shape = poses.positions.shape
    group = (*shape[:-2], 1, 3)
    position = noise.position_mm * rng.normal(size=shape) + noise.group_position_mm * rng.normal(size=group)
    turn = noise.orientation_deg * rng.normal(size=shape) + noise.group_orientation_deg * rng.normal(size=group)
    return rotations(np.radians(turn)) @ poses.rotations[..., None, :, :], poses.positions + position


def scan_planes(R_sensor, T_sensor, rotations, positions) -> tuple[np.ndarray, np.ndarray]:
    """Orientations (..., G, N, 3, 3) and origins (..., G, N, 3), mm, of scan planes in the base frame.

    `rotations` and `positions` are the flange's, of the same shapes.
    """
    return rotations @ R_sensor[..., None, None, :, :], positions + (rotations @ T_sensor[..., None, None, :, None])[
        ..., 0
    ]


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
    """Random scenes, `shape` of them: any edge 1 m in front of the robot, any mount within 150 mm of the flange."""
    edge = Edge(np.array([1000.0, 0.0, 300.0]) + rng.uniform(-100, 100, (*shape, 3)), directions(rng, shape))
    R_sensor = turns(rng, shape, np.pi)
    T_sensor = rng.uniform(50, 150, (*shape, 1)) * directions(rng, shape)
    poses = plan_edge(plan, edge, R_sensor, T_sensor, rng)
    return EdgeScene(edge, R_sensor, T_sensor, poses, sense_edge(edge, R_sensor, T_sensor, poses, noise, rng))


def edge_profiles(scene: EdgeScene, specimen: str, scanner: Scanner, noise: Noise, rng) -> np.ndarray:
    """Raw profiles (G, N, points, 2), mm, of one scene whose edge is that of a specimen.

    The specimen's top faces the scanner, and lies on the side of smaller x. `noise` gives the robot's errors; the
    scanner has its own.
    """
    rotation, origin = scan_planes(scene.R_sensor, scene.T_sensor, *actual_poses(scene.poses, noise, rng))
    x, _, z = np.moveaxis(rotation.mean(axis=(0, 1)), -1, 0)
    direction = scene.edge.direction
    up = (z @ direction) * direction - z  # against the line of sight
    direction = direction * np.sign(np.cross(direction, up) @ x)
    outline = Edge(scene.edge.point, direction).outline(specimen, up / np.linalg.norm(up), rotation, origin)
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
