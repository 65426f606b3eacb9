"""The disk method of Chen et al. 2018: chords to sensing data (Section III-B), sensing
data to pose (III-C, III-D).
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.closed_form.groups import find_groups
from profilecal.closed_form.two_step import (
    TwoStepSolution,
    check_fit,
    check_line,
    check_orientations,
    solve_rotation,
    solve_translation,
)
from profilecal.geometry.checks import (
    UnobservableError,
    check_array,
    check_count,
    check_positions,
    check_readings,
    check_rotations,
)
from profilecal.geometry.fitting import (
    Ellipse,
    fit_ellipse,
    from_components,
    principal_axes,
)
from profilecal.geometry.poses import unit

# a straight motion leaves its line by less than this part of its length
STRAIGHT = 0.01
# standard deviations by which the lengths of a motion's chords bend, at least
BEND = 3.0


@dataclass(frozen=True)
class SensingData:
    """What Section III-B makes of the chords of a scan, with all steps on the way."""

    # (..., 3) flange position at which the scan plane passes through the disk's centre,
    # mm, Eq. 10
    T_tcp: ndarray
    q: ndarray  # (..., 3) the disk's centre in the sensor frame, mm, Eq. 11
    # (..., 3) from one tangent position to the other, sensor frame, mm, Eq. 12
    D_i: ndarray
    D_b: ndarray  # (..., 3) the same in the base frame, mm, Eq. 13
    # (..., 2) unit vector of the chords, x and z of the sensor frame
    direction: ndarray
    e: ndarray  # (..., 5, 2) the elliptic points in the rotated frame, mm, Eq. 5
    # (...) the argument of Eq. 9's arccos; noise can push it out of [-1, 1]
    cos_alpha: ndarray

    @property
    def alpha(self) -> ndarray:
        """Angle between the scan plane and the disk in radians, Eq. 9; 0 or π where the
        arccos does not exist.
        """
        return np.arccos(np.clip(self.cos_alpha, -1, 1))


def solve_disk(
    R_tcp: ArrayLike,
    T_tcp: ArrayLike,
    chords: ArrayLike,
    radius: float,
    R_sensor_guess: ArrayLike,
    *,
    group: ArrayLike | None = None,
    heights: str = "regression",
) -> TwoStepSolution:
    """The sensor pose from a planar disk, of which n flange poses see one chord each.

    The method of Chen et al. 2018: at three orientations or more, the flange moves
    along a straight line over the disk. The chords of a motion lie on an ellipse, which
    gives its sensing data (Eqs 4-13); those of all motions give the rotation (Eqs
    14-16), then the translation (Eqs 17-20). A motion has three poses or more; their
    number and their steps may differ. Nothing tells how well three chords fix the
    ellipse.

    Chords do not show whether the scanner looks forwards or backwards along its motion:
    `R_sensor_guess` tells. Rows may come in any order. As in the paper, Eq. 17 takes
    differences of successive motions: with noise, the answer depends on their order.

    Parameters
    ----------
    R_tcp, T_tcp : array_like, (n, 3, 3) and (n, 3)
        Flange poses in the base frame, mm.
    chords : array_like, (n, 2, 2)
        Two tips of the chord from each pose, each x and z in the sensor frame, mm.
    radius : float
        Of the disk, mm.
    R_sensor_guess : array_like, (3, 3)
        The rotation from sensor to flange, roughly, from which follow the s_i of Eq. 3:
        1 where a motion goes towards the sensor's +y, else -1.
    group : array_like, (n,), optional
        Labels that poses of one motion share. Left out, orientations that agree within
        0.05° are one motion.
    heights : str, optional
        "regression" or "published", see `chord_weights`.

    Returns
    -------
    TwoStepSolution
        `R_sensor` (3, 3) and `T_sensor` (3,) mm; `translation` also has the disk's
        centre in the base frame, from each motion, and its scatter.

    Raises
    ------
    ValueError
        For malformed input, with the argument, the index and the value; motions that
        are not straight; chords that no disk of this radius shows to any sensor pose.
    UnobservableError
        Where the poses leave the answer open, with the motion to add.

    See Also
    --------
    solve_edge : The same from a straight edge.
    solve_ball : The same from a ball.
    sensing_data : The first step by itself, in batches.
    disk_equations : The second step by itself, in batches.

    Examples
    --------
    >>> import numpy as np
    >>> import profilecal as pc
    >>> from scipy.spatial.transform import Rotation
    >>> scan, truth = pc.simulate("disk", seed=1, noise={"profile_mm": 0.01})
    >>> R, T = scan.R_base_flange, scan.p_base_flange
    >>> chords = np.reshape(scan.values, (-1, 2, 2))
    >>> rough = truth.pose[:3, :3] @ Rotation.from_rotvec([0.2, 0.1, 0.3]).as_matrix()
    >>> found = pc.solve_disk(R, T, chords, radius=50, R_sensor_guess=rough)
    >>> bool(np.linalg.norm(found.T_sensor - truth.pose[:3, 3]) < 0.5)
    True
    """
    T_tcp = check_positions("T_tcp", T_tcp)
    n = len(T_tcp)
    R_tcp = check_rotations("R_tcp", R_tcp, n)
    chords = check_readings("chords", chords, (n, 2, 2))
    radius = float(check_array("radius", radius, ()))
    if not radius > 0:
        raise ValueError(f"radius is {radius:g}; expected a length in mm")
    guess = check_array("R_sensor_guess", R_sensor_guess, (3, 3))
    check_rotations("R_sensor_guess", guess[None], 1)
    motions = motions_of(T_tcp, find_groups("R_tcp", R_tcp, group))
    check_motions(T_tcp, motions)
    R_tcp = R_tcp[[rows.min() for rows in motions]]
    check_orientations(R_tcp)

    by_x = chords[..., :1].argsort(axis=1)
    tips = np.take_along_axis(chords, by_x, axis=1)
    check_bend(T_tcp, tips, motions)
    scans = scans_of(R_tcp, T_tcp, tips, motions, radius, heights, guess)
    D_i = np.array([scan.D_i for scan in scans])
    for k in np.flatnonzero(np.isnan(D_i).any(axis=1)):
        name = name_of(motions[k])
        raise ValueError(f"the tips at {name} are on no ellipse; expected a disk's")
    found = solve_scans(R_tcp, scans)
    for frame, motion in (("sensor", D_i), ("flange", found.rotation.Y.T)):
        check_line(
            motion,
            f"the {len(scans)} motions are parallel in the {frame} frame",
            "the rotation about them stays open; add one in another direction of it",
        )
    hint = ", is this the disk's radius, and does R_sensor_guess say the right way"
    check_fit(**vars(found.rotation), accuracy=found.translation.accuracy, also=hint)
    return found


def motions_of(T_tcp: ndarray, number: ndarray) -> list[ndarray]:
    """The rows of each motion's positions (..., n, 3) in the order of its way, by the
    numbers (n,) of the poses' motions; those of a batch go the same way.
    """
    T = T_tcp.reshape(-1, len(number), 3)[0]
    motions = []
    for k in np.unique(number):
        rows = np.flatnonzero(number == k)
        along = np.vecdot(T[rows], principal_axes(T[rows])[:1])
        motions.append(rows[along.argsort(kind="stable")])
    return motions


def scans_of(
    R_tcp: ndarray,
    T_tcp: ndarray,
    tips: ndarray,
    motions: list[ndarray],
    radius: float,
    heights: str,
    R_sensor: ndarray,
) -> list[SensingData]:
    """The sensing data of each of G motions of orientations (..., G, 3, 3), from all
    positions (..., n, 3) and tips (..., n, 2, 2), the one of smaller x first. Signs
    follow from `R_sensor` (..., 3, 3).
    """
    y = (R_tcp @ R_sensor[..., None, :, :])[..., 1]
    scans = []
    for k, rows in enumerate(motions):
        T, seen = T_tcp[..., rows, :], tips[..., rows, :, :]
        start, end = T[..., 0, :], T[..., -1, :]
        way = end - start
        s = np.sign(np.vecdot(way, y[..., k, :]))
        along = np.vecdot(T, way[..., None, :])
        scans.append(sensing_data(seen, start, end, s, radius, heights, along))
    return scans


def solve_scans(R_tcp: ndarray, scans: list[SensingData]) -> TwoStepSolution:
    """`disk_equations` of the scans at orientations (..., G, 3, 3)."""
    names = "T_tcp", "q", "D_i", "D_b"
    fields = ([getattr(scan, name) for scan in scans] for name in names)
    return disk_equations(R_tcp, *(np.stack(field, axis=-2) for field in fields))


def name_of(rows: ndarray) -> str:
    """What a motion is called in messages."""
    return f"the orientation R_tcp[{rows.min()}]"


def check_motions(T_tcp: ndarray, motions: list[ndarray]) -> None:
    """Refuse motions, rows of positions (..., n, 3), of too few chords or not along a
    straight line.
    """
    for rows in motions:
        name, why = name_of(rows), "an ellipse has five unknowns, a chord two tips"
        check_count(f"chords at {name}", len(rows), 3, why)
        offsets = T_tcp[..., rows, :] - T_tcp[..., rows[:1], :]
        way = offsets[..., -1:, :]
        length = np.linalg.norm(way, axis=-1)
        aside = np.linalg.norm(np.cross(offsets, way), axis=-1)  # times the length
        if not (aside < STRAIGHT * length**2).all():
            raise ValueError(
                f"the positions at {name}, {length.min():.3g} mm from end to end, "
                f"leave a line by more than {STRAIGHT:.0%} of that; expected a "
                "straight motion (group tells several at one orientation apart)"
            )


def check_bend(T_tcp: ndarray, tips: ndarray, motions: list[ndarray]) -> None:
    """Refuse motions, rows of positions (n, 3) and tips (n, 2, 2), whose chords hardly
    change in length: their ellipse may be of any size.

    The square of a chord's length is a parabola over the way. Any three are on one.
    """
    for rows in motions:
        if len(rows) == 3:
            continue
        along = np.linalg.norm(T_tcp[rows] - T_tcp[rows[0]], axis=-1)
        squares = np.sum(np.diff(tips[rows], axis=1) ** 2, axis=(1, 2))
        curve, covariance = np.polyfit(along, squares, 2, cov=True)
        if not -curve[0] > BEND * np.sqrt(covariance[0, 0]):  # true for NaN
            raise UnobservableError(
                f"the {len(rows)} chords at {name_of(rows)} hardly change in length, "
                "so their ellipse cannot be known; move farther across the disk"
            )


def sensing_data(
    tips: ndarray,
    T_start: ndarray,
    T_end: ndarray,
    s: ndarray,
    radius: float,
    heights: str = "regression",
    along: ndarray | None = None,
) -> SensingData:
    """Sensing data of scans from their chords' tips (..., m, 2, 2), in order of the
    motion: Eqs 4-13, no guards.

    Of each chord the tip of smaller x comes first. T_start and T_end (..., 3), mm:
    flange positions of the first and the last; s (...): +1 where the motion is towards
    the sensor's +y, else -1. `heights` and `along`: see `chord_weights`.
    """
    m = tips.shape[-3]
    points = np.moveaxis(tips, -2, -3).reshape(*tips.shape[:-3], 2 * m, 2)
    vectors = points.mT @ chord_weights(m, heights, along)
    ellipse = fit_ellipse(points)
    return sensing_data_from_ellipse(ellipse, vectors, T_start, T_end, s, radius)


def chord_weights(
    m: int, heights: str = "regression", along: ndarray | None = None
) -> ndarray:
    """Weights (..., 2m, 5) that make five vectors of the tips of m chords, all first
    tips before all second ones.

    They are the mean chord, then one point, and another, of each of both lines that
    place e4 and e5 on the line e1e2. `heights` "published": these lines are the first
    and the last chord, whose noise stays however many chords there are; "regression":
    they run along the mean chord, at the ends of the straight line fitted to the
    heights of all chords. These follow the flange's way `along` (..., m) the motion, in
    any unit; without it the steps are even. Raises ValueError for other `heights`.
    """
    chord = np.repeat([[-1 / m], [1 / m]], m, axis=0)
    if heights == "regression":
        step = np.linspace(-1, 1, m) if along is None else along
        step = step - step.mean(axis=-1, keepdims=True)
        square = np.vecdot(step, step)[..., None, None]
        # (..., m, 2): weights of the heights that give the ends of their line
        ends = 1 / m + step[..., None] * step[..., None, [0, -1]] / square
        middles = np.concatenate([ends, ends], axis=-2) / 2
        lines = [middles - chord / 2, middles + chord / 2]
    elif heights == "published":
        tips = np.eye(2 * m)
        lines = [tips[:, [0, m - 1]], tips[:, [m, 2 * m - 1]]]
    else:
        raise ValueError(
            f"heights is {heights!r}; expected 'regression' or 'published'"
        )
    return np.concatenate([chord + 0 * lines[0][..., :1], *lines], axis=-1)


def sensing_data_from_ellipse(
    ellipse: Ellipse,
    vectors: ndarray,
    T_start: ndarray,
    T_end: ndarray,
    s: ndarray,
    radius: float,
) -> SensingData:
    """As `sensing_data`, from the fitted ellipse and the vectors (..., 2, 5), x and z,
    that `chord_weights` makes.

    x̄ and z̄, the frame of Eq. 4, run along the chords and across. A chord at height z̄
    has its middle at x̄_3 + slope (z̄ - z̄_3), on the line e1e2. e1 and e2 are the lowest
    and the highest point of the ellipse, where a chord has no length, e3 is its centre;
    e4 and e5 are where the first and the last chord meet e1e2. All five are on one
    line, so heights alone make up Eq. 7's ratios.

    Components come first: NumPy is fast along long axes only.
    """
    vectors = np.moveaxis(vectors, (-2, -1), (0, 1))
    chord = vectors[:, 0]
    cos, sin = chord / np.hypot(*chord)

    def turned(vector: ndarray) -> tuple[ndarray, ndarray]:
        """By R_θ into the frame of Eq. 4."""
        x, z = vector
        return cos * x + sin * z, cos * z - sin * x

    x3, z3 = turned(np.moveaxis(ellipse.centre, -1, 0))
    S_x, S_z = np.moveaxis(ellipse.shape, (-2, -1), (0, 1))
    S_xz, S_zz = turned(cos * S_z - sin * S_x)
    slope = S_xz / S_zz

    # where the lines through two points each, a and b, meet e1e2
    xa, za = turned(vectors[:, 1:3])
    xb, zb = turned(vectors[:, 3:])
    rise = (zb - za) / (xb - xa)
    z4, z5 = (za + rise * (x3 - slope * z3 - xa)) / (1 - rise * slope)
    to_end = np.where(z5 < z4, -1.0, 1.0) * np.sqrt(S_zz)
    z = np.stack([z3 - to_end, z3 + to_end, z3, z4, z5])
    x = x3 + (z - z3) * slope
    with np.errstate(divide="ignore", invalid="ignore"):
        eta = ((z - z5) / (z4 - z5))[..., None]  # Eq. 7

    to_start = T_start - T_end
    D_b = (eta[1] - eta[0]) * to_start  # Eq. 13
    dx, dz = x[0] - x[1], z[0] - z[1]
    square = np.vecdot(D_b, D_b) - dx**2 - dz**2
    cos_alpha = (square - 4 * radius**2) / (4 * radius * dz)
    inside = np.clip(cos_alpha, -1, 1)
    D_y = 2 * radius * s * np.sqrt(1 - inside**2)
    D_z = dz + 2 * radius * inside
    return SensingData(
        T_tcp=T_end + eta[2] * to_start,  # Eq. 8
        q=np.insert(ellipse.centre, 1, 0, axis=-1),
        D_i=from_components(cos * dx - sin * D_z, D_y, sin * dx + cos * D_z),
        D_b=D_b,
        direction=from_components(cos, sin),
        e=np.moveaxis(np.stack([x, z]), (0, 1), (-1, -2)),
        cos_alpha=cos_alpha,
    )


def disk_equations(
    R_tcp: ndarray,
    T_tcp: ndarray,
    q: ndarray,
    D_i: ndarray,
    D_b: ndarray,
) -> TwoStepSolution:
    """Sensor pose from the flange's orientations (..., n, 3, 3) and `SensingData`, each
    (..., n, 3) mm, without the guards of `solve_disk`.

    Eq. 14's vectors are given unit length.
    """
    Y = np.vecmat(unit(D_b), R_tcp).mT  # columns R_tcp⁻¹ D_b
    rotation = solve_rotation(unit(D_i).mT, Y)
    translation = solve_translation(R_tcp, T_tcp, q, rotation.R_sensor)
    return TwoStepSolution(rotation, translation)
