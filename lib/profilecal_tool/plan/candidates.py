"""Poses that a robot may take: the target stays in view however wrong the guess is.

They are within the limits, away from zones that flange and sensor must avoid.
"""

from collections import Counter
from itertools import product

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from profilecal.geometry.poses import Frames, carry, rotations, unit
from profilecal.scan.tables import ScanError
from profilecal.simulation.scene import in_unit_ball
from profilecal_tool.plan.scan_model import ScanModel, joined
from profilecal_tool.plan.specification import LEAST

# So much more than the limits is drawn and then cut off at the limits. A third of the
# candidates is then at a limit, where good plans are.
BEYOND = 0.5
BATCHES = 100


def draw(model: ScanModel, count: int, rng: Generator, beyond: float = 0.0) -> Frames:
    """Draw possible flange poses (count, 3, 3), (count, 3) from all within the limits.

    With `beyond`, more of them are at the limits. Where hardly any are possible, fewer
    than `count` may come. Raises ScanError, with the reasons, for too few.
    """
    found, reasons = [], Counter()
    while len(found) < BATCHES and reasons[""] < count:
        R, T = random_poses(model, 2 * count, rng, beyond)
        why = refused(model, R, T)
        reasons.update(why)
        found.append((R[why == ""], T[why == ""]))
    total, possible, least = reasons.total(), reasons.pop("", 0), min(count, LEAST)
    if possible < least:
        words = [f"{some / total:.0%} {why}" for why, some in reasons.most_common()]
        raise ScanError(
            f"only {possible} of {total} poses within the limits are possible, "
            f"{least} are needed: {'; '.join(words)}. "
            "Widen [plan], narrow the margins of [guess], or move target or mount"
        )
    R, T = joined(*found)
    return R[:count], T[:count]


def random_poses(model: ScanModel, count: int, rng: Generator, beyond: float) -> Frames:
    """Draw flange poses (count, 3, 3), (count, 3) that look at the target, turned and
    aside within the limits.

    Some of them may be impossible: see `refused`.
    """

    def share(size: int) -> ndarray:
        """Shares of a limit (count, size), either way."""
        drawn = (1 + beyond) * rng.uniform(-1, 1, (count, size))
        return np.clip(drawn, -1, 1)

    limits = model.limits
    tilt = share(2)
    tilt /= np.maximum(np.linalg.norm(tilt, axis=1, keepdims=True), 1)
    tilt = np.radians(limits.tilt_deg) * tilt @ np.eye(3)[:2]
    spin = np.radians(limits.spin_deg) * share(1) * [0, 0, 1]
    R = model.facing @ rotations(tilt) @ rotations(spin)

    origin, axes = model.target.frame
    aim = origin + limits.extent_mm * (free_axes(model) * share(3)) @ axes.T
    for radius in model.target.sizes:
        aim += 0.9 * radius * in_unit_ball(rng, count)

    near, far = model.scanner.near, model.scanner.far
    z = (near + far + (far - near) * share(1)) / 2
    x = model.scanner.half_width(z) * share(1)
    return model.flange(R, carry(R, aim, -np.hstack([x, 0 * x, z])))


def neighbours(
    model: ScanModel, R: ndarray, T: ndarray, each: int, rng: Generator
) -> Frames:
    """Draw flange poses near some (P, 3, 3), (P, 3), `each` for each of them, about
    10 mm and 6° away or a fifth of that; those that are possible.
    """
    R_view, T_view = model.planes(R.repeat(each, axis=0), T.repeat(each, axis=0))
    far = rng.choice([0.2, 1.0], (len(T_view), 1))
    shift = 10.0 * far * rng.normal(size=T_view.shape)
    turn = np.radians(6.0) * far * rng.normal(size=T_view.shape)
    R, T = model.flange(R_view @ rotations(turn), T_view + shift)
    possible = refused(model, R, T) == ""
    return R[possible], T[possible]


def free_axes(model: ScanModel) -> ndarray:
    """Along which axes of its frame (3,) a shift does not change the target."""
    return np.array([axis not in model.target.shifts for axis in "xyz"])


def refused(model: ScanModel, R: ndarray, T: ndarray) -> ndarray:
    """Say why flange poses (P, 3, 3), (P, 3) are impossible.

    Returns words (P,), "" for poses that are possible.
    """
    limits, (_, flange) = model.limits, model.in_base(R, T)
    sensor = model.T_sensor if model.to_hand else model.planes(R, T)[1]
    why = np.full(len(T), "", dtype=object)

    most = limits.tilt_deg, limits.spin_deg, limits.extent_mm
    beyond = most < np.abs(off_square(model, R, T)).T
    why[beyond.any(axis=1)] = "are tilted, turned or aside too far"
    for (*centre, radius), place in product(limits.avoid, (flange, sensor)):
        near = np.linalg.norm(place - centre, axis=-1) < radius
        why[near] = "are in a zone to avoid"
    outside = (flange < limits.low) | (flange > limits.high)
    why[outside.any(axis=1)] = "are outside the box"

    left = np.flatnonzero(why == "")  # the next question takes the longest
    inside = worst_clearance(model, R[left], T[left]) >= 0  # not where it is NaN
    why[left[~inside]] = (
        "may lose the target from view if the guess is as wrong as stated"
    )
    return why


