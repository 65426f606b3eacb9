"""Noise studies of the disk and ball methods at any size: batched, in chunks, the same on any number of workers."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from profilecal.checks import check_count
from profilecal.closed_form.disk import (
    crossing_heights,
    in_chord_frame,
    line_ends,
    sensing_data,
    sensing_data_from_ellipse,
)
from profilecal.fitting import ROUNDS, Ellipse, circle_from_moments, ellipse_from_moments, moments
from profilecal.poses import nearest_rotation
from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk


@dataclass(frozen=True)
class DiskScans:
    """Scans across a disk: one flange orientation and a straight motion each."""

    disk: Disk
    R_sensor: np.ndarray  # (3, 3) sensor on the flange
    T_sensor: np.ndarray  # (3,) mm
    R_tcp: np.ndarray  # (n, 3, 3) flange in the base frame
    T_start: np.ndarray  # (n, 3) mm, flange at the first chord
    T_end: np.ndarray  # (n, 3) mm, flange at the last chord

    @property
    def s(self) -> np.ndarray:
        """+1 where the motion is towards the sensor's +y, else -1, (n,): Eq. 3."""
        return np.sign(np.einsum("na,nab,b->n", self.T_end - self.T_start, self.R_tcp, self.R_sensor[:, 1]))

    def tips(self, m: int) -> np.ndarray:
        """The tips of m evenly spaced chords of each scan, without noise, (n, m, 2, 2)."""
        way = np.linspace(0, 1, m)[:, None]
        T_tcp = (1 - way) * self.T_start[:, None] + way * self.T_end[:, None]
        rotation = self.R_tcp @ self.R_sensor
        return self.disk.meet(rotation[:, None], T_tcp + (self.R_tcp @ self.T_sensor)[:, None])


def disk_scans(disk: Disk, R_sensor, T_sensor, R_tcp, centre_seen, direction, extent) -> DiskScans:
    """Scans at flange orientations R_tcp (n, 3, 3) that move along `direction` (n, 3), base frame.

    On its way each sees the disk's centre at `centre_seen` (n, 3) of the sensor frame, mm.

    `extent`: first and last chord as signed fractions of the radius; at -1 and 1 the scan plane is tangent to the disk.
    """
    rotation = R_tcp @ R_sensor
    normal = rotation[..., 1]  # of the scan plane
    in_disk = np.linalg.norm(np.cross(normal, disk.normal), axis=-1)
    across = np.einsum("na,na->n", direction, normal)
    to_tangent = (disk.radius * in_disk / np.abs(across))[:, None] * direction
    T_centre = disk.centre - np.einsum("nab,nb->na", rotation, centre_seen) - R_tcp @ T_sensor
    return DiskScans(
        disk, R_sensor, T_sensor, R_tcp, T_centre + extent[0] * to_tangent, T_centre + extent[1] * to_tangent
    )


CHUNK = 1000  # trials that share one random stream: memory stays flat, and workers wait little for each other
ARC_BLOCK = 64  # arcs at once: they fit into the processor's cache


@dataclass(frozen=True)
class DiskStudy:
    """Errors of the disk method for every setting (sigma_mm, m) and trial, and what went wrong on the way."""

    sigma_mm: np.ndarray  # (k,) noise of a tip, mm
    m: np.ndarray  # (l,) chords of a scan
    centre_error: np.ndarray  # (k, l, trials, 3) of the disk's centre in the base frame, Eq. 20, mm
    rotation_error: np.ndarray  # (k, l, trials, 3) rotation vector from true to found sensor, flange frame, rad
    translation_error: np.ndarray  # (k, l, trials, 3) of the sensor on the flange, mm
    clipped: np.ndarray  # (k, l) trials in which the arccos of Eq. 9 does not exist for some scan
    by_svd: np.ndarray  # (k, l) trials too far from the truth for the quaternion; solved by SVD instead
    failed: np.ndarray  # (k, l) trials without a finite result


