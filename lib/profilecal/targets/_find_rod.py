"""A rod, a straight round bar, in raw profiles: an arc of the ellipse in which the scan plane cuts it."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from profilecal.profiles.arcs import Circle, best_circle, find_arc
from profilecal.profiles.feature import Feature

LARGEST_TILT_DEG = 60.0  # of the scan plane against square to the rod
FIRST_TILT_DEG = 30.0  # of the section with which a fit begins
LEAST_STEP = 3.0  # tolerances, from the section to what is seen beyond its arc
BEYOND = slice(3, 9)  # points that show it: the first ones may show both
PARTS = 60  # of a profile, of which a thin rod fills one or two


@dataclass(frozen=True)
class Section:
    """The ellipse |w|² - (w·t)² = R², w from its centre and t what of the rod's unit axis is in the plane: a `Curve`.

    `lean` q = t / √(1 - |t|²) is as long as the tangent of the tilt. The map B = 1 - q qᵀ / (s (1 + s)), s² = 1 + |q|²,
    takes w to the circle that the rod shows along its axis, and back with B⁻¹ = 1 + q qᵀ / (1 + s).
    """

    centre: np.ndarray  # (2,) mm
    lean: np.ndarray  # (2,)
    radius: float  # mm, of the rod
    shape = "ellipse"
    fitted = 4

    @property
    def secant(self) -> float:
        """Of the tilt: s."""
        return float(np.sqrt(1 + self.lean @ self.lean))

    def squared(self, w) -> np.ndarray:
        """B w for vectors (k, 2) in the scan plane."""
        return w - (w @ self.lean)[:, None] * self.lean / (self.secant * (1 + self.secant))

    def off(self, points) -> np.ndarray:
        """To first order: small beside the radius."""
        u = self.squared(points - self.centre)
        distance = np.hypot(*u.T)
        return (distance - self.radius) * distance / np.hypot(*self.squared(u).T)

    def normals(self, u) -> np.ndarray:
        """Unit normals (k, 2), outwards, where B takes the curve to the directions of u (k, 2)."""
        normal = self.squared(u)
        return normal / np.hypot(*normal.T)[:, None]

    def angles(self, points) -> np.ndarray:
        """About the rod's axis."""
        x, z = self.squared(points - self.centre).T
        return np.unwrap(np.arctan2(z, x))

    def points(self, angles, off) -> np.ndarray:
        u = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        w = u + (u @ self.lean)[:, None] * self.lean / (1 + self.secant)
        return self.centre + self.radius * w + off[:, None] * self.normals(u)

    def derivatives(self, points) -> np.ndarray:
        """Of `off` by centre and lean, (k, 4), to the same order."""
        w = points - self.centre
        normal = self.normals(self.squared(w))
        return -np.hstack([normal, normal * (w @ self.lean / self.secant**2)[:, None]])


def find(profiles, sizes) -> list[Feature]:
    """The arc of the rod in each profile (n, 2), mm, as up to 40 means over its points; `sizes` is its radius, mm."""
    (radius,) = sizes

    def start(points, limit):
        return best_circle(points, limit, least=0.5 * radius, largest=2.5 * radius, parts=PARTS)

    def fit(points, curve):
        return nearest_section(points, leaning(curve, points, radius) if isinstance(curve, Circle) else curve)

    missing = (
        f"no arc of a rod of {radius:.4g} mm whose axis is within {LARGEST_TILT_DEG:.0f}° of square to the profile"
    )
    return [find_arc(profile, start, fit, why_no_rod, missing) for profile in profiles]


def leaning(circle: Circle, points, radius: float) -> Section:
    """The section of a rod that leans towards the middle one of points (k, 2) on a circle, and touches it there."""
    middle = points[len(points) // 2]
    outwards = (middle - circle.centre) / np.hypot(*(middle - circle.centre))
    tilt = np.radians(FIRST_TILT_DEG)
    return Section(middle - radius / np.cos(tilt) * outwards, np.tan(tilt) * outwards, radius)


def nearest_section(points, section: Section) -> Section | None:
    """By least squares from points (k, 2), k ≥ 4, starting at a section near them; None if it leans too far."""

    def of(state):
        return Section(state[:2], state[2:], section.radius)

    found = least_squares(
        lambda state: of(state).off(points),
        np.concatenate([section.centre, section.lean]),
        lambda state: of(state).derivatives(points),
        method="lm",
        x_scale="jac",
        ftol=1e-4,  # of the sum of squares: far below what noise changes
    )
    return of(found.x) if np.hypot(*found.x[2:]) < np.tan(np.radians(LARGEST_TILT_DEG)) else None  # false for NaN


def why_no_rod(section: Section, points, on, limit: float) -> str:
    """Says so if the surface leaves the section gradually, as larger or smaller ones do, and not by a step."""
    first, last = np.flatnonzero(on)[[0, -1]]
    for beyond in (points[:first][::-1], points[last + 1 :]):
        off = np.abs(section.off(beyond[BEYOND]))
        if len(off) >= 3 and np.median(off) < LEAST_STEP * limit:
            return f"an arc that goes on where a rod of {section.radius:.4g} mm bends away"
    return ""
