"""Poses that a robot may take: the target in view however wrong the guess is, within reach, away from what is not."""

from collections import Counter
from dataclasses import astuple, dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import carry, inverse, rotations
from profilecal.plan.setup import Setup
from profilecal.scan.scan import ScanError
from profilecal.simulate.scene import in_unit_ball

BORDER = 0.05  # of the field of view, on each side: features need what is around them
LEAST_MARGIN = 1.0  # mm and degrees: a view that a smaller error spoils is none
SPARE = 1.05  # of a margin
STEP = 1e-3  # mm and rad, of derivatives
AT_LIMIT = 0.5  # of the candidates of a plan: as far tilted, turned and aside as they may be, where plans end up
NEAR_MM, NEAR_DEG, NEAR = 10.0, 6.0, (0.2, 1.0)  # neighbours, and those nearer still
TOLERANCE = 1e-6  # mm and degrees
TRIES = 40  # draws of candidates before giving up


@dataclass(frozen=True)
class Limits:
    """Where the robot may go: of the flange's positions in the base frame, mm."""

    low: tuple[float, ...] = (-np.inf,) * 3
    high: tuple[float, ...] = (np.inf,) * 3
    tilt_deg: float = 30.0  # of the direction of view against looking at the target squarely
    spin_deg: float = 45.0  # about the direction of view
    extent_mm: float = 50.0  # how far from the guess an edge, a rod or a face is seen, to either side
    avoid: tuple[tuple[float, ...], ...] = ()  # x, y, z, radius: where neither flange nor sensor may be


def draw(setup: Setup, limits: Limits, count: int, rng: np.random.Generator, at_limit: float = 0.0):
    """Flange poses (count, 3, 3), (count, 3) from anywhere within the limits; a share `at_limit` is as far out as it
    may be. Raises ScanError, with the reason, where there are too few."""
    found, why = [], Counter()
    for _ in range(TRIES):
        R, T = inverse_mount(setup, *random_views(setup, limits, 2 * count, rng, at_limit))
        reasons = refused(setup, limits, R, T)
        why.update(reasons)
        good = reasons == ""
        found.append((R[good], T[good]))
        if sum(len(T) for _, T in found) >= count:
            break
    R, T = (np.concatenate(part)[:count] for part in zip(*found, strict=True))
    if len(T) < count:
        total = sum(why.values())
        said = "; ".join(f"{n / total:.0%} {reason}" for reason, n in why.most_common() if reason)
        raise ScanError(
            f"only {len(T)} of {total} poses within the limits are possible: {said}. "
            "Widen the box, move target or mount, or state smaller margins"
        )
    return R, T


def random_views(setup: Setup, limits: Limits, count: int, rng: np.random.Generator, at_limit: float = 0.0):
    """Sensor frames (count, 3, 3), (count, 3) that look at the target, before anything forbids them."""
    outermost = rng.uniform(size=(count, 1)) < at_limit

    def share(*shape):  # of a limit, either way
        inside, end = rng.uniform(-1, 1, (count, *shape)), rng.choice([-1.0, 1.0], (count, *shape))
        return np.where(outermost & (rng.uniform(size=(count, *shape)) < 0.7), end, inside)

    about, far = rng.uniform(0, 2 * np.pi, (count, 1)), np.sqrt(np.abs(share(1)))
    tilt = np.radians(limits.tilt_deg) * far * np.hstack([np.cos(about), np.sin(about), 0 * about])
    spin = np.radians(limits.spin_deg) * share(1) * np.array([0.0, 0.0, 1.0])
    R = setup.facing @ rotations(tilt) @ rotations(spin)

    origin, axes = setup.target.frame
    free = np.array([axis not in setup.target.shifts for axis in "xyz"])
    aim = origin + limits.extent_mm * (free * share(3)) @ axes.T
    if setup.sizes:
        aim = aim + 0.9 * setup.sizes[0] * in_unit_ball(rng, count)
    scanner = setup.scanner
    z = (scanner.near + scanner.far) / 2 + (scanner.far - scanner.near) / 2 * share(1)
    x = scanner.half_width(z) * share(1)
    return R, aim - (R @ np.hstack([x, 0 * x, z])[..., None])[..., 0]