def disk_study(
    scans: DiskScans,
    sigma_mm,
    m,
    trials: int,
    rng: np.random.Generator,
    *,
    noise: str = "chord",
    heights: str = "regression",
    workers: int | None = None,
) -> DiskStudy:
    """The disk method from simulated noisy chords: `trials` calibrations for each sigma_mm (k,) and each m (l,).

    noise "chord" moves every tip along its chord (Eq. 52), "isotropic" in any direction of the scan plane; sigma_mm is
    the standard deviation along each. `heights`: see `closed_form.disk.sensing_data`; chord noise leaves them exact.
    Every chunk of a setting has its own random stream, so that the number of workers changes nothing; None: all cores.
    """
    simulate = {"chord": _chords_with_chord_noise, "isotropic": _chords_with_isotropic_noise}
    if noise not in simulate:
        raise ValueError(f"noise is {noise!r}; expected 'chord' or 'isotropic'")
    sigma_mm, m = np.atleast_1d(np.asarray(sigma_mm, dtype=float)), np.atleast_1d(np.asarray(m, dtype=int))
    check_count("chords", int(m.min()), 3, "an ellipse has five unknowns, a chord two tips")
    exact = _exact_scans(scans)
    shape = (len(sigma_mm), len(m), trials)
    centre, rotation, translation = (np.empty((*shape, 3)) for _ in range(3))
    clipped, by_svd = np.empty(shape, dtype=bool), np.empty(shape, dtype=bool)
    motion = np.einsum("nba,nb->na", scans.R_tcp, scans.T_end - scans.T_start)  # R_tcp⁻¹ D_b but for its length

    def run(task):
        (i, j, first), stream = task
        part = i, j, slice(first, min(first + CHUNK, trials))
        size = len(range(trials)[part[2]])
        ellipse = simulate[noise](exact, sigma_mm[i], m[j], size, stream, heights)
        found = sensing_data_from_ellipse(*ellipse, scans.T_start, scans.T_end, scans.s, scans.disk.radius)
        clipped[part] = found.clipped.any(axis=-1)
        solved = _solve(scans, scans.R_tcp, found.q, found.T_tcp, found.D_i, motion)
        centre[part], rotation[part], translation[part], by_svd[part] = solved

    parts = [(i, j, first) for i in range(shape[0]) for j in range(shape[1]) for first in range(0, trials, CHUNK)]
    _run_all(run, list(zip(parts, rng.spawn(len(parts)), strict=True)), workers)
    failed = ~np.isfinite(centre).all(axis=-1)
    counts = (flags.sum(axis=-1) for flags in (clipped, by_svd, failed))
    return DiskStudy(sigma_mm, m, centre - scans.disk.centre, rotation, translation, *counts)


def _run_all(run, tasks, workers: int | None) -> None:
    """Run all tasks on threads (NumPy leaves the interpreter lock while it computes), with a progress bar."""
    with ThreadPoolExecutor(max_workers=workers or os.cpu_count()) as pool:
        for _ in tqdm(pool.map(run, tasks), total=len(tasks), disable=None, leave=False):
            pass


@dataclass(frozen=True)
class _Exact:
    """The noise-free ellipses: x̄ = x̄_3 + r u + shear v, z̄ = z̄_3 + rise v, where (u, v) is the unit disk."""

    radius: float
    centre: np.ndarray  # (n, 2) in the rotated frame, mm
    shear: np.ndarray  # (n,) mm
    rise: np.ndarray  # (n,) mm
    along: np.ndarray  # (n, 2) x̄ in the sensor frame
    extent: np.ndarray  # (n, 2) v of the first and the last chord

    def heights(self, m: int) -> np.ndarray:
        """v of m chords of each scan, (n, m)."""
        return np.linspace(self.extent[:, 0], self.extent[:, 1], m, axis=-1)


