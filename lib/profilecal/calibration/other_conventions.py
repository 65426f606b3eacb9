"""Other readings of the same files, for a scan that contradicts itself: which one would
explain the data?

Poses read wrongly (angles in another order, the base in the flange, metres) fit
nothing, which looks like motions that determine nothing. Each other reading is judged
as a search judges a start, by distances in space and medians. The one that fits far
better is named, never used. What no data can tell is not tried: mirrored x, or x and z
exchanged, is what a scanner sees that is turned by 180° about its z, or about the line
halfway between x and z.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from profilecal.calibration.observe import Seen, as_observations
from profilecal.geometry.checks import REACH_MM
from profilecal.geometry.noise import Noise
from profilecal.joint.descent import refine, search, search_among_outliers, thin
from profilecal.joint.prior import FINEST_MM
from profilecal.joint.problem import Problem
from profilecal.joint.solve import LARGEST_ERROR_MM
from profilecal.scan.conventions import CONVENTIONS, from_rotations, named
from profilecal.scan.scan import MOUNTS, Scan
from profilecal.targets.observations import Observations

FINE_MM = 0.1  # residuals at which no other reading is looked for
# times smaller residuals; others than the best within that of it are as good
FAR_BETTER = 2.0
# logarithm of the odds against residuals so much smaller by chance, among all readings
# and starts
LUCK = 25.0
UNITS = {"cm instead of mm": 10.0, "inches instead of mm": 25.4}
SEQUENCES = (  # of three angles, as scipy names them
    *(
        (f"{one.name} {', '.join(one.columns)}", one.sequence)
        for one in CONVENTIONS
        if one.sequence
    ),
    ("angles about the fixed axes z, y, x", "zyx"),
)


@dataclass(frozen=True)
class Reading:
    """What the files may mean instead."""

    words: str  # after "with"
    check: str  # what to look at
    scan: Scan  # as it would then be
    # of each row of measurements the row of its pose; None: the same
    rows: ndarray | None = None


@dataclass(frozen=True)
class Misfit:
    """How badly a reading fits."""

    rms_mm: float  # of most residuals from the best sensor pose; infinite: none found
    # by how many the coordinates, two for each pose, exceed the unknowns
    freedom: int


def better_readings(scan: Scan, seen: Seen) -> list[str]:
    """A sentence on the readings, if any, that explain what was `seen` far better than
    the poses as stated.
    """
    scan, seen = sample(scan, seen)
    stated = misfit(observed(scan, seen), widely=True).rms_mm
    if not FINE_MM < stated < np.inf:
        return []
    others = [*readings(scan), *other_lengths(scan, seen)]
    misfits = [misfit(observed(one.scan, seen, one.rows)) for one in others]
    order = sorted(range(len(others)), key=lambda k: misfits[k].rms_mm)
    first = misfits[order[0]]
    best = max(first.rms_mm, FINEST_MM)
    by_chance = first.freedom * np.log(stated / best) < LUCK
    if best > LARGEST_ERROR_MM or stated < FAR_BETTER * best or by_chance:
        return []
    alike = [others[k] for k in order if misfits[k].rms_mm < FAR_BETTER * best]
    words = " or ".join(one.words for one in alike)
    checks = "; ".join(dict.fromkeys(one.check for one in alike))
    residuals = f"the residuals are {best:.2g} mm instead of {stated:.2g} mm"
    return [f"with {words} {residuals}; {checks}"]


def sample(scan: Scan, seen: Seen) -> tuple[Scan, Seen]:
    """A scan without its measurements, and what was seen from at most a thousand poses:
    enough for any reading.
    """
    step = -(-len(seen.poses) // 1000)
    few = Seen(seen.poses[::step], seen.points[::step])
    nothing = tuple(rows[:0] for rows in scan.values)
    return replace(scan, values=nothing), few


def observed(scan: Scan, seen: Seen, rows: ndarray | None = None) -> Observations:
    """What was seen, with the poses of other `rows`, and all points equally precise."""
    poses = seen.poses if rows is None else rows[seen.poses]
    inside = (poses >= 0) & (poses < len(scan.labels))
    return as_observations(scan, Seen(poses[inside], seen.points[inside]))


def misfit(observations: Observations, widely: bool = False) -> Misfit:
    """How badly observations fit. `widely`: the best sensor pose is searched for as
    where many poses are bad.
    """
    few = thin(observations, 30)
    problem = Problem([few], Noise(1.0), in_space=True)
    freedom = 2 * problem.terms[0].P - problem.n
    if freedom <= 0:
        return Misfit(np.inf, freedom)
    state = search(problem)
    if widely:
        state = search_among_outliers(Problem([observations], problem.noise), state)
    size = problem.typical(problem.moments(state))
    for _ in range(4):  # each weighs bad poses down further
        fit = refine(problem, state, scale=np.maximum(size, FINEST_MM), iterations=8)
        state, size = fit.state, problem.typical(fit)
    best = np.min(size, where=np.isfinite(size), initial=np.inf)
    return Misfit(float(best * np.sqrt(1 + problem.n / freedom)), freedom)


def readings(scan: Scan) -> Iterator[Reading]:
    """All other readings of a scan's poses."""
    (mount,) = {*MOUNTS} - {scan.mount}
    yield Reading(
        f'mount = "{mount}" or, what is the same, every pose inverted (base in flange)',
        "check the mount, and which frame the poses are in",
        replace(scan, mount=mount),
    )
    rows = np.arange(len(scan.labels))
    for words, others in (
        ("each profile taken from the next row's pose", rows + 1),
        ("each profile taken from the previous row's pose", rows - 1),
        ("the profiles in reverse order", rows[::-1]),
    ):
        yield Reading(words, "check which pose each profile belongs to", scan, others)
    low, high = REACH_MM
    farthest = np.linalg.norm(scan.p_base_flange, axis=1).max()
    for words, factor in UNITS.items():
        if low < farthest * factor < high:
            yield Reading(
                f"the poses' x, y, z in {words}",
                "check the units of poses and profiles",
                replace(scan, p_base_flange=scan.p_base_flange * factor),
            )
    for words, rotation in other_rotations(scan):
        robot = replace(scan, R_base_flange=rotation.as_matrix())
        yield Reading(words, "check how the robot prints its poses", robot)


