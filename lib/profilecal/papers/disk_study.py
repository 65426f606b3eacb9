"""Noise studies of the disk and ball methods at any size: batched, in chunks, the same on any number of workers."""

from dataclasses import dataclass

import numpy as np

from profilecal.closed_form.disk import (
    crossing_heights,
    in_chord_frame,
    line_ends,
    sensing_data,
    sensing_data_from_ellipse,
)
from profilecal.geometry.checks import check_count
from profilecal.geometry.fitting import Ellipse, ellipse_from_moments, moments
from profilecal.papers.monte_carlo import CHUNK, _run_all, _solve
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
