"""Radius and scales fitted together with the sensor pose come out as they are, to what is stated of them."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from profilecal.calibrate.calibration import calibrate
from profilecal.calibrate.suspects import fitted_together
from profilecal.geometry.noise import Noise, Systematic
from profilecal.simulate.spec import Spec, simulate_scan

BALL = Spec(kind="ball", groups=12, positions=3, noise=Noise(0.03), measured="profiles")


def wrong(seed: int, x: float, z: float, radius: float):
    """A calibration from profiles that are to be stretched by x and z, of a ball whose radius is larger than said."""
    scan = simulate_scan(replace(BALL, seed=seed))
    values = tuple(profile / [1 + x, 1 + z] for profile in scan.values)
    return calibrate([replace(scan, values=values, sizes=(scan.sizes[0] - radius,))])


def test_sizes_come_out_as_stated():
    true, square = np.array([0.002, -0.001, 0.1]), []
    for seed in range(4):
        found = wrong(seed, *true)
        prior = replace(
            found.solution.level.systematic, scale_percent=1.0, tolerance_mm=1.0, shear_percent=0, bend_mm=0
        )
        _, size, C = fitted_together(found.observed, found.solution, prior)
        sd = np.sqrt(np.diag(C))
        assert (sd[2] < 0.1) & (sd[:2] < 0.003).all()
        square.append((size - true) @ np.linalg.solve(C, size - true))
    assert chi2.ppf(1e-4, 12) < sum(square) < chi2.isf(1e-4, 12)


def test_what_is_not_free_stays():
    found = wrong(5, 0.0, 0.0, 0.0)
    state, size, covariance = fitted_together(found.observed, found.solution, Systematic(tolerance_mm=1e-6))
    assert size.shape == (1,)
    assert covariance.shape == (1, 1)
    assert abs(size[0]) < 1e-5
    moved = Rotation.from_matrix(state.rotation[0].T @ found.solution.rotation).magnitude()
    assert moved < np.radians(0.1)
