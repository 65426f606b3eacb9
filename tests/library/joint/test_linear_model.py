"""One linear Gaussian model, against the covariance of all residuals written out, and
each answer by brute force.
"""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import KINDS, SIGMA
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from profilecal.calibration.plausibility import of_robot
from profilecal.geometry.noise import ROBOT, Noise, Systematic
from profilecal.geometry.poses import inverse, rotations
from profilecal.joint.descent import refine
from profilecal.joint.linear_model import LinearModel, score
from profilecal.joint.prior import of_scanner, of_target
from profilecal.joint.problem import Problem
from profilecal.simulation.scene import random_scene
from profilecal.targets.observations import PoseGroups
from profilecal_tool.plan.scan_model import marginal

# Two targets: profiles 0 to 4 have five residuals, 5 to 8 three; six poses of three
# orientations
POSE = np.array([0, 0, 1, 2, 3, 4, 5, 5, 2])
GROUPS = PoseGroups(POSE, np.array([0, 0, 0, 1, 2, 2]), POSE)
COUNTS = np.array([5] * 5 + [3] * 4)
ROW = np.repeat(np.arange(9), COUNTS)  # the profile that each residual is of
# of the scanner and the robot, mm² and rad²
V = np.array([1.3, 0.4, 0.9, 0.7, 0.5, 0.3, 0.2])
UNITS = np.array(
    [1.0, *(1.0 if name.endswith("mm") else np.degrees(1) ** 2 for name in ROBOT)]
)  # to mm² and degrees²
N = 4


class Dense:
    """A model with its residuals r, derivatives A, and covariance C of r written out."""

    def __init__(self, rank: int = 5):
        """`rank`: how many residuals of the first target's profiles an error of the
        flange can move.
        """
        rng = np.random.default_rng(1)
        E, Y = ([rng.normal(size=(count, k)) for count in COUNTS] for k in (6, N + 1))
        for one in E[:5]:
            one[:] = rng.normal(size=(5, rank)) @ rng.normal(size=(rank, 6))
        root = rng.normal(size=(N, N))
        self.precision = root @ root.T
        padded = (
            np.array([np.pad(one, [(0, 5 - len(one)), (0, 0)]) for one in a])
            for a in (E, Y)
        )
        self.model = LinearModel(*padded, COUNTS, GROUPS, ROBOT, self.precision)
        self.E, self.A, self.r = (
            np.concatenate(E),
            np.concatenate(Y)[:, :N],
            np.concatenate(Y)[:, N],
        )
        self.C = sum(v * M for v, M in zip(V, self.parts(), strict=True))

    def parts(self):
        """The matrices that C is a sum of, one for each error."""
        yield np.eye(len(ROW))
        for name in ROBOT:
            Z = self.E[:, :3] if name.endswith("mm") else self.E[:, 3:]
            number = {
                "repeatability": np.arange(9),
                "group": GROUPS.orientation[POSE],
            }.get(name.split("_")[0], POSE)
            yield Z @ Z.T * np.equal.outer(number[ROW], number[ROW])

    def of(self, profiles):
        """r, A and C of some profiles."""
        rows = np.isin(ROW, profiles)
        return self.r[rows], self.A[rows], self.C[np.ix_(rows, rows)]


def textbook(r, A, C, precision):
    """x̂, V, P r and P."""
    W = np.linalg.inv(C)
    covariance = np.linalg.inv(A.T @ W @ A + precision)
    mean = -covariance @ A.T @ W @ r
    return mean, covariance, W @ (r + A @ mean), W - W @ A @ covariance @ A.T @ W


def squared(error, covariance) -> float:
    return error @ np.linalg.solve(covariance, error)


