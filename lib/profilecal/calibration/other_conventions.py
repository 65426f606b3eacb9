"""Other readings of the same files, for a scan that contradicts itself: which one would
explain the data?

Poses read wrongly (angles in another order, the base in the flange, metres) fit
nothing, which looks like motions that determine nothing. Each other reading is judged
as a search judges a start, by distances in space and medians. The one that fits far
better is named, never used. What no data can tell is not tried: mirrored x, or x and z
exchanged, is what a scanner sees that is turned by 180° about its z, or about the line
halfway between x and z.
"""

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from profilecal.calibration.observe import Seen, as_observations
from profilecal.geometry.noise import Noise
from profilecal.joint.descent import refine, search, search_among_outliers, thin
from profilecal.joint.prior import FINEST_MM
from profilecal.joint.problem import Problem
from profilecal.joint.solve import LARGEST_ERROR_MM
from profilecal.scan.conventions import CONVENTIONS, from_rotations, named
from profilecal.scan.folder import REACH_MM
from profilecal.scan.scan import Scan
from profilecal.targets.observations import Observations

UNITS = {
    "m instead of mm": 1000.0,
    "mm instead of m": 0.001,
    "cm instead of mm": 10.0,
    "inches instead of mm": 25.4,
}
SEQUENCES = (  # of three angles, as scipy names them
    *(
        (f"{c.name} {', '.join(c.columns)}", c.sequence)
        for c in CONVENTIONS
        if c.sequence
    ),
    ("angles about the fixed axes z, y, x", "zyx"),
    ("angles about z, the new y and the new z (Kawasaki)", "ZYZ"),
)


@dataclass(frozen=True)
class Reading:
    """What the files may mean instead."""

    words: str  # after "with"
    check: str  # what to look at
    scan: Scan  # as it would then be
    shift: int = 0  # the pose so many rows on belongs to a profile


def better_readings(scan: Scan, seen: Seen) -> list[str]:
    """A sentence on the readings, if any, that explain what was `seen` far better than
    the poses as stated.
    """
    fine_mm = 0.1  # residuals at which no other reading is looked for
    # times smaller residuals; others than the best within that of it are as good
    far_better = 2.0
    # logarithm of the odds against residuals so much smaller by chance, among all
    # readings and starts
    luck = 25.0
    stated, _ = misfit(observed(scan, seen), widely=True)
    if not fine_mm < stated < np.inf:
        return []
    others = (*readings(scan), *other_lengths(scan, seen))
    tried = sorted(
        [(*misfit(observed(r.scan, seen, r.shift)), r) for r in others],
        key=itemgetter(0),
    )
    best, freedom, _ = tried[0]
    best = max(best, FINEST_MM)
    if (
        best > LARGEST_ERROR_MM
        or stated < far_better * best
        or freedom * np.log(stated / best) < luck
    ):
        return []
    alike = [r for size, _, r in tried if size < far_better * best]
    words, checks = (
        " or ".join(r.words for r in alike),
        "; ".join(dict.fromkeys(r.check for r in alike)),
    )
    return [
        f"with {words} the residuals are {best:.2g} mm instead of {stated:.2g} mm; {checks}"
    ]


def observed(scan: Scan, seen: Seen, shift: int = 0) -> Observations:
    """What was seen, with the pose `shift` rows on, and all points equally precise."""
    poses = seen.poses + shift
    there = (poses >= 0) & (poses < len(scan.labels))
    return as_observations(scan, Seen(poses[there], seen.points[there]))


