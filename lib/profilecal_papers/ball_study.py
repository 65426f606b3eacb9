"""The disk paper's noise study of the two-step ball method, Section V-D3, from
simulated noisy arcs.
"""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.checks import check_count
from profilecal.geometry.fitting import circle_from_moments
from profilecal.geometry.poses import carry, rotation_from_xyz_angles
from profilecal.targets.ball import Ball
from profilecal_papers import published
from profilecal_papers.monte_carlo import (
    Study,
    in_chunks,
    noisy_blocks,
    two_step_errors,
)

# of the poses that fix the rotation; those for the translation have m arcs
PROTOCOLS = "one arc", "m arcs"


@dataclass(frozen=True)
class BallScans:
    """Poses that see a ball, the first `translating` in one orientation. Each is swept
    along the sensor's y.
    """

    ball: Ball
    R_sensor: np.ndarray  # (3, 3) sensor on the flange
    T_sensor: np.ndarray  # (3,) mm
    R_tcp: np.ndarray  # (n, 3, 3) flange in the base frame
    T_tcp: np.ndarray  # (n, 3) mm
    translating: int
    # way from the pose to either end of its motion, along the sensor's y
    sweep_mm: float = 10.0
    half_view_mm: float = 45.0  # the scanner sees |x| up to here …
    steepest_deg: float = 60.0  # … and surfaces tilted against its z by up to this
    x_resolution_mm: float = 0.1

    def positions(self, arcs: int) -> np.ndarray:
        """Flange positions (n, arcs, 3). They fill the motion so that the first few of
        them are spread over it too.
        """
        golden = (np.sqrt(5) - 1) / 2
        way = 2 * ((0.5 + golden * np.arange(arcs)) % 1) - 1
        y = (self.R_tcp @ self.R_sensor)[..., 1]
        return self.T_tcp[:, None] + self.sweep_mm * way[:, None] * y[:, None]

    def circles(self, arcs: int) -> np.ndarray:
        """The circles that the scan plane cuts, (n, arcs, 3): x, z, r."""
        origin = self.positions(arcs) + (self.R_tcp @ self.T_sensor)[:, None]
        return self.ball.meet((self.R_tcp @ self.R_sensor)[:, None], origin)

    def sides(self, arcs: int) -> np.ndarray:
        """+1 where the ball's centre lies towards the sensor's +y, else -1, (n, arcs)."""
        offset = (
            self.ball.centre
            - self.positions(arcs)
            - (self.R_tcp @ self.T_sensor)[:, None]
        )
        return np.sign(
            np.einsum("nka,na->nk", offset, (self.R_tcp @ self.R_sensor)[..., 1])
        )

    def x_seen(self, circle) -> np.ndarray:
        """The scanner's x at which it sees the upper side of a circle x, z, r."""
        reach = circle[2] * np.sin(np.radians(self.steepest_deg))
        first = np.ceil(
            max(-self.half_view_mm, circle[0] - reach) / self.x_resolution_mm
        )
        last = np.floor(
            min(self.half_view_mm, circle[0] + reach) / self.x_resolution_mm
        )
        return self.x_resolution_mm * np.arange(first, last + 1)


def fig17_scans(**free) -> BallScans:
    """Disk paper, Section V-D3: the poses of Table III, the sensor at Eq. 53, the ball
    where Eq. 53 puts it. The motion of the m arcs and the scanner's view are not
    printed; `free` sets them, see `BallScans`.
    """
    # disk paper, Section V-D2: the first four rows of Table III share one orientation
    ball_translating = 4
    R_sensor, T_sensor = published.sensor_pose("Eq. 53", "Upsilon")
    R_tcp = rotation_from_xyz_angles(published.values("disk", "Table III", "R_tcp"))
    T_tcp, q = (
        published.values("disk", "Table III", "T_tcp"),
        published.values("disk", "Table III", "q"),
    )
    centres = carry(R_tcp, T_tcp, q @ R_sensor.T + T_sensor)
    ball = Ball(
        centres[ball_translating:].mean(axis=0),
        float(published.values("disk", "Fig. 14", "ball radius")),
    )
    return BallScans(ball, R_sensor, T_sensor, R_tcp, T_tcp, ball_translating, **free)


