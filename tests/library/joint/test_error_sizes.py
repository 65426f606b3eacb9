"""How large the errors are, and what the answer owes to not knowing them better."""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import SIGMA
from scipy.optimize import minimize
from scipy.special import softmax
from scipy.stats import binom, chi2, norm, t

from profilecal.geometry.noise import Noise
from profilecal.joint.descent import refine
from profilecal.joint.error_sizes import average, draw, growth, likeliest, t_points
from profilecal.joint.prior import FREEDOM, USUAL, Prior, prior_from
from profilecal.joint.problem import Problem
from profilecal.simulation.robot import actual_poses, scan_planes
from profilecal.simulation.scene import random_scene

TRUE = Noise(SIGMA, position_mm=0.08, orientation_deg=0.03)
PRIOR = Prior(replace(USUAL, profile_mm=SIGMA), source="profiles")


def edge_model(seed, names=None, **plan):
    """The model of a simulated edge at its best fit, and the names of its errors, all
    that can be told by default.
    """
    rng = np.random.default_rng(seed)
    scene = random_scene("edge", rng, **plan)
    R, T = scene.truth.rotation[0], scene.truth.translation[0]
    planes = scan_planes(R, T, *actual_poses(scene.poses, TRUE, rng))
    points = scene.target.meet(*(p.reshape(-1, *p.shape[2:]) for p in planes))[
        None, :, None, :
    ]
    points = points + SIGMA * rng.normal(size=points.shape)
    problem = Problem([replace(scene.observations, points=points)], Noise(SIGMA))
    names = names or problem.groups.distinguishable
    return problem.model(refine(problem, scene.truth).state, names), names


def test_errors_are_as_usual_where_nothing_is_stated():
    assert prior_from({}).scales == replace(USUAL, profile_mm=1.0)


def averaged(model, names, prior=PRIOR):
    return average(model, prior, np.zeros(1 + len(names)))


def test_the_likeliest_sizes_are_those_that_scipy_finds():
    model, names = edge_model(1, groups=6, positions=4)
    law = PRIOR.law(names)

    def unlikely(y):
        return y @ y / 2 - model.posterior(law.variances(y[None])[0]).log_evidence[0]

    start = np.zeros(len(law.free))
    y, root = likeliest(model, law, start, tolerance=1e-8)
    other = minimize(
        unlikely,
        start,
        method="Nelder-Mead",
        options={"xatol": 1e-5, "fatol": 1e-9, "maxiter": 9999},
    )
    assert unlikely(y) == pytest.approx(other.fun, abs=1e-5)
    assert np.linalg.eigvalsh(root @ root.T).min() > 0


def test_draws_have_the_mean_and_the_sum_of_a_fine_grid():
    """Of one size. The sum is the evidence of the model, which stands beside that of
    others.
    """
    model, names = edge_model(2, ["position_mm"], groups=3, positions=2)
    law = Prior(replace(USUAL, profile_mm=SIGMA)).law(names)
    log_weight, drawn, _ = draw(model, law, *likeliest(model, law, np.zeros(1)))
    grid = np.linspace(-4.5, 4.5, 400)[:, None]
    found = model.posterior(law.variances(grid)[0])
    height = found.log_evidence + norm.logpdf(grid[:, 0])
    evidence = np.logaddexp.reduce(height) + np.log(grid[1, 0] - grid[0, 0])
    assert np.logaddexp.reduce(log_weight) == pytest.approx(evidence, abs=0.03)
    weight = softmax(height)
    both = (weight, found), (softmax(log_weight), drawn)
    by_grid, by_draws = (w @ (of.v[:, 1:] ** 0.5) for w, of in both)
    assert by_draws == pytest.approx(by_grid, rel=0.02)
    by_grid, by_draws = (np.tensordot(w, of.covariance, 1) for w, of in both)
    np.testing.assert_allclose(np.diag(by_draws)[:6], np.diag(by_grid)[:6], rtol=0.03)


def test_the_intervals_hold_the_true_sizes():
    """95 % each."""
    inside = {"position_mm": 0, "orientation_deg": 0}
    for seed in range(20):
        known = replace(PRIOR, source="given")  # an edge's robot looks like its scanner
        for size in averaged(*edge_model(seed, groups=15, positions=4), known).sizes:
            if size.name in inside:
                inside[size.name] += size.low <= getattr(TRUE, size.name) <= size.high
    assert min(inside.values()) >= binom.ppf(0.01, 20, 0.95)


