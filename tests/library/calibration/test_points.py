"""How well a measured point is known: the formula against differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from simulated import calibration_of, scan_of

from profilecal.calibration.points import over_all_seen, points_seen
from profilecal.geometry.poses import homogeneous, rotations


def by_differences(function, variances):
    """Standard deviations (n, 3) of points that a small twist δ (6,) moves, T · exp(δ),
    from the covariance (6, 6) of δ.
    """
    h = 1e-4
    steps = [
        function(homogeneous(rotations(d[3:]), d[:3]))
        - function(homogeneous(rotations(-d[3:]), -d[:3]))
        for d in h * np.eye(6)
    ]
    J = np.moveaxis(steps, 0, -1) / (2 * h)
    return J @ variances @ J.mT


def of_sizes(solution):
    return solution.error_sizes.sizes, solution.error_sizes.mean_v


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_points_vary_as_differences_of_pose_and_flange_have_it(mount):
    noise = {"profile_mm": 0.05, "position_mm": 0.2, "orientation_deg": 0.05}
    found = calibration_of("ball", seed=1, mount=mount, noise=noise)
    solution, T = found.solution, found.scans[0].T_base_flange[3]
    x, z = np.array([-30.0, 0, 25]), np.array([80.0, 100, 140])
    p = np.stack([x, 0 * x, z, 1 + 0 * x], axis=1)
    to_hand = mount == "eye-to-hand"

    def measured(delta, of_flange):
        flange = np.linalg.inv(T @ of_flange) if to_hand else T @ of_flange
        return (p @ (flange @ found.pose @ delta).T)[:, :3]

    C = solution.covariance_total
    own = by_differences(lambda d: (p @ (found.pose @ d).T)[:, :3], C)
    assert_allclose(found.point_sd_mm(x, z) ** 2, np.diagonal(own, 0, 1, 2), rtol=1e-6)
    sizes = {size.name: v for size, v in zip(*of_sizes(solution), strict=True)}
    mm, deg = sizes["position_mm"], sizes["orientation_deg"]
    mm += sizes["group_position_mm"]
    deg += sizes["group_orientation_deg"]
    robot = np.diag(np.repeat([mm, deg * np.radians(1) ** 2], 3))
    total = by_differences(lambda d: measured(d, np.eye(4)), C)
    total += by_differences(lambda d: measured(np.eye(4), d), robot)
    squares = found.point_sd_mm(x, z, T) ** 2
    assert_allclose(squares, np.diagonal(total, 0, 1, 2), rtol=1e-6)


def test_what_was_seen_of_arcs_is_what_the_profiles_show():
    arcs, profiles = (
        points_seen(calibration_of("ball", seed=1, measured=measured).solution)
        for measured in ("arcs", "profiles")
    )
    assert_allclose(arcs.max(axis=1), profiles.max(axis=1), atol=10)
    x, z = over_all_seen(calibration_of("edge").solution)
    points = np.concatenate(scan_of("edge").values)
    assert {*x[1, ::2]} == {points[:, 0].min(), points[:, 0].max()}
    assert z[1, 0] == (points[:, 1].min() + points[:, 1].max()) / 2
