"""The disk paper's noise study, Section V-B: calibrations from simulated noisy chords,
as many as wanted.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from numpy.typing import ArrayLike

from profilecal.closed_form.disk import chord_weights, sensing_data_from_ellipse
from profilecal.geometry.checks import check_count
from profilecal.geometry.fitting import (
    MONOMIALS,
    Ellipse,
    ellipse_from_moments,
    moments,
    transformed,
)
from profilecal.geometry.poses import rotation_from_xyz_angles
from profilecal.targets.disk import Disk
from profilecal_papers import published
from profilecal_papers.monte_carlo import (
    Scans,
    Study,
    in_chunks,
    noisy_blocks,
    two_step_errors,
)

# First and last chord, as signed fractions of the radius. Eq. 48's positions are not
# printed: notebook 22 fits the last one to the values printed for Fig. 15, read as root
# mean squares; other pairs fit as well.
FIG15_REACH = (-0.9, 0.62)


@dataclass(frozen=True)
class DiskScans(Scans):
    """Scans across a disk: one flange orientation and a straight motion each."""

    disk: Disk
    T_start: ndarray  # (n, 3) mm, flange at the first chord
    T_end: ndarray  # (n, 3) mm, flange at the last chord

    @property
    def s(self) -> ndarray:
        """+1 where the motion is towards the sensor's +y, else -1, (n,): Eq. 3."""
        motion = self.T_end - self.T_start
        return np.sign(np.einsum("na,na->n", motion, self.rotation[..., 1]))

    def tips(self, m: int) -> ndarray:
        """The tips of m evenly spaced chords of each scan, without noise, (n, m, 2,
        2).
        """
        way = np.linspace(0, 1, m)[:, None]
        T_tcp = (1 - way) * self.T_start[:, None] + way * self.T_end[:, None]
        return self.disk.meet(self.rotation[:, None], self.origins(T_tcp))


def disk_scans(
    disk: Disk,
    R_sensor: ndarray,
    T_sensor: ndarray,
    R_tcp: ndarray,
    centre_seen: ndarray,
    direction: ndarray,
    reach: tuple[float, float],
) -> DiskScans:
    """Scans at flange orientations R_tcp (n, 3, 3) that move along `direction` (n, 3),
    base frame, and on their way see the disk's centre at `centre_seen` (n, 3), sensor
    frame, mm. `reach`: first and last chord as signed fractions of the radius; at -1
    and 1 the scan plane is tangent to the disk.

    Along the normal y of the scan plane, the disk with its own normal N reaches radius
    |y × N| to either side of its centre. A way d along `direction` moves the scan plane
    by d · y.
    """
    rotation = R_tcp @ R_sensor
    y = rotation[..., 1]
    half_width = disk.radius * np.linalg.norm(np.cross(y, disk.normal), axis=-1)
    across = np.einsum("na,na->n", direction, y)
    to_tangent = (half_width / np.abs(across))[:, None] * direction
    in_base = np.einsum("nab,nb->na", rotation, centre_seen)
    T_centre = disk.centre - in_base - R_tcp @ T_sensor
    T_start, T_end = (T_centre + part * to_tangent for part in reach)
    return DiskScans(R_sensor, T_sensor, R_tcp, disk, T_start, T_end)


def fig15_scans(reach: tuple[float, float] = FIG15_REACH) -> DiskScans:
    """Scans of the disk paper's Section V-B: the disk at Eq. 50, the sensor at Eq. 49,
    orientations and motions of Table I; `reach` as `disk_scans` takes it.
    """
    normal = published.values("disk", "Section V-B", "disk normal of the simulation")
    radius = float(published.values("disk", "Fig. 14", "disk radius"))
    disk = Disk(published.values("disk", "Eq. 50", "q_b"), normal, radius)
    motion = published.values("disk", "Table I", "D_b")
    R_tcp = rotation_from_xyz_angles(published.values("disk", "Table I", "R_tcp"))
    q = published.values("disk", "Table I", "q")
    sensor = published.sensor_pose("Eq. 49", "Lambda")
    return disk_scans(disk, *sensor, R_tcp, q, motion, reach)


def disk_study(
    scans: DiskScans,
    sigma_mm: ArrayLike,
    m: ArrayLike,
    trials: int,
    rng: Generator,
    *,
    noise: str = "chord",
    heights: str = "regression",
    workers: int | None = None,
) -> Study:
    """The disk method from simulated noisy chords: `trials` calibrations for each
    sigma_mm (k,) and each m (l,).

    noise "chord" moves every tip along its chord (Eq. 52), "isotropic" in any direction
    of the scan plane; sigma_mm is the standard deviation along each. `heights`: see
    `closed_form.disk.chord_weights`; chord noise leaves them exact. `workers`: see
    `in_chunks`. Where the arccos of Eq. 9 does not exist, α is 0° or 180°.
    """
    kinds = {
        "chord": Chords.with_chord_noise,
        "isotropic": Chords.with_isotropic_noise,
    }
    study = Study.blank(sigma_mm, m, trials)
    why = "an ellipse has five unknowns, a chord two tips"
    check_count("chords", int(study.m.min()), 3, why)
    chords = [Chords.of(scans, count, heights) for count in study.m]
    # R_tcp⁻¹ D_b but for its length, one for all trials
    motion = np.einsum("nba,nb->na", scans.R_tcp, scans.T_end - scans.T_start)
    way = scans.T_start[:, None], scans.T_end[:, None], scans.s[:, None]

    def run(setting: tuple, part: slice, stream: Generator) -> None:
        """Fill in the errors of some trials of one setting."""
        i, j = setting
        size = part.stop - part.start
        fitted = kinds[noise](chords[j], study.sigma_mm[i], size, stream)
        data = sensing_data_from_ellipse(*fitted, *way, scans.disk.radius)
        study.errors[i, j, :, part] = two_step_errors(
            scans,
            scans.disk.centre,
            scans.R_tcp,
            data.T_tcp.mT,
            data.q.mT,
            data.D_i.mT,
            motion,
        )

    in_chunks(run, study.errors.shape[:2], trials, rng, workers)
    return study


