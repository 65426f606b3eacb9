"""The joint calibration: exact without noise, efficient and honest with it, unmoved by outliers."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, f

from profilecal.closed_form.edge import edge_equations
from profilecal.closed_form.solve import closed_form
from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import angle_between, directions, rotations
from profilecal.joint.descent import estimate, refine
from profilecal.joint.noise import affine_noise
from profilecal.joint.problem import Problem
from profilecal.joint.search import search
from profilecal.joint.solve import solve
from profilecal.joint.state import State, normalised_square, pose_error
from profilecal.papers.edge_plan import EdgePlan
from profilecal.papers.edge_scenes import edge_scenes, observations_of, second_edge
from profilecal.simulate.scene import Scene, random_scene, stack
from profilecal.targets import TARGETS
from profilecal.targets.disk import Disk

KINDS = list(TARGETS)
SMALL = {"disk": {"positions": 20}}
SIGMA = 0.05
KNOWN = Noise(SIGMA, steering_mm=0.2)


@functools.cache
def many(kind: str, count: int, seed: int, **choices) -> Scene:
    """`count` random scenes as a batch."""
    rng = np.random.default_rng(seed)
    return stack([random_scene(kind, rng, count=10, **SMALL.get(kind, {}), **choices) for _ in range(count)])


def errors(state: State, truth: State) -> np.ndarray:
    return pose_error(state.rotation, state.translation, truth.rotation, truth.translation)


def assert_exact(error):
    """1e-9° and 1e-9 mm."""
    assert np.degrees(np.linalg.norm(error[..., 3:], axis=-1)).max() < 1e-9
    assert np.linalg.norm(error[..., :3], axis=-1).max() < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_noise_free_from_no_guess_at_all(kind):
    scene = many(kind, 200, 7)
    noise, found = Noise(SIGMA), []
    for i in range(200):
        one = scene.observations.take([i])
        fit = refine(Problem([one], noise), search([one], noise))
        found.append(fit.state[[np.argmin(fit.loss)]])
    assert_exact(errors(found[0].join(*found[1:]), scene.truth))


@pytest.mark.parametrize("kind", KINDS)
def test_noise_free_from_a_mount_guess(kind):
    """20° and 30 mm wrong. Descent alone does it nearly always, for a rod mostly; the others need the grid that `solve`
    adds."""
    scene = many(kind, 200, 7, spread_deg=20.0)
    rng, noise = np.random.default_rng(8), Noise(SIGMA)
    R = scene.truth.rotation @ rotations(np.radians(20) * directions(rng, (200,)))
    T = scene.truth.translation + 30 * directions(rng, (200,))
    problem = Problem([scene.observations], noise)
    near = refine(Problem([scene.observations], noise, in_space=True), problem.place(R, T)).state
    fit = refine(problem, near)
    lost = np.flatnonzero(fit.loss > 1e-9)
    assert len(lost) <= (60 if kind == "rod" else 20)
    for i in lost:
        solution = solve([scene.observations.take([i])], noise, starts=[(R[i], T[i])], robust=False)
        fit.state.rotation[i], fit.state.translation[i] = solution.rotation, solution.translation
    assert_exact(errors(fit.state, scene.truth))


def test_agrees_with_scipy_on_residuals_of_its_own():
    """scipy's least_squares on observed minus `Disk.meet`, with numerical derivatives."""
    rng = np.random.default_rng(9)
    scene = random_scene("disk", rng, positions=30)
    seen = scene.noisy(SIGMA, rng)
    fit = refine(Problem([seen], Noise(SIGMA)), scene.truth)

    def residual(x):
        R = scene.truth.rotation[0] @ Rotation.from_rotvec(x[3:6]).as_matrix()
        rotation, origin = (
            seen.R_flange[0] @ R,
            seen.R_flange[0] @ (scene.truth.translation[0] + x[:3]) + seen.T_flange[0],
        )
        normal = scene.target.normal + np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])[:2].T @ x[9:]
        disk = Disk(scene.truth.placements[0][0][0] + x[6:9], normal / np.linalg.norm(normal), *seen.sizes)
        return (seen.points[0] - disk.meet(rotation, origin)).ravel() / SIGMA

    x = least_squares(residual, np.zeros(11), jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    assert np.abs(fit.state.translation[0] - scene.truth.translation[0] - x[:3]).max() < 1e-6
    turned = scene.truth.rotation[0] @ Rotation.from_rotvec(x[3:6]).as_matrix()
    assert angle_between(fit.state.rotation[0], turned) < 1e-8
    np.testing.assert_allclose(fit.loss[0], (residual(x) ** 2).sum(), rtol=1e-10)


ROBOT = Noise(SIGMA, position_mm=0.03, orientation_deg=0.02, group_position_mm=0.2, group_orientation_deg=0.05)


@pytest.mark.parametrize("eye_to_hand", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_whitening_agrees_with_the_dense_covariance(kind, eye_to_hand):
    """The covariance of all residuals, written out, with pose errors differentiated numerically."""
    rng = np.random.default_rng(10)
    scene = random_scene(kind, rng, groups=3, positions=4, count=5)
    seen = replace(scene.noisy(0.3, rng), eye_to_hand=eye_to_hand)
    problem = Problem([seen], ROBOT)
    term, truth = problem.terms[0], scene.truth
    z = term.linearise(truth, truth.placements[0]).columns[0]
    N, K, P = z.shape

    def residuals(pose, component, h):
        turn, shift = np.eye(3), np.zeros(3)
        shift[component % 3] = h * (component < 3)
        if component >= 3:
            turn = Rotation.from_rotvec(h * np.eye(3)[component - 3]).as_matrix()
        R, T = seen.R_flange[0].copy(), seen.T_flange[0].copy()
        if eye_to_hand:  # (F exp(ε))⁻¹ = exp(-ε) F⁻¹
            R[pose], T[pose] = turn.T @ R[pose], turn.T @ (T[pose] - shift)
        else:
            R[pose], T[pose] = R[pose] @ turn, T[pose] + R[pose] @ shift
        moved = Problem([replace(seen, R_flange=R[None], T_flange=T[None])], ROBOT).terms[0]
        return moved.linearise(truth, truth.placements[0]).residual[0]

    h = 3e-6
    E = np.array([[(residuals(p, c, h) - residuals(p, c, -h)) / (2 * h) for c in range(6)] for p in range(P)])
    E = np.moveaxis(E, 1, -1).reshape(P, K * P, 6)  # by pose, residual, component
    C = SIGMA**2 * np.eye(K * P)
    for p in range(P):
        C += (E[p] * problem.of_pose) @ E[p].T
    for g in range(3):
        shared = E[seen.group == g].sum(axis=0)
        C += (shared * problem.of_group) @ shared.T
    flat = z.reshape(N, -1)
    expected = flat @ np.linalg.solve(C, flat.T)
    ours = problem.moments(truth).normal[0]
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(ours / size / size[:, None], expected / size / size[:, None], atol=1e-6)


CASES = [("edge", "arc"), ("edge", "space"), ("disk", "space"), ("ball", "space"), ("plane", "space")]


@pytest.mark.parametrize(("kind", "motion"), CASES)
def test_attains_the_cramer_rao_bound(kind, motion):
    rng = np.random.default_rng(11)
    scene = random_scene(kind, rng, motion=motion, count=20)
    trials = 400
    truth = scene.truth.repeat(trials)
    state, _, _ = estimate([scene.noisy(SIGMA, rng, trials)], Noise(SIGMA), truth)
    bound = estimate([scene.observations], Noise(SIGMA), scene.truth)[1].covariance[0]
    error = errors(state, truth)
    for part in (slice(0, 3), slice(3, 6)):
        rms = np.sqrt((error[:, part] ** 2).sum(axis=1).mean())
        assert 0.9 < rms / np.sqrt(np.trace(bound[part, part])) < 1.1


def of_unlike_precision(scene, rng):
    """Noisy observations of which each point has a covariance of its own, between 1/10 and 3 noise levels large."""
    clean = scene.observations
    *batch, m, _ = clean.points.shape
    if clean.on_curve:
        covariance = rng.uniform(0.1, 3, (*batch, m)) ** 2
        noise = np.sqrt(covariance)[..., None] * rng.normal(size=clean.points.shape)
    else:
        root = rng.uniform(0.1, 3, (*batch, 2 * m, 1)) * np.linalg.qr(rng.normal(size=(*batch, 2 * m, 2 * m)))[0]
        covariance = np.swapaxes(root, -1, -2) @ root
        noise = (rng.normal(size=(*batch, 1, 2 * m)) @ root).reshape(clean.points.shape)
    return replace(clean, points=clean.points + SIGMA * noise, covariance=covariance)


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_stated_uncertainty_is_honest_where_points_differ_in_precision(kind):
    """As below, and forgetting the covariances makes the errors larger."""
    trials = 300
    scene, rng = many(kind, trials, 12), np.random.default_rng(14)
    seen = of_unlike_precision(scene, rng)
    state, found, square = estimate([seen], Noise(SIGMA), scene.truth)
    error = errors(state, scene.truth)
    dof = int(Problem([seen], Noise(SIGMA)).count()[0]) - found.parameters
    assert abs(normalised_square(found.covariance, error).mean() - 6) < 3 * np.sqrt(12 / trials)
    assert abs((square / dof).mean() - 1) < 3 * np.sqrt(2 / dof / trials) + 1e-3
    forgotten = estimate([replace(seen, covariance=None)], Noise(SIGMA), scene.truth)[0]
    worse = errors(forgotten, scene.truth)
    assert (np.sqrt(np.mean(worse**2, axis=0)) > 1.2 * np.sqrt(np.mean(error**2, axis=0))).all()


@pytest.mark.parametrize("kind", ["edge", "disk", "ball", "plane"])
def test_equal_covariances_are_as_good_as_none(kind):
    rng = np.random.default_rng(15)
    scene = random_scene(kind, rng, count=10, **SMALL.get(kind, {}))
    plain = scene.noisy(SIGMA, rng)
    *batch, m, _ = plain.points.shape
    one = np.ones((*batch, m)) if plain.on_curve else np.broadcast_to(np.eye(2 * m), (*batch, 2 * m, 2 * m))
    first, second = (solve([seen], Noise(SIGMA)) for seen in (plain, replace(plain, covariance=one)))
    np.testing.assert_allclose(first.T_flange_sensor, second.T_flange_sensor, atol=1e-7)
    np.testing.assert_allclose(first.covariance, second.covariance, rtol=1e-6, atol=1e-6 * first.covariance.max())


def test_covariances_of_another_shape_are_refused():
    rng = np.random.default_rng(16)
    edge, point = (random_scene(kind, rng).observations for kind in ("edge", "point"))
    with pytest.raises(ValueError, match=r"covariance has shape \(250, 3, 3\); expected \(..., 250, 2, 2\)"):
        replace(edge, covariance=np.ones((250, 3, 3)))
    with pytest.raises(ValueError, match="a point has no covariance of its own"):
        replace(point, covariance=np.ones((20, 2, 2)))


@pytest.mark.parametrize("kind", KINDS)
def test_stated_uncertainty_is_honest(kind):
    """Over 1,000 random scenes: the normalised error squared averages 6, its 95 % regions hold, χ²/dof is one; the
    bounds are three standard errors. The same with the noise estimated, where F replaces χ²."""
    trials = 1000
    scene, rng = many(kind, trials, 12, steering_mm=0.2), np.random.default_rng(13)
    seen = scene.noisy(SIGMA, rng)
    state, found, square = estimate([seen], KNOWN, scene.truth)
    nees = normalised_square(found.covariance, errors(state, scene.truth))
    dof = int(Problem([seen], KNOWN).count()[0]) - found.parameters
    assert abs(nees.mean() - 6) < 3 * np.sqrt(12 / trials)
    assert 0.93 < (nees < chi2.ppf(0.95, 6)).mean() < 0.97
    assert abs((square / dof).mean() - 1) < min(0.05, 3 * np.sqrt(2 / dof / trials) + 1e-3)
    assert (found.status != "ok").mean() < 0.01

    scaled = nees / (square / dof)  # covariance with the noise that the residuals show
    mean, sd = f.stats(6, dof, moments="mv")
    assert abs(scaled.mean() / 6 - mean) < 3 * np.sqrt(sd / trials)
    assert 0.93 < (scaled / 6 < f.ppf(0.95, 6, dof)).mean() < 0.97


def test_smaller_errors_than_the_two_phase_edge_method():
    for motion, factor in (("arc", 5), ("space", 1.5)):
        scene = edge_scenes(EdgePlan(motion=motion), Noise(SIGMA), np.random.default_rng(14), (600,))
        seen = observations_of(scene)
        start = Problem([seen], Noise(SIGMA)).place(scene.R_sensor, scene.T_sensor)
        state, _, _ = estimate([seen], Noise(SIGMA), start)
        closed = edge_equations(scene.poses.rotations, scene.poses.positions, scene.points).R_sensor
        ours, theirs = (np.sqrt(np.mean(angle_between(R, scene.R_sensor) ** 2)) for R in (state.rotation, closed))
        assert theirs > factor * ours


def test_a_third_of_the_disk_methods_error_from_many_chords():
    """Median ratio of twelve random scenes, each of which has its own."""
    rng, trials, turn, shift = np.random.default_rng(15), 50, [], []
    for _ in range(12):
        scene = random_scene("disk", rng, positions=200)
        seen, truth = scene.noisy(SIGMA, rng, trials), scene.truth.repeat(trials)
        state, _, _ = estimate([seen], Noise(SIGMA), truth)
        R_closed, T_closed = closed_form(seen, scene.truth.rotation[0])
        ours, theirs = (np.sqrt(np.mean(angle_between(R, truth.rotation) ** 2)) for R in (state.rotation, R_closed))
        turn.append(ours / theirs)
        ours, theirs = (np.sqrt(np.mean((T - truth.translation) ** 2)) for T in (state.translation, T_closed))
        shift.append(ours / theirs)
    assert np.median(turn) < 0.35
    assert np.median(shift) < 0.35


@pytest.mark.parametrize("motion", ["arc", "space"])
def test_errors_common_to_a_rotation_group(motion):
    noise = Noise(SIGMA, group_position_mm=0.2)
    scene = edge_scenes(EdgePlan(motion=motion), noise, np.random.default_rng(16), (200,))
    seen = observations_of(scene)
    problem = Problem([seen], noise)
    state, found, square = estimate([seen], noise, problem.place(scene.R_sensor, scene.T_sensor))
    closed = edge_equations(scene.poses.rotations, scene.poses.positions, scene.points).R_sensor
    ours, theirs = (np.sqrt(np.mean(angle_between(R, scene.R_sensor) ** 2)) for R in (state.rotation, closed))
    assert ours < 0.7 * theirs
    dof = int(problem.count()[0]) - problem.n
    assert 0.9 < (square / dof).mean() < 1.1
    nees = normalised_square(
        found.covariance, pose_error(state.rotation, state.translation, scene.R_sensor, scene.T_sensor)
    )
    assert abs(nees.mean() - 6) < 3 * np.sqrt(12 / 200)


@pytest.mark.parametrize("choices", [{"motion": "line"}, {"tilt_deg": 0.0}, {"frame": "tool"}], ids=str)
def test_motions_that_leave_the_two_phase_method_without_rank_are_solved_and_honest(choices):
    """Straight lines, arcs whose plane contains the edge, arcs that turn with the tool."""
    trials = 300
    scene = edge_scenes(EdgePlan(**choices), Noise(SIGMA), np.random.default_rng(23), (trials,))
    seen = observations_of(scene)
    start = Problem([seen], Noise(SIGMA)).place(scene.R_sensor, scene.T_sensor)
    state, found, _ = estimate([seen], Noise(SIGMA), start)
    error = pose_error(state.rotation, state.translation, scene.R_sensor, scene.T_sensor)
    nees = normalised_square(found.covariance, error)
    assert abs(nees.mean() - 6) < 3 * np.sqrt(12 / trials)
    closed = edge_equations(scene.poses.rotations, scene.poses.positions, scene.points).R_sensor
    assert np.median(angle_between(closed, scene.R_sensor)) > 5 * np.median(np.linalg.norm(error[:, 3:], axis=1))


def with_second_edge(plan, what, rng):
    """An edge scene of which a tenth of the points, or 5 of 25 groups, lie on a second edge 10 mm away."""
    planted = np.zeros((25, 10), dtype=bool)
    if what == "points":
        planted.flat[rng.choice(250, 25, replace=False)] = True
    else:
        planted[rng.choice(25, 5, replace=False)] = True
    scene = second_edge(plan, Noise(SIGMA), planted, rng)
    return scene, observations_of(scene), planted.ravel()


@pytest.mark.parametrize("what", ["points", "groups"])
def test_bad_points_and_groups_are_found_and_left_out(what):
    rng, trials = np.random.default_rng(17), 40
    error, exact = [], 0
    for _ in range(trials):
        scene, seen, planted = with_second_edge(EdgePlan(motion="space"), what, rng)
        found = solve([seen], Noise(SIGMA))
        error.append(pose_error(found.rotation, found.translation, scene.R_sensor, scene.T_sensor))
        exact += (found.rejected[0] == planted).all()
    error = np.array(error)
    assert np.degrees(np.median(np.linalg.norm(error[:, 3:], axis=1))) < 0.15
    assert np.median(np.linalg.norm(error[:, :3], axis=1)) < 0.12
    assert exact >= 0.95 * trials


def test_noise_is_estimated_and_said_how():
    rng = np.random.default_rng(18)
    edge = random_scene("edge", rng).noisy(SIGMA, rng)
    level, freedom = affine_noise(edge)
    assert freedom == 25 * (10 - 4) * 2
    assert abs(level / SIGMA - 1) < 4 * np.sqrt(0.5 / freedom) * np.sqrt(np.pi / 2)  # of a median over the groups
    found = solve([edge])
    assert found.noise_source == "estimated"
    assert "rotation groups" in found.level.how
    ball = solve([random_scene("ball", rng, count=20).noisy(SIGMA, rng)])
    assert ball.level.how == "from the residuals"
    assert abs(ball.noise_mm / SIGMA - 1) < 4 * np.sqrt(0.5 / ball.dof)
    assert abs(ball.chi2_per_dof - 1) < 1e-6


def test_two_targets_together_know_more_than_either_alone():
    rng, inside = np.random.default_rng(19), []
    for _ in range(20):
        mount = rotations(rng.normal(size=3)), rng.uniform(-100, 100, 3)
        edge = random_scene("edge", rng, mount=mount, groups=8).noisy(SIGMA, rng)
        ball = random_scene("ball", rng, mount=mount, groups=4, count=20).noisy(SIGMA, rng)
        alone, other, both = (solve(o, Noise(SIGMA)) for o in ([edge], [ball], [edge, ball]))
        assert (both.observability.sd < np.minimum(alone.observability.sd, other.observability.sd)).all()
        inside.append(normalised_square(both.covariance, pose_error(both.rotation, both.translation, *mount)))
    assert abs(np.mean(inside) - 6) < 3 * np.sqrt(12 / 20)
    assert len(both.placements) == 2


def test_eye_to_hand_is_the_same_problem_with_the_poses_inverted():
    rng = np.random.default_rng(20)
    scene = random_scene("ball", rng, count=10)
    found = solve([replace(scene.noisy(SIGMA, rng), eye_to_hand=True)], ROBOT)
    assert normalised_square(found.covariance, pose_error(found.rotation, found.translation, *mount_of(scene))) < 30


def mount_of(scene):
    return scene.truth.rotation[0], scene.truth.translation[0]


def test_missing_points_are_left_out():
    rng = np.random.default_rng(21)
    scene = random_scene("ball", rng, count=20)
    seen = scene.noisy(SIGMA, rng)
    gaps = rng.uniform(size=seen.points.shape[:-1]) < 0.3
    points = np.where(gaps[..., None], np.nan, seen.points)
    found = solve([replace(seen, points=points)], Noise(SIGMA))
    assert found.dof == (~gaps).sum() - 9
    assert normalised_square(found.covariance, pose_error(found.rotation, found.translation, *mount_of(scene))) < 30


def test_guards_say_what_is_wrong():
    rng = np.random.default_rng(22)
    good = random_scene("ball", rng, groups=2, positions=2, count=3).observations
    with pytest.raises(ValueError, match="kind is 'cone'; expected one of edge"):
        replace(good, kind="cone")
    with pytest.raises(ValueError, match="the ball's radius is None; expected a length in mm"):
        replace(good, sizes=())
    with pytest.raises(
        ValueError, match=r"points of the disk have shape \(1, 4, 3, 2\); expected \(..., poses, 2, 2\)"
    ):
        replace(good, kind="disk")
    with pytest.raises(ValueError, match=r"T_flange has shape \(1, 3, 3\)"):
        replace(good, T_flange=good.T_flange[:, :3])
    with pytest.raises(ValueError, match="R_flange holds a value that is not finite"):
        replace(good, R_flange=good.R_flange * np.nan)
    with pytest.raises(ValueError, match=r"group has shape \(1,\); expected \(4,\)"):
        replace(good, group=np.zeros(1))
    with pytest.raises(ValueError, match="no observations given"):
        solve([])
    with pytest.raises(ValueError, match="profile_mm is -1"):
        solve([good], Noise(-1))
    few = random_scene("point", rng, groups=3).observations
    with pytest.raises(UnobservableError, match="9 measured coordinates cannot determine 9 unknowns; add poses"):
        solve([few], Noise(SIGMA))
