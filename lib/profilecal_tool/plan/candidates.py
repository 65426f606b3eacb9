"""Poses that a robot may take: the target in view however wrong the guess is, within
reach, away from what is not.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import carry, inverse, rotations
from profilecal.scan.scan import ScanError
from profilecal.simulation.scene import in_unit_ball
from profilecal_tool.plan.scan_model import ScanModel

# of the limits are drawn and cut off: a third of the candidates is at a limit, where
# good plans are
BEYOND = 0.5


@dataclass(frozen=True)
class Limits:
    """Where the robot may go: of the flange's positions in the base frame, mm."""

    low: tuple[float, ...] = (-np.inf,) * 3
    high: tuple[float, ...] = (np.inf,) * 3
    # of the direction of view against looking at the target squarely
    tilt_deg: float = 30.0
    spin_deg: float = 45.0  # about the direction of view
    # how far from the guess an edge, a rod or a face is seen, to either side
    extent_mm: float = 50.0
    # x, y, z, radius: where neither flange nor sensor may be
    avoid: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self):
        for axis, low, high in zip("xyz", self.low, self.high, strict=True):
            if low >= high:
                raise ScanError(
                    f"the box is empty along {axis}: low is {low:g} and high is {high:g} mm"
                )


def draw(
    model: ScanModel,
    limits: Limits,
    count: int,
    rng: np.random.Generator,
    beyond: float = 0.0,
):
    """Flange poses (count, 3, 3), (count, 3) from anywhere within the limits; with
    `beyond`, more of them at the limits. Raises ScanError, with the reason, where there
    are too few.
    """
    found, why = [], Counter()
    for _ in range(40):  # then too few are possible
        R, T = random_poses(model, limits, 2 * count, rng, beyond)
        reasons = refused(model, limits, R, T)
        why.update(reasons)
        found.append((R[reasons == ""], T[reasons == ""]))
        if why[""] >= count:
            break
    R, T = (np.concatenate(part)[:count] for part in zip(*found, strict=True))
    if len(T) < count:
        total = why.total()
        said = "; ".join(
            f"{n / total:.0%} {reason}" for reason, n in why.most_common() if reason
        )
        raise ScanError(
            f"only {len(T)} of {total} poses within the limits are possible: {said}. "
            "Widen the box, move target or mount, or state smaller margins"
        )
    return R, T


def random_poses(
    model: ScanModel,
    limits: Limits,
    count: int,
    rng: np.random.Generator,
    beyond: float,
):
    """Flange poses (count, 3, 3), (count, 3) that look at the target, before anything
    forbids them.
    """

    def share(*shape):  # of a limit, either way
        return np.clip((1 + beyond) * rng.uniform(-1, 1, (count, *shape)), -1, 1)

    tilt = share(2)
    tilt = (
        np.radians(limits.tilt_deg)
        * tilt
        / np.maximum(np.linalg.norm(tilt, axis=1, keepdims=True), 1)
    )
    R = model.facing @ rotations(np.pad(tilt, [(0, 0), (0, 1)]))
    R = R @ rotations(np.radians(limits.spin_deg) * np.pad(share(1), [(0, 0), (2, 0)]))
    origin, axes = model.target.frame
    aim = origin + limits.extent_mm * (free_axes(model) * share(3)) @ axes.T
    if model.sizes:
        aim = aim + 0.9 * model.sizes[0] * in_unit_ball(rng, count)
    scanner = model.scanner
    z = (scanner.near + scanner.far) / 2 + (scanner.far - scanner.near) / 2 * share(1)
    x = scanner.half_width(z) * share(1)
    return flange_at(model, R, carry(R, aim, -np.hstack([x, 0 * x, z])))


def neighbours(
    model: ScanModel, limits: Limits, R, T, each: int, rng: np.random.Generator
):
    """Possible flange poses near some (P, 3, 3), (P, 3): about 10 mm and 6° away, or a
    fifth of that.
    """
    R, T = np.repeat(R, each, axis=0), np.repeat(T, each, axis=0)
    far = rng.choice([0.2, 1.0], (len(T), 1))
    shift, turn = (
        10.0 * far * rng.normal(size=T.shape),
        np.radians(6.0) * far * rng.normal(size=T.shape),
    )
    R_view, T_view = model.planes(R, T)
    R, T = flange_at(model, R_view @ rotations(turn), T_view + shift)
    good = refused(model, limits, R, T) == ""
    return R[good], T[good]


def flange_at(model: ScanModel, R_view, T_view):
    """Flange poses that bring the sensor to frames (P, 3, 3), (P, 3)."""
    R = R_view @ model.R_sensor.T
    return R, T_view - R @ model.T_sensor


def free_axes(model: ScanModel) -> np.ndarray:
    """Along which axes of its frame (3,) a shift does not change the target."""
    return np.array([axis not in model.target.shifts for axis in "xyz"])


