"""The arc of a curve in a raw profile: of the circle that a ball shows, or of the
ellipse of a rod.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.optimize import leastsq
from scipy.spatial.distance import cdist

from profilecal.geometry.fitting import fit_circle
from profilecal.profiles.candidates import AMBIGUOUS
from profilecal.profiles.features import Feature, block_means, nothing
from profilecal.profiles.points import (
    LARGEST_TOLERANCE,
    Profiles,
    in_each,
    stretches,
    surface,
    variance_inflation,
)

LEAST_ARC_POINTS = 20  # of a curve that must be seen
# tolerances, rms, of an arc's points from its curve, at most: two and a half times the
# noise, as real scanners see a ball
ON_CURVE = 0.5
LARGEST_TILT_DEG = 60.0  # of the scan plane against square to a rod


@dataclass(frozen=True)
class Section:
    """The ellipse |w|² - (w·t)² = R² in which the scan plane cuts a rod; w runs from
    its centre.

    t is the part of the rod's unit axis that is in the plane. The `lean` is
    t / √(1 - |t|²), as long as the tangent of the tilt; it is zero for a circle.
    """

    centre: ndarray  # (2,) mm
    lean: ndarray  # (2,)
    radius: float  # mm, of the rod

    def off_and_normals(self, points: ndarray) -> tuple[ndarray, ndarray]:
        """How far points (k, 2) are outside, (k,) mm, and unit normals there, outwards,
        (k, 2).

        For an ellipse it is to first order: the distance from the rod's surface over
        how fast it grows in the plane. With a, which is the lean turned by 90°, a point
        has the distance d from the rod's axis, d² = w · o with o = (w + (w·a) a) /
        (1 + |a|²), which grows in the plane by o / d. The centre itself has no normal:
        NaN.
        """
        w = points - self.centre
        aside = self.lean[::-1] * [1, -1]
        outwards = (w + np.outer(w @ aside, aside)) / (1 + aside @ aside)
        distance = np.sqrt(np.vecdot(w, outwards))
        size = np.where(distance, np.hypot(*outwards.T), np.nan)
        return (distance - self.radius) * distance / size, outwards / size[:, None]


# Below are the sections of two bodies. Of points (k, 2) of a profile `nearest` gives
# the one nearest to them, looked for from one `near` them; None where it cannot be the
# body's. `why_not` says what speaks against one with points `on` it, as indices, to
# within some mm; "" if nothing does.


@dataclass(frozen=True)
class BallSections:
    """Circles, as large as the ball or smaller."""

    radius: float  # mm, of the ball
    largest = 1.2  # of circles with which a search begins, in radii
    missing = "no arc of a circle as large as the ball or smaller"

    def nearest(self, points: ndarray, near: Section) -> Section:
        """The circle, whatever was near; NaN if points are on a line."""
        return section_of(fit_circle(points))

    def why_not(self, found: Section, points: ndarray, on: ndarray, mm: float) -> str:
        """That a circle is larger than the ball."""
        off, normals = found.off_and_normals(points[on])
        J = np.column_stack([normals, np.ones(len(off))])  # by centre and radius
        variance = off @ off / max(len(off) - 3, 1) * variance_inflation(off)
        radius_sd = np.sqrt(variance * np.linalg.inv(J.T @ J)[2, 2])
        if found.radius > 1.01 * self.radius + 4 * radius_sd:
            largest = f"expected at most the ball's {self.radius:.4g} mm"
            return f"a circle of {found.radius:.4g} mm; {largest}"
        return ""


@dataclass(frozen=True)
class RodSections:
    """Ellipses, by planes that are not too far off square to the rod."""

    radius: float  # mm, of the rod
    largest = 2.5

    @property
    def missing(self) -> str:
        """With how the rod has to stand."""
        square = f"within {LARGEST_TILT_DEG:.0f}° of square to the profile"
        return f"no arc of a rod of {self.radius:.4g} mm whose axis is {square}"

    def nearest(self, points: ndarray, near: Section) -> Section | None:
        """The ellipse by least squares, k ≥ 4, from one near or leaning from a circle;
        None if it leans too far.
        """

        def section_at(state: ndarray) -> Section:
            return Section(state[:2], state[2:], self.radius)

        def off(state: ndarray) -> ndarray:
            return section_at(state).off_and_normals(points)[0]

        centre, lean = near.centre, near.lean
        if not lean.any():  # by 30° towards the middle of the points, where it touches
            middle, tilt = points[len(points) // 2], np.radians(30)
            outwards = near.off_and_normals(middle[None])[1][0]
            centre = middle - self.radius / np.cos(tilt) * outwards
            lean = np.tan(tilt) * outwards
        start = np.concatenate([centre, lean])
        # a share of the sum of squares: far below what noise changes
        state, *_ = leastsq(off, start, ftol=1e-4, full_output=True)
        nearest = section_at(state)
        steepest = np.tan(np.radians(LARGEST_TILT_DEG))
        return nearest if np.hypot(*nearest.lean) < steepest else None  # false for NaN

    def why_not(self, found: Section, points: ndarray, on: ndarray, mm: float) -> str:
        """That the surface leaves the section gradually, as that of larger or smaller
        rods does, and not by a step.
        """
        before, after = points[: on[0]][::-1], points[on[-1] + 1 :]
        for beyond in (before, after):
            # the first ones may show both
            off = np.abs(found.off_and_normals(beyond[3:9])[0])
            if len(off) >= 3 and np.median(off) < 3 * mm:
                rod = f"a rod of {found.radius:.4g} mm"
                return f"an arc that goes on where {rod} bends away"
        return ""


Kind = BallSections | RodSections


def find_balls(profiles: Profiles, radius: float) -> list[Feature]:
    """The arc of the ball in each profile (n, 2), mm, as means over points."""
    return in_each(profiles, find_arc, BallSections(radius))


def find_rods(profiles: Profiles, radius: float) -> list[Feature]:
    """The arc of the rod in each profile (n, 2), mm, as means over points."""
    return in_each(profiles, find_arc, RodSections(radius))


def find_arc(profile: ndarray, kind: Kind) -> Feature:
    """The arc that a profile (n, 2) shows of a kind, as means over its points.

    The search begins with a circle, which the kind's own curve refines.
    """
    rows, limit = surface(profile)
    if limit == LARGEST_TOLERANCE:
        return nothing("neighbouring points differ too much to be of one surface")
    points = profile[rows]
    if len(points) < LEAST_ARC_POINTS:
        return nothing(f"{len(points)} points; an arc needs {LEAST_ARC_POINTS}")
    circles = circles_through(points, kind.largest * kind.radius)
    found = arc_among(points, circles, limit, kind)
    if isinstance(found, str):
        return nothing(found)
    curve, on = found
    least = max(LEAST_ARC_POINTS, int(AMBIGUOUS * len(on)))
    others = np.delete(points, on, axis=0)
    other = arc_among(others, circles, limit, kind, least)
    if not isinstance(other, str):
        return nothing("two arcs of similar length")
    arc = points[on]
    means, off, covariance = block_means(arc, *curve.off_and_normals(arc))
    # the bend within a block draws its mean inwards
    inside, normals = curve.off_and_normals(means)
    means = means + (off - inside)[:, None] * normals
    return Feature(means, covariance, rows[on], "arc")


def arc_among(
    points: ndarray,
    circles: ndarray,
    limit: float,
    kind: Kind,
    least: int = LEAST_ARC_POINTS,
) -> tuple[Section, ndarray] | str:
    """The longest arc of a kind that points (k, 2) show, and which of them are on it,
    as indices; or, in words, why there is none of at least so many.

    The search begins with that of some circles (c, 3) on which most points are for its
    size.
    """
    if not len(circles):
        return kind.missing
    few = points[:: max(1, len(points) // 250)]
    off = cdist(circles[:, :2], few) - circles[:, 2:]
    count = np.count_nonzero(np.abs(off) < limit, axis=1)
    # a line stays near a circle over a length that grows as √radius
    best = (count / np.sqrt(circles[:, 2])).argmax()
    circle = section_of(circles[best])
    found = refined(circle, points, limit, kind, least) if count[best] >= 10 else None
    if found is None:
        return kind.missing
    curve, on = found
    reason = why_no_arc(curve, points, on, limit)
    return reason or kind.why_not(curve, points, on, limit) or found


def refined(
    curve: Section,
    points: ndarray,
    limit: float,
    kind: Kind,
    least: int,
) -> tuple[Section, ndarray] | None:
    """A curve fitted to the longest arc of points (k, 2) on it, until that stays the
    same, and the arc, as indices; None where that has fewer than `least` or nothing
    fits.
    """
    on = np.zeros(0, dtype=int)
    for _ in range(6):  # two or three are usual
        before = on
        near = np.abs(curve.off_and_normals(points)[0]) <= limit
        # an arc goes on behind a gap of up to 20 rows
        on = max(stretches(np.flatnonzero(near), 20), key=len)
        if np.array_equal(on, before):
            break
        if len(on) < least:
            return None
        fitted = kind.nearest(points[on], curve)
        if fitted is None:
            return None
        curve = fitted
    return curve, on


def why_no_arc(curve: Section, points: ndarray, on: ndarray, limit: float) -> str:
    """What speaks against the points that are `on` a curve being an arc of it, in
    words; "" if nothing does.
    """
    off, normals = curve.off_and_normals(points[on])
    directions = np.unwrap(np.arctan2(*normals.T[::-1]))
    extent = float(np.ptp(directions))
    if not extent >= np.radians(30):  # false for NaN
        return f"an arc of {np.degrees(extent):.0f}°; expected 30° or more"
    # a circle touches what is before a step and what is behind it
    if np.diff(np.sort(directions)).max() > extent / 2:
        return "an arc that is seen in pieces"
    if np.sqrt(np.mean(off**2)) > ON_CURVE * limit:
        return f"points that follow no {'ellipse' if curve.lean.any() else 'circle'}"
    return ""


def circles_through(points: ndarray, largest: float) -> ndarray:
    """Circles (c, 3), x, z and radius, through three points of a profile (k, 2) each,
    with equal numbers of points between them.

    No circle is larger than `largest`, mm, or smaller than a fifth of it. The three
    points spread over a sixtieth of the profile to all of it, so that some see the arc
    alone, without spikes.
    """
    k = len(points)
    spans = np.unique(np.geomspace(max(8, k // 60), k - 1, 7).astype(int))[:, None]
    starts = (np.linspace(0, 1, 40) * (k - 1 - spans)).astype(int)
    rows = np.stack([starts, starts + spans // 2, starts + spans], axis=-1)
    circles = fit_circle(points[rows.reshape(-1, 3)])
    radii = circles[:, 2]
    return circles[(largest / 5 < radii) & (radii < largest)]  # false for NaN


def section_of(circle: ndarray) -> Section:
    """A circle (3,), x, z and radius, as a section."""
    return Section(circle[:2], np.zeros(2), circle[2])
