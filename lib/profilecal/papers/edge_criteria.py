"""The edge paper's own measures of error, Δα and Δd (Section 4.1, Fig. 5), beside the truth of simulated scenes."""

import numpy as np
import pandas as pd

from profilecal.closed_form.edge import EdgeSolution, edge_equations, judge
from profilecal.geometry.poses import angle_between
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


def principal(vectors, about_mean: bool = True) -> np.ndarray:
    """Unit vectors (..., 3) along which vectors (..., n, 3) extend most."""
    vectors = vectors - about_mean * vectors.mean(axis=-2, keepdims=True)
    return np.linalg.eigh(np.swapaxes(vectors, -1, -2) @ vectors)[1][..., -1]


def angle_deviations(solution: EdgeSolution, about_mean: bool = True) -> np.ndarray:
    """Δα (..., G), rad: between the edge's direction u_b and the principal direction of each group of p_b.

    They are seen along one fixed axis perpendicular to u_b: left and right differ, what leans along it is not seen.
    The principal direction is that of vectors about their mean (PCA), or as they are.
    """
    u_b = solution.u_b
    groups = principal(solution.p_b - solution.p_b[..., :1, :], about_mean)
    aside = np.cross(u_b, np.eye(3)[np.argmin(np.abs(u_b), axis=-1)])
    aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
    along, across = (np.sum(groups * axis[..., None, :], axis=-1) for axis in (u_b, aside))
    return np.arctan(across / along)


def line_distances(solution: EdgeSolution) -> np.ndarray:
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
