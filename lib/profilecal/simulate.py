"""Simulated measurements: a robot with pose errors carries a scanner with noise over a target."""

from dataclasses import dataclass

import numpy as np

from profilecal.acquisition import EdgePlan, Poses, directions, plan_edge, rotations, turns
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


def sense_edge(edge: Edge, R_sensor, T_sensor, poses: Poses, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """Edge points (..., G, N, 2), x and z in the sensor frame, mm, that a scanner on the flange reports.

    R_sensor (..., 3, 3), T_sensor (..., 3), mm, the edge and the poses may share leading axes, one entry a scene.
    """
    R_b, T_b = actual_poses(poses, noise, rng)
    R = R_b @ R_sensor[..., None, None, :, :]
    T = T_b + (R_b @ T_sensor[..., None, None, :, None])[..., 0]
    seen = Edge(edge.point[..., None, None, :], edge.direction[..., None, None, :]).meet(R, T)
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
