"""The disk paper's noise study of the two-step ball method, Section V-D3, from
simulated noisy arcs.
"""

from dataclasses import dataclass
from itertools import combinations_with_replacement as pairs_of

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from numpy.typing import ArrayLike

from profilecal.geometry.checks import check_count
from profilecal.geometry.fitting import circle_from_moments
from profilecal.geometry.poses import carry, rotation_from_xyz_angles
from profilecal.targets.ball import Ball
from profilecal_papers import published
from profilecal_papers.monte_carlo import (
    Scans,
    Study,
    in_chunks,
    noisy_blocks,
    two_step_errors,
)

# of the poses that fix the rotation; those for the translation have m arcs
PROTOCOLS = "one arc", "m arcs"


@dataclass(frozen=True)
class BallScans(Scans):
    """Poses that see a ball, the first `translating` in one orientation. Each is swept
    along the sensor's y.
    """

    T_tcp: ndarray  # (n, 3) mm, flange in the base frame
    ball: Ball
    translating: int
    # way from the pose to either end of its motion, along the sensor's y
    sweep_mm: float = 10.0
    half_view_mm: float = 45.0  # the scanner sees |x| up to here …
    steepest_deg: float = 60.0  # … and surfaces tilted against its z by up to this
    x_resolution_mm: float = 0.1

    def positions(self, arcs: int) -> ndarray:
        """Flange positions (n, arcs, 3). They fill the motion so that the first few of
        them are spread over it too.
        """
        golden = (np.sqrt(5) - 1) / 2
        way = 2 * ((0.5 + golden * np.arange(arcs)) % 1) - 1
        y = self.rotation[..., 1]
        return self.T_tcp[:, None] + self.sweep_mm * way[:, None] * y[:, None]

    def circles(self, arcs: int) -> ndarray:
        """The circles that the scan plane cuts, (n, arcs, 3): x, z, r."""
        origins = self.origins(self.positions(arcs))
        return self.ball.meet(self.rotation[:, None], origins)

    def sides(self, arcs: int) -> ndarray:
        """On which side of the scan plane the ball's centre lies, (n, arcs): +1 towards
        the sensor's +y, else -1.
        """
        origins = self.origins(self.positions(arcs))
        return self.ball.sides(self.rotation[:, None], origins)

    def x_seen(self, circle: ndarray) -> ndarray:
        """The scanner's x at which it sees the upper side of a circle x, z, r."""
        x, _, r = circle
        reach = r * np.sin(np.radians(self.steepest_deg))
        low = max(-self.half_view_mm, x - reach)
        high = min(self.half_view_mm, x + reach)
        first = np.ceil(low / self.x_resolution_mm)
        last = np.floor(high / self.x_resolution_mm)
        return self.x_resolution_mm * np.arange(first, last + 1)


def fig17_scans(**free: float) -> BallScans:
    """Scans of the disk paper's Section V-D3: the poses of Table III, the sensor at Eq.
    53, the ball where Eq. 53 puts it.

    The motion of the m arcs and the scanner's view are not printed; `free` sets them,
    see `BallScans`.
    """
    # disk paper, Section V-D2: the first four rows of Table III share one orientation
    translating = 4
    R_sensor, T_sensor = published.sensor_pose("Eq. 53", "Upsilon")
    R_tcp = rotation_from_xyz_angles(published.values("disk", "Table III", "R_tcp"))
    T_tcp = published.values("disk", "Table III", "T_tcp")
    q = published.values("disk", "Table III", "q")
    centres = carry(R_tcp, T_tcp, q @ R_sensor.T + T_sensor)
    radius = float(published.values("disk", "Fig. 14", "ball radius"))
    ball = Ball(centres[translating:].mean(axis=0), radius)
    return BallScans(R_sensor, T_sensor, R_tcp, T_tcp, ball, translating, **free)


