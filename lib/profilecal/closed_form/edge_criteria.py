"""The edge paper's own measures of error, Δα and Δd (Section 4.1, Fig. 5), in every reading that its text allows."""

import numpy as np
import pandas as pd

from profilecal.acquisition import EdgePlan
from profilecal.closed_form.edge import EdgeSolution, edge_equations, judge
from profilecal.poses import angle_between
from profilecal.simulate import EdgeScene, Noise, edge_scenes

DIRECTIONS = ("group", "sum", "vector")
CHUNK = 100  # scenes solved at a time: 60 MB


def edge_directions(p_b, of: str) -> np.ndarray:
    """Directions of the edge, (..., k, 3), not of unit length, from points p_b (..., G, N, 3) in the base frame, mm.

    `of`: "group", the principal direction of each group's points; "sum", the sum of each group's vectors from its
    first point (Eq. 5); "vector", every one of these vectors by itself.
    """
    if of == "group":
        return np.linalg.svd(p_b - p_b.mean(axis=-2, keepdims=True), full_matrices=False)[2][..., 0, :]
    vectors = p_b[..., 1:, :] - p_b[..., :1, :]
    if of == "sum":
        return vectors.sum(axis=-2)
    if of == "vector":
        return vectors.reshape(*vectors.shape[:-3], -1, 3)
    raise ValueError(f"of is {of!r}; expected one of {', '.join(DIRECTIONS)}")


def angle_deviations(solution: EdgeSolution, of: str = "group", signed: bool = False) -> np.ndarray:
    """Δα (..., k), rad: between the edge's direction u_b and the directions of its parts.

    Unsigned, the angle between the two lines, 0 to π/2. Signed, that angle as seen along a fixed axis perpendicular
    to u_b: left and right differ, and what leans along the axis is not seen.
    """
    parts, u_b = edge_directions(solution.p_b, of), solution.u_b[..., None, :]
    along = (parts * u_b).sum(axis=-1)
    if not signed:
        return np.arctan2(np.linalg.norm(np.cross(parts, u_b), axis=-1), np.abs(along))
    aside = np.cross(u_b, np.eye(3)[np.argmin(np.abs(u_b), axis=-1)])
    aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
    return np.arctan((parts * aside).sum(axis=-1) / along)


def line_distances(solution: EdgeSolution) -> np.ndarray:
    """Δd (..., G N), mm: of all points from the line along u_b through their mean."""
    points = solution.p_b.reshape(*solution.p_b.shape[:-3], -1, 3)
    offset = points - points.mean(axis=-2, keepdims=True)
    return np.linalg.norm(np.cross(offset, solution.u_b[..., None, :]), axis=-1)


def study(plan: EdgePlan, noise: Noise, seeds: int, rng, counts=(10, 15, 20, 25), of="group", signed=False):
    """The paper's criteria beside the truth, over random scenes: a DataFrame with one row per scene and count.

    `counts`: numbers of rotation groups used, in the order they were collected, as in Section 4.1; `of` and `signed`
    as in `angle_deviations`. Angles in degrees, lengths in mm; "strength" and "sd" are `judge`'s, who is told the
    scanner's noise.
    """
    frames = []
    for start in range(0, seeds, CHUNK):
        scene = edge_scenes(plan, noise, rng, (min(CHUNK, seeds - start),))
        for count in counts:
            poses = scene.poses.first(count)
            solution = edge_equations(poses.rotations, poses.positions, scene.points[:, :count])
            evidence = judge(poses.rotations, poses.positions, scene.points[:, :count], solution, noise.profile_mm)
            row = {"rotations": count, "strength": evidence.rotation_strength, "sd": evidence.translation_sd_mm}
            frames.append(pd.DataFrame(row | criteria(solution, scene, of, signed)))
    return pd.concat(frames, ignore_index=True)


def criteria(solution: EdgeSolution, scene: EdgeScene, of: str, signed: bool) -> dict[str, np.ndarray]:
    """Mean and standard deviation of Δα and Δd, and the true errors, one number a scene."""
    angles, distances = np.degrees(angle_deviations(solution, of, signed)), line_distances(solution)
    return {
        "mean Δα": angles.mean(axis=-1),
        "std Δα": angles.std(axis=-1),
        "mean Δd": distances.mean(axis=-1),
        "std Δd": distances.std(axis=-1),
        "rotation error": np.degrees(angle_between(solution.R_sensor, scene.R_sensor)),
        "translation error": np.linalg.norm(solution.T_sensor - scene.T_sensor, axis=-1),
    }