@pytest.mark.parametrize("rank", [2, 5])
@pytest.mark.parametrize("missing", [[], [3, 7]])
def test_posterior_and_evidence_are_those_of_the_dense_covariance(missing, rank):
    """Evidence: the law of r where x is integrated out, N(0, C + A Π⁻¹ Aᵀ), but for
    constants.
    """
    dense, kept = Dense(rank), ~np.isin(np.arange(9), missing)
    (r, A, C), precision = dense.of(np.flatnonzero(kept)), dense.precision
    model = dense.model.keeping(kept)
    found = model.posterior(np.array([1, 2])[:, None] * UNITS * V)
    mean, covariance, w, _ = textbook(r, A, C, precision)
    np.testing.assert_allclose(found.mean[0], mean, rtol=1e-8)
    np.testing.assert_allclose(found.covariance[0], covariance, rtol=1e-8, atol=1e-12)
    assert found.square[0] == pytest.approx(r @ w)
    prior = A @ np.linalg.inv(precision) @ A.T
    by_law = [
        multivariate_normal(cov=factor * C + prior).logpdf(r) for factor in (1, 2)
    ]
    assert np.diff(found.log_evidence)[0] == pytest.approx(np.diff(by_law)[0])
    exact = model.without_robot().posterior(V[None])
    np.testing.assert_allclose(
        exact.mean[0], textbook(r, A, V[0] * np.eye(len(r)), precision)[0], rtol=1e-8
    )


def test_gradient_and_average_information_of_the_evidence():
    dense, h = Dense(2), 1e-4
    v = UNITS * V
    slope, information = dense.model.gradient(dense.model.posterior(v[None]))
    plus, minus = (
        dense.model.posterior(v + sign * h * np.diag(v)).log_evidence
        for sign in (1, -1)
    )
    np.testing.assert_allclose(
        slope * v, (plus - minus) / (2 * h), rtol=1e-5, atol=1e-7
    )
    _, _, w, P = textbook(dense.r, dense.A, dense.C, dense.precision)
    moved = np.array([M @ w for M in dense.parts()])
    np.testing.assert_allclose(
        information * UNITS[:, None] * UNITS,
        moved @ P @ moved.T / 2,
        rtol=1e-6,
        atol=1e-9,
    )


@pytest.mark.parametrize("profile", range(9))
def test_a_profile_left_out_is_predicted_as_by_the_model_without_it(profile):
    """With the errors that it shares with others, where it is kept; as a new one, where
    it is not.
    """
    dense, v = Dense(), (UNITS * V)[None]
    others = np.delete(np.arange(9), profile)
    (r, A, C), (r_own, A_own, C_own) = dense.of(others), dense.of(profile)
    mean, covariance, _, _ = textbook(r, A, C, dense.precision)
    error, S = r_own + A_own @ mean, C_own + A_own @ covariance @ A_own.T
    kept = np.arange(9) != profile
    model = dense.model.keeping(kept)
    errors, covariances = model.left_out(model.posterior(v))
    assert squared(errors[profile], covariances[profile]) == pytest.approx(
        squared(error, S)
    )

    shared = dense.C[np.ix_(profile == ROW, profile != ROW)] @ np.linalg.inv(C)
    slope = A_own - shared @ A
    error = r_own + A_own @ mean - shared @ (r + A @ mean)
    S = (
        C_own
        - shared @ dense.C[np.ix_(profile != ROW, profile == ROW)]
        + slope @ covariance @ slope.T
    )
    errors, covariances = dense.model.left_out(dense.model.posterior(v))
    assert squared(errors[profile], covariances[profile]) == pytest.approx(
        squared(error, S)
    )


def test_what_each_profile_says_by_itself():
    dense, v = Dense(rank=2), UNITS * V
    alone = [(np.c_[A, r], C) for r, A, C in map(dense.of, range(9))]
    expected = [Y.T @ np.linalg.solve(C, Y) for Y, C in alone]
    np.testing.assert_allclose(dense.model.alone(v), expected, rtol=1e-8)


def test_a_score_is_one_step_of_a_model_with_one_more_unknown():
    dense, n = Dense(), 2
    columns, W = np.c_[dense.A, dense.r], np.linalg.inv(dense.C)
    known = dense.precision[:n, :n]
    sizes, sds, moves = score(columns.T @ W @ columns, n, known)
    alone = textbook(dense.r, dense.A[:, :n], dense.C, known)[0]
    for k in range(N - n):
        with_one = dense.A[:, [*range(n), n + k]]
        mean, covariance, _, _ = textbook(
            dense.r, with_one, dense.C, block_diag(known, 0)
        )
        assert (sizes[k], sds[k]) == pytest.approx((mean[n], np.sqrt(covariance[n, n])))
        np.testing.assert_allclose(alone + moves[:, k] * sizes[k], mean[:n], rtol=1e-8)
        information = with_one.T @ W @ with_one + block_diag(known, 0)
        np.testing.assert_allclose(
            np.linalg.inv(marginal(information, n)), covariance[:n, :n], rtol=1e-8
        )


