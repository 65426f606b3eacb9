"""One linear Gaussian model, against the covariance of all residuals written out, and
each answer by brute force.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from many_scenes import KINDS, SIGMA
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal
from simulated import state_of, with_values

import profilecal as pc
from profilecal.calibration.observe import observe_all
from profilecal.calibration.plausibility import robot_patterns
from profilecal.geometry.fitting import fit_circle
from profilecal.geometry.noise import ROBOT, SMOOTH, Noise
from profilecal.geometry.poses import inverse, rotations
from profilecal.joint.linear_model import linear_model
from profilecal.joint.pose_groups import PoseGroups
from profilecal.joint.prior import OF_SCANNER, of_target
from profilecal.joint.problem import FLANGE, Problem
from profilecal.joint.restricted_likelihood import gradient
from profilecal.simulation.scene import random_scene

PROFILES = np.arange(9)
# variances of the scanner and the robot, mm² and degrees²
V = np.array([1.3, 0.4, 0.9, 0.7, 0.5, 0.3, 0.2])
N = 4
JITTER = "jitter_ms"


def random_groups(profiles, poses, rng):
    """Profiles in poses and poses in four orientations, some of them alone."""
    pose = np.unique(rng.integers(0, poses, profiles), return_inverse=True)[1]
    labels = rng.integers(0, 4, pose.max() + 1)
    orientation = np.unique(labels, return_inverse=True)[1]
    return PoseGroups(pose, orientation, orientation[pose])


# poses of one, two and three profiles, an orientation of two poses
GROUPS = random_groups(len(PROFILES), 8, default_rng(6))


@dataclass(frozen=True)
class Smooth:
    """Errors that are smooth, of which only steps remember which profiles are kept."""

    left: np.ndarray  # (2, profiles, 6, 7), of smooth errors, then of bends
    bends: bool = False
    steps: int = len(PROFILES)
    count: int = 7

    def columns(self, by_flange, profiles):
        return by_flange @ self.left[int(self.bends), profiles]

    def keeping(self, kept):
        return replace(self, steps=int(kept.sum()))


class Dense:
    """A random model, and its residuals r, derivatives A and covariance written out."""

    def __init__(self, rank=5, groups=GROUPS, names=ROBOT, smooth=False):
        """Of two targets: the first five profiles have five residuals each, of which an
        error of the flange can move `rank`, all others have three. `smooth`: whether
        errors vary smoothly too. Where clocks jitter, the first column of A is the
        derivative by time.
        """
        rng = default_rng(1)
        counts = np.full(len(groups.pose), 3)
        counts[:5] = 5
        there = np.arange(5) < counts[:, None]  # of the padded residuals
        units = np.array([1, 1, 1, 60, 60, 60])  # a degree moves as much as a mm
        E = rng.normal(size=(*there.shape, 6))
        E[:5] = rng.normal(size=(5, 5, rank)) @ rng.normal(size=(5, rank, 6))
        Y = rng.normal(size=(*there.shape, N + 1))
        clock = 0 if JITTER in names else None
        if JITTER in names:  # time moves the residuals as the flange's motion does
            Y[..., 0] = 30 * (E @ rng.normal(size=(len(counts), 6, 1)))[..., 0]
        E, Y = (columns * there[..., None] for columns in (units * E, Y))
        root = rng.normal(size=(N, N))
        self.precision = root @ root.T
        left = rng.normal(size=(2, len(counts), 6, 7)) / units[:, None]
        errors = Smooth(left) if smooth else None
        known = names, self.precision, clock, errors
        self.model = linear_model(E, Y, counts, groups, *known)
        self.profile = np.nonzero(there)[0]  # of each residual
        self.A, self.r, E = Y[there, :N], Y[there, N], E[there]
        # what the covariance is a sum of, one for each error
        self.parts = [np.eye(len(E))]
        for name in names:
            Z = E[:, :3] if name.endswith("mm") else np.radians(E[:, 3:])
            if name == JITTER:
                Z = 1e-3 * self.A[:, :1]
            number = groups.sharing(name)[self.profile]
            self.parts.append(Z @ Z.T * np.equal.outer(number, number))
        if smooth:
            B, self.bends = (E[:, None] @ left[:, self.profile])[:, :, 0]
            self.parts.append(B @ B.T)

    def of(self, profiles, v=V):
        """r, A and C of some profiles."""
        rows = np.isin(self.profile, profiles)
        C = np.tensordot(v, self.parts, 1)
        return self.r[rows], self.A[rows], C[np.ix_(rows, rows)]


def textbook(r, A, C, precision):
    """x̂, V, P r and P."""
    W = np.linalg.inv(C)
    covariance = np.linalg.inv(A.T @ W @ A + precision)
    mean = -covariance @ A.T @ W @ r
    return mean, covariance, W @ (r + A @ mean), W - W @ A @ covariance @ A.T @ W


def test_errors_that_may_be_larger_change_the_posterior_as_another_prior_does():
    precision = np.diag([4.0, 1.0, 3.0, 2.0])
    model = replace(Dense(2).model, precision=precision, may_be_poor=range(1, 4))
    posterior = model.posterior(np.array([V, 2 * V]))
    times = np.array([[1.0, 10, 1, 0.1], [1, 1, 1, 1]])
    for own, gain, x, covariance in zip(
        times, *model.rescaled(posterior, times), strict=True
    ):
        larger = replace(model, precision=precision / np.outer(own, own))
        other = larger.posterior(posterior.v)
        assert_allclose(x, other.mean, rtol=1e-9)
        assert_allclose(covariance, other.covariance, rtol=1e-9)
        by_prior = other.log_evidence - posterior.log_evidence - np.log(own).sum()
        assert_allclose(gain, by_prior, atol=1e-9)


@pytest.mark.parametrize("kept", [PROFILES, PROFILES[1:]], ids=["all", "some"])
def test_bends_add_what_they_do_to_a_mean_that_ignores_them(kept):
    dense, v = Dense(smooth=True), np.append(V, 0.6)
    r, A, C = dense.of(kept, v)
    bends = dense.bends[np.isin(dense.profile, kept)]
    without, *_ = textbook(r, A, C, dense.precision)
    moves = [textbook(r + bend, A, C, dense.precision)[0] - without for bend in bends.T]
    found = dense.model.keeping(np.isin(PROFILES, kept)).by_bends(v)
    assert_allclose(found, v[-1] * np.transpose(moves) @ moves, rtol=1e-8)


@pytest.mark.parametrize("poses", [8, 30, 300], ids=["crowded", "mixed", "alone"])
@pytest.mark.parametrize("also", ["", JITTER, SMOOTH])
@pytest.mark.parametrize("zero", [False, True])
def test_the_structure_gives_the_answers_of_the_dense_covariance(
    poses, zero, also, monkeypatch
):
    """And the evidence, its gradient and average information: of uneven groups, some of
    one profile, profiles left out, variances of zero; smooth errors are further
    unknowns there, and a part of the covariance here.

    Evidence: the law of r where x is integrated out, N(0, C + A Π⁻¹ Aᵀ), but for
    constants.
    """
    if zero:  # sets of variances are then looked at one after the other, in bundles
        monkeypatch.setattr("profilecal.joint.linear_model.AT_ONCE", 1)
    rng = default_rng(poses)
    groups = random_groups(60, poses, rng)
    names = [name for name in ROBOT if name in groups.distinguishable]
    names += [JITTER] * (also == JITTER)
    dense = Dense(2, groups, names, also == SMOOTH)
    model = dense.model
    v = np.r_[1.0, rng.uniform(0, 1, len(dense.parts) - 1)]
    if zero:
        v[[1, -1]] = 0.0
    for kept in (rng.uniform(size=60) > 0.2, np.full(60, True)):
        r, A, C = dense.of(np.flatnonzero(kept), v)
        mean, covariance, w, P = textbook(r, A, C, dense.precision)
        rows = kept[dense.profile]
        parts = [M[np.ix_(rows, rows)] for M in dense.parts]
        moved = np.array([M @ w for M in parts])
        information = moved @ P @ moved.T / 2
        if also == SMOOTH:  # the curvature itself
            PM = P @ parts[-1]
            information[-1, -1] *= 2
            information[-1, -1] -= np.sum(PM * PM.T) / 2
        expected = (
            mean,
            covariance,
            (moved @ w - [np.sum(P * M) for M in parts]) / 2,
            information,
        )
        model = model.keeping(kept)
        assert also != SMOOTH or model.smooth.steps == kept.sum()
        posterior = model.posterior(np.array([v, 2 * v]))
        of_one = posterior.mean[0, :N], posterior.covariance[0, :N, :N]
        found = *of_one, *gradient(model, model.posterior(v[None]))
        for ours, right in zip(found, expected, strict=True):
            atol = 1e-9 * np.abs(right).max()
            assert_allclose(ours, right, rtol=0, atol=atol)
        assert posterior.square[0] == pytest.approx(r @ w)
        prior = A @ np.linalg.inv(dense.precision) @ A.T
        once, twice = (multivariate_normal(cov=k * C + prior).logpdf(r) for k in (1, 2))
        assert np.diff(posterior.log_evidence)[0] == pytest.approx(twice - once)
        none = np.zeros((1, len(v)))
        none[0, 0] = 1.0
        mean, _, _, _ = textbook(r, A, np.eye(len(r)), dense.precision)
        exact = model.without_fresh().posterior(none)
        for found in (model.posterior(none), exact):
            assert_allclose(found.mean[0, :N], mean, rtol=1e-8)
        assert_allclose(exact.log_evidence, model.posterior(none).log_evidence)


@pytest.mark.parametrize("is_kept", [True, False])
@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_left_out_is_predicted_as_by_the_model_without_it(profile, is_kept):
    """With the errors that it shares with others, where it is kept; as a new one, where
    it is not.
    """
    dense = Dense()
    r, A, C = dense.of(np.delete(PROFILES, profile))
    r_own, A_own, C_own = dense.of(profile)
    mean, covariance, _, _ = textbook(r, A, C, dense.precision)
    # the others' residuals say what the shared errors are
    own = dense.profile == profile
    common = is_kept * dense.of(PROFILES)[2][np.ix_(own, ~own)]
    shared = common @ np.linalg.inv(C)
    slope = A_own - shared @ A
    error = r_own + A_own @ mean - shared @ (r + A @ mean)
    S = C_own - shared @ common.T + slope @ covariance @ slope.T
    model = dense.model.keeping(is_kept | (profile != PROFILES))
    square = model.left_out(model.posterior(V[None]))[profile]
    assert square == pytest.approx(error @ np.linalg.solve(S, error))


def erring(seen, error, h: float):
    """Observations with an error of size h; eye-to-hand, poses are of the base in the
    flange's frame.
    """
    if error.length:
        sizes = np.array(seen.sizes)
        sizes[error.length[2]] += h
        return replace(seen, sizes=tuple(sizes))
    if error.points:
        return replace(seen, points=wrongly_seen(seen.points, error, h))
    return with_flange(seen, lambda R, T: (R, T + h * error.positions(T)))


def wrongly_seen(points, error, h):
    """Points (..., 2) with an error of the scanner of size h."""
    x, z = np.moveaxis(points, -1, 0)
    return points + h * np.stack(error.points(x, z), axis=-1)


def with_flange_error(seen, axes, component: int, h: float):
    """Observations from flanges shifted along, or turned about, one of the sensor's
    axes (P, 3, 3), flange frame.
    """
    error = h * axes[:, :, component % 3]
    if component < 3:
        return with_flange(seen, lambda R, T: (R, T + (R @ error[..., None])[..., 0]))
    return with_flange(seen, lambda R, T: (R @ rotations(error), T))


def with_flange(seen, change):
    """Observations from flanges whose poses in the base are changed."""
    R, T = seen.R_flange[0], seen.T_flange[0]
    if seen.eye_to_hand:
        R, T = inverse(R, T)
    R, T = change(R, T)
    if seen.eye_to_hand:
        R, T = inverse(R, T)
    return replace(seen, R_flange=R[None], T_flange=T[None])


def assert_derivative(column, changed, state):
    """A column (K, P) is the derivative of the residuals at a state, by differences, as
    `changed` (h) changes the observations.
    """
    h = 1e-5
    terms = [Problem([changed(step)], Noise(1.0)).terms[0] for step in (h, -h)]
    plus, minus = (term.linearise(state, *state.placements)[0, -1] for term in terms)
    expected = (plus - minus) / (2 * h)
    assert_allclose(column, expected, atol=1e-4 * max(1, np.abs(expected).max()))


@pytest.mark.parametrize("eye_to_hand", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_by_all_that_may_be_wrong_are_those_of_differences(
    kind, eye_to_hand
):
    """The data are exact, so that points are where the state has them."""
    rng = default_rng(10)
    scene = random_scene(kind, rng, groups=3, positions=4, count=5)
    seen = replace(scene.observations, eye_to_hand=eye_to_hand)
    truth = scene.truth
    problem = Problem([seen], Noise(SIGMA))
    tried = [*OF_SCANNER, *of_target([seen]), *robot_patterns(problem)]
    ((columns,),) = problem.columns_in_mm(truth, tried)
    for column, error in zip(columns[problem.n :], tried, strict=False):
        assert_derivative(column, partial(erring, seen, error), truth)

    axes = np.broadcast_to(truth.rotation[0], seen.R_flange[0].shape)
    if eye_to_hand:
        # the sensor stands in the base, and poses are of the base in the flange's frame
        axes = seen.R_flange[0] @ axes
    sign = -1 if eye_to_hand else 1  # of an error that is as likely either way
    for component, column in enumerate(columns[FLANGE]):
        changed = partial(with_flange_error, seen, axes, component)
        assert_derivative(sign * column, changed, truth)


def test_derivatives_are_those_where_the_state_has_the_points():
    """At noisy points they would follow the noise, and all lengths look too small: of a
    rod all do.
    """
    rng = default_rng(0)
    scene = random_scene("rod", rng)
    seen = scene.noisy(1e-3, rng)  # mm: its square is less than what is looked for
    (term,), truth = Problem([seen], Noise(SIGMA)).terms, scene.truth
    moved = term.on_target(term.linearise(truth, *truth.placements)).seen
    there = replace(seen, points=moved.transpose(1, 3, 2, 0))
    problems = [Problem([one], Noise(SIGMA)) for one in (seen, there)]
    (noisy,), (exact,) = (
        problem.columns_in_mm(scene.truth, OF_SCANNER) for problem in problems
    )
    differ = np.abs(noisy - exact).max(axis=(0, 2, 3)) > 1e-6
    assert np.flatnonzero(differ) == noisy.shape[1] - 7  # the residual alone


def test_a_length_of_one_target_is_not_that_of_another():
    """But several scans of one target have one error of it."""
    rng = default_rng(10)
    scenes = [random_scene(kind, rng) for kind in ("ball", "rod", "rod")]
    seen = [scene.observations for scene in scenes]
    problem, truth = Problem(seen, Noise(SIGMA)), scenes[0].truth
    state = problem.place(truth.rotation, truth.translation)
    errors = of_target(seen)
    columns = problem.columns_in_mm(state, errors)
    by_error = [z[0, problem.n : -7].any(axis=(1, 2)) for z in columns]
    assert_array_equal(by_error, np.eye(2)[[0, 1, 1]])
    assert len({error.words for error in errors}) == 2


def test_points_that_are_missing_do_not_move_the_place_of_an_edge():
    scene = random_scene("edge", default_rng(5))
    points = scene.observations.points.copy()
    points[:, ::5] = np.nan
    problem = Problem([replace(scene.observations, points=points)], Noise(SIGMA))
    state = problem.place(scene.truth.rotation, scene.truth.translation)
    ((origin, axes),) = state.placements
    ends = origin + [[0.0], [100.0]] * axes[:, :, 2]
    assert scene.target.distance(ends).max() < 1e-9


def arc_wrongly_seen(error, h, circle):
    """The circle (1, 3) of an arc with an error of the scanner of size h."""
    angle = np.radians(np.linspace(-50, 50, 21))
    outwards = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    points = circle[:, :2] + circle[:, 2:] * outwards
    return fit_circle(wrongly_seen(points, error, h))[None]


@pytest.mark.parametrize("error", OF_SCANNER, ids=lambda error: error.words[:30])
def test_a_scanner_errs_in_circles_as_in_the_arcs_that_it_saw(error):
    """The derivative by its error, against circles through arcs that have it."""
    scan, truth = pc.simulate("ball", seed=1, noise={"profile_mm": 0.0})
    state = state_of(truth)

    def changed(size):
        wrong = with_values(scan, partial(arc_wrongly_seen, error, size))
        _, (seen,), _ = observe_all([wrong])
        return seen

    problem = Problem([changed(0.0)], Noise(SIGMA))
    ((columns,),) = problem.columns_in_mm(state, [error])
    assert_derivative(columns[problem.n], changed, state)