def _exact_scans(scans: DiskScans) -> _Exact:
    sensing = sensing_data(scans.tips(50), scans.T_start, scans.T_end, scans.s, scans.disk.radius)
    shear, rise = ((sensing.e[:, 1] - sensing.e[:, 0]) / 2).T
    return _Exact(scans.disk.radius, sensing.e[:, 2], shear, rise, sensing.direction, sensing.extent)


def _chords_with_chord_noise(exact: _Exact, sigma_mm, m, size, rng, heights):
    """Fitted ellipses of `size` trials, as `sensing_data_from_ellipse` takes them: Eq. 52, chord-aligned fast path.

    The direct ellipse fit is invariant under affine maps, so it is done where the disk is the unit circle. There chord
    noise changes u alone: heights v are exact, and the means of u^a v^b are products with fixed powers of v. Sum and
    difference of a chord's two u have independent noise, so they are what is drawn.
    """
    v = exact.heights(m)
    n = len(v)
    mean = {(a, b): np.empty((size, n)) for a in range(1, 5) for b in range(5 - a)}
    mean |= {(0, b): (v**b).mean(axis=-1) for b in range(1, 5)}
    noise, work = np.empty((2, size, m)), np.empty((3, size, m))  # new arrays for each scan cost more than the sums
    for i in range(n):
        rng.standard_normal(out=noise)
        noise *= np.sqrt(2) * sigma_mm / exact.radius
        total, difference = noise
        difference += 2 * np.sqrt(1 - v[i] ** 2)
        powers = np.vander(v[i], 4, increasing=True)
        total2, difference2 = np.multiply(noise, noise, out=work[:2])
        squares = np.add(total2, difference2, out=work[2])  # twice u₁² + u₂²
        fourth = np.einsum("ij,ij->i", squares, squares) + 4 * np.einsum("ij,ij->i", total2, difference2)
        difference2 *= 2
        difference2 += squares
        difference2 *= total  # four times u₁³ + u₂³
        for a, values in ((1, total), (2, squares), (3, difference2)):
            sums = values @ powers[:, : 5 - a]
            for b in range(5 - a):
                mean[a, b][:, i] = sums[:, b] / (2**a * m)
        mean[4, 0][:, i] = fourth / (16 * m)

    unit = ellipse_from_moments(mean)
    (u, v3), (S_uv, S_vv) = np.moveaxis(unit.centre, -1, 0), (unit.shape[..., 0, 1], unit.shape[..., 1, 1])
    r, shear, rise = exact.radius, exact.shear, exact.rise
    centre = exact.centre + np.stack([r * u + shear * v3, rise * v3], axis=-1)
    across = np.stack([rise * (r * S_uv + shear * S_vv), rise**2 * S_vv], axis=-1)
    ends = exact.centre[:, 1:] + exact.rise[:, None] * exact.extent
    return centre, across, np.broadcast_to(ends, centre.shape), exact.along


