"""The arc of a curve in a raw profile: of the circle that a ball shows, or of the
ellipse of a rod.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from profilecal.geometry.fitting import fit_circle
from profilecal.profiles.points import (
    FOLLOWS,
    LARGEST_TOLERANCE,
    Feature,
    block_means,
    correlation,
    nothing,
    present,
    stretches,
    surface,
)

LEAST_ARC_POINTS = 20  # of a curve that must be seen
LARGEST_TILT_DEG = 60.0  # of the scan plane against square to a rod


@dataclass(frozen=True)
class Section:
    """The ellipse |w|² - (w·t)² = R², w from its centre, in which the scan plane cuts a
    rod; t is what of the rod's unit axis is in the plane. `lean`, t / √(1 - |t|²), is
    as long as the tangent of the tilt, zero for a circle.
    """

    centre: np.ndarray  # (2,) mm
    lean: np.ndarray  # (2,)
    radius: float  # mm, of the rod

    def off_and_normals(self, points) -> tuple[np.ndarray, np.ndarray]:
        """How far points (k, 2) are outside, (k,) mm, and unit normals there, outwards,
        (k, 2); of an ellipse to first order: the distance from the rod's surface, over
        how fast it grows in the plane.
        """
        w, growth = points - self.centre, 1 + self.lean @ self.lean
        across = w[:, 0] * self.lean[1] - w[:, 1] * self.lean[0]
        distance = np.sqrt(((w**2).sum(axis=1) + across**2) / growth)
        outwards = w - np.outer(w @ self.lean, self.lean) / growth
        # none at the centre
        size = np.where(outwards.any(axis=1), np.hypot(*outwards.T), np.nan)
        return (distance - self.radius) * distance / size, outwards / size[:, None]

    def derivatives(self, points) -> np.ndarray:
        """Of how far points are outside by centre and lean, (k, 4), to the same order."""
        along = (points - self.centre) @ self.lean / (1 + self.lean @ self.lean)
        normals = self.off_and_normals(points)[1]
        return -np.hstack([normals, normals * along[:, None]])


def find_balls(profiles, radius: float) -> list[Feature]:
    """The arc of the ball in each profile (n, 2), mm, as up to 40 means over its
    points.
    """

    def why_not(circle, points, on, _):
        return why_no_ball(circle, points[on], radius)

    missing = "no arc of a circle as large as the ball or smaller"
    return [
        find_arc(profile, 1.2 * radius, nearest_circle, why_not, missing)
        for profile in profiles
    ]


def find_rods(profiles, radius: float) -> list[Feature]:
    """The arc of the rod in each profile (n, 2), mm, as up to 40 means over its points."""

    def fit(points, curve):
        return nearest_section(
            points, curve if curve.lean.any() else leaning(curve, points, radius)
        )

    missing = f"no arc of a rod of {radius:.4g} mm whose axis is within {LARGEST_TILT_DEG:.0f}° of square to the profile"
    return [
        find_arc(profile, 2.5 * radius, fit, why_no_rod, missing)
        for profile in profiles
    ]


def find_arc(profile, largest: float, fit, why_not, missing: str) -> Feature:
    """The arc that a profile (n, 2) shows of a curve, as up to 40 means over its
    points.

    It begins as a circle, its radius at most `largest`, mm. `fit(points, curve)` gives
    the curve nearest to points (k, 2) near the last one, or None: `missing` says so.
    `why_not(curve, points, on, limit)` says what speaks against it, or "", with the
    points that are `on` it, as indices, to within `limit` mm.
    """
    seen = np.flatnonzero(present(profile))
    if len(seen) < LEAST_ARC_POINTS:
        return nothing(f"{len(seen)} points; an arc needs {LEAST_ARC_POINTS}")
    rows, limit = surface(profile, seen)
    if limit == LARGEST_TOLERANCE:
        return nothing("neighbouring points differ too much to be of one surface")
    points = profile[rows]
    curve, on = best_circle(points, limit, largest), None
    for _ in range(6):  # two or three are usual
        if curve is None:
            break
        before, near = (
            on,
            np.flatnonzero(np.abs(curve.off_and_normals(points)[0]) <= limit),
        )
        # an arc goes on behind a gap of up to 20 rows
        on = max(stretches(near, 20), key=len)
        if np.array_equal(on, before):
            break
        curve = fit(points[on], curve) if len(on) >= LEAST_ARC_POINTS else None
    if curve is None:
        return nothing(missing)
    reason = why_no_arc(curve, points, on, limit) or why_not(curve, points, on, limit)
    if reason:
        return nothing(reason)
    means, off, covariance = block_means(points[on], *curve.off_and_normals(points[on]))
    # the bend within a block draws its mean inwards
    inside, normals = curve.off_and_normals(means)
    return Feature(
        means + (off - inside)[:, None] * normals, covariance, rows[on], "arc"
    )


def why_no_arc(curve: Section, points, on, limit: float) -> str:
    """What speaks against the points that are `on` a curve being an arc of it, in
    words; "" if nothing does.
    """
    off, normals = curve.off_and_normals(points[on])
    extent = float(np.ptp(np.unwrap(np.arctan2(normals[:, 1], normals[:, 0]))))
    if extent < np.radians(30):
        return f"an arc of {np.degrees(extent):.0f}°; expected 30° or more"
    if curve.radius * (1 - np.cos(min(extent / 2, np.pi))) < 4 * limit:
        return "an arc too flat to be told from a line"
    if np.sqrt(np.mean(off**2)) > FOLLOWS * limit:
        return f"points that follow no {'ellipse' if curve.lean.any() else 'circle'}"
    share = len(on) / (on[-1] - on[0] + 1)
    if share < 0.9:  # pieces of other things cross the curve
        return f"only {100 * share:.0f} % of the points along the arc are on it"
    return ""


def why_no_ball(circle: Section, points, radius: float) -> str:
    """What speaks against a circle through points (k, 2) being the ball's, in words; ""
    if nothing does.
    """
    off, normals = circle.off_and_normals(points)
    J = np.column_stack([normals, np.ones(len(off))])
    variance = (off**2).sum() / max(len(off) - 3, 1) * correlation(off)
    radius_sd = np.sqrt(variance * np.linalg.inv(J.T @ J)[2, 2])
    if circle.radius > 1.01 * radius + 4 * radius_sd:
        return f"a circle of {circle.radius:.4g} mm; expected at most the ball's {radius:.4g} mm"
    return ""


def why_no_rod(section: Section, points, on, limit: float) -> str:
    """Says so if the surface leaves the section gradually, as larger or smaller ones
    do, and not by a step.
    """
    for beyond in (points[: on[0]][::-1], points[on[-1] + 1 :]):
        # the first ones may show both
        off = np.abs(section.off_and_normals(beyond[3:9])[0])
        if len(off) >= 3 and np.median(off) < 3 * limit:
            return (
                f"an arc that goes on where a rod of {section.radius:.4g} mm bends away"
            )
    return ""


def best_circle(points, limit: float, largest: float) -> Section | None:
    """Of circles through three points of a profile (k, 2) each, none larger than
    `largest`, mm, nor smaller than a fifth of it, the one on which most points are for
    its size, or None. The three points spread over a sixtieth of the profile to all of
    it, so that some see the arc alone, without spikes.
    """
    k = len(points)
    spans = np.unique(np.geomspace(max(8, k // 60), k - 1, 7).astype(int))[:, None]
    starts = (np.linspace(0, 1, 40) * (k - 1 - spans)).astype(int)
    number = points[:, 0] + 1j * points[:, 1]
    first, middle, last = (
        number[(starts + step).ravel()] for step in (0, spans // 2, spans)
    )
    a, b = middle - first, last - first
    with np.errstate(divide="ignore", invalid="ignore"):  # three on one line: no number
        # from the first point to the centre
        arm = (abs(a) ** 2 * b - abs(b) ** 2 * a) / (2j * (a.conj() * b).imag)
    centre = first + arm
    circles = np.stack([centre.real, centre.imag, abs(arm)], axis=-1)
    # false for NaN
    circles = circles[(largest / 5 < circles[:, 2]) & (circles[:, 2] < largest)]
    if not len(circles):
        return None
    few = points[:: max(1, k // 250)]
    distance = np.sqrt(
        (few[:, 0] - circles[:, :1]) ** 2 + (few[:, 1] - circles[:, 1:2]) ** 2
    )  # faster than hypot
    count = np.count_nonzero(np.abs(distance - circles[:, 2:]) < limit, axis=1)
    # a line is as near to a circle over √radius of length
    best = (count / np.sqrt(circles[:, 2])).argmax()
    return section_of(circles[best]) if count[best] >= 10 else None


def section_of(circle) -> Section:
    """A circle (3,), x, z and radius, as a section."""
    return Section(circle[:2], np.zeros(2), circle[2])


def nearest_circle(points, _) -> Section | None:
    """The circle nearest to points (k, 2); None if they are too few places to tell."""
    with np.errstate(divide="ignore", invalid="ignore"):  # repeated points: NaN
        circle = fit_circle(points)
    return section_of(circle) if np.isfinite(circle).all() else None


def leaning(circle: Section, points, radius: float) -> Section:
    """The section of a rod that leans by 30° towards the middle of points (k, 2) on a
    circle, and touches it there.
    """
    middle = points[len(points) // 2]
    (outwards,) = circle.off_and_normals(middle[None])[1]
    tilt = np.radians(30)
    return Section(
        middle - radius / np.cos(tilt) * outwards, np.tan(tilt) * outwards, radius
    )


def nearest_section(points, section: Section) -> Section | None:
    """By least squares from points (k, 2), k ≥ 4, starting at a section near them; None
    if it leans too far.
    """

    def of(state):
        return Section(state[:2], state[2:], section.radius)

    found = least_squares(
        lambda state: of(state).off_and_normals(points)[0],
        np.concatenate([section.centre, section.lean]),
        lambda state: of(state).derivatives(points),
        method="lm",
        x_scale="jac",
        ftol=1e-4,  # of the sum of squares: far below what noise changes
    )
    return (
        of(found.x)
        if np.hypot(*found.x[2:]) < np.tan(np.radians(LARGEST_TILT_DEG))
        else None
    )  # false for NaN
