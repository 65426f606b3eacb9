"""How large the errors are, and what the answer owes to not knowing them better."""

from dataclasses import replace

import numpy as np
import pytest
from many_scenes import KINDS, SIGMA
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.optimize import minimize
from scipy.special import softmax
from scipy.stats import binom, chi2, gmean, norm, t
from simulated import scan_of, state_of

import profilecal as pc
from profilecal.calibration.observe import observe_all
from profilecal.geometry.noise import SMOOTH, Noise
from profilecal.joint.descent import refine
from profilecal.joint.error_sizes import (
    average,
    draw,
    growth,
    likeliest,
    of_robots,
)
from profilecal.joint.prior import (
    USUAL,
    Prior,
    prior_from,
)
from profilecal.joint.problem import Problem

TRUE = Noise(SIGMA, position_mm=0.08, orientation_deg=0.03)
PRIOR = Prior(replace(USUAL, profile_mm=SIGMA), source="profiles")


def edge_model(seed, names=(), **plan):
    """The model of a simulated edge at its best fit, with errors of these names; else
    with all that can be told by default.
    """
    scan, truth = pc.simulate("edge", seed, noise=vars(TRUE), **plan)
    noise = Noise(SIGMA) if names else Noise(SIGMA, accuracy_mm=0.3, accuracy_deg=0.03)
    problem = Problem(observe_all([scan])[1], noise)
    state = refine(problem, state_of(truth)).state
    return problem.model(state, names or [*problem.groups.distinguishable, SMOOTH])


def averaged(model, prior):
    law = prior.law(model.names)
    return average(model, prior, likeliest(model, law))


@pytest.mark.parametrize(
    ("stated", "count", "deg"),
    [
        ({"accuracy_mm": 0.0}, 0, 0.0),
        ({"accuracy_mm": 0.0, "accuracy_deg": 0.1}, 1, 0.1),
        ({"accuracy_mm": 0.1}, 1, 0.01),
    ],
)
def test_errors_are_as_usual_where_nothing_is_stated(stated, count, deg):
    """Smooth ones are there also if they are of orientations alone."""
    assert prior_from({}).scales == replace(USUAL, profile_mm=1.0)
    prior = prior_from(stated)
    assert len(prior.names([])) == count
    assert prior.scales.accuracy_deg == pytest.approx(deg)


def test_the_likeliest_sizes_are_those_that_scipy_finds(monkeypatch):
    model = edge_model(1, groups=6, positions=4)
    law = PRIOR.law(model.names)
    roughly = likeliest(model, law)
    monkeypatch.setattr("profilecal.joint.error_sizes.PROMISE", 1e-8)

    def unlikely(y):
        v = law.variances(y[None])
        return y @ y / 2 - model.posterior(v).log_evidence[0]

    start = np.zeros(len(law.free))
    likely = likeliest(model, law, start)
    by_scipy = minimize(unlikely, start, method="BFGS")
    assert unlikely(likely.y) == pytest.approx(by_scipy.fun, abs=1e-5)
    assert np.linalg.eigvalsh(likely.root).min() > 0
    for found, within in ((likely, 1e-6), (roughly, 1e-2)):  # that steps promise
        height = found.log_evidence - np.linalg.slogdet(found.root)[1]
        assert height == pytest.approx(-unlikely(likely.y), abs=within)


def test_a_search_ends_by_a_small_step_where_the_data_leave_an_unknown_open():
    """There the gradient is less exact than such a step."""
    scan, _ = pc.simulate("edge", 1, groups=1, positions=8, measured="profiles")
    solution = pc.calibrate(scan).solution
    model = solution.model()
    law = solution.prior.law(model.names)
    likely = likeliest(model, law)
    assert not np.allclose(likely.posterior.v, law.variances(likely.y[None]))


def test_draws_have_the_mean_and_the_sum_of_a_fine_grid():
    """Of one size. The sum is the evidence of the model, which stands beside that of
    others.
    """
    model = edge_model(2, ["position_mm"], groups=3, positions=2)
    known_scanner = replace(PRIOR, source="given")
    law = known_scanner.law(model.names)
    likely = likeliest(model, law)
    log_weight, _, drawn = draw(model, law, likely)
    grid = np.linspace(-4.5, 4.5, 400)[:, None]
    on_grid = model.posterior(law.variances(grid))
    height = on_grid.log_evidence + norm.logpdf(grid[:, 0])
    evidence = np.logaddexp.reduce(height) + np.log(grid[1, 0] - grid[0, 0])
    assert np.logaddexp.reduce(log_weight) == pytest.approx(evidence, abs=0.03)
    means = []
    for log_of, found in ((log_weight, drawn), (height, on_grid)):
        variances = np.diagonal(found.covariance, 0, 1, 2)[:, :6]
        each = np.column_stack([np.sqrt(found.v[:, 1]), variances])
        means.append(softmax(log_of) @ each)
    assert_allclose(*means, rtol=0.02)


