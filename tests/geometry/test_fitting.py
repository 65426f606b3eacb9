import numpy as np
import pytest

from profilecal.geometry.fitting import fit_line, fit_sphere
from profilecal.geometry.poses import directions


def test_line_through_points_on_a_line():
    rng = np.random.default_rng(1)
    point, direction = rng.uniform(-50, 50, (20, 3)), directions(rng, (20,))
    line = fit_line(point[:, None] + rng.uniform(-10, 10, (20, 7, 1)) * direction[:, None])
    np.testing.assert_allclose(np.abs((line.direction * direction).sum(axis=-1)), 1, rtol=1e-12)
    np.testing.assert_allclose(np.cross(line.point - point, direction), 0, atol=1e-12)
    np.testing.assert_allclose(line.rms, 0, atol=1e-12)


def test_line_rms_is_that_of_the_distances():
    points = np.array([[0.0, 1], [1, -1], [2, -1], [3, 1]])
    line = fit_line(points)
    np.testing.assert_allclose(np.abs(line.direction), [1, 0], atol=1e-12)
    assert line.rms == pytest.approx(1)


def test_only_the_points_kept_count():
    points = np.array([[[0.0, 0], [1, 1], [2, 2], [9, 0]], [[5.0, 5], [0, 1], [3, 3], [3, 3]]])
    kept = np.array([[True, True, True, False], [True, False, False, False]])
    line = fit_line(points, kept)
    np.testing.assert_allclose(np.abs(line.direction[0]), np.sqrt(0.5), rtol=1e-12)
    np.testing.assert_allclose(line.point[0], [1, 1])
    assert line.rms[0] < 1e-12
    assert np.isnan(line.point[1]).all()  # one point makes no line


def test_sphere_through_points_on_a_sphere():
    rng = np.random.default_rng(2)
    centre, radius = rng.uniform(-1000, 1000, (20, 3)), rng.uniform(5, 50, 20)
    cap = directions(rng, (20, 50))
    cap[..., 2] = np.abs(cap[..., 2])  # half of it seen, as a scanner does
    sphere = fit_sphere(centre[:, None] + radius[:, None, None] * cap)
    np.testing.assert_allclose(sphere.centre, centre, atol=1e-10)
    np.testing.assert_allclose(sphere.radius, radius, atol=1e-10)
    np.testing.assert_allclose(sphere.rms, 0, atol=1e-10)


def test_sphere_rms_is_the_noise():
    """Within four standard errors; the fit takes four of 2,000 degrees of freedom."""
    rng = np.random.default_rng(3)
    points = 20 * directions(rng, (2000,))
    sphere = fit_sphere(points * (1 + 0.1 / 20 * rng.normal(size=(2000, 1))))
    assert sphere.rms == pytest.approx(0.1 * np.sqrt(1996 / 2000), rel=4 / np.sqrt(2 * 2000))