def other_rotations(scan: Scan) -> Iterator[tuple[str, Rotation]]:
    """What the scan's orientations may mean besides what is stated, in words and as
    rotations.
    """
    stated = named(scan.convention)
    block = scan.orientation
    if block is None:
        block = from_rotations(stated, scan.R_base_flange)
    columns = ", ".join(stated.columns)
    for words, rotation in orientations(block, stated.sequence):
        yield f"{columns} read as {words}", rotation
    inverted = Rotation.from_matrix(scan.R_base_flange).inv()
    yield "every rotation inverted (matrices transposed)", inverted


def other_lengths(scan: Scan, seen: Seen) -> Iterator[Reading]:
    """The scan with each of its target's lengths as it fits best, the others as given:
    a quarter to four times as long.
    """
    for k, name in enumerate(scan.measures):

        def rms_mm(log_ratio: float, k: int = k) -> float:
            return misfit(observed(with_length(scan, k, log_ratio), seen)).rms_mm

        coarse = min(np.arange(-2, 2.1, 0.25), key=rms_mm)
        fine = minimize_scalar(
            rms_mm,
            bounds=(coarse - 0.25, coarse + 0.25),
            method="bounded",
            options={"xatol": 1e-3},
        )
        fitting = with_length(scan, k, fine.x)
        yield Reading(
            f"a {name} of {fitting.sizes[k]:.3g} mm",
            f"{scan.sizes[k]:g} mm was given",
            fitting,
        )


def with_length(scan: Scan, k: int, log_ratio: float) -> Scan:
    """The scan with its k-th length multiplied by a power of two."""
    sizes = [*scan.sizes]
    sizes[k] *= 2**log_ratio
    return replace(scan, sizes=tuple(sizes))


def orientations(block: ndarray, sequence: str) -> Iterator[tuple[str, Rotation]]:
    """What a block of orientation columns (n, k) may mean besides what is stated, in
    words and as rotations. `sequence`: of the angles stated, "" for others.
    """
    if block.shape[1] == 3:
        yield from of_three_numbers(block, sequence)
    if block.shape[1] == 4:
        first = "z, w, x, y (as if columns named qx, qy, qz, qw held w, x, y, z)"
        for words, order in (("x, y, z, w", [3, 0, 1, 2]), (first, [1, 2, 3, 0])):
            yield words, Rotation.from_quat(block[:, order], scalar_first=True)


def of_three_numbers(block: ndarray, sequence: str) -> Iterator[tuple[str, Rotation]]:
    """`orientations` of angles or rotation vectors (n, 3)."""
    for unit, degrees in (("degrees", block), ("radians", np.degrees(block))):
        for words, other in SEQUENCES:
            if (other, unit) != (sequence, "degrees"):
                rotation = Rotation.from_euler(other, degrees, degrees=True)
                yield f"{words} in {unit}", rotation
        if sequence or unit == "degrees":
            rotation = Rotation.from_rotvec(np.radians(degrees))
            yield f"a rotation vector in {unit}", rotation
