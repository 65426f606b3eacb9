"""The disk paper's noise study of the two-step ball method, Section V-D3, from simulated noisy arcs."""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.checks import check_count
from profilecal.geometry.fitting import circle_from_moments
from profilecal.papers.monte_carlo import Study, in_chunks, noisy_blocks, two_step_errors
from profilecal.targets.ball import Ball

PROTOCOLS = ("one arc", "m arcs")  # of the poses that fix the rotation; those for the translation have m arcs


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


def ball_study(
    scans: BallScans,
    sigma_mm,
    m,
    trials: int,
    rng: np.random.Generator,
    *,
    fit: str = "taubin",
    workers: int | None = None,
) -> dict[str, Study]:
    """The two-step ball method from simulated noisy arcs, for each sigma_mm (k,) of z and m (l,), by protocol.

    A trial draws max(m) arcs a pose and averages ball centres and flange positions of the first m (the equations are
    linear in both), so different m share noise. `workers`: see `in_chunks`. Clipped are arcs, of all that are
    drawn, whose circle is larger than the ball.
    """
    studies = {protocol: Study.blank(sigma_mm, m, trials) for protocol in PROTOCOLS}
    sigma_mm, m = studies[PROTOCOLS[0]].sigma_mm, studies[PROTOCOLS[0]].m
    check_count("arcs", int(m.min()), 1, "a ball's centre comes from one arc")
    T_tcp = _running_mean(scans.positions(int(m.max()))[..., None])
    fixed, turning = slice(None, scans.translating), slice(scans.translating, None)
    to_flange = np.swapaxes(scans.R_tcp[1 : scans.translating], -1, -2)

    def run(setting, part, stream):
        (i,) = setting
        q, clipped = ball_centres_seen(scans, int(m.max()), sigma_mm[i], part.stop - part.start, stream, fit)
        q = _running_mean(q)
        for j, arcs in enumerate(m):
            seen = scans.R_tcp[turning], T_tcp[turning, arcs - 1], q[turning, arcs - 1]
            for study, of_rotation in zip(studies.values(), (1, arcs), strict=True):
                q_fixed, T_fixed = q[fixed, of_rotation - 1], T_tcp[fixed, of_rotation - 1]
                X, Y = q_fixed[:1] - q_fixed[1:], (to_flange @ (T_fixed[1:] - T_fixed[:1]))[..., 0]
                errors = two_step_errors(scans, scans.ball.centre, *seen, X, Y)
                study.errors[i, j, :, part], study.by_svd[i, j, part] = errors
                study.clipped[i, j, part] = clipped

    in_chunks(run, sigma_mm.shape, trials, rng, workers)
    return studies


def _running_mean(values) -> np.ndarray:
    """Means over the first 1, 2, … arcs of values (n, arcs, 3, size)."""
    return np.cumsum(values, axis=1) / np.arange(1, values.shape[1] + 1)[:, None, None]


def ball_centres_seen(scans: BallScans, arcs: int, sigma_mm: float, size: int, rng, fit: str = "taubin"):
    """Ball centres in the sensor frame (n, arcs, 3, size), mm, from circles fitted to noisy arcs; and clips (size,).

    x is the scanner's fixed grid, only z is noisy: so the means of x^a z^b are products with fixed powers of x. Units:
    the circle's radius, about the mean of the noise-free arc.
    """
    circles = scans.circles(arcs)
    fitted = np.empty((*circles.shape, size))
    for place in np.ndindex(circles.shape[:2]):
        cx, cz, r = circles[place]
        x = scans.x_seen(circles[place])
        z = cz + np.sqrt(r * r - (x - cx) ** 2)
        shift = np.array([x.mean(), z.mean(), 0.0])
        x, z = (x - shift[0]) / r, (z - shift[1]) / r
        powers = np.vander(x, 3, increasing=True).T
        sums = np.empty((8, size))  # of z, xz, x²z, z², xz², x²z², z³, z⁴
        for part, noisy, square in noisy_blocks(z, sigma_mm / r, size, rng, spare=1):
            np.multiply(noisy, noisy, out=square)
            np.matmul(powers, noisy.T, out=sums[:3, part])
            np.matmul(powers, square.T, out=sums[3:6, part])
            np.vecdot(square, noisy, out=sums[6, part])
            np.vecdot(square, square, out=sums[7, part])
        fitted[place] = (shift + r * _circle_from_sums(x, sums, fit)).T
    fitted = np.swapaxes(fitted, -1, -2)
    centres = scans.ball.centre_from_circle(fitted, scans.side[:, None, None])
    return np.swapaxes(centres, -1, -2), (fitted[..., 2] > scans.ball.radius).sum(axis=(0, 1))


def _circle_from_sums(x, sums, fit: str) -> np.ndarray:
    """Circles (size, 3) from the sums of `ball_centres_seen`. The mean of x is 0; moments about z's are expanded."""
    z, xz, xxz, zz, xzz, xxzz, zzz, zzzz = sums / len(x)
    square = x * x
    xx, xxx, xxxx = square.mean(), square @ x / len(x), square @ square / len(x)
    z2 = z * z
    about = {"xx": xx, "xz": xz, "zz": zz - z2}
    about["wx"] = xxx + xzz - 2 * z * xz
    about["wz"] = xxz - xx * z + zzz - 3 * z * zz + 2 * z * z2
    about["ww"] = xxxx + 2 * (xxzz - 2 * z * xxz + z2 * xx) + zzzz - 4 * z * zzz + 6 * z2 * zz - 3 * z2 * z2
    circles = circle_from_moments(about, fit)
    circles[:, 1] += z
    return circles
