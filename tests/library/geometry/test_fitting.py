"""Fits: equal to the textbook's eigenproblems on noisy points."""

import numpy as np
import pytest
import scipy.linalg
from numpy.random import default_rng
from numpy.testing import assert_allclose

from profilecal.geometry.fitting import (
    affine_residuals,
    fit_circle,
    fit_ellipse,
    fit_sphere,
)
from profilecal.geometry.poses import circle_around, directions


def on_circle(angle):
    return np.column_stack([np.cos(angle), np.sin(angle)])


def ellipse_points(rng, count=40):
    """About the middle of an arc of half an ellipse or more."""
    angle = rng.uniform(0, 2 * np.pi) + np.linspace(0, rng.uniform(3.5, 6), count)
    points = on_circle(angle) @ (rng.normal(size=(2, 2)) + 2 * np.eye(2))
    return points - points.mean(axis=0)


def conic_of(ellipse):
    """A to F of A x² + B x z + C z² + D x + E z + F, of length 1."""
    M = np.linalg.inv(ellipse.shape)
    slope = -2 * M @ ellipse.centre
    level = ellipse.centre @ M @ ellipse.centre - 1
    conic = np.array([M[0, 0], 2 * M[0, 1], M[1, 1], *slope, level])
    return conic / np.linalg.norm(conic)


def test_noisy_ellipse_equals_the_textbook_eigenproblem():
    """Fitzgibbon's, 6×6."""
    rng = default_rng(2)
    constraint = np.zeros((6, 6))
    constraint[[0, 1, 2], [2, 1, 0]] = 2, -1, 2
    for _ in range(100):
        points = ellipse_points(rng) + rng.normal(0, 0.1, (40, 2))
        x, z = points.T
        design = np.column_stack([x * x, x * z, z * z, x, z, np.ones_like(x)])
        values, vectors = scipy.linalg.eig(constraint, design.T @ design)
        expected = vectors[:, values.real.argmax()].real
        found = conic_of(fit_ellipse(points))
        assert_allclose(found * np.sign(found[0] * expected[0]), expected, atol=1e-8)


def textbook_taubin(points):
    """Taubin's generalised eigenproblem for A (x² + z²) + B x + C z + D."""
    x, z = points.T
    w = x * x + z * z
    design = np.column_stack([w, x, z, np.ones_like(x)])
    gradient = np.diag([4 * w.mean(), 1, 1, 0])
    gradient[0, 1:3] = gradient[1:3, 0] = 2 * x.mean(), 2 * z.mean()
    A, B, C, D = scipy.linalg.eigh(gradient, design.T @ design / len(x))[1][:, -1]
    centre = np.array([-B, -C]) / 2 / A
    return np.append(centre, np.sqrt(centre @ centre - D / A))


def test_noisy_arcs_equal_the_textbook_eigenproblem():
    """Flat ones, too, which noise bends more than the circle does."""
    rng = default_rng(5)
    for sigma, half in (0.01, 0.9), (1.0, 0.9), (0.05, 0.06), (0.1, 0.06):
        angle = np.pi / 2 + np.linspace(-half, half, 300)
        points = 50 * on_circle(angle) + rng.normal(0, sigma, (300, 2))
        assert_allclose(fit_circle(points), textbook_taubin(points), 1e-7, 1e-6)


def test_points_on_a_line_of_a_grid_have_no_circle():
    """Rounding leaves them a little beside it."""
    rng = default_rng(0)
    steps, direction = (
        rng.integers(1, 100, (300, 3, 1)),
        rng.integers(-9, 9, (300, 1, 2)),
    )
    points = np.round(50 + 0.1 * np.cumsum(steps, axis=1) * direction, 1)
    assert np.isnan(fit_circle(points)).all()


def test_points_on_a_sphere_give_it_back_and_those_on_a_circle_the_smallest_one():
    rng = default_rng(2)
    centre, radius = rng.uniform(-1000, 1000, (20, 3)), rng.uniform(5, 50, 20)
    cap = directions(rng, (20, 50))
    cap[..., 2] = np.abs(cap[..., 2])  # half of it seen, as a scanner does
    found = fit_sphere(centre[:, None] + radius[:, None, None] * cap)
    assert_allclose(found[0], centre, rtol=0, atol=1e-9)
    assert_allclose(found[1], radius, rtol=0, atol=1e-9)
    rim = circle_around(centre[0], directions(rng, ()), 30.0)
    middle, found_radius = fit_sphere(rim)
    assert_allclose(middle, centre[0], rtol=0, atol=0.1)
    assert found_radius == pytest.approx(30, abs=1e-3)


@pytest.mark.parametrize("dimensions", [0, 1, 2, 3])
def test_affine_residuals_are_those_of_the_regression_on_where_the_positions_extend(
    dimensions,
):
    rng = default_rng(6)
    offsets = rng.normal(size=(9, dimensions)) @ rng.normal(size=(dimensions, 3))
    values = rng.normal(size=(9, 2))
    present = rng.permutation(9) < 7
    values[~present] = np.nan
    positions = offsets + 1000 + 1e-12 * rng.normal(size=(9, 3))
    residuals = affine_residuals(positions, values, present)
    A = np.column_stack([np.ones(7), offsets[present]])
    fitted = A @ np.linalg.lstsq(A, values[present], rcond=1e-9)[0]
    assert_allclose(residuals[present], values[present] - fitted, atol=1e-9)
    assert_allclose(residuals[~present], 0, atol=1e-9)
