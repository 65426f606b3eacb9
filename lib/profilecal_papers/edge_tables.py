"""The edge paper's Tables 1 to 3 from simulation: many specimens at once, each
calibrated from its first 10, 15, 20 and 25 rotations.

`columns` is the whole of it. Each group's part in the normal equations of the rotation
is found once, for all four calibrations.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.closed_form.edge import rotation_system, translation_system, unvec
from profilecal.geometry.fitting import fit_sphere
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between, nearest_rotation
from profilecal.targets.ball import Ball
from profilecal_papers.edge_study import (
    EdgePlan,
    EdgeScene,
    angles_from,
    ball_points,
    edge_scenes,
    line_distances,
    plan_ball,
    principal,
)
from profilecal_papers.published import values

# used for a calibration; the paper sums up its tables from 15 on
ROTATIONS = 10, 15, 20, 25
BALL_MM = 20.0  # radius of Table 3's ball
SPECIMENS = "parallel bar", "straight scale", "knife blade"
# by name, the table and the quantity that the paper prints
PLACES = {
    "mean(Δα)": ("Table 1", "mean of delta alpha"),
    "std(Δα)": ("Table 1", "std of delta alpha"),
    "mean(Δd)": ("Table 2", "mean of delta d"),
    "std(Δd)": ("Table 2", "std of delta d"),
    "r": ("Table 3", "radius"),
}
# what the paper does not print: the motion, and standard deviations of errors
RANGES = {
    "spread_deg": (10.0, 60.0),
    "radius": (8.0, 40.0),  # mm
    "span_deg": (45.0, 180.0),
    "tilt_deg": (20.0, 90.0),
    "profile_mm": (0.03, 0.4),
    "position_mm": (0.01, 0.2),
    "group_position_mm": (0.01, 0.4),  # shared by a rotation
    "group_orientation_deg": (0.003, 0.1),  # shared by a rotation
}
OF_MOTION = tuple(RANGES)[:4]


def printed() -> ndarray:
    """Tables 1 to 3, (3, 4, 5): specimens, numbers of rotations, `PLACES`."""
    tables = [values("edge", *place).T for place in PLACES.values()]
    return np.stack(tables, axis=-1)


def random_settings(
    count: int, rng: Generator, ranges: Mapping[str, tuple[float, float]]
) -> dict[str, ndarray]:
    """`count` random settings, each (count,): the motion's uniform in its ranges, the
    errors' uniform in their logarithm.
    """
    drawn = {}
    for name, ends in ranges.items():
        if name in OF_MOTION:
            drawn[name] = rng.uniform(*ends, count)
        else:
            drawn[name] = np.exp(rng.uniform(*np.log(ends), count))
    return drawn


def plan_and_noise(
    settings: Mapping[str, ndarray], frame: str, repeats: int
) -> tuple[EdgePlan, Noise]:
    """For `columns`: each of the settings for `repeats` scenes."""
    each = {name: drawn.repeat(repeats) for name, drawn in settings.items()}
    motion = {name: each.pop(name)[:, None] for name in OF_MOTION}
    errors = {name: drawn[:, None, None, None] for name, drawn in each.items()}
    return EdgePlan(frame=frame, **motion), Noise(**errors)


class Calibration(NamedTuple):
    """From the first rotations of S scenes."""

    R_sensor: ndarray  # (S, 3, 3)
    T_sensor: ndarray  # (S, 3) mm
    u_b: ndarray  # (S, 3) the edge's direction
    directions: ndarray  # (S, G, 3) of each rotation's points
    p_b: ndarray  # (S, G, N, 3) mm, all points in the base frame

    @property
    def delta_alpha(self) -> ndarray:
        """Δα (S, G), °, with its sign."""
        return np.degrees(angles_from(self.u_b, self.directions))

    @property
    def delta_d(self) -> ndarray:
        """Δd (S, G N), mm, from the line along u_b through the middle."""
        return line_distances(self)


def calibrations(
    scene: EdgeScene, about_mean: Sequence[bool] = (True,)
) -> Iterator[list[Calibration]]:
    """From the first 10, 15, 20 and 25 rotations of S scenes, one for each entry of
    `about_mean`: principal components of vectors about their mean, or as they are.
    """
    p_s = scene.points
    A_r, b_r = rotation_system(*scene.poses, p_s)  # Eq. 24
    rows = np.concatenate([A_r, b_r[..., None]], axis=-1)
    rows = rows.reshape(*p_s.shape[:2], -1, 10)
    sums = np.cumsum(rows.mT @ rows, axis=1)  # normal equations of Eq. 26
    for count in ROTATIONS:
        poses = scene.poses.first(count)
        AtA, Atb = np.split(sums[:, count - 1, :9], [9], axis=-1)
        R_s = nearest_rotation(unvec(np.linalg.solve(AtA, Atb)[..., 0]))  # Eqs 26, 27
        in_flange = p_s[:, :count] @ R_s[:, None, :, ::2].mT
        # in the base frame, but for R_b T_s
        points = in_flange @ poses.rotations.mT + poses.positions
        vectors = points - points[:, :, :1]  # Eq. 5, and a zero
        all_vectors = vectors[:, :, 1:].reshape(len(R_s), -1, 3)
        found = []
        for reading in about_mean:
            u_b = principal(all_vectors, reading)
            A_t, b_t = translation_system(poses.rotations, points, u_b)  # Eqs 31, 33
            T_s = np.linalg.solve(A_t.mT @ A_t, A_t.mT @ b_t[..., None])  # Eq. 35
            p_b = points + (poses.rotations @ T_s[:, None]).mT
            in_group = principal(vectors, reading)
            found.append(Calibration(R_s, T_s[..., 0], u_b, in_group, p_b))
        yield found


def columns(
    plan: EdgePlan,
    noise: Noise,
    count: int,
    rng: Generator,
    about_mean: Sequence[bool] = (True,),
    share: bool = False,
) -> ndarray:
    """What the tables print of `count` specimens, and the true errors: `PLACES`, then
    of the rotation, °, and of the translation, mm, for each number of `ROTATIONS`:
    (readings, count, 4, 7).

    `about_mean` has an entry for each reading of the principal components. `share`:
    whether specimens share edge, mount and motions, in threes.
    """
    scene = edge_scenes(plan, noise, rng, (count,), alike=3 if share else 1)
    # Table 3's ball: 60 poses, and six points of each profile
    ball = Ball(np.zeros_like(scene.T_sensor), BALL_MM)
    mount = scene.R_sensor, scene.T_sensor
    poses = plan_ball(ball.centre, ball.radius, *mount, rng)
    noise = replace(noise, profile_mm=np.asarray(noise.profile_mm)[..., None])
    seen = ball_points(ball, *mount, poses, noise, rng, 6)
    table = np.empty((len(about_mean), count, len(ROTATIONS), 7))
    for row, readings in enumerate(calibrations(scene, about_mean)):
        for k, found in enumerate(readings):
            alpha, d = found.delta_alpha, found.delta_d
            R, T = found.R_sensor, found.T_sensor
            r = fit_sphere(poses.carry(seen, R, T).reshape(count, -1, 3))[1]
            turn = np.degrees(angle_between(R, scene.R_sensor))
            shift = np.linalg.norm(T - scene.T_sensor, axis=1)
            numbers = alpha.mean(1), alpha.std(1), d.mean(1), d.std(1), r, turn, shift
            table[k, :, row] = np.stack(numbers, axis=-1)
    return table