@dataclass(frozen=True)
class Chords:
    """The tips of n scans without noise, in coordinates u along the chords and v across
    them, of about unit size: no affine map changes the direct fit of an ellipse.

    A tip p, x and z of the sensor frame, is p = centre + to_sensor (u, v). The columns
    of to_sensor are the directions along and across the chords, times `unit`.
    """

    tips: ndarray  # (n, 2, 2m) u and v; all first tips, then all second ones
    centre: ndarray  # (n, 2) mm, sensor frame: where u = v = 0
    to_sensor: ndarray  # (n, 2, 2) mm
    unit: ndarray  # (n, 2) mm, one unit of u and of v
    weights: ndarray  # (2m, 5), see `chord_weights`

    @classmethod
    def of(cls, scans: DiskScans, m: int, heights: str) -> "Chords":
        """The tips of m evenly spaced chords a scan."""
        tips = np.swapaxes(scans.tips(m), 1, 2).reshape(-1, 2 * m, 2)
        along = tips[:, m] - tips[:, 0]
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        across = along[:, ::-1] * [-1, 1]
        frame = np.stack([along, across], axis=-1)
        centre = tips.mean(axis=1)
        in_frame = (tips - centre[:, None]) @ frame
        unit = in_frame.std(axis=1)
        in_units = np.swapaxes(in_frame / unit[:, None], 1, 2)
        to_sensor = frame * unit[:, None]
        return cls(in_units, centre, to_sensor, unit, chord_weights(m, heights))

    def in_sensor(self, mean: ndarray, vectors: ndarray) -> tuple[Ellipse, ndarray]:
        """Ellipses (n, size) and vectors (n, size, 2, 5), mm, sensor frame, as
        `sensing_data_from_ellipse` takes them, from `moments` (6, 6, n, size) and
        `vectors` (n, 2, 5, size) in u and v.
        """
        ellipse = transformed(
            ellipse_from_moments(mean), self.to_sensor[:, None], self.centre[:, None]
        )
        vectors = np.einsum("nab,nbck->acnk", self.to_sensor, vectors)
        # the first one is a difference of points, the others are points
        vectors[:, 1:] += self.centre.T[:, None, :, None]
        return ellipse, np.moveaxis(vectors, (0, 1), (-2, -1))

    def with_chord_noise(
        self, sigma_mm: float, size: int, rng: Generator
    ) -> tuple[Ellipse, ndarray]:
        """What `sensing_data_from_ellipse` takes of `size` trials of Eq. 52.

        Noise is in u alone, so that v is the same in all trials. With the matrix V of
        the powers V_bj = v_j^b, of tip j, all means that one power of u takes part in
        are one product,

            ⟨u^a v^b⟩ = (V u^a)_b / 2m,  b = 0 … 4 - a.
        """
        n, _, count = self.tips.shape
        # of each power a: over b, scans and trials; u⁰ has no noise
        sums = [np.empty((5 - a, n, size if a else 1)) for a in range(5)]
        for i, (u, v) in enumerate(self.tips):
            V = np.vander(v, 5, increasing=True).T
            sums[0][:, i, 0] = V.sum(axis=1)
            sd = sigma_mm / self.unit[i, 0]
            for part, noisy, square, cube in noisy_blocks(u, sd, size, rng):
                np.multiply(noisy, noisy, out=square)
                np.multiply(noisy, square, out=cube)
                for a, power in enumerate((noisy, square, cube), 1):
                    np.matmul(V[: 5 - a], power.T, out=sums[a][:, i, part])
                np.vecdot(square, square, out=sums[4][0, i, part])
        mean = np.empty((6, 6, n, size))
        for i, j in np.ndindex(6, 6):
            a, b = np.add(MONOMIALS[i], MONOMIALS[j])
            mean[i, j] = sums[a][b] / count
        return self.in_sensor(mean, (self.tips @ self.weights)[..., None])

    def with_isotropic_noise(
        self, sigma_mm: float, size: int, rng: Generator
    ) -> tuple[Ellipse, ndarray]:
        """As `with_chord_noise`, with noise in u and in v."""
        n = len(self.tips)
        mean = np.empty((6, 6, n, size))
        vectors = np.empty((n, 2, 5, size))
        for i, tips in enumerate(self.tips):
            sd = sigma_mm / self.unit[i][:, None]
            for part, noisy, *_ in noisy_blocks(tips, sd, size, rng):
                mean[:, :, i, part] = moments(noisy[:, 0], noisy[:, 1])
                vectors[i, :, :, part] = np.moveaxis(noisy @ self.weights, 0, -1)
        return self.in_sensor(mean, vectors)
