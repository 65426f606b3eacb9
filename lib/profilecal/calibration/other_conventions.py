"""Other readings of the same files, for a scan that contradicts itself: which one would
explain the data?

Poses read wrongly (angles in another order, the base in the flange) fit nothing, which
looks like motions that determine nothing. Each other reading is judged as a search
judges a start, by distances in space and medians. The one that fits far better is
named, never used. What no data can tell is not tried: mirrored x, or x and z exchanged,
is what a scanner sees that is turned by 180° about its z, or about the line halfway
between x and z.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy import ndarray
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from profilecal.calibration.observe import Seen, as_observations
from profilecal.geometry.noise import Noise
from profilecal.geometry.observability import brief
from profilecal.geometry.poses import inverse
from profilecal.joint.descent import reweighted, search, search_among_outliers, thin
from profilecal.joint.first_fit import LARGEST_ERROR_MM
from profilecal.joint.prior import FINEST_MM
from profilecal.joint.problem import Problem
from profilecal.scan.conventions import CONVENTIONS, from_rotations, named
from profilecal.scan.scan import MOUNTS, Scan
from profilecal.targets.observations import Observations

FINE_MM = 0.1  # residuals at which no other reading is looked for
# times smaller residuals; others than the best within that of it are as good
FAR_BETTER = 2.0
# logarithm of the odds against residuals so much smaller by chance, among all readings
# and starts
LUCK = 25.0
SEQUENCES = {  # of three angles, as scipy names them
    f"{one.name} {', '.join(one.columns)}": one.sequence
    for one in CONVENTIONS
    if one.sequence
} | {"angles about the fixed axes z, y, x": "zyx"}
QUATERNIONS = {  # columns of the scalar, x, y and z
    "x, y, z, w": [3, 0, 1, 2],
    "z, w, x, y (as if columns named qx, qy, qz, qw held w, x, y, z)": [1, 2, 3, 0],
}


def better_readings(scan: Scan, seen: Seen) -> list[str]:
    """A sentence on the readings, if any, that explain what was `seen` far better than
    the poses as stated.
    """
    step = -(-len(seen.poses) // 1000)  # a thousand poses are enough for any reading
    seen = Seen(seen.poses[::step], seen.points[::step])
    observed = as_observations(scan, seen)  # all points as precise
    stated, freedom = misfit(observed, widely=True)
    if not FINE_MM < stated < np.inf:
        return []
    others = readings(scan, seen.poses, observed)
    tried = sorted((misfit(observed)[0], words) for words, observed in others)
    best = max(tried[0][0], FINEST_MM)
    by_chance = freedom * np.log(stated / best) < LUCK
    if best > LARGEST_ERROR_MM or stated < FAR_BETTER * best or by_chance:
        return []
    alike = " or ".join(words for mm, words in tried if mm < FAR_BETTER * best)
    return [
        f"with {alike} the residuals are {brief(best)} mm instead of "
        f"{brief(stated)} mm; correct the files if they hold that"
    ]


def misfit(observations: Observations, widely: bool = False) -> tuple[float, int]:
    """How far most points are from the best sensor pose, mm, infinite where none is
    found; and by how many the coordinates, two for each pose, exceed the unknowns.
    `widely`: that pose is searched for as where many poses are bad.
    """
    few = thin(observations, 30)
    problem = Problem([few], Noise(1.0), in_space=True)
    freedom = 2 * problem.terms[0].P - problem.n
    if freedom <= 0:
        return np.inf, freedom
    state = search(problem)
    if widely:
        state = search_among_outliers(Problem([observations], problem.noise), state)
    best = problem.typical(reweighted(problem, state, 4).per_pose)[0]
    best = np.fmin(best, np.inf)  # for NaN
    return float(best * np.sqrt(1 + problem.n / freedom)), freedom


def readings(
    scan: Scan, poses: ndarray, observed: Observations
) -> Iterator[tuple[str, Observations]]:
    """All other readings, in words, and what was then seen from some poses, by number,
    of a scan.
    """
    R, p = scan.R_base_flange, scan.p_base_flange

    def posed(R: ndarray, p: ndarray) -> Observations:
        """The same if the flange was at all these poses in the base."""
        frames = R[poses], p[poses]
        R, p = inverse(*frames) if observed.eye_to_hand else frames
        return replace(observed, R_flange=R[None], T_flange=p[None])

    (mount,) = {*MOUNTS} - {scan.mount}
    inverted = "or, what is the same, every pose inverted (base in flange)"
    yield f'mount = "{mount}" {inverted}', posed(*inverse(R, p))
    rows = np.arange(len(p))
    for words, order in (
        ("each profile taken from the next row's pose", np.roll(rows, -1)),
        ("each profile taken from the previous row's pose", np.roll(rows, 1)),
        ("the profiles in reverse order", rows[::-1]),
    ):
        yield words, posed(R[order], p[order])
    for words, rotation in other_rotations(scan):
        yield words, posed(rotation.as_matrix(), p)
    if scan.sizes:
        fitting = with_best_sizes(observed)
        pairs = zip(scan.sizes, fitting.sizes, strict=True)
        words = " and ".join(f"a {name} of {mm:.3g} mm" for name, mm in pairs)
        yield words, fitting


def other_rotations(scan: Scan) -> Iterator[tuple[str, Rotation]]:
    """What the scan's orientations may mean, in words and as rotations, the stated
    meaning of three numbers among them.
    """
    stated = named(scan.convention)
    block = scan.orientation
    if block is None:
        block = from_rotations(stated, scan.R_base_flange)
    read = f"{', '.join(stated.columns)} read as"
    if len(stated.columns) == 3:
        for unit, degrees in (("degrees", block), ("radians", np.degrees(block))):
            for words, sequence in SEQUENCES.items():
                rotation = Rotation.from_euler(sequence, degrees, degrees=True)
                yield f"{read} {words} in {unit}", rotation
            rotation = Rotation.from_rotvec(degrees, degrees=True)
            yield f"{read} a rotation vector in {unit}", rotation
    if len(stated.columns) == 4:
        for words, order in QUATERNIONS.items():
            rotation = Rotation.from_quat(block[:, order], scalar_first=True)
            yield f"{read} {words}", rotation
    inverted = Rotation.from_matrix(scan.R_base_flange).inv()
    yield "every rotation inverted (matrices transposed)", inverted


def with_best_sizes(stated: Observations) -> Observations:
    """With the target's sizes as they fit best, a quarter to four times as long."""

    def times(log_ratio: float) -> Observations:
        return replace(stated, sizes=tuple(2**log_ratio * mm for mm in stated.sizes))

    def square(log_ratio: float) -> float:
        """That of the misfit is a parabola near the best length."""
        return misfit(times(log_ratio))[0] ** 2

    rough = min(np.arange(-2, 2.1, 0.5), key=square)
    bounds = rough - 0.5, rough + 0.5
    best = minimize_scalar(square, bounds=bounds, options={"xatol": 0.004})
    return times(best.x)