def _chords_with_isotropic_noise(exact: _Exact, sigma_mm, m, size, rng, heights):
    """As `_chords_with_chord_noise`, with noise in both directions: the general path."""
    v = exact.heights(m)
    n = len(v)
    mm = np.stack([np.full(n, exact.radius), exact.rise], axis=-1)  # per unit of the coordinates (x̄ - x̄_3, z̄ - z̄_3)
    half, middle = np.sqrt(1 - v * v), (exact.shear / exact.radius)[:, None] * v
    weights = line_ends(m) if heights == "regression" else None
    mean = {(a, b): np.empty((size, n)) for a in range(5) for b in range(5 - a) if a + b}
    chord, ends = np.empty((size, n, 2)), np.empty((2, size, n, 2))
    noise = np.empty((2, size, 2, m))
    first_last = np.empty((size, n, 2, 2, 2))
    for i in range(n):
        rng.standard_normal(out=noise)
        for axis, noise_free in enumerate(([middle[i] - half[i], middle[i] + half[i]], [v[i], v[i]])):
            noise[axis] *= sigma_mm / mm[i, axis]
            noise[axis] += noise_free
        for power, values in moments(*noise.reshape(2, size, 2 * m)).items():
            mean[power][:, i] = values
        chord[:, i] = (noise[:, :, 1] - noise[:, :, 0]).mean(axis=-1).T * mm[i]
        if heights == "regression":
            ends[:, :, i] = (noise[:, :, 0] + noise[:, :, 1]) @ weights / 2 * mm[i][:, None, None]
        first_last[:, i] = noise[..., [0, -1]].transpose(1, 3, 2, 0) * mm[i]

    unit = ellipse_from_moments(mean)
    ellipse = Ellipse(unit.centre * mm, unit.shape * mm[:, :, None] * mm[:, None, :])
    chord /= np.linalg.norm(chord, axis=-1, keepdims=True)
    centre, across, frame = in_chord_frame(ellipse, chord)
    if heights == "regression":
        ends = np.einsum("akne,kna->kne", ends, frame[..., 1, :])
    else:
        ends = crossing_heights(
            np.einsum("...mta,...ba->...mtb", first_last, frame), centre, across[..., 0] / across[..., 1]
        )
    centre += np.einsum("...ab,...b->...a", frame, exact.centre)
    ends += np.einsum("...a,...a->...", frame[..., 1, :], exact.centre)[..., None]
    (cos, sin), (cx, cz) = np.moveaxis(chord, -1, 0), exact.along.T
    return centre, across, ends, np.stack([cos * cx - sin * cz, cos * cz + sin * cx], axis=-1)


def _solve(scans, R_tcp, q, T_tcp, X, Y):
    """Eqs 14-20: rotation from X (k, n, 3) and Y (n, 3), translation from R_tcp (l, 3, 3), q and T_tcp (k, l, 3).

    Returns the fixed point (k, 3), mm, the errors of rotation (k, 3), rad, and translation (k, 3), mm, and which trials
    took the SVD. The flange orientations are the same in all trials: the least squares of Eq. 19 is one fixed matrix.
    """
    X = X / np.linalg.norm(X, axis=-1, keepdims=True)
    Y = Y / np.linalg.norm(Y, axis=-1, keepdims=True)
    turn, by_svd = rotations_near(X @ scans.R_sensor.T, Y)

    seen = np.einsum("nab,knb->kna", R_tcp, (q @ scans.R_sensor.T) @ np.swapaxes(turn, -1, -2)) + T_tcp
    M = (R_tcp[:-1] - R_tcp[1:]).reshape(-1, 3)
    N = (seen[:, 1:] - seen[:, :-1]).reshape(len(seen), -1)
    T_sensor = N @ np.linalg.pinv(M).T
    point = seen.mean(axis=1) + T_sensor @ R_tcp.mean(axis=0).T
    return point, _rotation_vectors(turn), T_sensor - scans.T_sensor, by_svd


