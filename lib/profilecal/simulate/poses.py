"""Simulated measurements: a robot with pose errors carries a scanner with noise over a target."""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import inverse, rotations


@dataclass(frozen=True)
class Poses:
    """G rotation groups of N positions: what the robot reports, base frame, mm."""

    rotations: np.ndarray  # (..., G, 3, 3) of the flange
    positions: np.ndarray  # (..., G, N, 3) of the flange

    def first(self, groups: int) -> "Poses":
        """The first groups only, in the order they were collected."""
        return Poses(self.rotations[..., :groups, :, :], self.positions[..., :groups, :, :])

    def carry(self, points, R_sensor, T_sensor) -> np.ndarray:
        """Sensed points (..., G, N, M, 2), mm, in the base frame, (..., G, N, M, 3), by the poses reported.

        The sensor is at R_sensor (..., 3, 3), T_sensor (..., 3), mm, on the flange.
        """
        R = (self.rotations @ R_sensor[..., None, :, :])[..., None, :, :]
        T = self.positions + (self.rotations @ T_sensor[..., None, :, None])[..., None, :, 0]
        return points @ R[..., ::2].mT + T[..., None, :]


def actual_poses(
    poses: Poses, noise: Noise, rng: np.random.Generator, same=slice(None), to_hand: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Where the flange really is, rotations (..., G, N, 3, 3) and positions (..., G, N, 3), mm.

    `same` (G,): groups with one number share the error of a group. `to_hand`: poses are of the base in the flange's
    frame; what is returned is the flange in the base.
    """
    shape = poses.positions.shape
    group = (*shape[:-2], 1, 3)

    def error(own, shared):
        return own * rng.normal(size=shape) + shared * rng.normal(size=group)[..., same, :, :]

    position = error(noise.position_mm, noise.group_position_mm)
    turn = error(noise.orientation_deg, noise.group_orientation_deg)
    R, T = poses.rotations[..., None, :, :], poses.positions
    if to_hand:
        R, T = inverse(R, T)
    return rotations(np.radians(turn)) @ R, T + position


def scan_planes(R_sensor, T_sensor, rotations, positions) -> tuple[np.ndarray, np.ndarray]:
    """Orientations (..., G, N, 3, 3) and origins (..., G, N, 3), mm, of scan planes in the base frame.

    `rotations` and `positions` are the flange's, of the same shapes.
    """
    return rotations @ R_sensor[..., None, None, :, :], positions + (rotations @ T_sensor[..., None, None, :, None])[
        ..., 0
    ]