def misfit(observations: Observations, widely: bool = False) -> tuple[float, int]:
    """How large most residuals from the best sensor pose are, mm, infinite where none
    is found, and by how many the coordinates, two for each pose, exceed the unknowns.
    `widely`: searched for as where many poses are bad.
    """
    few = thin(observations, 30)
    problem = Problem([few], Noise(1.0), in_space=True)
    freedom = 2 * problem.terms[0].P - problem.n
    if freedom <= 0:
        return np.inf, freedom
    state = search([few], problem.noise)
    if widely:
        state = search_among_outliers([observations], problem.noise, state)
    size = problem.typical(problem.moments(state))
    for _ in range(4):  # each weighs bad poses down further
        fit = refine(problem, state, scale=np.maximum(size, FINEST_MM), iterations=8)
        state, size = fit.state, problem.typical(fit)
    best = np.min(size, where=np.isfinite(size), initial=np.inf)
    return float(best * np.sqrt(1 + problem.n / freedom)), freedom


def readings(scan: Scan):
    """All other readings of a scan's poses."""
    mount = "eye-to-hand" if scan.mount == "eye-in-hand" else "eye-in-hand"
    yield Reading(
        f'mount = "{mount}" or, what is the same, every pose inverted (base in flange)',
        "check the mount, and which frame the poses are in",
        replace(scan, mount=mount),
    )
    for shift, which in ((1, "next"), (-1, "previous")):
        words = f"each profile taken from the {which} row's pose"
        yield Reading(words, "check which pose each profile belongs to", scan, shift)
    (low, high), farthest = REACH_MM, np.linalg.norm(scan.p_base_flange, axis=1).max()
    for words, factor in UNITS.items():
        if low < farthest * factor < high:
            scaled = replace(scan, p_base_flange=scan.p_base_flange * factor)
            yield Reading(
                f"the poses' x, y, z in {words}",
                "check the units of poses and profiles",
                scaled,
            )
    stated = named(scan.convention)
    block = (
        from_rotations(stated, scan.R_base_flange)
        if scan.orientation is None
        else scan.orientation
    )
    turned = [
        (f"{', '.join(stated.columns)} read as {words}", R)
        for words, R in orientations(block, stated.sequence)
    ]
    turned.append(
        (
            "every rotation inverted (matrices transposed)",
            Rotation.from_matrix(scan.R_base_flange).inv(),
        )
    )
    for words, rotation in turned:
        robot = replace(scan, R_base_flange=rotation.as_matrix())
        yield Reading(words, "check how the robot prints its poses", robot)


def other_lengths(scan: Scan, seen: Seen):
    """The scan with each of its target's lengths as it fits best, the others as given."""
    for k, name in enumerate(scan.measures):

        def of(log, k=k):
            sizes = [
                size * 2**log if i == k else size for i, size in enumerate(scan.sizes)
            ]
            return replace(scan, sizes=tuple(sizes))

        def off(log, of=of):
            return misfit(observed(of(log), seen))[0]

        best = min(np.arange(-2, 2.1, 0.25), key=off)
        found = of(
            minimize_scalar(
                off,
                bounds=(best - 0.25, best + 0.25),
                method="bounded",
                options={"xatol": 1e-3},
            ).x
        )
        yield Reading(
            f"a {name} of {found.sizes[k]:.3g} mm",
            f"{scan.sizes[k]:g} mm was given",
            found,
        )


def orientations(block, sequence: str):
    """What a block of orientation columns (n, k) may mean besides what is stated, in
    words and as rotations. `sequence`: of the angles stated, "" for others.
    """
    match block.shape[1]:
        case 3:
            for unit, degrees in (("degrees", block), ("radians", np.degrees(block))):
                for words, other in SEQUENCES:
                    if (other, unit) != (sequence, "degrees"):
                        yield (
                            f"{words} in {unit}",
                            Rotation.from_euler(other, degrees, degrees=True),
                        )
                if sequence or unit == "degrees":
                    yield (
                        f"a rotation vector in {unit}",
                        Rotation.from_rotvec(np.radians(degrees)),
                    )
        case 4:
            first = "z, w, x, y (as if columns named qx, qy, qz, qw held w, x, y, z)"
            for words, order in (("x, y, z, w", [3, 0, 1, 2]), (first, [1, 2, 3, 0])):
                yield words, Rotation.from_quat(block[:, order], scalar_first=True)
