"""Where the edge paper's robot goes: flange orientations times translations (Sections 3 and 4.2)."""

from dataclasses import dataclass

import numpy as np

from profilecal.geometry.poses import directions, frame_along, random_turns
from profilecal.simulate.poses import Poses
from profilecal.targets.edge import Edge

STANDOFF = 75.0  # mm, the middle of the 60 to 90 mm for which the paper's scanner does best


def arc(count: int, radius: float, span: float, middle=0.0) -> np.ndarray:
    """Positions (..., count, 3) on a circular arc in the plane z = 0, mm, relative to its middle.

    `middle` (...), rad, is where on the circle that lies.
    """
    radius, span, middle = (np.asarray(number)[..., None] for number in (radius, span, middle))
    angle = middle + span * np.linspace(-0.5, 0.5, count)
    x, y = np.cos(angle) - np.cos(middle), np.sin(angle) - np.sin(middle)
    return radius[..., None] * np.stack([x, y, np.zeros_like(x)], axis=-1)


def arc_planes(direction, tilt, azimuth) -> np.ndarray:
    """Frames (..., 3, 3), in columns, of planes (their x and y axes) that make the angle `tilt` with the edge.

    `direction` (..., 3) is the edge's; `azimuth` (...) turns the plane about it. x is the plane's direction nearest
    to the edge, y is perpendicular to the edge. With `tilt` zero the plane contains the edge.
    """
    frame, tilt = frame_along(direction, azimuth), np.asarray(tilt)[..., None]
    across, along = frame[..., 0], frame[..., 1]
    x = np.cos(tilt) * along - np.sin(tilt) * across
    normal = np.sin(tilt) * along + np.cos(tilt) * across
    return np.stack([x, np.cross(normal, x), normal], axis=-1)


def above(point, flange, R_sensor, T_sensor, standoff: float = STANDOFF) -> np.ndarray:
    """Flange positions (..., G, 3) with `point` (..., 3) in the middle of the scan, at depth `standoff`.

    The flange has the orientations `flange` (..., G, 3, 3).
    """
    seen = R_sensor @ np.array([0.0, 0.0, standoff]) + T_sensor
    return point[..., None, :] - (flange @ seen[..., None, :, None])[..., 0]


@dataclass(frozen=True)
class EdgePlan:
    """How to move over an edge: `groups` orientations, each held for `positions` positions.

    Spread, radius, span and tilt of arcs may be arrays (S, 1), one number for each of S scenes.
    """

    groups: int = 25
    positions: int = 10
    spread_deg: float = 30.0  # the flange turns by up to this, either way
    one_axis: bool = False  # all turns about one axis
    motion: str = "arc"  # or "line", or "space": anywhere in a ball of the arc's radius
    frame: str = "base"  # one arc for all groups; "group": each its own; "tool": it turns with the flange
    radius: float = 25.0  # mm
    span_deg: float = 90.0
    tilt_deg: float = 45.0  # between the arc's plane and the edge

    def __post_init__(self):
        for name, known in (("motion", ("arc", "line", "space")), ("frame", ("base", "group", "tool"))):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected one of {', '.join(known)}")

    def offsets(self, direction, rng: np.random.Generator) -> np.ndarray:
        """Translations within each group, (..., G or 1, N, 3), over edges along `direction` (..., 3), mm."""
        shape = (*direction.shape[:-1], self.groups if self.frame == "group" else 1)
        if self.motion == "space":
            length = self.radius * np.cbrt(rng.uniform(size=(*shape, self.positions, 1)))
            return length * directions(rng, (*shape, self.positions))
        azimuth, middle = rng.uniform(0, 2 * np.pi, (2, *shape))
        plane = arc_planes(direction[..., None, :], np.radians(self.tilt_deg), azimuth)
        if self.motion == "line":
            return self.radius * np.linspace(-1, 1, self.positions)[:, None] * plane[..., None, :, 0]
        return arc(self.positions, self.radius, np.radians(self.span_deg), middle) @ np.swapaxes(plane, -1, -2)


def plan_edge(plan: EdgePlan, edge: Edge, R_sensor, T_sensor, rng: np.random.Generator) -> Poses:
    """Poses that carry the scanner at R_sensor (..., 3, 3), T_sensor (..., 3), mm, over the edge.

    The operator first turns the scanner so that its scan plane crosses the edge at up to 20° from square, then turns
    the flange from group to group, and starts each group with the edge in the middle of the scan.
    """
    shape = edge.point.shape[:-1]
    square = frame_along(edge.direction, rng.uniform(0, 2 * np.pi, shape))
    start = random_turns(rng, shape, np.radians(20)) @ square @ np.swapaxes(R_sensor, -1, -2)
    axis = directions(rng, shape)[..., None, :] if plan.one_axis else None
    turned = random_turns(rng, (*shape, plan.groups), np.radians(plan.spread_deg)[..., None], axis)
    offsets = plan.offsets(edge.direction, rng)
    if plan.frame == "tool":
        offsets = offsets @ np.swapaxes(turned, -1, -2)
    flange = turned @ start[..., None, :, :]
    return Poses(flange, above(edge.point, flange, R_sensor, T_sensor)[..., None, :] + offsets)


def plan_ball(centre, radius: float, R_sensor, T_sensor, rng, *, groups=10, positions=6, spread_deg=30.0) -> Poses:
    """Poses that draw `positions` parallel profiles over a ball in each of some orientations (edge paper, Section 4.2).

    `centre` (..., 3), mm. The profiles spread over 1.2 radii, along the sensor's y.
    """
    start = random_turns(rng, centre.shape[:-1], np.pi) @ np.swapaxes(R_sensor, -1, -2)
    flange = random_turns(rng, (*centre.shape[:-1], groups), np.radians(spread_deg)) @ start[..., None, :, :]
    y = (flange @ R_sensor[..., None, :, :])[..., 1]
    steps = np.linspace(-0.6, 0.6, positions)[:, None] * radius * y[..., None, :]
    return Poses(flange, above(centre, flange, R_sensor, T_sensor, STANDOFF + radius)[..., None, :] + steps)
