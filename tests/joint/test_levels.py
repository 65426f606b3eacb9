"""How large the errors are."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from many_scenes import SIGMA
from scipy.stats import binom, norm

from profilecal.geometry.noise import Noise
from profilecal.joint.descent import refine
from profilecal.joint.field import field_over
from profilecal.joint.levels import USUAL, Likelihood, Prior, levels, likeliest
from profilecal.joint.problem import Problem
from profilecal.joint.sharing import level_variances
from profilecal.simulate.poses import actual_poses, scan_planes
from profilecal.simulate.scene import random_scene

TRUE = Noise(SIGMA, position_mm=0.08, orientation_deg=0.03)


def linear_model(seed, noise=TRUE, **plan):
    """The model of a simulated edge at its best fit, and the fit."""
    rng = np.random.default_rng(seed)
    scene = random_scene("edge", rng, **plan)
    R, T = scene.truth.rotation[0], scene.truth.translation[0]
    planes = scan_planes(R, T, *actual_poses(scene.poses, noise, rng))
    points = scene.target.meet(*(p.reshape(-1, *p.shape[2:]) for p in planes))[None, :, None, :]
    seen = [replace(scene.observations, points=points + SIGMA * rng.normal(size=points.shape))]
    problem = Problem(seen, Noise(SIGMA))
    state = refine(problem, scene.truth).state
    kept = [np.ones(problem.terms[0].P, dtype=bool)]
    return Likelihood(problem, state, kept, Prior(USUAL)), problem, state


def test_the_restricted_likelihood_is_that_of_the_dense_covariance():
    model, problem, state = linear_model(1, groups=4, positions=3)
    linear = problem.linear(state, with_flange=True)[0]
    z, E = (part[0].transpose(2, 1, 0) for part in (linear.with_residual, linear.by_flange))  # (P, K, columns)
    P, K, _ = z.shape
    J, r = z[..., :-1].reshape(P * K, -1), z[..., -1].ravel()
    group = problem.terms[0].group

    def dense(noise):
        _, of_pose, of_group = level_variances(noise)
        V = np.eye(P * K)
        blocks = V.reshape(P, K, P, K)
        for p in range(P):
            for q in range(P):
                blocks[p, :, q] += (p == q) * (E[p] * of_pose) @ E[q].T
                blocks[p, :, q] += (group[p] == group[q]) * (E[p] * of_group) @ E[q].T
        W = np.linalg.inv(V)
        H = J.T @ W @ J
        square = r @ W @ r - r @ W @ J @ np.linalg.solve(H, J.T @ W @ r)
        return square + np.linalg.slogdet(V)[1] + np.linalg.slogdet(H)[1]

    y = np.random.default_rng(2).normal(size=(2, len(model.scales)))
    noises = [model.noise_of({name: float(size) for name, size in model.sizes(one).items()}) for one in y]
    first, second = model.at(y)[0] - (y**2).sum(axis=1)
    assert first - second == pytest.approx(dense(noises[0]) - dense(noises[1]), rel=1e-6)


def test_the_intervals_hold_the_true_sizes():
    """95 % each."""
    inside = {"position_mm": 0, "orientation_deg": 0}
    for seed in range(20):
        model, _, state = linear_model(seed, groups=15, positions=4)
        field = field_over(model.sharing, state.rotation[0], state.translation[0], eye_to_hand=False)
        found = levels(model, likeliest(model, asdict(TRUE)), field, {})
        for size in found.sizes:
            if size.name in inside:
                inside[size.name] += size.low <= getattr(TRUE, size.name) <= size.high
    assert min(inside.values()) >= binom.ppf(0.01, 20, 0.95)


def test_where_less_is_stated_than_is_usual_the_usual_is_as_likely():
    """So a statement that is far too small leaves the region nearly as large as none does."""
    model, problem, state = linear_model(3, groups=4, positions=3)
    kept = [np.ones(problem.terms[0].P, dtype=bool)]
    field = field_over(model.sharing, state.rotation[0], state.translation[0], eye_to_hand=False)
    scales, sd = {}, {}
    for stated in (0.0, 1e-4, 0.2):
        prior = Prior(replace(USUAL, position_mm=stated), frozenset({"position_mm"})) if stated else Prior(USUAL)
        model = Likelihood(problem, state, kept, prior)
        scales[stated] = [rival.scales.get("position_mm") for rival in model.rivals()]
        sd[stated] = np.sqrt(np.diag(levels(model, likeliest(model, asdict(TRUE)), field, {}).covariance))
    assert scales == {0.0: [0.05, 0.05, None], 1e-4: [1e-4, 1e-4, None, 0.05, 0.05], 0.2: [0.2, 0.2, None]}
    np.testing.assert_array_less(0.9 * sd[0.0], sd[1e-4])


@pytest.mark.parametrize(("stated", "middle", "beyond_five"), [((), 0.765, 0.0154), (("position_mm",), 1.0, 0.1257)])
def test_a_size_is_standard_normal_beforehand(stated, middle, beyond_five):
    """Half-t laws of three degrees of freedom and, where the scale is stated, of one: the middle, and how many sizes
    are more than five times their scale."""
    size, coordinate = Prior(USUAL, frozenset(stated)).law("position_mm")
    assert size(0.0) == pytest.approx(middle, abs=0.001)
    assert norm.sf(coordinate(5.0)) == pytest.approx(beyond_five, abs=1e-4)
    assert coordinate(size(1.3)) == pytest.approx(1.3)
    assert size(norm.ppf(1e-6)) < 1e-5


def test_rough_sizes_give_nearly_the_same_standard_deviations():
    model, _, state = linear_model(5, groups=5, positions=3)
    field = field_over(model.sharing, state.rotation[0], state.translation[0], eye_to_hand=False)
    found = [levels(model, likeliest(model, asdict(TRUE), t), field, {}, t).covariance for t in (1e-10, 1e-5)]
    np.testing.assert_allclose(np.sqrt(np.diag(found[1])), np.sqrt(np.diag(found[0])), rtol=0.01)