def inverse_mount(setup: Setup, R_view, T_view):
    """Flange poses that bring the sensor to frames (P, 3, 3), (P, 3)."""
    R = R_view @ setup.R_sensor.T
    return R, T_view - R @ setup.T_sensor


def refused(setup: Setup, limits: Limits, R, T) -> np.ndarray:
    """Why flange poses (P, 3, 3), (P, 3) are not possible, in words, (P,); "" for those that are."""
    flange, sensor = T, setup.planes(R, T)[1]
    if setup.to_hand:
        flange, sensor = inverse(R, T)[1], np.broadcast_to(setup.T_sensor, T.shape)
    reasons = np.full(len(T), "", dtype=object)
    tilt, spin = turned(setup, R)
    if setup.shows_beside:
        tilt = np.maximum(tilt, ray_tilt(setup, R, T))
    too_far = (tilt > limits.tilt_deg + TOLERANCE) | (np.abs(spin) > limits.spin_deg + TOLERANCE)
    reasons[too_far | (aside(setup, R, T) > limits.extent_mm + TOLERANCE)] = "are tilted, turned or aside too far"
    for *centre, radius in limits.avoid:
        near = np.minimum(*(np.linalg.norm(place - centre, axis=1) for place in (flange, sensor))) < radius
        reasons[near] = "are in a zone to avoid"
    reasons[((flange < limits.low) | (flange > limits.high)).any(axis=1)] = "are outside the box"
    left = np.flatnonzero(reasons == "")  # this takes the longest
    lost = left[worst_clearance(setup, R[left], T[left]) < 0]
    reasons[lost] = "may lose the target from view if the guess is as wrong as stated"
    return reasons


def turned(setup: Setup, R) -> tuple[np.ndarray, np.ndarray]:
    """By how much the sensor's direction of view is tilted off square, and how far it is turned about that direction,
    (P,) degrees each, at flange orientations (P, 3, 3)."""
    x, y, z, w = Rotation.from_matrix(setup.facing.T @ R @ setup.R_sensor).as_quat(canonical=True).T
    return np.degrees(2 * np.arctan2(np.hypot(x, y), np.hypot(z, w))), np.degrees(2 * np.arctan2(z, w))


