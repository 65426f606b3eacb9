"""Disk against ball from as many profiles, which the disk paper leaves out (Section V-D3)."""

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.closed_form.disk import disk_equations, sensing_data
from profilecal.geometry.noise import Noise
from profilecal.joint.descent import estimate
from profilecal.joint.observations import Observations
from profilecal.joint.state import State
from profilecal.papers.ball_study import BallScans
from profilecal.papers.disk_study import DiskScans

NODE = np.polynomial.legendre.leggauss(5)[0]  # places along an arc, from -1 to 1


def error_in_view(rotation_error, translation_error, R_sensor, points) -> np.ndarray:
    """How far, rms, mm, a wrong sensor pose misplaces points (k, 3) of the sensor frame, (...).

    rotation_error (..., 3), rad, and translation_error (..., 3), mm: flange frame, as in `Study`.
    """
    moved = np.cross(rotation_error[..., None, :], points @ R_sensor.T) + translation_error[..., None, :]
    return np.sqrt((moved**2).sum(axis=-1).mean(axis=-1))


def tip_covariance(tips, sigma_mm: float, step_mm: float | None = None) -> np.ndarray:
    """Covariance (..., 4, 4), mm², of x and z of the two tips of chords (..., 2, 2).

    Without `step_mm` each tip is as noisy as a point, sigma_mm in x and in z. With it a profile has points every
    step_mm in x, each with noise sigma_mm in z. A chord's tips are then the ends of the straight line through all of
    its points; where along the line it ends is unknown by one step, evenly distributed.
    """
    tips = np.asarray(tips, dtype=float)
    way = tips[..., 1, :] - tips[..., 0, :]
    if step_mm is None:
        return sigma_mm**2 * np.broadcast_to(np.eye(4), (*way.shape[:-1], 4, 4))
    n = 1 + np.maximum(np.abs(way[..., 0]) / step_mm, 1)  # points; a line needs two
    own, shared = (4 * n - 2) / (n * (n + 1)), (4 - 2 * n) / (n * (n + 1))  # of a fitted line's ends, times sigma_mm²
    along = np.stack([np.ones_like(n), way[..., 1] / way[..., 0]], axis=-1)  # mm for each mm in x
    ends = step_mm**2 / 12 * along[..., :, None] * along[..., None, :]
    covariance = np.zeros((*way.shape[:-1], 4, 4))
    for tip in (slice(0, 2), slice(2, 4)):
        covariance[..., tip, tip] = ends
    covariance[..., 1::2, 1::2] += sigma_mm**2 * np.stack([own, shared, shared, own], axis=-1).reshape(*n.shape, 2, 2)
    return covariance


def noisy_tips(exact, covariance, trials: int, rng: np.random.Generator) -> np.ndarray:
    """Tips (trials, ..., 2, 2) with normal noise of a `tip_covariance`."""
    root = np.linalg.cholesky(covariance)
    noise = np.einsum("...ab,t...b->t...a", root, rng.standard_normal((trials, *root.shape[:-1])))
    return exact + noise.reshape(trials, *exact.shape)


def closed_form_from_disk(
    scans: DiskScans, m: int, sigma_mm: float, trials: int, rng: np.random.Generator, step_mm: float | None = None
):
    """As `joint_from_disk`, by the paper's closed form with heights from regression."""
    exact = scans.tips(m)
    tips = noisy_tips(exact, tip_covariance(exact, sigma_mm, step_mm), trials, rng)
    data = sensing_data(tips, scans.T_start, scans.T_end, scans.s, scans.disk.radius)
    solved = disk_equations(scans.R_tcp, data.T_tcp, data.q, data.D_i, data.D_b)
    return small_turns(solved.R_sensor, scans.R_sensor), solved.T_sensor - scans.T_sensor


