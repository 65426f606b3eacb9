"""One scan solved as the papers do it: the rotation first, then the translation.

Edge: Eqs 5-35 of the edge paper. Disk: Eqs 4-20 of the disk paper. Ball: Section V-D of the disk paper,
with the differences inside every rotation group in place of those of one. The covariance comes from repetitions
with simulated noise and robot errors, so that it counts the methods' bias.
"""

from dataclasses import asdict, replace
from functools import partial

import numpy as np

from profilecal.closed_form.disk import best_signs, disk_equations, sensing_data, solve_disk_from_chords
from profilecal.closed_form.edge import edge_equations, solve_edge
from profilecal.closed_form.two_step import check_directions, check_orientations, solve_rotation, solve_translation
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.noise import Noise, Systematic
from profilecal.geometry.poses import carry, rotations
from profilecal.joint.descent import settle_targets
from profilecal.joint.field import field_over
from profilecal.joint.levels import Likelihood, likeliest
from profilecal.joint.noise import NoiseLevel, affine_noise
from profilecal.joint.observability import explain, of_covariance
from profilecal.joint.observations import Observations
from profilecal.joint.problem import Problem
from profilecal.joint.sharing import Sharing, sharing
from profilecal.joint.solution import Solution, solution_of
from profilecal.joint.state import pose_error
from profilecal.targets.ball import Ball


def closed_form(seen: Observations, R_sensor, heights: str = "published") -> tuple[np.ndarray, np.ndarray]:
    """What the papers' methods make of a batch of edge or disk observations: (B, 3, 3) and (B, 3).

    R_sensor (3, 3) gives the signs s_i of the disk method, which its user knows; `heights`: see `sensing_data`.
    """
    B, G = len(seen.points), seen.group.max() + 1
    R = np.broadcast_to(seen.R_flange, (B, *seen.R_flange.shape[1:])).reshape(B, G, -1, 3, 3)
    T = np.broadcast_to(seen.T_flange, (B, *seen.T_flange.shape[1:])).reshape(B, G, -1, 3)
    points = seen.points.reshape(B, G, -1, *seen.points.shape[2:])
    if seen.kind == "edge":
        found = edge_equations(R[:, :, 0], T, points[:, :, :, 0])
        return found.R_sensor, found.T_sensor
    start, end = T[:, :, 0], T[:, :, -1]
    s = np.sign(np.einsum("bga,bga->bg", end - start, (R[:, :, 0] @ R_sensor)[..., 1]))
    data = sensing_data(points, start, end, s, seen.sizes[0], heights)
    found = disk_equations(R[:, :, 0], data.T_tcp, data.q, data.D_i, data.D_b)
    return found.R_sensor, found.T_sensor


DRAWS = 200  # repetitions with simulated noise
LEAST_POSITIONS = 3  # in a rotation group
STRAIGHT = 0.01  # of a disk scan's length: the most by which its flange positions may leave equal steps on a line


def solve_in_closed_form(observations: Observations, level: NoiseLevel, side, rng: np.random.Generator) -> Solution:
    """The sensor pose from one target's observations (a batch of one), stated as a joint solution is.

    side (P,): +1, -1, or 0 where it is not known, as in the scan folder.

    Raises ValueError for a target or a motion that no paper's method takes, UnobservableError for poses that cannot
    determine the answer.
    """
    if observations.kind not in METHODS:
        raise ValueError(f"the papers have no closed form for a {observations.kind}; expected the method joint")
    points = observations.points[0]
    side = np.asarray(side, dtype=float)
    find, remarks = METHODS[observations.kind](observations, side)
    (rotation,), (translation,) = find(observations)

    alone = Problem([observations], Noise(profile_mm=1.0))
    state = settle_targets(alone, rotation[None], translation[None])
    dof = int(alone.count()[0]) - alone.n
    seen_noise = max(float(np.sqrt(alone.moments(state).loss[0] / dof)), 1e-12)  # the robot's errors too
    if level.unknown:
        level = replace(level, noise=replace(level.noise, profile_mm=seen_noise))
    everything, accuracy = [np.ones(len(points), dtype=bool)], level.accuracy
    problem = alone.with_noise(level.noise)
    noise = level.noise
    if level.prior:
        model = Likelihood(problem, state, everything, level.prior.with_scanner(noise.profile_mm))
        noise = model.noise_of(model.sizes(likeliest(model, asdict(noise))))
        level = replace(level, noise=noise, systematic=Systematic())
        problem = problem.with_noise(noise)
    moments = problem.moments(state)

    shared = sharing([observations])
    errors = pose_error(rotation, translation, *find(erring(observations, shared, noise, rng)))
    size = np.sqrt(np.diag(moments.normal[0])[:-1])
    rank = np.linalg.matrix_rank(moments.normal[0, :-1, :-1] / np.outer(size, size), hermitian=True)
    found = of_covariance(errors.T @ errors / DRAWS, rank, problem.n)
    R_flange = np.asarray(observations.R_flange).reshape(-1, 3, 3)
    messages = [*remarks, *explain(found, rotation, R_flange, "base" if observations.eye_to_hand else "flange")]
    bias = errors.mean(axis=0)
    turn, shift = np.degrees(np.linalg.norm(bias[3:])), np.linalg.norm(bias[:3])
    messages.append(
        f"noise biases the closed form by about {shift:.2g} mm and {turn:.2g}° here, which its standard deviations "
        "include; the joint method has no such bias"
    )
    solution = solution_of(problem, state, moments, everything, level, found, str(found.status), messages)
    if not accuracy:
        return solution
    field = field_over(shared, rotation, translation, observations.eye_to_hand)
    return replace(solution, unseen=field.common(*accuracy.values()))