def refused(model: ScanModel, limits: Limits, R, T) -> np.ndarray:
    """Why flange poses (P, 3, 3), (P, 3) are not possible, in words, (P,); "" for those
    that are.
    """
    flange, sensor = T, model.planes(R, T)[1]
    if model.to_hand:
        flange, sensor = inverse(R, T)[1], model.T_sensor
    reasons = np.full(len(T), "", dtype=object)
    tilt, spin, aside = off_square(model, R, T)
    far = (
        (tilt > limits.tilt_deg)
        | (np.abs(spin) > limits.spin_deg)
        | (aside > limits.extent_mm)
    )
    reasons[far] = "are tilted, turned or aside too far"
    for *centre, radius in limits.avoid:
        near = (
            np.minimum(
                *(np.linalg.norm(place - centre, axis=-1) for place in (flange, sensor))
            )
            < radius
        )
        reasons[near] = "are in a zone to avoid"
    reasons[((flange < limits.low) | (flange > limits.high)).any(axis=1)] = (
        "are outside the box"
    )
    left = np.flatnonzero(reasons == "")  # this takes the longest
    lost = left[worst_clearance(model, R[left], T[left]) < 0]
    reasons[lost] = "may lose the target from view if the guess is as wrong as stated"
    return reasons


def off_square(model: ScanModel, R, T) -> np.ndarray:
    """How far flange poses (P, 3, 3), (P, 3) are from looking at the guess squarely,
    (3, P): the tilt of the direction of view, or of the ray that hits the middle of
    what is seen where a side that is turned away is hidden; the turn about that
    direction, both in degrees; how far that middle lies along an edge, a rod or a face,
    mm, inf where it is missed. Rounded, so that what is at a limit is within it.
    """
    R_view, T_view = model.planes(R, T)
    x, y, z, w = Rotation.from_matrix(model.facing.T @ R_view).as_quat(canonical=True).T
    tilt, spin = 2 * np.arctan2(np.hypot(x, y), np.hypot(z, w)), 2 * np.arctan2(z, w)
    points = model.seen(R_view, T_view, 5)
    ray = (R_view[..., ::2] @ points[:, points.shape[1] // 2, :, None])[..., 0]
    if model.shows_beside:
        square = ray @ model.facing[:, 2] / np.linalg.norm(ray, axis=1)
        tilt = np.maximum(tilt, np.arccos(np.clip(square, -1, 1)))
    origin, axes = model.target.frame
    aside = np.abs((T_view + ray - origin) @ axes)[:, free_axes(model)].max(
        axis=1, initial=0.0
    )
    return np.array(
        [np.degrees(tilt), np.degrees(spin), np.nan_to_num(aside, nan=np.inf)]
    ).round(6)


def worst_clearance(model: ScanModel, R, T) -> np.ndarray:
    """How far inside the field of view the target stays at flange poses (P, 3, 3), (P,
    3), in the worst case of a guess that is wrong by up to its margins, or by 1 mm and
    1° (a view that these spoil is none): (P,) mm; -inf where it may be missed.

    Each of the nine errors, shifts and turns of the sensor and turns of the target, is
    tried at its full size, either way. The worst case is their sum where each kind of
    error points in the worst direction. What moves the scan plane off the target
    altogether is tried besides.
    """
    mount_mm, mount_rad, target_mm, target_rad = (
        model.guess.margins if model.guess else np.zeros(4)
    )
    sizes = np.maximum(
        [mount_mm + target_mm, mount_rad, target_rad], [1, np.radians(1), np.radians(1)]
    )
    frames = model.planes(R, T)
    here = clearances(model, *frames, np.zeros((3, 3)))
    lost = np.zeros((3, 3, *here.shape))
    for kind, axis in np.ndindex(3, 3):
        error = sizes[kind] * np.outer(np.eye(3)[kind], np.eye(3)[axis])
        for way in (error, -error):
            lost[kind, axis] = np.maximum(
                lost[kind, axis], here - clearances(model, *frames, way)
            )
    worst = (here - np.linalg.norm(lost, axis=1).sum(axis=0)).min(axis=1)
    for way, turn in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        off_plane = way * sizes[:, None] * [[0, -1, 0], [1, 0, 0], [turn, 0, 0]]
        # NaN where it is missed
        worst += 0 * clearances(model, *frames, off_plane).min(axis=1)
    return np.nan_to_num(worst, nan=-np.inf)


def clearances(model: ScanModel, R_view, T_view, error) -> np.ndarray:
    """How far inside each border of the field of view the target is seen from sensor
    frames (P, 3, 3), (P, 3) after an error (3, 3): a shift and a turn in their own
    axes, mm and rad, and a turn of the target about its origin, in these axes too; (P,
    k) mm, NaN where it is not seen.
    """
    shift, turn, target_turn = error
    origin, back = model.target.frame[0], R_view @ rotations(-target_turn)
    in_view = carry(*inverse(R_view, T_view), origin)
    points = model.seen(back @ rotations(turn), carry(back, origin, shift - in_view), 5)
    scanner, (x, z) = model.scanner, np.moveaxis(points, -1, 0)
    beside = model.target.beside_mm if model.shows_beside else 0.0
    # of the field of view, on each side: features need what is around them
    share = 0.05
    border = share * (scanner.far - scanner.near) + beside
    side = (1 - share) * scanner.half_width(z) - beside
    return np.concatenate(
        [z - scanner.near - border, scanner.far - border - z, side - x, side + x],
        axis=1,
    )
