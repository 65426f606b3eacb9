"""The edge paper's own measures of error, Δα and Δd (Section 4.1, Fig. 5), in every reading that its text allows."""

import numpy as np
import pandas as pd
from tqdm import tqdm

from profilecal.closed_form.edge import EdgeSolution, edge_equations, judge
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import EdgeScene, edge_scenes
from profilecal.papers.published import half_unit, values
from profilecal.papers.scorecard import row

DIRECTIONS = ("group", "sum", "vector")  # the readings of a part of the edge, see `edge_directions`
READINGS = {f"{of}, {sign}": (of, sign == "signed") for of in DIRECTIONS for sign in ("signed", "unsigned")}
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


def printed_range(criterion: str, counts=ROTATIONS[1:]) -> tuple[float, float]:
    """The least and the greatest value that print like the table's at `counts` rotations, signs aside."""
    entries = printed(criterion)[[ROTATIONS.index(count) for count in counts]]
    rounding = half_unit("edge", *CRITERIA[criterion])
    return entries.min() - rounding, entries.max() + rounding


def printed_ratio(part: str, whole: str) -> tuple[float, float]:
    """The least and the greatest ratio of two criteria that print like the tables' from 15 rotations on."""
    (a, r), (b, s) = ((printed(c)[1:], half_unit("edge", *CRITERIA[c])) for c in (part, whole))
    return ((a - r) / (b + s)).min(), ((a + r) / (b - s)).max()


def range_row(item: str, quantity: str, limits, ours: float, unit: str, *, free="", note="") -> dict:
    """A row of the scorecard where the paper prints a range: its middle, with half its width for tolerance."""
    low, high = limits
    words = f"{quantity} (middle of {low:.3g} to {high:.3g}, not printed as such)"
    return row("edge", item, words, (low + high) / 2, ours, unit, (high - low) / 2, free=free, note=note)


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


def study(plan: EdgePlan, noise: Noise, seeds: int, rng, counts=ROTATIONS, of="group", signed=False):
    """`evaluate` over random scenes: a DataFrame with one row for each scene and number of rotation groups used."""
    frames = []
    for start in tqdm(range(0, seeds, CHUNK), unit=f"{CHUNK} scenes", disable=None):
        scene = edge_scenes(plan, noise, rng, (min(CHUNK, seeds - start),))
        frames += [evaluate(scene, count, noise.profile_mm, of, signed) for count in counts]
    return pd.concat(frames, ignore_index=True)


def evaluate(scene: EdgeScene, rotations: int, noise_mm=None, of="group", signed=False) -> pd.DataFrame:
    """The paper's criteria beside the truth of scenes (S) calibrated from their first groups (Section 4.1).

    `of` and `signed` as in `angle_deviations`. "strength" and "sd" are those of `judge`, told the noise of the sensed
    points, or left to estimate it. Angles in degrees, lengths in mm.
    """
    poses, points = scene.poses.first(rotations), scene.points[..., :rotations, :, :]
    solution = edge_equations(poses.rotations, poses.positions, points)
    evidence = judge(poses.rotations, poses.positions, points, solution, noise_mm)
    angles, distances = np.degrees(angle_deviations(solution, of, signed)), line_distances(solution)
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
