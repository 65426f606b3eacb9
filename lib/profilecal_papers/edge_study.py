"""The edge paper's experiments: where its robot goes (Sections 3 and 4.2), random
scenes of an edge, what the scanner sees of them, and the paper's own measures of error,
Δα and Δd (Section 4.1, Fig. 5).
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from numpy.typing import ArrayLike

from profilecal.closed_form.edge import EdgeSolution
from profilecal.geometry.fitting import middle_of
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import (
    Frames,
    carry,
    directions,
    frame_around,
    rotations,
)
from profilecal.simulation.robot import actual_poses
from profilecal.targets.ball import Ball
from profilecal.targets.edge import Edge
from profilecal.targets.observations import Observations
from profilecal.targets.target import ALONG_Y

# mm, the middle of the 60 to 90 mm for which the paper's scanner does best
STANDOFF = 75.0


class Poses(NamedTuple):
    """G rotation groups of N positions: what the robot reports, base frame, mm."""

    rotations: ndarray  # (..., G, 3, 3) of the flange
    positions: ndarray  # (..., G, N, 3) of the flange

    def first(self, groups: int) -> "Poses":
        """The first groups only, in the order they were collected."""
        return Poses(*(part[..., :groups, :, :] for part in self))

    def carry(self, points: ndarray, R_sensor: ndarray, T_sensor: ndarray) -> ndarray:
        """Sensed points in the base frame, by the poses reported and the sensor's pose.

        `points` (..., G, N, M, 2) are x and z, mm; R_sensor (..., 3, 3) and T_sensor
        (..., 3), mm, the sensor's pose on the flange. Returns (..., G, N, M, 3), mm.
        """
        R = self.rotations[..., None, :, :]
        turned, T = scan_planes(R_sensor, T_sensor, R, self.positions)
        return points @ turned[..., ::2].mT + T[..., None, :]


def scan_planes(
    R_sensor: ndarray,
    T_sensor: ndarray,
    rotations: ndarray,
    positions: ndarray,
) -> Frames:
    """Scan planes in the base frame: orientations (..., G, N, 3, 3) and origins (...,
    G, N, 3), mm.

    `rotations` and `positions` are the flange's, of the same shapes; R_sensor (..., 3,
    3) and T_sensor (..., 3), mm, the sensor's pose on it.
    """
    orientations = rotations @ R_sensor[..., None, None, :, :]
    return orientations, carry(rotations, positions, T_sensor[..., None, None, :])


def random_turns(
    rng: np.random.Generator,
    shape: tuple[int, ...],
    spread: float | ndarray,
    axis: ndarray | None = None,
) -> ndarray:
    """Rotations (*shape, 3, 3) by uniform angles up to ±`spread`, rad, about random
    axes or about `axis` (..., 3).
    """
    angle = rng.uniform(-spread, spread, (*shape, 1))
    if axis is None:
        axis = directions(rng, shape)
    return rotations(angle * axis)


def frame_along(direction: ndarray, angle: ArrayLike) -> ndarray:
    """Frames (..., 3, 3), in columns, whose second axis is `direction` (..., 3);
    `angle` (...) turns them about it.
    """
    turn = rotations(np.asarray(angle)[..., None] * direction)
    return turn @ frame_around(direction) @ ALONG_Y.T


def arc(
    count: int, radius: float | ndarray, span: ArrayLike, middle: ndarray
) -> ndarray:
    """Positions (..., count, 3), mm, on circular arcs in the plane z = 0, from their
    middles. Of each arc: the radius, mm, the angle that it spans and the angle at which
    its middle lies, rad, all (...).
    """
    way = np.asarray(span)[..., None] * np.linspace(-0.5, 0.5, count)
    # as complex numbers
    place = (radius * np.exp(1j * middle))[..., None] * (np.exp(1j * way) - 1)
    return np.stack([place.real, place.imag, np.zeros(place.shape)], axis=-1)


def above(
    point: ndarray,
    flange: ndarray,
    R_sensor: ndarray,
    T_sensor: ndarray,
    standoff: float = STANDOFF,
) -> ndarray:
    """Positions (..., G, 3) of the flange, at orientations (..., G, 3, 3), that put
    `point` (..., 3) into the middle of the scan, at depth `standoff`.
    """
    seen = R_sensor @ np.array([0.0, 0.0, standoff]) + T_sensor
    return point[..., None, :] - (flange @ seen[..., None, :, None])[..., 0]


WORDS = {"motion": ("arc", "line", "space"), "frame": ("base", "group", "tool")}


@dataclass(frozen=True)
class EdgePlan:
    """How to move over an edge: `groups` orientations, each held for `positions`
    positions. Spread, radius, span and tilt of arcs may be arrays (S, 1), one number
    for each of S scenes.
    """

    groups: int = 25
    positions: int = 10
    spread_deg: float | ndarray = 30.0  # the flange turns by up to this, either way
    one_axis: bool = False  # all turns about one axis
    motion: str = "arc"  # or "line", or "space": anywhere in a ball of the arc's radius
    # one arc for all groups; "group": each its own; "tool": it turns with the flange
    frame: str = "base"
    radius: float | ndarray = 25.0  # mm
    span_deg: float | ndarray = 90.0
    tilt_deg: float | ndarray = 45.0  # between the arc's plane and the edge

    def __post_init__(self) -> None:
        for name, known in WORDS.items():
            if (word := getattr(self, name)) not in known:
                names = ", ".join(known)
                raise ValueError(f"{name} is {word!r}; expected one of {names}")

    def offsets(self, direction: ndarray, rng: Generator) -> ndarray:
        """Translations within each group, (..., G or 1, N, 3), over edges along
        `direction` (..., 3), mm.
        """
        groups = self.groups if self.frame == "group" else 1
        shape = (*direction.shape[:-1], groups)
        if self.motion == "space":
            share = rng.uniform(size=(*shape, self.positions, 1))
            length = self.radius * np.cbrt(share)
            return length * directions(rng, (*shape, self.positions))
        azimuth, middle = rng.uniform(0, 2 * np.pi, (2, *shape))
        # the plane's x and y axes: x is nearest to the edge, y square to it
        tilt = np.radians(self.tilt_deg)[..., None] * np.eye(3)[2]
        along = frame_along(direction[..., None, :], azimuth)
        plane = (along @ rotations(tilt))[..., [1, 2, 0]]
        if self.motion == "line":
            way = self.radius * np.linspace(-1, 1, self.positions)[:, None]
            return way * plane[..., None, :, 0]
        span = np.radians(self.span_deg)
        return arc(self.positions, self.radius, span, middle) @ plane.mT


def plan_edge(
    plan: EdgePlan,
    edge: Edge,
    R_sensor: ndarray,
    T_sensor: ndarray,
    rng: Generator,
) -> Poses:
    """Poses that carry the scanner at R_sensor (..., 3, 3), T_sensor (..., 3), mm, over
    the edge: the operator makes the scan plane cross the edge at up to 20° from square,
    turns the flange from group to group, and has the edge in the middle of the scan
    where a group has its middle.
    """
    shape = edge.point.shape[:-1]
    square = frame_along(edge.direction, rng.uniform(0, 2 * np.pi, shape))
    start = random_turns(rng, shape, np.radians(20)) @ square @ R_sensor.mT
    axis = directions(rng, shape)[..., None, :] if plan.one_axis else None
    spread = np.radians(plan.spread_deg)[..., None]
    turned = random_turns(rng, (*shape, plan.groups), spread, axis)
    offsets = plan.offsets(edge.direction, rng)
    if plan.frame == "tool":
        offsets = offsets @ turned.mT
    flange = turned @ start[..., None, :, :]
    middle = above(edge.point, flange, R_sensor, T_sensor)
    return Poses(flange, middle[..., None, :] + offsets)


def plan_ball(
    centre: ndarray,
    radius: float,
    R_sensor: ndarray,
    T_sensor: ndarray,
    rng: Generator,
) -> Poses:
    """Poses that draw six parallel profiles over a ball at `centre` (..., 3), mm, in
    each of ten orientations (edge paper, Section 4.2). The profiles spread over 1.2
    radii, along the sensor's y.
    """
    shape = centre.shape[:-1]
    start = random_turns(rng, shape, np.pi) @ R_sensor.mT
    turned = random_turns(rng, (*shape, 10), np.radians(30))
    flange = turned @ start[..., None, :, :]
    y = (flange @ R_sensor[..., None, :, :])[..., 1]
    steps = np.linspace(-0.6, 0.6, 6)[:, None] * radius * y[..., None, :]
    middle = above(centre, flange, R_sensor, T_sensor, STANDOFF + radius)
    return Poses(flange, middle[..., None, :] + steps)


def sense_edge(
    edge: Edge,
    R_sensor: ndarray,
    T_sensor: ndarray,
    poses: Poses,
    noise: Noise,
    rng: Generator,
) -> ndarray:
    """Edge points (..., G, N, 2), x and z in the sensor frame, mm, that a scanner on
    the flange reports. Sensor poses (..., 3, 3), (..., 3), the edge and the poses may
    share leading axes, one entry a scene.
    """
    planes = scan_planes(R_sensor, T_sensor, *actual_poses(*poses, noise, rng))
    point = edge.point[..., None, None, :]
    direction = edge.direction[..., None, None, :]
    seen = Edge(point, direction).meet(*planes)
    return seen + noise.profile_mm * rng.normal(size=seen.shape)


@dataclass(frozen=True)
class EdgeScene:
    """An edge, a scanner on a flange, the poses that the robot reports and what the
    scanner sees.
    """

    edge: Edge
    R_sensor: ndarray  # (..., 3, 3)
    T_sensor: ndarray  # (..., 3) mm
    poses: Poses
    points: ndarray  # (..., G, N, 2) mm


def edge_scenes(
    plan: EdgePlan,
    noise: Noise,
    rng: Generator,
    shape: tuple[int, ...] = (),
    alike: int = 1,
) -> EdgeScene:
    """Random scenes, `shape` of them: any edge 1 m in front of the robot, any mount
    within 150 mm of the flange. Entries of `noise` may be arrays (S, 1, 1, 1), one for
    each of S scenes. So many of S in a row are `alike`: only the errors are their own.
    """
    point = np.array([1000.0, 0.0, 300.0]) + rng.uniform(-100, 100, (*shape, 3))
    edge = Edge(point, directions(rng, shape))
    R_sensor = random_turns(rng, shape, np.pi)
    T_sensor = rng.uniform(50, 150, (*shape, 1)) * directions(rng, shape)
    poses = plan_edge(plan, edge, R_sensor, T_sensor, rng)
    if alike > 1:
        first = np.arange(*shape) // alike * alike
        edge = Edge(point[first], edge.direction[first])
        R_sensor, T_sensor = R_sensor[first], T_sensor[first]
        poses = Poses(*(part[first] for part in poses))
    points = sense_edge(edge, R_sensor, T_sensor, poses, noise, rng)
    return EdgeScene(edge, R_sensor, T_sensor, poses, points)


def ball_points(
    ball: Ball,
    R_sensor: ndarray,
    T_sensor: ndarray,
    poses: Poses,
    noise: Noise,
    rng: Generator,
    count: int = 40,
) -> ndarray:
    """Points (..., G, N, count, 2) on a ball, x and z in the sensor frame, mm, that a
    scanner on the flange reports: in each profile up to 60° to either side of the point
    nearest to it.
    """
    planes = scan_planes(R_sensor, T_sensor, *actual_poses(*poses, noise, rng))
    seen = Ball(ball.centre[..., None, None, :], ball.radius).arc(*planes, 60, count)
    return seen + noise.profile_mm * rng.normal(size=seen.shape)


def observations_of(scene: EdgeScene) -> Observations:
    """Simulated edge scenes, with or without a batch axis, as observations."""
    G, N = scene.points.shape[-3:-1]
    R = np.repeat(scene.poses.rotations, N, axis=-3).reshape(-1, G * N, 3, 3)
    T = scene.poses.positions.reshape(-1, G * N, 3)
    points = scene.points.reshape(-1, G * N, 1, 2)
    return Observations("edge", R, T, points, group=np.repeat(np.arange(G), N))


def principal(vectors: ndarray, about_mean: bool = True) -> ndarray:
    """Unit vectors (..., 3) along which vectors (..., n, 3) extend most."""
    if about_mean:
        vectors = vectors - middle_of(vectors)
    return np.linalg.eigh(vectors.mT @ vectors)[1][..., -1]


def angle_deviations(solution: EdgeSolution, about_mean: bool = True) -> ndarray:
    """Δα (..., G), rad: between the edge's direction u_b and the principal direction of
    each group of p_b, of vectors about their mean (PCA) or as they are.
    """
    groups = principal(solution.p_b - solution.p_b[..., :1, :], about_mean)
    return angles_from(solution.u_b, groups)


def angles_from(u_b: ndarray, groups: ndarray) -> ndarray:
    """Angles (..., G), rad, of directions (..., G, 3) from u_b (..., 3), seen along one
    fixed axis perpendicular to u_b: left and right differ.
    """
    aside = np.cross(u_b, np.eye(3)[np.argmin(np.abs(u_b), axis=-1)])
    aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
    along = np.vecdot(groups, u_b[..., None, :])
    across = np.vecdot(groups, aside[..., None, :])
    return np.arctan(across / along)


def line_distances(solution: Any) -> ndarray:
    """Δd (..., G N), mm: of all points `p_b` of a solution from the line along its
    `u_b` through their mean.
    """
    points = solution.p_b.reshape(*solution.p_b.shape[:-3], -1, 3)
    offset = points - middle_of(points)
    along = offset @ solution.u_b[..., None]
    return np.linalg.norm(offset - along * solution.u_b[..., None, :], axis=-1)