def erring(seen, error, h: float):
    """Observations with an error of size h; eye-to-hand, poses are of the base in the
    flange's frame.
    """
    if error.length:
        pairs = zip(seen.target.lengths, seen.sizes, strict=True)
        return replace(
            seen, sizes=tuple(size + h * (name == error.length) for name, size in pairs)
        )
    if error.points:
        moved = np.stack(
            error.points(seen.points[..., 0], seen.points[..., 1]), axis=-1
        )
        return replace(seen, points=seen.points + h * moved)
    R, T = seen.R_flange[0], seen.T_flange[0]
    if seen.eye_to_hand:
        in_base = inverse(R, T)[1]
        return replace(
            seen,
            T_flange=inverse(
                np.swapaxes(R, 1, 2), in_base + h * error.positions(in_base)
            )[1][None],
        )
    return replace(seen, T_flange=(T + h * error.positions(T))[None])


def with_flange_error(seen, axes, component: int, h: float):
    """Observations from flanges shifted along, or turned about, one of the sensor's
    axes (P, 3, 3), flange frame.
    """
    R, T = seen.R_flange[0], seen.T_flange[0]
    if seen.eye_to_hand:
        R, T = inverse(R, T)
    error = h * axes[:, :, component % 3]
    shift, turn = (error, 0 * error) if component < 3 else (0 * error, error)
    T, R = T + (R @ shift[..., None])[..., 0], R @ rotations(turn)
    R, T = inverse(R, T) if seen.eye_to_hand else (R, T)
    return replace(seen, R_flange=R[None], T_flange=T[None])


@pytest.mark.parametrize("eye_to_hand", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_by_all_that_may_be_wrong_are_those_of_differences(
    kind, eye_to_hand
):
    """The data are exact, so that points are where the state has them."""
    scene = random_scene(
        kind, np.random.default_rng(10), groups=3, positions=4, count=5
    )
    seen, truth = replace(scene.observations, eye_to_hand=eye_to_hand), scene.truth
    problem = Problem([seen], Noise(SIGMA))
    tried = [*of_scanner(), *of_target([seen.target]), *of_robot()]
    (columns,) = problem.columns_in_mm(truth, tried)
    R_sensor = truth.rotation[0]
    # eye-to-hand, the sensor stands in the base, and poses are of the base in the
    # flange's frame
    axes = (
        seen.R_flange[0] @ R_sensor
        if eye_to_hand
        else np.tile(R_sensor, (len(seen.R_flange[0]), 1, 1))
    )
    changes = [lambda h, error=error: erring(seen, error, h) for error in tried]
    changes += [lambda h, c=c: with_flange_error(seen, axes, c, h) for c in range(6)]
    # without the residual
    derivatives, h = np.delete(columns[0, problem.n :], len(tried), axis=0), 1e-5
    for column, change in zip(derivatives, changes, strict=True):
        plus, minus = (
            Problem([change(s * h)], Noise(1.0)).linear(truth)[0][0, -1]
            for s in (1, -1)
        )
        expected = (plus - minus) / (2 * h)
        # of an error that is as likely either way
        sign = -1 if eye_to_hand and change in changes[-6:] else 1
        np.testing.assert_allclose(
            sign * column, expected, atol=1e-4 * max(1, np.abs(expected).max())
        )


def test_lengths_do_not_look_too_small_because_of_noise():
    """A scale of all positions moves nothing that the answer cannot follow but the
    profiles' own scale: where derivatives are taken at the noisy points, it is found
    three standard deviations from zero.
    """
    clear = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        scene = random_scene("plane", rng, groups=21, positions=5, count=20)
        seen = scene.noisy(SIGMA, rng)
        problem = Problem([seen], Noise(SIGMA), Systematic(scale_percent=0.1))
        state = refine(problem, scene.truth).state
        tried = of_robot()[:1]
        model = problem.model(state, (), tried)
        (normal,) = model.posterior(np.ones((1, 1))).normal
        size, sd, _ = score(normal, model.n - 1, model.precision[:-1, :-1])
        clear.append(size[0] / sd[0])
    assert abs(np.mean(clear)) < 3 / np.sqrt(10)