def ball_study(
    scans: BallScans,
    sigma_mm: ArrayLike,
    m: ArrayLike,
    trials: int,
    rng: Generator,
) -> dict[str, Study]:
    """The two-step ball method from simulated noisy arcs, for each sigma_mm (k,) of z
    and m (l,), by protocol.

    A trial draws max(m) arcs a pose and averages ball centres and flange positions of
    the first m, because the equations are linear in both. All sigma_mm and m share one
    draw, so that curves over them are smooth.
    """
    studies = {protocol: Study.blank(sigma_mm, m, trials) for protocol in PROTOCOLS}
    one_arc = studies[PROTOCOLS[0]]
    sigma_mm, m = one_arc.sigma_mm, one_arc.m
    check_count("arcs", int(m.min()), 1, "a ball's centre comes from one arc")
    counts = np.union1d(1, m)
    n = len(scans.R_tcp)
    q = np.empty((len(sigma_mm), len(counts), n, 3, trials))
    circles, sides = scans.circles(counts[-1]), scans.sides(counts[-1])

    def run(setting: tuple, part: slice, stream: Generator) -> None:
        """Fill in the centres that some trials see from one pose, means over arcs."""
        (pose,) = setting
        size = part.stop - part.start
        total = np.zeros((len(sigma_mm), size, 3))
        arcs = zip(circles[pose], sides[pose], strict=True)
        for k, (circle, side) in enumerate(arcs, 1):
            x = scans.x_seen(circle)
            fitted = noisy_circles(circle, x, sigma_mm, size, stream)
            total += scans.ball.centre_from_circle(fitted, side)
            q[:, :, pose, :, part][:, counts == k] = (total / k).mT[:, None]

    in_chunks(run, (n,), trials, rng)
    T_tcp = np.stack([scans.positions(k).mean(axis=1) for k in counts])
    last, turning = scans.translating, slice(scans.translating, None)
    for i, j in np.ndindex(len(sigma_mm), len(m)):
        all_arcs = int(np.searchsorted(counts, m[j]))
        for study, arcs in zip(studies.values(), (0, all_arcs), strict=True):
            # While the flange keeps R_tcp and moves from T_1 to T_i, the centre moves
            # by q_i - q_1, sensor frame: R_sensor (q_1 - q_i) = R_tcp⁻¹ (T_i - T_1).
            moved = T_tcp[arcs, 1:last] - T_tcp[arcs, 0]
            study.errors[i, j] = two_step_errors(
                scans,
                scans.ball.centre,
                scans.R_tcp[turning],
                T_tcp[all_arcs, turning, :, None],
                q[i, all_arcs, turning],
                q[i, arcs, 0] - q[i, arcs, 1:last],
                moved @ scans.R_tcp[0],
            )
    return studies


def noisy_circles(
    circle: ndarray,
    x: ndarray,
    sigma_mm: ndarray,
    size: int,
    rng: Generator,
) -> ndarray:
    """Circles (k, size, 3) fitted to the upper side of a circle (3,) seen at x
    (points,), z noisy by sigma_mm (k,).

    The fit needs means of products about the centroid. The unit of length is the radius
    r, and x and z are of the noise-free arc about its middle. Noise makes z + s ε of z,
    with s = sigma_mm / r and ε about its own mean, and of w = x² + z²

        w + 2 s z ε + s² ε².

    So the means are polynomials in s, such as

        ⟨wz⟩ = ⟨w z⟩ + s ⟨(w + 2 z²) ε⟩ + s² ⟨3 z ε²⟩ + s³ ⟨ε³⟩,

    whose coefficients serve all sigma_mm. Last, the mean of the noise that ε lacks
    shifts the circle along z.
    """
    cx, cz, r = circle
    z = cz + np.sqrt(r * r - (x - cx) ** 2)
    middle = np.array([x.mean(), z.mean(), 0.0])
    x = (x - middle[0]) / r
    z = (z - middle[1]) / r
    zero, one = np.zeros_like(x), np.ones_like(x)
    # by powers of ε
    X, Z, W = (x, zero, zero), (z, one, zero), (x * x + z * z, 2 * z, one)
    factors = np.zeros((5, 6, len(x)))
    for k, (first, second) in enumerate(pairs_of((W, X, Z), 2)):
        for i, j in np.ndindex(3, 3):
            factors[i + j, k] += first[i] * second[j]
    means = np.empty((5, 6, size))
    means[0] = factors[0].mean(axis=1, keepdims=True)
    mean_noise = np.empty(size)
    for part, noise, power, _ in noisy_blocks(zero, 1.0, size, rng):
        mean_noise[part] = noise.mean(axis=1)
        noise -= mean_noise[part, None]
        power[:] = 1 / len(x)
        for k in range(1, 5):
            power *= noise
            np.matmul(factors[k], power.T, out=means[k, :, part])
    s = sigma_mm[:, None] / r
    of_all = np.einsum("kp,pft->fkt", s ** np.arange(5), means)
    circles = middle + r * circle_from_moments(of_all)
    circles[..., 1] += r * s * mean_noise
    return circles