def erring(observations: Observations, shared: Sharing, noise: Noise, rng: np.random.Generator) -> Observations:
    """A batch of the observations as other errors of that size would make them: of the points, and of the poses."""
    errors, noises = np.zeros((DRAWS, len(observations.labels), 6)), []
    for draw in errors:
        member = np.arange(len(draw))
        for variances, belongs in shared.levels(noise):
            draw += (np.sqrt(variances) * rng.normal(size=(len(belongs), 6)))[member]
            member = belongs[member]
        noises.append(noise_like(observations, rng))
    R, T = observations.R_flange, observations.T_flange
    moved = T + (R @ errors[..., :3, None])[..., 0]
    points = observations.points + noise.profile_mm * np.array(noises)
    return replace(observations, R_flange=R @ rotations(errors[..., 3:]), T_flange=moved, points=points)


def noise_like(observations: Observations, rng: np.random.Generator) -> np.ndarray:
    """Errors (P, m, 2) of the observed points as their covariance has them, in units of the noise."""
    points = observations.points[0]
    errors = rng.normal(size=points.shape)
    if observations.covariance is None:
        return circles_alike(points, errors) if observations.on_curve else errors
    if observations.on_curve:
        return errors * np.sqrt(observations.covariance[0])[..., None]
    root = np.linalg.cholesky(observations.covariance[0])
    return (root @ errors.reshape(len(points), -1, 1)).reshape(points.shape)


def circles_alike(points, errors) -> np.ndarray:
    """Errors (P, 3, 2) of three points that stand for a circle whose x, z and r err alike, from independent ones; the
    radial ones keep their size."""
    outward = points - points.mean(axis=1, keepdims=True)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    return (errors[:, :1] + errors[:, 1:2, :1] * outward) / np.sqrt(2)


def groups_of(observations: Observations, least: int) -> list[np.ndarray]:
    """The poses (k,) of each rotation group with `least` positions or more, in order."""
    group = observations.labels
    members = [np.flatnonzero(group == label) for label in range(group.max() + 1)]
    return [rows for rows in members if len(rows) >= least]


def many_groups(observations: Observations, what: str) -> list[np.ndarray]:
    """The groups that a method of whole groups can use; three at least."""
    groups = groups_of(observations, LEAST_POSITIONS)
    if len(groups) < 3:
        raise UnobservableError(
            f"{len(groups)} of the flange orientations have {LEAST_POSITIONS} {what} or more; the closed form needs 3: "
            "add poses that share an orientation, or use the method joint, which needs no groups"
        )
    return groups


def unused(observations: Observations, groups) -> list[str]:
    """A remark on the poses that are in none of the groups."""
    left = observations.points.shape[-3] - sum(map(len, groups))
    return [f"{left} poses are in no group of {LEAST_POSITIONS} or more, which the closed form needs"] if left else []


def from_edge(observations: Observations, side):
    """The edge paper's method on groups of any size: those with fewer positions than the largest are filled up with
    their own mean, for which the same equations hold, as the sensed point is affine in the position."""
    groups = many_groups(observations, "positions")
    most = max(map(len, groups))

    def filled(values):
        own = (values[:, g] for g in groups)
        return np.stack([np.hstack([v, *[v.mean(axis=1, keepdims=True)] * (most - v.shape[1])]) for v in own], axis=1)

    def arranged(seen):
        return seen.R_flange[:, [g[0] for g in groups]], filled(seen.T_flange), filled(seen.points[:, :, 0])

    solve_edge(*(batch[0] for batch in arranged(observations)), affine_noise(observations)[0] or None)

    def find(seen):
        found = edge_equations(*arranged(seen))
        return found.R_sensor, found.T_sensor

    return find, unused(observations, groups)