def _rotation_vectors(R) -> np.ndarray:
    """Rotation vectors (k, 3) of rotations (k, 3, 3) by less than a half turn: scipy's, without its detour."""
    skew = (R - np.swapaxes(R, -1, -2)) / 2
    sine_axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
    sine = np.linalg.norm(sine_axis, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    return sine_axis * (angle / np.maximum(sine, np.finfo(float).tiny))[:, None]


def rotations_near(X, Y) -> tuple[np.ndarray, np.ndarray]:
    """The rotations R (k, 3, 3), expected near the identity, that best take unit vectors X (k, n, 3) to Y (n, 3).

    Davenport's quaternion q maximises qᵀ K q; with q = (1, g), its eigenvalue solves a scalar equation by Newton's
    steps. q has no such form for a half turn, so what is not surely within a quarter turn is solved by SVD; the flags
    (k,) say where.
    """
    B = np.einsum("...na,...nb->...ab", np.broadcast_to(Y, X.shape), X)
    trace = np.trace(B, axis1=-2, axis2=-1)
    S = np.moveaxis(B + np.swapaxes(B, -1, -2), 0, -1)
    z = np.stack([B[:, 2, 1] - B[:, 1, 2], B[:, 0, 2] - B[:, 2, 0], B[:, 1, 0] - B[:, 0, 1]])
    value = np.full(len(X), float(X.shape[1]))
    with np.errstate(all="ignore"):
        for _ in range(ROUNDS):
            a, b, c = (value + trace) - S[0, 0], (value + trace) - S[1, 1], (value + trace) - S[2, 2]
            d, e, f = -S[0, 1], -S[0, 2], -S[1, 2]
            adjugate = (b * c - f * f, e * f - c * d, d * f - b * e, a * c - e * e, d * e - a * f, a * b - d * d)
            determinant = a * adjugate[0] + d * adjugate[1] + e * adjugate[2]
            p, q, r, s, t, u = adjugate
            g = np.stack(
                [p * z[0] + q * z[1] + r * z[2], q * z[0] + s * z[1] + t * z[2], r * z[0] + t * z[1] + u * z[2]]
            )
            g /= determinant
            square = np.einsum("ak,ak->k", g, g)
            step = (trace - value + np.einsum("ak,ak->k", z, g)) / (1 + square)
            value = value + step
            if not (np.abs(step) > 4e-16 * X.shape[1]).any():
                break
        skew = np.zeros((len(X), 3, 3))
        skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0] = g
        skew -= np.swapaxes(skew, -1, -2)
        R = np.eye(3) + 2 * (skew + skew @ skew) / (1 + square)[:, None, None]
        sure = (determinant > 0) & (a > 0) & (a * b > d * d) & (square < 1) & (np.abs(step) < 1e-12)
    if not sure.all():
        rest = ~sure & np.isfinite(B).all(axis=(1, 2))
        R[~sure] = np.nan
        R[rest] = nearest_rotation(B[rest])
    return R, ~sure


@dataclass(frozen=True)
class BallScans:
    """Poses that see a ball, the first `translating` in one orientation. Each is swept along the sensor's y."""

    ball: Ball
    R_sensor: np.ndarray  # (3, 3) sensor on the flange
    T_sensor: np.ndarray  # (3,) mm
    R_tcp: np.ndarray  # (n, 3, 3) flange in the base frame
    T_tcp: np.ndarray  # (n, 3) mm
    translating: int
    sweep_mm: float = 10.0  # way from the pose to either end of its motion, along the sensor's y
    half_view_mm: float = 45.0  # the scanner sees |x| up to here …
    steepest_deg: float = 60.0  # … and surfaces tilted against its z by up to this
    x_resolution_mm: float = 0.1

    def positions(self, arcs: int) -> np.ndarray:
        """Flange positions (n, arcs, 3). They fill the motion so that the first few of them are spread over it too."""
        golden = (np.sqrt(5) - 1) / 2
        way = 2 * ((0.5 + golden * np.arange(arcs)) % 1) - 1
        y = (self.R_tcp @ self.R_sensor)[..., 1]
        return self.T_tcp[:, None] + self.sweep_mm * way[:, None] * y[:, None]

    def circles(self, arcs: int) -> np.ndarray:
        """The circles that the scan plane cuts, (n, arcs, 3): x, z, r."""
        origin = self.positions(arcs) + (self.R_tcp @ self.T_sensor)[:, None]
        return self.ball.meet((self.R_tcp @ self.R_sensor)[:, None], origin)

    @property
    def side(self) -> np.ndarray:
        """+1 where the ball's centre lies towards the sensor's +y, else -1, (n,)."""
        offset = self.ball.centre - self.T_tcp - self.R_tcp @ self.T_sensor
        return np.sign(np.einsum("na,na->n", offset, (self.R_tcp @ self.R_sensor)[..., 1]))

    def x_seen(self, circle) -> np.ndarray:
        """The scanner's x at which it sees the upper side of a circle x, z, r."""
        reach = circle[2] * np.sin(np.radians(self.steepest_deg))
        first = np.ceil(max(-self.half_view_mm, circle[0] - reach) / self.x_resolution_mm)
        last = np.floor(min(self.half_view_mm, circle[0] + reach) / self.x_resolution_mm)
        return self.x_resolution_mm * np.arange(first, last + 1)