def test_the_intervals_hold_the_true_sizes():
    """95 % each."""
    known = replace(PRIOR, source="given")  # an edge's robot looks like its scanner
    inside = {"position_mm": 0, "orientation_deg": 0}
    for seed in range(20):
        model = edge_model(seed, groups=15, positions=4)
        for size in averaged(model, known).sizes:
            if size.name in inside:
                inside[size.name] += size.low <= getattr(TRUE, size.name) <= size.high
    assert min(inside.values()) >= binom.ppf(0.01, 20, 0.95)


def test_where_less_is_stated_than_is_usual_the_usual_is_as_likely():
    """So a statement that is far too small leaves the region nearly as large as none
    does.
    """
    scales = (replace(PRIOR.scales, position_mm=mm) for mm in (1e-4, 0.2))
    stated = frozenset({"position_mm"})
    small, large = (Prior(some, stated, "profiles") for some in scales)
    assert small.usual == PRIOR
    assert large.usual is None
    assert PRIOR.usual is None
    model = edge_model(3, groups=4, positions=3)
    by_small, by_none = (averaged(model, prior).covariance for prior in (small, PRIOR))
    narrower = np.diag(by_small)[:6] / np.diag(by_none)[:6]
    assert gmean(narrower) > 0.9**2
    likely = likeliest(model, small.law(model.names))
    unlikely = replace(likely, log_evidence=-1e4)
    assert len([*of_robots(model, small, unlikely)]) == 2


@pytest.mark.parametrize(("stated", "freedom"), [((), 3), (("position_mm",), 1)])
def test_a_size_is_standard_normal_beforehand(stated, freedom):
    """Half-t laws of three degrees of freedom and, where the scale is stated, of one;
    up to 100 times their scale.
    """
    law = Prior(USUAL, frozenset(stated)).law(["position_mm"])
    y = np.array([-2.0, 0.0, 1.5, 40.0])
    v = law.variances(y[:, None])
    size = np.sqrt(v[:, 1]) / USUAL.position_mm
    assert_allclose(2 * t.sf(size, freedom)[:3], norm.sf(y)[:3], rtol=5e-3)
    assert size[3] == pytest.approx(100)


def test_a_region_holds_over_all_sizes():
    """Of errors that have one of two sizes, one in a hundred is beyond it; nothing is
    added where there is one size.
    """
    squares = np.array([np.eye(6), 16 * np.eye(6)])
    weight = np.array([0.9, 0.1])
    assert growth(squares[:1], np.ones(1)) == 1.0
    variance = growth(squares, weight) * weight @ [1, 16]
    beyond = weight @ chi2.sf(chi2.isf(0.01, 6) * variance / [1, 16], 6)
    assert beyond == pytest.approx(0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_no_sign_of_a_decomposition_decides_a_calibration(kind, monkeypatch):
    scan = scan_of(kind, seed=2, groups=8, positions=3, noise=vars(TRUE))
    rng = default_rng(1)
    svd, eigh = np.linalg.svd, np.linalg.eigh

    def answer():
        found = pc.calibrate(scan)
        return found.pose, found.covariance_mm_deg, found.targets[0].frame[1]

    def signs(values):
        return rng.choice([-1, 1], values.shape)[..., None, :]

    def any_svd(matrix, full_matrices=True):
        U, values, Vt = svd(matrix, full_matrices)
        sign, k = signs(values), values.shape[-1]
        U[..., :k] *= sign
        Vt[..., :k, :] *= sign.mT
        return U, values, Vt

    def any_eigh(matrix):
        values, vectors = eigh(matrix)
        return values, vectors * signs(values)

    expected = answer()
    monkeypatch.setattr(np.linalg, "svd", any_svd)
    monkeypatch.setattr(np.linalg, "eigh", any_eigh)
    for same, right in zip(answer(), expected, strict=True):
        assert_allclose(same, right, rtol=1e-9)