def off_square(model: ScanModel, R: ndarray, T: ndarray) -> ndarray:
    """How far flange poses (P, 3, 3), (P, 3) are from looking at the guess squarely.

    Returns (3, P):

    - the tilt, degrees: of the direction of view; where a side of the target that is
      turned away is hidden, of the ray that hits the middle of what is seen if that is
      tilted more;
    - the spin, degrees, about the direction of view;
    - how far that middle lies along an edge, a rod or a face, mm; inf where the target
      is missed.

    A spin by s and then a tilt by t about an axis across z have a matrix Q with
    Q₁₀ - Q₀₁ = (1 + cos t) sin s, Q₀₀ + Q₁₁ = (1 + cos t) cos s and Q₂₂ = cos t. All is
    rounded, so that what is at a limit is within it.
    """
    R_view, T_view = model.planes(R, T)
    Q = np.moveaxis(model.facing.T @ R_view, 0, -1)
    spin = np.arctan2(Q[1, 0] - Q[0, 1], Q[0, 0] + Q[1, 1])
    square = Q[2, 2]
    ray = np.matvec(R_view[..., ::2], model.middle_seen(R_view, T_view))
    if model.beside_mm:
        square = np.minimum(square, unit(ray) @ model.facing[:, 2])
    tilt = np.arccos(np.clip(square, -1, 1))
    origin, axes = model.target.frame
    along = np.abs((T_view + ray - origin) @ axes)[:, free_axes(model)]
    aside = np.nan_to_num(along.max(axis=1, initial=0.0), nan=np.inf)
    return np.array([np.degrees(tilt), np.degrees(spin), aside]).round(5)


def worst_clearance(model: ScanModel, R: ndarray, T: ndarray) -> ndarray:
    """How far inside the field of view the target stays, however wrong the guess is.

    The guess may be wrong by up to its margins, or by 1 mm and 1°, for a view that
    these spoil is none. An error (9,) has shares of these, in the sensor's axes: of a
    shift, a turn of the sensor, a turn of the target. Each of the nine is tried alone,
    either way, for what it costs. To first order a shift of shares s, |s| <= 1, costs
    s · c, with c the costs along its axes: at most |c|. So do the turns, and the worst
    case is the sum of the three.

    The scan plane y = 0 leaves the target by a shift along y and turns about x, which
    no sum of costs tells: these are tried together.

    R (P, 3, 3) and T (P, 3) are flange poses. Returns (P,) mm; NaN where the target
    may be missed.
    """
    margins = model.guess.margins if model.guess else np.zeros(4)
    shift_mm, turn_rad, target_mm, target_rad = margins
    degree = np.radians(1)
    sizes = np.maximum(
        [shift_mm + target_mm, turn_rad, target_rad], [1, degree, degree]
    )
    one = np.eye(9)
    ways = [*one, one[3] - one[1] + one[6], one[3] - one[1] - one[6]]
    errors = np.concatenate([0 * one[:1], ways, np.negative(ways)])
    exact, *off = clearances(model, R, T, sizes.repeat(3) * errors)
    lowest = np.minimum(off[:11], off[11:])  # NaN if either is
    cost = np.maximum(exact - lowest[:9], 0).reshape(3, 3, *exact.shape)
    worst = exact - np.linalg.norm(cost, axis=1).sum(axis=0)
    worst[np.isnan(lowest[9:]).any(axis=0)] = np.nan  # the scan plane leaves it
    return worst.min(axis=1)


def clearances(model: ScanModel, R: ndarray, T: ndarray, errors: ndarray) -> ndarray:
    """How far inside each border of the field of view the target is seen.

    At flange poses (P, 3, 3), (P, 3) the sensor frames R, T are off by each of `errors`
    (E, 9): a shift s and a turn in their own axes, mm and rad, and a turn u of the
    target about its origin o, in these axes too. Returns (E, P, k) mm, NaN where the
    target is not seen.

    A target turned by u shows what it shows unturned from a sensor that is turned back
    about o. With U the rotation by -u, R becomes R U; and the sensor's origin, which is
    s - Rᵀ(o - T) from o along its axes, comes to o + R U (s - Rᵀ(o - T)).
    """
    R_view, T_view = model.planes(R, T)
    shift, turn, target_turn = errors.reshape(-1, 3, 1, 3).swapaxes(0, 1)
    origin = model.target.frame[0]
    R_back = R_view @ rotations(-target_turn)
    T_back = carry(R_back, origin, shift - np.vecmat(origin - T_view, R_view))
    turned = (R_back @ rotations(turn)).reshape(-1, 3, 3)
    points = model.points_seen(turned, T_back.reshape(-1, 3), 5)
    points = points.reshape(*T_back.shape[:2], *points.shape[1:])
    x, z = np.moveaxis(points, -1, 0)

    # a part of the field of view on each side: features need what is around them
    scanner, beside = model.scanner, model.beside_mm
    border = 0.05 * (scanner.far - scanner.near) + beside
    side = 0.95 * scanner.half_width(z) - beside
    borders = [z - scanner.near - border, scanner.far - border - z, side - x, side + x]
    return np.concatenate(borders, axis=-1)
