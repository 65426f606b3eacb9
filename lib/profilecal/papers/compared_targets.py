"""The same scans of every target, for comparing them: one sensor mount, one robot, one scanner, batches of scenes."""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.closed_form.ball import solve_tetra_ball
from profilecal.closed_form.disk import solve_disk_from_chords
from profilecal.closed_form.edge import solve_edge
from profilecal.closed_form.two_step import check_directions, check_orientations, solve_rotation, solve_translation
from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.poses import rotations
from profilecal.joint.observations import Observations, State, pose_error
from profilecal.simulate.scene import random_scene, stack
from profilecal.targets.ball import Ball

POINTS = 10  # of a curve: they stand for all that a profile shows of it
MEANS = 40  # along a curve, whose error is known
CORNERS = 30.0 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])  # mm, of a tetra-ball's tetrahedron


@dataclass(frozen=True)
class Case:
    """What is seen of one or several targets in a batch of scans, the truth, and which places were probed."""

    seen: list[Observations]
    truth: State
    probed: list[bool]

    def __add__(self, other: "Case") -> "Case":
        both = State(self.truth.rotation, self.truth.translation, self.truth.placements + other.truth.placements)
        return Case(self.seen + other.seen, both, self.probed + other.probed)

    def half(self, first: int) -> "Case":
        """Every second orientation, from the first, 0 or 1."""
        return replace(self, seen=[one.keep(one.group % 2 == first) for one in self.seen])


def as_precise(seen: Observations, sd) -> Observations:
    """Observations that say how large their errors are, mm: of x and of z (2,), or across a curve (1,)."""
    _, P, m, _ = seen.points.shape
    if seen.on_curve:
        return replace(seen, covariance=np.full((1, P, m), sd[0] ** 2))
    return replace(seen, covariance=np.broadcast_to(np.diag(np.tile(sd, m) ** 2), (1, P, 2 * m, 2 * m)))


def perfect_case(kind: str, sd, seed: int, scenes: int, *, tetra: bool = False, **plan) -> Case:
    """A perfect scan of a target in every scene, its errors said to be `sd`, mm. Sensor, place and orientations are the
    same for every kind. `plan`: of `random_scene`. `tetra`: of four such targets, by turns."""
    many = stack([random_scene(kind, np.random.default_rng([seed, k]), count=POINTS, **plan) for k in range(scenes)])
    seen = as_precise(many.observations, sd * (np.sqrt(POINTS / MEANS) if many.observations.on_curve else 1))
    if not tetra:
        return Case([seen], many.truth, [False])
    turn, ((origin, axes),) = np.arange(seen.points.shape[1]) % 4, many.truth.placements
    four = [replace(seen.keep(turn == k), T_flange=seen.T_flange[:, turn == k] + CORNERS[k]) for k in range(4)]
    return Case(four, replace(many.truth, placements=tuple((origin + corner, axes) for corner in CORNERS)), [True] * 4)


def with_errors(
    case: Case, times: int, rng: np.random.Generator, *, scanner: float, position_mm: float, orientation_deg: float
) -> Case:
    """Each scene's scan `times` times, with fresh errors: the scanner's `scanner` times as large as the case says, and
    the robot's at each pose."""
    each, seen = np.repeat(np.arange(len(case.truth.rotation)), times), []
    for one in (one.take(each) for one in case.seen):
        variance = one.covariance if one.on_curve else np.diagonal(one.covariance, axis1=2, axis2=3)
        sd = np.multiply(scanner, np.sqrt(variance.reshape(1, *one.points.shape[1:3], -1)))
        turn = np.radians(orientation_deg) * rng.normal(size=one.T_flange.shape)
        R = one.R_flange @ rotations(turn.reshape(-1, 3)).reshape(one.R_flange.shape)
        T = one.T_flange + position_mm * rng.normal(size=one.T_flange.shape)
        seen.append(replace(one, points=one.points + sd * rng.normal(size=one.points.shape), R_flange=R, T_flange=T))
    return replace(case, seen=seen, truth=case.truth[each])


def bent(case: Case, bend_mm: float, over_mm: float) -> Case:
    """The same scan of a target that is an arch, `bend_mm` high over a length: along it; a plane, in one direction."""
    (seen,), truth, points = case.seen, case.truth, []
    ((origins, frames),) = truth.placements
    for R_flange, T_flange, view, R, T, origin, axes in zip(
        seen.R_flange, seen.T_flange, seen.points, truth.rotation, truth.translation, origins, frames, strict=True
    ):
        along, across = (axes[:, 0], axes[:, 2]) if seen.kind == "plane" else (axes[:, 2], axes[:, 0])
        turned, sensor = R_flange @ R, T_flange + R_flange @ T
        place = sensor + (turned[..., [0, 2]] @ view.mean(axis=1)[..., None])[..., 0]
        height = bend_mm * (1 - ((place - origin) @ along / (over_mm / 2)) ** 2)
        target = seen.target.at(origin, axes, seen.sizes)
        points.append(target.points_seen(turned, sensor - height[:, None] * across, POINTS))
    return replace(case, seen=[replace(seen, points=np.array(points))])