def joint_from_disk(
    scans: DiskScans, m: int, sigma_mm: float, trials: int, rng: np.random.Generator, step_mm: float | None = None
):
    """Errors of joint solutions from m chords of each scan, see `errors_of`; noise of their tips: `tip_covariance`."""
    tips = scans.tips(m).reshape(-1, 2, 2)
    way = np.linspace(0, 1, m)[:, None]
    T = ((1 - way) * scans.T_start[:, None] + way * scans.T_end[:, None]).reshape(-1, 3)
    covariance = tip_covariance(tips, sigma_mm, step_mm)
    points, R = noisy_tips(tips, covariance, trials, rng), np.repeat(scans.R_tcp, m, axis=0)
    unlike = None if step_mm is None else covariance[None] / sigma_mm**2
    seen = Observations("disk", R[None], T[None], points, (scans.disk.radius,), covariance=unlike)
    return errors_of(scans, seen, scans.disk.frame, sigma_mm)


def joint_from_ball(scans: BallScans, arcs, sigma_mm: float, trials: int, rng: np.random.Generator):
    """As `joint_from_disk`, from the first arcs (n,) of each pose, their points noisy in z.

    An arc's many points are represented by five, see `arc_nodes`.
    """
    pose, k = np.array([(i, j) for i, count in enumerate(arcs) for j in range(count)]).T
    most = int(np.max(arcs))
    circles = scans.circles(most)[pose, k]
    x, z, sd = (np.stack(values) for values in zip(*(arc_nodes(scans, circle) for circle in circles), strict=True))
    z_seen = z + sigma_mm * sd * rng.standard_normal((trials, *z.shape))
    points = np.stack([np.broadcast_to(x, z_seen.shape), z_seen], axis=-1)
    slope = (z - circles[:, 1:2]) / circles[:, 2:]  # of z, towards the distance from the circle
    T, R = scans.positions(most)[pose, k], scans.R_tcp[pose]
    covariance = ((slope * sd) ** 2)[None]
    seen = Observations("ball", R[None], T[None], points, (scans.ball.radius,), covariance=covariance)
    return errors_of(scans, seen, scans.ball.frame, sigma_mm)


def arc_nodes(scans: BallScans, circle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x and z, mm, of five points that stand for all of an arc, and their noise as a multiple of a single point's.

    What a point at the angle θ tells of its circle, in sums over (sin θ, cos θ, 1)ᵀ (sin θ, cos θ, 1), has five
    different entries. The five points' weights reproduce the sums over the arc, so that nothing is lost.
    """

    def entries(sine):
        cosine = np.sqrt(1 - sine**2)
        return np.stack([np.ones_like(sine), sine, cosine, sine * cosine, cosine**2])

    cx, cz, r = circle
    sine = (scans.x_seen(circle) - cx) / r
    first, last = np.arcsin(sine[[0, -1]])
    at = np.sin((first + last) / 2 + (last - first) / 2 * NODE)
    weight = np.linalg.solve(entries(at), (entries(sine) / (1 - sine**2)).sum(axis=1))  # noise in z, seen askew
    return cx + r * at, cz + r * np.sqrt(1 - at**2), 1 / np.sqrt(weight * (1 - at**2))


def errors_of(scans, seen: Observations, frame, sigma_mm: float):
    """Rotation (trials, 3), rad, and translation errors (trials, 3), mm, of joint solutions started at the truth."""
    trials = len(seen.points)
    origin, axes = (np.broadcast_to(value, (trials, *value.shape)) for value in frame)
    start = (np.broadcast_to(value, (trials, *value.shape)) for value in (scans.R_sensor, scans.T_sensor))
    found, _, _ = estimate([seen], Noise(sigma_mm), State(*start, ((origin, axes),)))
    return small_turns(found.rotation, scans.R_sensor), found.translation - scans.T_sensor


def small_turns(rotation, truth) -> np.ndarray:
    """Rotation vectors (..., 3), rad, from the truth (3, 3) to rotations (..., 3, 3), in the frame they lead to."""
    turn = rotation @ truth.T
    return Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
