"""The arc of a curve in a raw profile: of the circle that a ball shows, or of the ellipse of a rod."""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy.optimize import least_squares

from profilecal.geometry.fitting import fit_circle
from profilecal.profiles.points import (
    FOLLOWS,
    LARGEST_TOLERANCE,
    Feature,
    block_means,
    correlation,
    mask,
    nothing,
    present,
    stretches,
    surface,
)

LEAST_ARC_POINTS = 20  # of a curve that must be seen
LARGEST_TILT_DEG = 60.0  # of the scan plane against square to a rod


@dataclass(frozen=True)
class Section:
    """The ellipse |w|² - (w·t)² = R², w from its centre, in which the scan plane cuts a rod.

    t is what of the rod's unit axis is in the plane; `lean` q = t / √(1 - |t|²) is as long as the tangent of the tilt,
    zero for a circle. Points are rows (k, 2).
    """

    centre: np.ndarray  # (2,) mm
    lean: np.ndarray  # (2,)
    radius: float  # mm, of the rod

    @cached_property
    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """From w to the circle that the rod shows along its axis, B = 1 - q qᵀ / (s (1 + s)) with s² = 1 + |q|², and
        back, B⁻¹ = 1 + q qᵀ / (1 + s)."""
        s, square = np.sqrt(1 + self.lean @ self.lean), np.outer(self.lean, self.lean)
        return np.eye(2) - square / (s * (1 + s)), np.eye(2) + square / (1 + s)

    def around(self, points) -> np.ndarray:
        """Points from the rod's axis, seen along it, mm."""
        return (points - self.centre) @ self.maps[0]

    def off(self, points) -> np.ndarray:
        """How far points are outside, (k,) mm; of an ellipse to first order: small beside the radius."""
        u = self.around(points)
        distance = lengths(u)
        return (distance - self.radius) * distance / lengths(u @ self.maps[0])

    def normals(self, u) -> np.ndarray:
        """Unit normals, outwards, where the rod seen along its axis has the directions of u (k, 2)."""
        normal = u @ self.maps[0]
        return normal / lengths(normal)[:, None]

    def angles(self, points) -> np.ndarray:
        """Where on it points in scan order are, about the rod's axis, (k,) rad, without jumps."""
        x, z = self.around(points).T
        return np.unwrap(np.arctan2(z, x))

    def points(self, angles, off) -> np.ndarray:
        """At angles (k,) and so far outside (k,), mm."""
        u = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return self.centre + self.radius * u @ self.maps[1] + off[:, None] * self.normals(u)

    def derivatives(self, points) -> np.ndarray:
        """Of `off` by centre and lean, (k, 4), to the same order."""
        normal = self.normals(self.around(points))
        along = (points - self.centre) @ self.lean / (1 + self.lean @ self.lean)
        return -np.hstack([normal, normal * along[:, None]])


def lengths(vectors) -> np.ndarray:
    """Of vectors (k, 2)."""
    return np.hypot(*vectors.T)


def find_balls(profiles, radius: float) -> list[Feature]:
    """The arc of the ball in each profile (n, 2), mm, as up to 40 means over its points."""

    def why_not(circle, points, on, _):
        return why_no_ball(circle, points[on], radius)

    start = partial(best_circle, largest=1.2 * radius)
    missing = "no arc of a circle as large as the ball or smaller"
    return [find_arc(profile, start, nearest_circle, 3, why_not, missing) for profile in profiles]


def find_rods(profiles, radius: float) -> list[Feature]:
    """The arc of the rod in each profile (n, 2), mm, as up to 40 means over its points."""

    def fit(points, curve):
        return nearest_section(points, curve if curve.lean.any() else leaning(curve, points, radius))

    start = partial(best_circle, largest=2.5 * radius, least=0.5 * radius, parts=60)  # a thin rod fills one or two
    missing = (
        f"no arc of a rod of {radius:.4g} mm whose axis is within {LARGEST_TILT_DEG:.0f}° of square to the profile"
    )
    return [find_arc(profile, start, fit, 4, why_no_rod, missing) for profile in profiles]


def find_arc(profile, start, fit, fitted: int, why_not, missing: str) -> Feature:
    """The arc that a profile (n, 2) shows of a curve, as up to 40 means over its points.

    `start(points, limit)` gives a circle of which points (k, 2) may show an arc to within `limit` mm, or None, and
    `fit(points, curve)` the curve nearest to points near the last one, of so many parameters `fitted`. What speaks
    against it, or "", is told by `why_not(curve, points, on, limit)`, with the points that are `on` it (k,); that there
    is none by `missing`.
    """
    seen = np.flatnonzero(present(profile))
    if len(seen) < LEAST_ARC_POINTS:
        return nothing(profile, f"{len(seen)} points; an arc needs {LEAST_ARC_POINTS}")
    rows, limit = surface(profile, seen)
    if limit == LARGEST_TOLERANCE:
        return nothing(profile, "neighbouring points differ too much to be of one surface")
    points = profile[rows]
    curve, on = start(points, limit), None
    for _ in range(6):  # two or three are usual
        if curve is None:
            break
        before, on = on, largest_part(np.abs(curve.off(points)) <= limit)
        if np.array_equal(on, before):
            break
        curve = fit(points[on], curve) if on.sum() >= LEAST_ARC_POINTS else None
    if curve is None:
        return nothing(profile, missing)
    reason = why_no_arc(curve, points, on, limit) or why_not(curve, points, on, limit)
    if reason:
        return nothing(profile, reason)
    angles, off = curve.angles(points[on]), curve.off(points[on])
    angles, means, covariance = block_means(angles, off, curve.normals(curve.around(points[on])), fitted)
    return Feature(curve.points(angles, means), covariance, mask(profile, rows[on]), "arc")