def misstated(case: Case, radius_mm: float) -> Case:
    """The same scan, the radius stated too small."""
    return replace(case, seen=[replace(one, sizes=tuple(s - radius_mm for s in one.sizes)) for one in case.seen])


def side_of(seen: Observations, truth: State, b: int) -> np.ndarray:
    """What the user of a closed form knows of scan b: on which side of the scan plane a ball's centre lies, or where
    to a disk's chords went, (P,) 1 or -1."""
    y = (seen.R_flange[b] @ truth.rotation[b])[..., 1]
    if seen.kind == "ball":
        sensor = seen.T_flange[b] + seen.R_flange[b] @ truth.translation[b]
        return np.sign(((truth.placements[0][0][b] - sensor) * y).sum(axis=1))
    ends = [np.flatnonzero(seen.labels == g)[[0, -1]] for g in seen.labels]
    return np.sign(
        [(seen.T_flange[b, last] - seen.T_flange[b, first]) @ v for (first, last), v in zip(ends, y, strict=True)]
    )


def tetra_pairs(case: Case, b: int, k: int, error) -> tuple[np.ndarray, np.ndarray]:
    """Centres (P, 3) of the k-th ball in scan b: in the flange frame, from its probed place, which is wrong by an
    `error` (3,), and in the sensor frame, from its arcs. In mm."""
    seen, truth = case.seen[k], case.truth
    side = side_of(seen, replace(truth, placements=truth.placements[k : k + 1]), b)
    place = truth.placements[k][0][b] + error
    in_flange = ((place - seen.T_flange[b])[:, None] @ seen.R_flange[b])[:, 0]
    return in_flange, seen.target(place, *seen.sizes).centre_from_circle(fit_circle(seen.points[b]), side)


def ball_in_groups(R, T, q) -> tuple[np.ndarray, np.ndarray]:
    """The two-step ball method with the differences inside every group in place of those of one: R (3, 3) and T (3,)
    from orientations (G, 3, 3), positions and centres (G, N, 3) in mm."""
    check_orientations(R)
    moved = (T[:, 1:] - T[:, :1]) @ R
    length = np.linalg.norm(moved, axis=-1, keepdims=True)
    X, Y = ((part / length).reshape(-1, 3).T for part in (q[:, :1] - q[:, 1:], moved))
    check_directions(Y, "motion inside a group of one orientation")
    rotation = solve_rotation(X, Y).R_sensor
    return rotation, solve_translation(R, T.mean(axis=1), q.mean(axis=1), rotation, "all").T_sensor


def in_closed_form(case: Case, b: int, probe_mm: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The papers' answer for one scan, R (3, 3) and T (3,), mm; of a tetra-ball probed to `probe_mm`, the rigid
    transform between the balls' centres in both frames. Raises ValueError where their method refuses it."""
    if all(case.probed):
        pairs = [tetra_pairs(case, b, k, probe_mm * rng.normal(size=3)) for k in range(len(case.seen))]
        found = solve_tetra_ball(*(np.concatenate(part) for part in zip(*pairs, strict=True)))
        return found.R, found.T
    (seen,) = case.seen
    side, groups = side_of(seen, case.truth, b), seen.labels.max() + 1
    R, T, points = (
        part[b].reshape(groups, -1, *part.shape[2:]) for part in (seen.R_flange, seen.T_flange, seen.points)
    )
    R = R[:, 0]
    if seen.kind == "ball":
        ball = Ball(np.zeros(3), *seen.sizes)
        return ball_in_groups(R, T, ball.centre_from_circle(fit_circle(points), side.reshape(groups, -1)))
    if seen.kind == "edge":
        found = solve_edge(R, T, points[:, :, 0])
    else:
        found = solve_disk_from_chords(R, T[:, 0], T[:, -1], points, side.reshape(groups, -1)[:, 0], *seen.sizes)
    return found.R_sensor, found.T_sensor


def errors_in_closed_form(case: Case, probe_mm: float, rng: np.random.Generator) -> np.ndarray:
    """(B, 6) mm and rad, infinite where the method refuses a scan."""
    found = np.full((len(case.truth.rotation), 6), np.inf)
    for b, truth in enumerate(zip(case.truth.rotation, case.truth.translation, strict=True)):
        try:
            found[b] = pose_error(*in_closed_form(case, b, probe_mm, rng), *truth)
        except ValueError:
            continue
    return found