@dataclass(frozen=True)
class BallStudy:
    """Errors of the two-step ball method for every setting (sigma_mm, m) and trial."""

    sigma_mm: np.ndarray  # (k,) noise of a point's z, mm
    m: np.ndarray  # (l,) arcs of a pose
    centre_error: dict[str, np.ndarray]  # per protocol (k, l, trials, 3): the ball's centre in the base frame, mm
    rotation_error: dict[str, np.ndarray]  # per protocol (k, l, trials, 3) rotation vectors, flange frame, rad
    clipped: np.ndarray  # (k,) arcs, of all, whose circle is larger than the ball
    by_svd: dict[str, np.ndarray]  # per protocol (k, l) trials solved by SVD instead of the quaternion
    failed: dict[str, np.ndarray]  # per protocol (k, l) trials without a finite result


# the three readings of "the standard deviation e" of the disk paper, from errors (..., trials, 3) to (...)
READINGS = {
    "standard deviation of the norms": lambda errors: np.linalg.norm(errors, axis=-1).std(axis=-1),
    "root mean square": lambda errors: np.sqrt((errors**2).sum(axis=-1).mean(axis=-1)),
    "mean of the norms": lambda errors: np.linalg.norm(errors, axis=-1).mean(axis=-1),
}

PROTOCOLS = ("one arc", "m arcs")  # of the poses that fix the rotation; those for the translation have m arcs


def ball_study(
    scans: BallScans,
    sigma_mm,
    m,
    trials: int,
    rng: np.random.Generator,
    *,
    fit: str = "taubin",
    workers: int | None = None,
) -> BallStudy:
    """The two-step ball method from simulated noisy arcs, Section V-D3, for each sigma_mm (k,) and m (l,).

    A trial draws max(m) arcs a pose and averages ball centres and flange positions of the first m (the equations are
    linear in both), so different m share noise. Random streams: as in `disk_study`.
    """
    sigma_mm, m = np.atleast_1d(np.asarray(sigma_mm, dtype=float)), np.atleast_1d(np.asarray(m, dtype=int))
    check_count("arcs", int(m.min()), 1, "a ball's centre comes from one arc")
    shape = (len(sigma_mm), len(m), trials)
    centre = {protocol: np.empty((*shape, 3)) for protocol in PROTOCOLS}
    rotation = {protocol: np.empty((*shape, 3)) for protocol in PROTOCOLS}
    by_svd = {protocol: np.empty(shape, dtype=bool) for protocol in PROTOCOLS}
    clipped = np.zeros((len(sigma_mm), trials), dtype=int)
    T_tcp = _running_mean(scans.positions(int(m.max())))
    fixed, turning = slice(None, scans.translating), slice(scans.translating, None)
    to_flange = np.swapaxes(scans.R_tcp[1 : scans.translating], -1, -2)

    def run(task):
        (i, first), stream = task
        part = slice(first, min(first + CHUNK, trials))
        q, clipped[i, part] = ball_centres_seen(scans, int(m.max()), sigma_mm[i], part.stop - first, stream, fit)
        q = _running_mean(q)
        for j, arcs in enumerate(m):
            for protocol, of_rotation in zip(PROTOCOLS, (1, arcs), strict=True):
                q_fixed, T_fixed = q[:, fixed, of_rotation - 1], T_tcp[fixed, of_rotation - 1]
                X = q_fixed[:, :1] - q_fixed[:, 1:]
                Y = np.einsum("nab,nb->na", to_flange, T_fixed[1:] - T_fixed[:1])
                found = _solve(scans, scans.R_tcp[turning], q[:, turning, arcs - 1], T_tcp[turning, arcs - 1], X, Y)
                centre[protocol][i, j, part], rotation[protocol][i, j, part] = found[0] - scans.ball.centre, found[1]
                by_svd[protocol][i, j, part] = found[3]

    parts = [(i, first) for i in range(shape[0]) for first in range(0, trials, CHUNK)]
    _run_all(run, list(zip(parts, rng.spawn(len(parts)), strict=True)), workers)
    failed = {protocol: (~np.isfinite(error).all(axis=-1)).sum(axis=-1) for protocol, error in centre.items()}
    by_svd = {protocol: flags.sum(axis=-1) for protocol, flags in by_svd.items()}
    return BallStudy(sigma_mm, m, centre, rotation, clipped.sum(axis=-1), by_svd, failed)


