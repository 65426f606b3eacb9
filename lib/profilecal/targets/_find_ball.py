"""A ball in raw profiles: the arc of a circle no larger than the ball."""

import numpy as np

from profilecal.profiles.arcs import Circle, best_circle, find_arc
from profilecal.profiles.feature import Feature
from profilecal.profiles.points import correlation


def find(profiles, sizes) -> list[Feature]:
    """The arc of the ball in each profile (n, 2), mm, as up to 40 means over its points; `sizes` is its radius, mm."""
    (radius,) = sizes

    def start(points, limit):
        return best_circle(points, limit, least=10 * limit, largest=1.2 * radius)

    def fit(points, _):
        return Circle.through(points)

    def why_not(circle, points, on, _):
        return why_no_ball(circle, points[on], radius)

    missing = "no arc of a circle as large as the ball or smaller"
    return [find_arc(profile, start, fit, why_not, missing) for profile in profiles]


def why_no_ball(circle: Circle, points, radius: float) -> str:
    """What speaks against a circle through points (k, 2) being the ball's, in words; "" if nothing does."""
    if circle.radius > 1.01 * radius + 4 * circle_radius_sd(circle.angles(points), circle.off(points)):
        return f"a circle of {circle.radius:.4g} mm; expected at most the ball's {radius:.4g} mm"
    return ""


def circle_radius_sd(angles, off) -> float:
    """Standard deviation of the radius of a circle fitted to points at angles (k,) that are `off` (k,) it, mm."""
    J = np.stack([np.cos(angles), np.sin(angles), np.ones_like(angles)], axis=-1)
    variance = (off**2).sum() / max(len(off) - 3, 1) * correlation(off)
    return float(np.sqrt(variance * np.linalg.inv(J.T @ J)[2, 2]))