def ball_study(
    scans: BallScans,
    sigma_mm,
    m,
    trials: int,
    rng: np.random.Generator,
    *,
    workers: int | None = None,
) -> dict[str, Study]:
    """The two-step ball method from simulated noisy arcs, for each sigma_mm (k,) of z
    and m (l,), by protocol.

    A trial draws max(m) arcs a pose and averages ball centres and flange positions of
    the first m: the equations are linear in both. All sigma_mm and m share one draw, so
    curves over them are smooth. `workers`: see `in_chunks`.
    """
    studies = {protocol: Study.blank(sigma_mm, m, trials) for protocol in PROTOCOLS}
    sigma_mm, m = studies[PROTOCOLS[0]].sigma_mm, studies[PROTOCOLS[0]].m
    check_count("arcs", int(m.min()), 1, "a ball's centre comes from one arc")
    counts, n = np.union1d(1, m), len(scans.R_tcp)
    q = np.empty((len(sigma_mm), len(counts), n, 3, trials))

    def run(setting, part, stream):
        (pose,) = setting
        q[:, :, pose, :, part] = mean_centres(
            scans, pose, counts, sigma_mm, part.stop - part.start, stream
        )

    in_chunks(run, (n,), trials, rng, workers)
    T_tcp = np.stack([scans.positions(k).mean(axis=1) for k in counts])[..., None]
    fixed, turning = slice(None, scans.translating), slice(scans.translating, None)
    to_flange = scans.R_tcp[1 : scans.translating].mT
    for i, j in np.ndindex(len(sigma_mm), len(m)):
        of_turning = np.searchsorted(counts, m[j])
        seen = (
            scans.R_tcp[turning],
            T_tcp[of_turning, turning],
            q[i, of_turning, turning],
        )
        for study, of_rotation in zip(studies.values(), (0, of_turning), strict=True):
            q_fixed, T_fixed = q[i, of_rotation, fixed], T_tcp[of_rotation, fixed]
            X, Y = (
                q_fixed[:1] - q_fixed[1:],
                (to_flange @ (T_fixed[1:] - T_fixed[:1]))[..., 0],
            )
            study.errors[i, j] = two_step_errors(scans, scans.ball.centre, *seen, X, Y)
    return studies


def mean_centres(
    scans: BallScans, pose: int, counts, sigma_mm, size: int, rng
) -> np.ndarray:
    """Means (k, l, 3, size), mm, of the ball's centres, sensor frame, that circles
    fitted to the first counts (l,) of a pose's noisy arcs give, for each sigma_mm (k,).
    """
    arcs = int(np.max(counts))
    circles, sides = scans.circles(arcs)[pose], scans.sides(arcs)[pose]
    found = np.empty((len(sigma_mm), len(counts), 3, size))
    total = np.zeros((len(sigma_mm), size, 3))
    for k, (circle, side) in enumerate(zip(circles, sides, strict=True), 1):
        fitted = noisy_circles(circle, scans.x_seen(circle), sigma_mm, size, rng)
        total += scans.ball.centre_from_circle(fitted, side)
        found[:, np.asarray(counts) == k] = (total / k).mT[:, None]
    return found


def noisy_circles(circle, x, sigma_mm, size: int, rng) -> np.ndarray:
    """Circles (k, size, 3) fitted to the upper side of a circle (3,) seen at x
    (points,), z noisy by sigma_mm (k,).

    Only z is noisy, z + s ε, so what the fit needs are polynomials in s. Their
    coefficients, means of ε, ε², ε³ and ε⁴ times functions of x and z, serve all
    sigma_mm. Units: the circle's radius, about the mean of the noise-free arc.
    """
    cx, cz, r = circle
    z = cz + np.sqrt(r * r - (x - cx) ** 2)
    middle = np.array([x.mean(), z.mean(), 0.0])
    x, z = (x - middle[0]) / r, (z - middle[1]) / r
    w, one = x * x + z * z, np.ones_like(x)
    beside = (
        [x, 2 * z, 2 * x * z, w + 2 * z * z, 4 * w * z],
        [one, x, 3 * z, 2 * w + 4 * z * z],
        [one, 4 * z],
        [one],
    )
    sums = [np.empty((len(factors), size)) for factors in beside]
    mean_noise = np.empty(size)
    for part, noise, square, cube in noisy_blocks(0 * x, 1.0, size, rng):
        mean_noise[part] = noise.mean(axis=1)
        noise -= mean_noise[part, None]
        np.multiply(noise, noise, out=square)
        np.multiply(square, noise, out=cube)
        for factors, total, power in zip(
            beside, sums, (noise, square, cube), strict=False
        ):
            np.matmul(factors, power.T, out=total[:, part])
        np.vecdot(square, square, out=sums[3][0, part])
    (xe, ze, xze, wze, wwe), (ee, xee, zee, wee), (eee, zeee), (eeee,) = (
        total / len(x) for total in sums
    )
    s = np.asarray(sigma_mm, dtype=float)[:, None] / r
    mean = {
        "xx": np.mean(x * x),
        "xz": np.mean(x * z) + s * xe,
        "zz": np.mean(z * z) + s * (ze + s * ee),
    }
    mean["wx"] = np.mean(w * x) + s * (xze + s * xee)
    mean["wz"] = np.mean(w * z) + s * (wze + s * (zee + s * eee))
    mean["ww"] = np.mean(w * w) + s * (wwe + s * (wee + s * (zeee + s * eeee)))
    circles = middle + r * circle_from_moments(mean)
    circles[..., 1] += r * s * mean_noise
    return circles