def _running_mean(values) -> np.ndarray:
    """Means of the first 1, 2, … of values (..., k, 3) along k."""
    return np.cumsum(values, axis=-2) / np.arange(1, values.shape[-2] + 1)[:, None]


def ball_centres_seen(scans: BallScans, arcs: int, sigma_mm: float, size: int, rng, fit: str = "taubin"):
    """Ball centres in the sensor frame (size, n, arcs, 3), mm, from circles fitted to noisy arcs; and clips (size,).

    x is the scanner's fixed grid, only z is noisy: so the means of x^a z^b are products with fixed powers of x. Units:
    the circle's radius, about the mean of the noise-free arc.
    """
    circles = scans.circles(arcs)
    fitted = np.empty((size, *circles.shape))
    noise = np.empty((ARC_BLOCK, round(2 * scans.half_view_mm / scans.x_resolution_mm) + 1))
    for place in np.ndindex(circles.shape[:2]):
        cx, cz, r = circles[place]
        x = scans.x_seen(circles[place])
        z = cz + np.sqrt(r * r - (x - cx) ** 2)
        shift = np.array([x.mean(), z.mean(), 0.0])
        x, z = (x - shift[0]) / r, (z - shift[1]) / r
        sums = np.empty((8, size))
        for first in range(0, size, ARC_BLOCK):
            part = slice(first, min(first + ARC_BLOCK, size))
            noisy = noise.ravel()[: (part.stop - first) * len(x)].reshape(-1, len(x))
            rng.standard_normal(out=noisy)
            noisy *= sigma_mm / r
            noisy += z
            sums[:, part] = _arc_sums(x, noisy)
        fitted[(slice(None), *place)] = shift + r * _circle_from_sums(x, sums, fit)
    clipped = (fitted[..., 2] > scans.ball.radius).sum(axis=(1, 2))
    return scans.ball.centre_from_circle(fitted, scans.side[:, None]), clipped


def _arc_sums(x, z) -> np.ndarray:
    """Sums over points x (k,), z (size, k) of z, xz, x²z, z², xz², x²z², z³, z⁴: (8, size)."""
    powers = np.vander(x, 3, increasing=True)
    z2 = z * z
    high = np.einsum("ij,ij->i", z2, z), np.einsum("ij,ij->i", z2, z2)
    return np.concatenate([(z @ powers).T, (z2 @ powers).T, high])


def _circle_from_sums(x, sums, fit: str) -> np.ndarray:
    """Circles (size, 3) from `_arc_sums`, where the mean of x is 0: the means about the centroid are expanded."""
    z, xz, xxz, zz, xzz, xxzz, zzz, zzzz = sums / len(x)
    xx, xxx, xxxx = (x**2).mean(), (x**3).mean(), (x**4).mean()
    about = {"xx": xx, "xz": xz, "zz": zz - z * z}
    about["wx"] = xxx + xzz - 2 * z * xz
    about["wz"] = xxz - xx * z + zzz - 3 * z * zz + 2 * z**3
    about["ww"] = xxxx + 2 * (xxzz - 2 * z * xxz + z * z * xx) + zzzz - 4 * z * zzz + 6 * z * z * zz - 3 * z**4
    circles = circle_from_moments(about, fit)
    circles[:, 1] += z
    return circles