def test_where_less_is_stated_than_is_usual_the_usual_is_as_likely():
    """So a statement that is far too small leaves the region nearly as large as none
    does.
    """
    model, names = edge_model(3, groups=4, positions=3)
    stated = frozenset({"position_mm"})
    small, large = (
        Prior(replace(PRIOR.scales, position_mm=mm), stated, "profiles")
        for mm in (1e-4, 0.2)
    )
    assert small.usual == PRIOR
    assert large.usual is None
    assert PRIOR.usual is None
    by_none, by_small = (
        np.sqrt(np.diag(averaged(model, names, prior).covariance))
        for prior in (PRIOR, small)
    )
    assert np.mean(np.log(by_small / by_none)[:6]) > np.log(0.9)


@pytest.mark.parametrize(
    ("stated", "middle", "beyond_five"),
    [((), 0.765, 0.0154), (("position_mm",), 1.0, 0.1257)],
)
def test_a_size_is_standard_normal_beforehand(stated, middle, beyond_five):
    """Half-t laws of three degrees of freedom and, where the scale is stated, of one:
    the middle, and how many sizes are more than five times their scale.
    """
    law, scale = Prior(USUAL, frozenset(stated)).law(["position_mm"]), USUAL.position_mm
    five = norm.isf(2 * t.sf(5.0, 1 if stated else FREEDOM))
    assert norm.sf(five) == pytest.approx(beyond_five, abs=1e-4)
    sizes = np.sqrt(law.variances(np.array([[0.0], [five]]))[0][:, 1])
    assert sizes == pytest.approx([scale * middle, 5 * scale], rel=2e-3)
    assert np.sqrt(
        law.variances(np.arange(9.0, 45.0)[:, None])[0][:, 1]
    ) == pytest.approx(100 * scale)  # draws far out


def test_slopes_of_variances_are_those_of_differences():
    law, h = PRIOR.law(["position_mm", "orientation_deg"]), 1e-5
    y = np.array([[0.3, -1.2, 2.0]])
    _, first, second = law.variances(y)
    (plus, slope_plus, _), (minus, slope_minus, _) = (
        law.variances(y + h),
        law.variances(y - h),
    )
    np.testing.assert_allclose(first, (plus - minus) / (2 * h), rtol=1e-7)
    np.testing.assert_allclose(second, (slope_plus - slope_minus) / (2 * h), rtol=1e-6)


def test_known_sizes_are_a_prior_without_spread():
    known = Prior(TRUE, robot_known=True)
    model, names = edge_model(5, known.names([]), groups=5, positions=3)
    assert names == ["position_mm", "orientation_deg"]
    found = averaged(model, names, known)
    assert [(size.low, size.high) for size in found.sizes] == [
        (SIGMA,) * 2,
        (0.08,) * 2,
        (0.03,) * 2,
    ]
    expected = model.posterior(np.array([[1.0, 0.08**2, 0.03**2]]))
    np.testing.assert_allclose(found.covariance, expected.covariance[0])


def test_a_region_holds_over_all_sizes():
    """Of errors that have one of two sizes, one in a hundred is beyond it; nothing is
    added where there is one size.
    """
    rng, squares, weight = (
        np.random.default_rng(1),
        np.array([np.eye(6), 16 * np.eye(6)]),
        np.array([0.9, 0.1]),
    )
    assert growth(squares[:1], np.ones(1)) == 1.0
    covariance = growth(squares, weight) * np.tensordot(weight, squares, 1)
    sizes = np.where(rng.random(40_000) < weight[0], 1.0, 4.0)
    square = (
        np.sum((sizes[:, None] * rng.normal(size=(40_000, 6))) ** 2, axis=1)
        / covariance[0, 0]
    )
    assert (
        binom.ppf(1e-3, 40_000, 0.01)
        < np.sum(square > chi2.ppf(0.99, 6))
        < binom.isf(1e-3, 40_000, 0.01)
    )


def test_points_of_the_t_law_stand_on_either_side_alike():
    z = t_points(3, 32)
    np.testing.assert_array_equal(np.sign(z), -np.sign(z[::-1]))