def why_no_arc(curve: Section, points, on, limit: float) -> str:
    """What speaks against the points that are `on` a curve being an arc of it, in words; "" if nothing does."""
    extent = float(np.ptp(curve.angles(points[on])))
    if extent < np.radians(30):
        return f"an arc of {np.degrees(extent):.0f}°; expected 30° or more"
    if curve.radius * (1 - np.cos(min(extent / 2, np.pi))) < 4 * limit:
        return "an arc too flat to be told from a line"
    if np.sqrt(np.mean(curve.off(points[on]) ** 2)) > FOLLOWS * limit:
        return f"points that follow no {'ellipse' if curve.lean.any() else 'circle'}"
    share = on[on.argmax() : len(on) - on[::-1].argmax()].mean()
    if share < 0.9:  # pieces of other things cross the curve
        return f"only {100 * share:.0f} % of the points along the arc are on it"
    return ""


def why_no_ball(circle: Section, points, radius: float) -> str:
    """What speaks against a circle through points (k, 2) being the ball's, in words; "" if nothing does."""
    if circle.radius > 1.01 * radius + 4 * circle_radius_sd(circle.angles(points), circle.off(points)):
        return f"a circle of {circle.radius:.4g} mm; expected at most the ball's {radius:.4g} mm"
    return ""


def circle_radius_sd(angles, off) -> float:
    """Standard deviation of the radius of a circle fitted to points at angles (k,) that are `off` (k,) it, mm."""
    J = np.stack([np.cos(angles), np.sin(angles), np.ones_like(angles)], axis=-1)
    variance = (off**2).sum() / max(len(off) - 3, 1) * correlation(off)
    return float(np.sqrt(variance * np.linalg.inv(J.T @ J)[2, 2]))


def why_no_rod(section: Section, points, on, limit: float) -> str:
    """Says so if the surface leaves the section gradually, as larger or smaller ones do, and not by a step."""
    first, last = np.flatnonzero(on)[[0, -1]]
    for beyond in (points[:first][::-1], points[last + 1 :]):
        off = np.abs(section.off(beyond[3:9]))  # the first ones may show both
        if len(off) >= 3 and np.median(off) < 3 * limit:
            return f"an arc that goes on where a rod of {section.radius:.4g} mm bends away"
    return ""


def best_circle(points, limit: float, largest: float, least: float = 0.0, parts: int = 12) -> Section | None:
    """Of circles through three points of a profile (k, 2) each, the one on which most points are for its size, or None.

    Its radius is between `least`, or what noise alone may bend, and `largest`, mm. The three points are spread over
    stretches of different length, from one of so many `parts` of the profile to all of it, so that some see the arc
    alone, without spikes.
    """
    k = len(points)
    spans = np.unique(np.geomspace(max(8, k // parts), k - 1, 7).astype(int))[:, None]
    starts = (np.linspace(0, 1, 40) * (k - 1 - spans)).astype(int)
    circles = circles_through(*(points[(starts + step).ravel()] for step in (0, spans // 2, spans)))
    circles = circles[((least or 10 * limit) < circles[:, 2]) & (circles[:, 2] < largest)]  # false for NaN
    if not len(circles):
        return None
    few = points[:: max(1, k // 250)]
    distance = np.sqrt((few[:, 0] - circles[:, :1]) ** 2 + (few[:, 1] - circles[:, 1:2]) ** 2)  # faster than hypot
    count = np.count_nonzero(np.abs(distance - circles[:, 2:]) < limit, axis=1)
    best = (count / np.sqrt(circles[:, 2])).argmax()  # a line is as near to a circle over √radius of length
    return section_of(circles[best]) if count[best] >= 10 else None


def circles_through(p, q, r) -> np.ndarray:
    """The circles (c, 3) as x, z, radius through three points (c, 2) each; not finite where these are on one line."""
    a, b = q - p, r - p
    twice = 2 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        aa, bb = (a**2).sum(axis=1) / twice, (b**2).sum(axis=1) / twice
        x, z = b[:, 1] * aa - a[:, 1] * bb, a[:, 0] * bb - b[:, 0] * aa  # of the centre, from p
    return np.stack([p[:, 0] + x, p[:, 1] + z, np.hypot(x, z)], axis=-1)


def section_of(circle) -> Section:
    """A circle (3,), x, z and radius, as a section."""
    return Section(circle[:2], np.zeros(2), circle[2])


def nearest_circle(points, _) -> Section | None:
    """The circle nearest to points (k, 2); None if they are too few places to tell."""
    with np.errstate(divide="ignore", invalid="ignore"):  # repeated points: NaN
        circle = fit_circle(points)
    return section_of(circle) if np.isfinite(circle).all() else None


def leaning(circle: Section, points, radius: float) -> Section:
    """The section of a rod that leans by 30° towards the middle of points (k, 2) on a circle, and touches it there."""
    middle = points[len(points) // 2]
    (outwards,) = circle.normals(circle.around(middle[None]))
    tilt = np.radians(30)
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


def largest_part(on) -> np.ndarray:
    """Of points that are `on` (k,), the stretch with most of them; an arc goes on behind a gap of up to 20 rows."""
    return mask(on, max(stretches(np.flatnonzero(on), 20), key=len))
