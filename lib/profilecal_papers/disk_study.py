"""The disk paper's noise study, Section V-B: calibrations from simulated noisy chords,
as many as wanted.
"""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.closed_form.disk import chord_weights, sensing_data_from_ellipse
from profilecal.geometry.checks import check_count
from profilecal.geometry.fitting import ellipse_from_moments, moments, transformed
from profilecal.geometry.poses import rotation_from_xyz_angles
from profilecal.targets.disk import Disk
from profilecal_papers import published
from profilecal_papers.monte_carlo import (
    Study,
    in_chunks,
    noisy_blocks,
    two_step_errors,
)

# First and last chord, as signed fractions of the radius. Eq. 48's positions are not
# printed: notebook 22 fits the last
# one to the values printed for Fig. 15; other pairs fit as well.
FIG15_EXTENT = (-0.9, 0.31)


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
        return np.sign(
            np.einsum(
                "na,nab,b->n",
                self.T_end - self.T_start,
                self.R_tcp,
                self.R_sensor[:, 1],
            )
        )

    def tips(self, m: int) -> np.ndarray:
        """The tips of m evenly spaced chords of each scan, without noise, (n, m, 2, 2)."""
        way = np.linspace(0, 1, m)[:, None]
        T_tcp = (1 - way) * self.T_start[:, None] + way * self.T_end[:, None]
        rotation = self.R_tcp @ self.R_sensor
        return self.disk.meet(
            rotation[:, None], T_tcp + (self.R_tcp @ self.T_sensor)[:, None]
        )


def disk_scans(
    disk: Disk, R_sensor, T_sensor, R_tcp, centre_seen, direction, extent
) -> DiskScans:
    """Scans at flange orientations R_tcp (n, 3, 3) that move along `direction` (n, 3),
    base frame, and on their way see the disk's centre at `centre_seen` (n, 3), sensor
    frame, mm. `extent`: first and last chord as signed fractions of the radius; at -1
    and 1 the scan plane is tangent to the disk.
    """
    rotation = R_tcp @ R_sensor
    normal = rotation[..., 1]  # of the scan plane
    in_disk = np.linalg.norm(np.cross(normal, disk.normal), axis=-1)
    across = np.einsum("na,na->n", direction, normal)
    to_tangent = (disk.radius * in_disk / np.abs(across))[:, None] * direction
    T_centre = (
        disk.centre - np.einsum("nab,nb->na", rotation, centre_seen) - R_tcp @ T_sensor
    )
    start, end = (T_centre + part * to_tangent for part in extent)
    return DiskScans(disk, R_sensor, T_sensor, R_tcp, start, end)


def fig15_scans(extent=FIG15_EXTENT) -> DiskScans:
    """Disk paper, Section V-B: the disk at Eq. 50, the sensor at Eq. 49, orientations
    and motions of Table I; `extent` as `disk_scans` takes it.
    """
    normal = published.values("disk", "Section V-B", "disk normal of the simulation")
    radius = float(published.values("disk", "Fig. 14", "disk radius"))
    disk = Disk(published.values("disk", "Eq. 50", "q_b"), normal, radius)
    motion = published.values("disk", "Table I", "D_b")
    motion = motion / np.linalg.norm(motion, axis=1, keepdims=True)
    R_tcp = rotation_from_xyz_angles(published.values("disk", "Table I", "R_tcp"))
    q, pose = (
        published.values("disk", "Table I", "q"),
        published.sensor_pose("Eq. 49", "Lambda"),
    )
    return disk_scans(disk, *pose, R_tcp, q, motion, extent)


def disk_study(
    scans: DiskScans,
    sigma_mm,
    m,
    trials: int,
    rng,
    *,
    noise="chord",
    heights="regression",
    workers: int | None = None,
) -> Study:
    """The disk method from simulated noisy chords: `trials` calibrations for each
    sigma_mm (k,) and each m (l,).

    noise "chord" moves every tip along its chord (Eq. 52), "isotropic" in any direction
    of the scan plane; sigma_mm is the standard deviation along each. `heights`: see
    `closed_form.disk.chord_weights`; chord noise leaves them exact. `workers`: see
    `in_chunks`. A trial is clipped if the arccos of Eq. 9 does not exist for some scan.
    """
    fitted = {
        "chord": Chords.with_chord_noise,
        "isotropic": Chords.with_isotropic_noise,
    }
    if noise not in fitted:
        raise ValueError(f"noise is {noise!r}; expected 'chord' or 'isotropic'")
    study = Study.blank(sigma_mm, m, trials)
    clipped = np.empty(study.failed.shape, dtype=bool)
    check_count(
        "chords",
        int(study.m.min()),
        3,
        "an ellipse has five unknowns, a chord two tips",
    )
    chords = [Chords.of(scans, count, heights) for count in study.m]
    # R_tcp⁻¹ D_b but for its length
    motion = np.einsum("nba,nb->na", scans.R_tcp, scans.T_end - scans.T_start)
    # one for all trials
    start, end, s = scans.T_start[:, None], scans.T_end[:, None], scans.s[:, None]

    def run(setting, part, stream):
        i, j = setting
        seen = fitted[noise](
            chords[j], study.sigma_mm[i], part.stop - part.start, stream
        )
        found = sensing_data_from_ellipse(*seen, start, end, s, scans.disk.radius)
        clipped[i, j, part] = found.clipped.any(axis=0)
        T_tcp, q, D_i = (vectors.mT for vectors in (found.T_tcp, found.q, found.D_i))
        study.errors[i, j, :, part] = two_step_errors(
            scans, scans.disk.centre, scans.R_tcp, T_tcp, q, D_i, motion
        )

    in_chunks(run, clipped.shape[:2], trials, rng, workers)
    return replace(study, clipped=clipped)