def from_disk(observations: Observations, side):
    """The disk paper's method; each group is a scan along a line, its chords at equal steps."""
    groups = many_groups(observations, "chords")
    T = observations.T_flange[0]
    for g in groups:
        even = np.linspace(T[g[0]], T[g[-1]], len(g))
        off, length = np.linalg.norm(T[g] - even, axis=1).max(), np.linalg.norm(T[g[-1]] - T[g[0]])
        if off > STRAIGHT * length:
            raise UnobservableError(
                f"the {len(g)} flange positions of one orientation leave equal steps on a line by {off:.2g} mm, which "
                "the disk's closed form needs; drive straight at a steady speed, or use the method joint"
            )

    first, last = ([g[k] for g in groups] for k in (0, -1))

    def arranged(seen):
        return seen.R_flange[:, first], seen.T_flange[:, first], seen.T_flange[:, last]

    def scans(seen, s):
        R, *ends = arranged(seen)
        data = [
            sensing_data(seen.points[:, g], *(end[:, k] for end in ends), s[k], observations.sizes[0])
            for k, g in enumerate(groups)
        ]
        return R, *(np.stack([getattr(d, name) for d in data], axis=1) for name in ("T_tcp", "q", "D_i", "D_b"))

    s, remarks = np.array([side[g[0]] for g in groups]), []
    if not s.all():
        R, _, _, D_i, D_b = (batch[0] for batch in scans(observations, np.ones(len(groups))))
        s, _ = best_signs(D_i.T, np.einsum("nba,nb->an", R, D_b))
        remarks = [f"sides of the motions decided from the data: {', '.join(f'{v:+.0f}' for v in s)}"]
    tips = [observations.points[0, g] for g in groups]
    ends = (batch[0] for batch in arranged(observations))
    remarks += solve_disk_from_chords(*ends, tips, s, observations.sizes[0]).remarks

    def find(seen):
        found = disk_equations(*scans(seen, s))
        return found.R_sensor, found.T_sensor

    return find, [*remarks, *unused(observations, groups)]


def from_ball(observations: Observations, side):
    """The two-step ball method: differences of centres inside groups, then all poses."""

    def centres(points, side=side):
        there = np.isfinite(points[0]).all(axis=-1)
        if there.all():
            circles = fit_circle(points)
        else:
            circles = np.stack([fit_circle(points[:, k, seen]) for k, seen in enumerate(there)], axis=1)
        return Ball(np.zeros(3), observations.sizes[0]).centre_from_circle(circles, side)

    if side.all():
        return from_centres(observations, centres), []
    R, T, tried = observations.R_flange[0], observations.T_flange[0], []
    for sign in (1.0, -1.0):
        seen = partial(centres, side=np.full(len(T), sign))
        find = from_centres(observations, seen)
        (rotation,), (translation,) = find(observations)
        places = carry(R, T, seen(observations.points)[0] @ rotation.T + translation)
        tried.append((float(np.sqrt(places.var(axis=0).sum())), sign, find))
    (least, sign, find), (more, _, _) = sorted(tried, key=lambda entry: entry[0])
    return find, [
        f"the ball's centre is taken to lie on side {sign:+.0f} of every scan plane, which leaves {least:.2g} mm "
        f"between its places, against {more:.2g} mm on the other; a column side says it pose by pose"
    ]


def from_centres(observations: Observations, centres):
    """Both steps; `centres` gives the ball's centre (B, P, 3) in the sensor frame from points (B, P, m, 2)."""
    groups = groups_of(observations, 1)
    moved = np.array([(g[0], k) for g in groups for k in g[1:]]).reshape(-1, 2)
    if len(moved) < 2:
        raise UnobservableError(
            f"the closed form takes the rotation from motions without a turn, and there are {len(moved)}; expected 2 "
            "or more: add poses that share an orientation, or use the method joint, which needs none"
        )
    i, j = moved.T

    def motions(seen):
        R, T = seen.R_flange, seen.T_flange
        Y = np.einsum("znba,znb->zan", R[:, i], T[:, j] - T[:, i])
        length = np.linalg.norm(Y, axis=1, keepdims=True)
        return Y / length, length, R[:, [g[0] for g in groups]]

    (Y,), _, (R_first,) = motions(observations)
    check_directions(Y, "motion inside a group of one orientation")
    check_orientations(R_first)

    def find(seen):
        Y, length, R_first = motions(seen)
        q = centres(seen.points)
        rotation = solve_rotation(np.swapaxes(q[:, i] - q[:, j], 1, 2) / length, Y).R_sensor
        T_mean, q_mean = (np.stack([v[:, g].mean(axis=1) for g in groups], axis=1) for v in (seen.T_flange, q))
        return rotation, solve_translation(R_first, T_mean, q_mean, rotation, "all").T_sensor

    return find


METHODS = {"edge": from_edge, "disk": from_disk, "ball": from_ball}
