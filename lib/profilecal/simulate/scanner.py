"""What a profile scanner reports of the outline that its scan plane cuts from a scene."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Scanner:
    """A laser triangulation scanner; the defaults are those of the edge paper's VLM350 (its Section 3).

    Its rays fan out from behind the housing: `points` of them, evenly spaced at every depth.
    """

    near: float = 60.0  # mm, the measuring range in z
    far: float = 350.0  # mm
    near_width: float = 40.0  # mm, the field of view in x at `near`
    far_width: float = 160.0  # mm, at `far`
    points: int = 980  # of a profile
    resolution: float = 0.25  # mm in x: a sample comes from anywhere within this width around its ray
    quantum: float = 0.1  # mm, coordinates are whole multiples of it
    noise_mm: float = 0.06  # standard deviation of z: of a resolution of 0.2 mm, as a uniform error's width

    def half_width(self, z) -> np.ndarray:
        """Half the field of view in x at depth z, mm."""
        return (self.near_width + (self.far_width - self.near_width) * (z - self.near) / (self.far - self.near)) / 2

    def count(self, outline, rng: np.random.Generator) -> np.ndarray:
        """Profiles (..., points, 2) as the scanner sends them: 16-bit integers, in `quantum`; z = 0 where nothing is.

        `outline` (..., V, 2) is a chain of straight pieces in the scan plane, x and z in mm.
        """
        rays = np.linspace(-1, 1, self.points)
        middle = self.half_width(outline[..., 1].mean(axis=-1))[..., None]
        spot = rng.uniform(-0.5, 0.5, (*middle.shape[:-1], self.points)) * self.resolution / middle
        z = nearest_on_rays(outline, rays + spot, self)
        z = z + self.noise_mm * rng.normal(size=z.shape)
        x = rays * self.half_width(z)
        seen = (self.near <= z) & (z <= self.far)  # false for NaN: nothing there
        counts = np.stack([x, z], axis=-1) / self.quantum
        return np.where(seen[..., None], np.rint(counts), 0).astype(np.int16)

    def decode(self, counts) -> np.ndarray:
        """Profiles in mm, NaN where the scanner saw nothing."""
        return np.where(counts[..., 1:] > 0, counts * self.quantum, np.nan)


def nearest_on_rays(outline, rays, scanner: Scanner) -> np.ndarray:
    """Depth z (..., n) at which rays (..., n), as fractions of the half width, first meet an outline (..., V, 2).

    NaN where they miss it. Along a ray x is a linear function of z, so that a ray meets a straight piece where x less
    that function, linear along the piece, passes through zero.
    """
    x, z = np.moveaxis(outline, -1, 0)  # (..., V)
    half, depth = scanner.half_width(z), np.full(rays.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = (x / half)[..., None] > rays[..., None, :]  # of all pairs, few pass through zero
        beyond ^= (half < 0)[..., None]
        *scan, piece, ray = np.nonzero(beyond[..., :-1, :] != beyond[..., 1:, :])
        begin, stop, ray = (*scan, piece), (*scan, piece + 1), (*scan, ray)
        start, end = x[begin] - rays[ray] * half[begin], x[stop] - rays[ray] * half[stop]
        t = start / (start - end)
        met = z[begin] + t * (z[stop] - z[begin])
    np.minimum.at(depth, ray, np.where((t >= 0) & (t <= 1), met, np.inf))
    return np.where(np.isfinite(depth), depth, np.nan)