@dataclass(frozen=True)
class Chords:
    """The tips of n scans without noise, in coordinates u along the chords and v across
    them, of about unit size: no affine map changes the direct fit of an ellipse.
    """

    tips: np.ndarray  # (n, 2, 2m) u and v; all first tips, then all second ones
    centre: np.ndarray  # (n, 2) mm, sensor frame: where u = v = 0
    to_sensor: np.ndarray  # (n, 2, 2) mm, from u and v to x and z of the sensor frame
    unit: np.ndarray  # (n, 2) mm, one unit of u and of v
    weights: np.ndarray  # (2m, 5), see `chord_weights`

    @classmethod
    def of(cls, scans: DiskScans, m: int, heights: str) -> "Chords":
        """Of m evenly spaced chords a scan."""
        tips = np.swapaxes(scans.tips(m), 1, 2).reshape(-1, 2 * m, 2)
        along = tips[:, m] - tips[:, 0]
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        frame = np.stack([along, along[:, ::-1] * [-1, 1]], axis=-1)
        centre = tips.mean(axis=1)
        in_frame = (tips - centre[:, None]) @ frame
        unit = in_frame.std(axis=1)
        in_units = np.swapaxes(in_frame / unit[:, None], 1, 2)
        return cls(
            in_units, centre, frame * unit[:, None], unit, chord_weights(m, heights)
        )

    def in_sensor(self, mean: dict, vectors):
        """Ellipses, from moments {(a, b): (n, size)}, and `vectors` (n, 2, 5, size): in
        mm, in the sensor frame.
        """
        ellipse = transformed(
            ellipse_from_moments(mean), self.to_sensor[:, None], self.centre[:, None]
        )
        vectors = np.einsum("nab,nbck->acnk", self.to_sensor, vectors)
        vectors[:, 1:] += self.centre.T[:, None, :, None]
        return ellipse, np.moveaxis(vectors, (0, 1), (-2, -1))

    def with_chord_noise(self, sigma_mm: float, size: int, rng):
        """What `sensing_data_from_ellipse` takes of `size` trials of Eq. 52: noise in u
        alone, so that the means of u^a v^b are products with fixed powers of v.
        """
        n, _, count = self.tips.shape
        # over u^a v^b, by b
        sums = {a: np.empty((5 - a, n, size)) for a in range(1, 5)}
        sums[0] = np.empty((5, n, 1))
        for i, (u, v) in enumerate(self.tips):
            powers = np.vander(v, 5, increasing=True).T
            sums[0][:, i, 0] = powers.sum(axis=1)
            for part, noisy, square, cube in noisy_blocks(
                u, sigma_mm / self.unit[i, 0], size, rng
            ):
                np.multiply(noisy, noisy, out=square)
                np.multiply(noisy, square, out=cube)
                for a, values in ((1, noisy), (2, square), (3, cube)):
                    np.matmul(powers[: 5 - a], values.T, out=sums[a][:, i, part])
                sums[4][0, i, part] = np.vecdot(square, square)
        mean = {
            (a, b): values / count for a in sums for b, values in enumerate(sums[a])
        }
        return self.in_sensor(mean, (self.tips @ self.weights)[..., None])

    def with_isotropic_noise(self, sigma_mm: float, size: int, rng):
        """As `with_chord_noise`, with noise in u and in v."""
        mean = {
            (a, b): np.empty((len(self.tips), size))
            for a in range(5)
            for b in range(5 - a)
            if a + b
        }
        vectors = np.empty((len(self.tips), 2, 5, size))
        for i, tips in enumerate(self.tips):
            for part, noisy, *work in noisy_blocks(
                tips, sigma_mm / self.unit[i][:, None], size, rng
            ):
                products = work[0][:, 0], work[0][:, 1], work[1][:, 0]
                for power, values in moments(
                    noisy[:, 0], noisy[:, 1], products
                ).items():
                    mean[power][i, part] = values
                vectors[i, :, :, part] = np.moveaxis(noisy @ self.weights, 0, -1)
        return self.in_sensor(mean, vectors)
