"""The arc of a circle, or of a curve like it, in a raw profile."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from profilecal.geometry.fitting import fit_circle
from profilecal.profiles.feature import Feature, block_means, mask, nothing
from profilecal.profiles.points import LARGEST_TOLERANCE, present, stretches, surface

LEAST_ARC_DEG, LEAST_ARC_POINTS = 30.0, 20  # of a curve that must be seen
LARGEST_RMS = 0.5  # tolerances, of an arc's points from the curve; pieces of lines near a curve have more
LEAST_ON_ARC = 0.9  # of the points along an arc that must lie on it
LARGEST_GAP = 20  # rows from one point of an arc to the next
ROUNDS = 6  # of fitting a curve and choosing the points on it


class Curve(Protocol):
    """A closed curve in the scan plane, convex, and what it means to be on it."""

    shape: str  # in words
    fitted: int  # parameters that a fit of it takes from points
    radius: float  # mm, about

    def off(self, points) -> np.ndarray:
        """How far points (k, 2) are outside, mm."""

    def angles(self, points) -> np.ndarray:
        """Where on it points (k, 2) in scan order are, rad, without jumps."""

    def points(self, angles, off) -> np.ndarray:
        """At angles (k,) and so far outside (k,), mm: (k, 2)."""


@dataclass(frozen=True)
class Circle:
    """The points at `radius` mm from `centre` (2,): a `Curve`."""

    centre: np.ndarray
    radius: float
    shape = "circle"
    fitted = 3

    @staticmethod
    def through(points) -> "Circle | None":
        """The one nearest to points (k, 2); None if they are too few places to tell."""
        with np.errstate(divide="ignore", invalid="ignore"):  # repeated points: NaN
            circle = fit_circle(points)
        return Circle(circle[:2], circle[2]) if np.isfinite(circle).all() else None

    def off(self, points) -> np.ndarray:
        return np.hypot(*(points - self.centre).T) - self.radius

    def angles(self, points) -> np.ndarray:
        x, z = (points - self.centre).T
        return np.unwrap(np.arctan2(z, x))

    def points(self, angles, off) -> np.ndarray:
        return self.centre + (self.radius + off)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def find_arc(profile, start, fit, why_not, missing: str) -> Feature:
    """The arc that a profile (n, 2) shows of a curve, as up to 40 means over its points.

    `start(points, limit)` gives a rough curve of which points (k, 2) may show an arc to within `limit` mm, or None, and
    `fit(points, curve)` the one nearest to points near the last one. `why_not(curve, points, on, limit)` says what
    speaks against it, with the points that are `on` it (k,), or "", and `missing` that there is none.
    """
    seen = np.flatnonzero(present(profile))
    if len(seen) < LEAST_ARC_POINTS:
        return nothing(profile, f"{len(seen)} points; an arc needs {LEAST_ARC_POINTS}")
    rows, limit = surface(profile, seen)
    if limit == LARGEST_TOLERANCE:
        return nothing(profile, "neighbouring points differ too much to be of one surface")
    points = profile[rows]
    curve, on = start(points, limit), None
    for _ in range(ROUNDS):
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
    normals = curve.points(angles, np.ones_like(off)) - curve.points(angles, np.zeros_like(off))
    angles, means, covariance = block_means(angles, off, normals, curve.fitted)
    return Feature(curve.points(angles, means), covariance, mask(profile, rows[on]), "arc")


def why_no_arc(curve: Curve, points, on, limit: float) -> str:
    """What speaks against the points that are `on` a curve being an arc of it, in words; "" if nothing does."""
    extent = float(np.ptp(curve.angles(points[on])))
    if extent < np.radians(LEAST_ARC_DEG):
        return f"an arc of {np.degrees(extent):.0f}°; expected {LEAST_ARC_DEG:.0f}° or more"
    if curve.radius * (1 - np.cos(min(extent / 2, np.pi))) < 4 * limit:
        return "an arc too flat to be told from a line"
    if np.sqrt(np.mean(curve.off(points[on]) ** 2)) > LARGEST_RMS * limit:
        return f"points that follow no {curve.shape}"
    share = on[on.argmax() : len(on) - on[::-1].argmax()].mean()
    if share < LEAST_ON_ARC:
        return f"only {100 * share:.0f} % of the points along the arc are on it"
    return ""


def best_circle(points, limit: float, least: float, largest: float, parts: int = 12) -> Circle | None:
    """Of circles through three points of a profile (k, 2) each, the one on which most points are for its size, or None.

    Its radius is between `least` and `largest`, mm. The three points are spread over stretches of different length,
    from one of so many `parts` of the profile to all of it, so that some see the arc alone, without spikes.
    """
    k = len(points)
    spans = np.unique(np.geomspace(max(8, k // parts), k - 1, 7).astype(int))[:, None]
    starts = (np.linspace(0, 1, 40) * (k - 1 - spans)).astype(int)
    circles = circles_through(*(points[(starts + step).ravel()] for step in (0, spans // 2, spans)))
    circles = circles[(least < circles[:, 2]) & (circles[:, 2] < largest)]  # false for NaN
    if not len(circles):
        return None
    few = points[:: max(1, k // 250)]
    distance = np.sqrt((few[:, 0] - circles[:, :1]) ** 2 + (few[:, 1] - circles[:, 1:2]) ** 2)  # faster than hypot
    count = np.count_nonzero(np.abs(distance - circles[:, 2:]) < limit, axis=1)
    best = (
        count / np.sqrt(circles[:, 2])
    ).argmax()  # a line comes as near to a circle for a length that grows like this
    return Circle(circles[best, :2], circles[best, 2]) if count[best] >= 10 else None


def circles_through(p, q, r) -> np.ndarray:
    """The circles (c, 3) as x, z, radius through three points (c, 2) each; not finite where these are on one line."""
    a, b = q - p, r - p
    twice = 2 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        aa, bb = (a**2).sum(axis=1) / twice, (b**2).sum(axis=1) / twice
        x, z = b[:, 1] * aa - a[:, 1] * bb, a[:, 0] * bb - b[:, 0] * aa  # of the centre, from p
    return np.stack([p[:, 0] + x, p[:, 1] + z, np.hypot(x, z)], axis=-1)


def largest_part(on) -> np.ndarray:
    """Of points that are `on` (k,), the stretch with most of them."""
    return mask(on, max(stretches(np.flatnonzero(on), LARGEST_GAP), key=len))
