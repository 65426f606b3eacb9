"""The edge paper's own measures of error, Δα and Δd (Section 4.1, Fig. 5), beside the truth of simulated scenes."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from profilecal.closed_form.edge import (
    EdgeSolution,
    edge_equations,
    judge,
    rotation_system,
    translation_system,
    unvec,
)
from profilecal.geometry.poses import angle_between, nearest_rotation
from profilecal.papers.edge_scenes import EdgeScene
from profilecal.papers.published import values

CRITERIA = {  # where the paper prints them: a row for each of ROTATIONS, a column for each of its specimens
    "mean Δα": ("Table 1", "mean of delta alpha"),
    "std Δα": ("Table 1", "std of delta alpha"),
    "mean Δd": ("Table 2", "mean of delta d"),
    "std Δd": ("Table 2", "std of delta d"),
}
ROTATIONS = (10, 15, 20, 25)  # used for a calibration; the paper sums up its tables from 15 on
CHUNK = 25  # scenes solved at a time, which stay near the cache


def printed(criterion: str) -> np.ndarray:
    """What Table 1 or 2 has of a criterion, (4, 3): ROTATIONS by specimens, signs aside; degrees or mm."""
    return np.abs(values("edge", *CRITERIA[criterion]))


@dataclass(frozen=True)
class Calibration:
    """What both phases find of scenes (S)."""

    R_sensor: np.ndarray  # (S, 3, 3)
    T_sensor: np.ndarray  # (S, 3) mm
    u_b: np.ndarray  # (S, 3) direction of the edge
    p_b: np.ndarray  # (S, G, N, 3) the edge points in the base frame, mm


def nested_calibrations(scene: EdgeScene, counts=ROTATIONS, about_mean: bool = True):
    """Calibrations of scenes (S) from their first groups, as many as each of `counts` says: one after the other.

    The normal equations of Eq. 26 are sums over groups, so that four counts take hardly longer than one. They square
    the condition of A_r, which costs digits that noise has spoilt before: for noisy data only. The principal direction
    u_b is that of the vectors of Eq. 5 about their mean, or as they are.
    """
    R_b, T_b, p_s = scene.poses.rotations, scene.poses.positions, scene.points
    A_r, b_r = rotation_system(R_b, T_b, p_s)
    rows = np.concatenate([A_r, b_r[..., None]], axis=-1)
    rows = rows.reshape(*rows.shape[:-2], R_b.shape[-3], -1, 10)
    squares = np.cumsum(np.swapaxes(rows, -1, -2) @ rows, axis=-3)
    for count in counts:
        normal, turns = squares[..., count - 1, :9, :], R_b[..., :count, :, :]
        R_sensor = nearest_rotation(unvec(np.linalg.solve(normal[..., :9], normal[..., 9:])[..., 0]))
        in_flange = p_s[..., :count, :, :] @ np.swapaxes(R_sensor[..., ::2], -1, -2)[..., None, :, :]
        points = in_flange @ np.swapaxes(turns, -1, -2) + T_b[..., :count, :, :]
        vectors = (points[..., 1:, :] - points[..., :1, :]).reshape(*points.shape[:-3], -1, 3)
        u_b = principal(vectors, about_mean)
        A_t, b_t = translation_system(turns, points, u_b)
        A_tT = np.swapaxes(A_t, -1, -2)
        T_sensor = np.linalg.solve(A_tT @ A_t, A_tT @ b_t[..., None])
        points = points + np.swapaxes(turns @ T_sensor[..., None, :, :], -1, -2)
        yield Calibration(R_sensor, T_sensor[..., 0], u_b, points)


def principal(vectors, about_mean: bool = True) -> np.ndarray:
    """Unit vectors (..., 3) along which vectors (..., n, 3) extend most."""
    vectors = vectors - about_mean * vectors.mean(axis=-2, keepdims=True)
    return np.linalg.eigh(np.swapaxes(vectors, -1, -2) @ vectors)[1][..., -1]


def angle_deviations(solution: EdgeSolution | Calibration, about_mean: bool = True) -> np.ndarray:
    """Δα (..., G), rad: between the edge's direction u_b and the principal direction of each group.

    They are seen along one fixed axis perpendicular to u_b: left and right differ, what leans along it is not seen.
    `about_mean` as for `nested_calibrations`.
    """
    u_b = solution.u_b
    groups = principal(solution.p_b - solution.p_b[..., :1, :], about_mean)
    aside = np.cross(u_b, np.eye(3)[np.argmin(np.abs(u_b), axis=-1)])
    aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
    along, across = (np.sum(groups * axis[..., None, :], axis=-1) for axis in (u_b, aside))
    return np.arctan(across / along)


def line_distances(solution: EdgeSolution | Calibration) -> np.ndarray:
    """Δd (..., G N), mm: of all points from the line along u_b through their mean."""
    points = solution.p_b.reshape(*solution.p_b.shape[:-3], -1, 3)
    offset = points - points.mean(axis=-2, keepdims=True)
    return np.linalg.norm(np.cross(offset, solution.u_b[..., None, :]), axis=-1)


def evaluate(scene: EdgeScene, rotations: int, noise_mm=None) -> pd.DataFrame:
    """The paper's criteria beside the truth of scenes (S) calibrated from their first groups (Section 4.1).

    "strength" and "sd" are those of `judge`, told the noise of the sensed points, or left to estimate it. Angles in
    degrees, lengths in mm.
    """
    poses, points = scene.poses.first(rotations), scene.points[..., :rotations, :, :]
    solution = edge_equations(poses.rotations, poses.positions, points)
    evidence = judge(poses.rotations, poses.positions, points, solution, noise_mm)
    angles, distances = np.degrees(angle_deviations(solution)), line_distances(solution)
    return pd.DataFrame(
        {
            "rotations": rotations,
            "mean Δα": angles.mean(axis=-1),
            "std Δα": angles.std(axis=-1),
            "mean Δd": distances.mean(axis=-1),
            "std Δd": distances.std(axis=-1),
            "rotation error": np.degrees(angle_between(solution.R_sensor, scene.R_sensor)),
            "translation error": np.linalg.norm(solution.T_sensor - scene.T_sensor, axis=-1),
            "strength": evidence.rotation_strength,
            "sd": evidence.translation_sd_mm,
        }
    )