def ray_tilt(setup: Setup, R, T) -> np.ndarray:
    """How far off square the ray is that hits the middle of what is seen, (P,) degrees: a side of a corner turned away
    by more is hidden."""
    points = setup.seen(setup.target, setup.planes(R, T), 5)
    rays = points[:, points.shape[1] // 2]
    length = np.linalg.norm(rays, axis=-1)
    along = (setup.facing[:, 2] @ R @ setup.R_sensor)[:, [0, 2]]
    return np.degrees(np.arccos(np.clip((rays * along).sum(axis=-1) / length, -1, 1)))


def aside(setup: Setup, R, T) -> np.ndarray:
    """How far the middle of what is seen from flange poses lies from the guess along an edge, a rod or a face, (P,)."""
    points = setup.seen(setup.target, setup.planes(R, T), 5)
    x, z = np.moveaxis(points[:, [points.shape[1] // 2]], -1, 0)
    R_view, T_view = setup.planes(R, T)
    origin, axes = setup.target.frame
    off = (x * R_view[..., 0] + z * R_view[..., 2] + T_view - origin) @ axes
    free = [axis not in setup.target.shifts for axis in "xyz"]
    return np.nan_to_num(np.abs(off[:, free]).max(axis=1, initial=0.0), nan=np.inf)


def neighbours(setup: Setup, limits: Limits, R, T, each: int, rng: np.random.Generator):
    """Possible flange poses near some (P, 3, 3), (P, 3)."""
    R, T = np.repeat(R, each, axis=0), np.repeat(T, each, axis=0)
    size = rng.choice(NEAR, (len(T), 1))
    R_view, T_view = setup.planes(R, T)
    turn = np.radians(NEAR_DEG) * size * rng.normal(size=T.shape)
    R, T = inverse_mount(setup, R_view @ rotations(turn), T_view + NEAR_MM * size * rng.normal(size=T.shape))
    good = refused(setup, limits, R, T) == ""
    return R[good], T[good]


def worst_clearance(setup: Setup, R, T) -> np.ndarray:
    """How far inside the field of view the target stays at flange poses (P, 3, 3), (P, 3), in the worst case of a guess
    that is wrong by up to its margins: (P,) mm; -inf where it may be missed. Below zero it may be still less.

    The worst case for each border of the view is the one that its derivatives say; it is looked at to first order and
    as it is. What moves the scan plane off the target altogether is looked at besides.
    """
    frames, sizes = setup.planes(R, T), margins(setup)
    here = clearances(setup, *frames)
    worst = here.min(axis=1)
    left = np.flatnonzero(worst >= 0)  # false for NaN
    frames, here = [part[left] for part in frames], here[left]
    with np.errstate(invalid="ignore"):
        by_error = [(clearances(setup, *wrong(setup, *frames, STEP * row)) - here) / STEP for row in np.eye(9)]
        by_error = np.stack(by_error, axis=-1).reshape(*here.shape, 3, 3)
        length = np.linalg.norm(by_error, axis=-1, keepdims=True)
        steps = -sizes[:, None] * by_error / np.maximum(length, 1e-12)
        worst[left] = (here - length[..., 0] @ sizes).min(axis=1)
        good = worst[left] >= 0
        left, frames, steps = left[good], [part[good] for part in frames], steps[good]
        cases = [clearances(setup, *wrong(setup, *frames, steps[:, k].reshape(-1, 9))) for k in range(here.shape[1])]
        for way in (1.0, -1.0):  # along the sensor's y
            for turn in (1.0, -1.0):
                off = way * sizes[:, None] * [[0, -1, 0], [1, 0, 0], [turn, 0, 0]]
                cases.append(clearances(setup, *wrong(setup, *frames, off.ravel())))
    worst[left] = np.minimum(worst[left], np.concatenate(cases, axis=1).min(axis=1))  # NaN stays
    return np.nan_to_num(worst, nan=-np.inf)


def margins(setup: Setup) -> np.ndarray:
    """By how much a sensor frame may be wrong, with something to spare: in place, in orientation, and in the target's
    orientation, (3,) mm and rad."""
    mount_mm, mount_deg, target_mm, target_deg = astuple(setup.margins)
    angles = np.radians(np.maximum([mount_deg, target_deg], LEAST_MARGIN)) * [1, bool(setup.target.turns)]
    return SPARE * np.r_[max(mount_mm + target_mm, LEAST_MARGIN), angles]


def wrong(setup: Setup, R_view, T_view, by):
    """Sensor frames (P, 3, 3), (P, 3) shifted and turned by (P, 9) or (9,) in their own axes, mm and rad: the first six
    about their own origin; by the last three as they are seen by a target that turns about its."""
    shift, turn, target_turn = np.split(np.atleast_2d(by), 3, axis=1)
    about, back = setup.target.frame[0], R_view @ rotations(-target_turn)
    from_target = (np.swapaxes(R_view, 1, 2) @ (T_view - about)[..., None])[..., 0] + shift
    return back @ rotations(turn), carry(back, about, from_target)


def clearances(setup: Setup, R_view, T_view) -> np.ndarray:
    """How far inside each border of the field of view the target is seen from sensor frames, (P, k) mm, NaN where it is
    not."""
    scanner, (x, z) = setup.scanner, np.moveaxis(setup.seen(setup.target, (R_view, T_view), 5), -1, 0)
    beside = setup.target.beside_mm if setup.shows_beside else 0.0
    border = BORDER * (scanner.far - scanner.near) + beside
    side = (1 - BORDER) * scanner.half_width(z) - beside
    inside = np.stack([z - scanner.near - border, scanner.far - border - z, side - x, side + x], axis=1)
    return np.where(np.isfinite(inside), inside, np.nan).reshape(len(T_view), 4 * x.shape[1])
