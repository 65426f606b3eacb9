"""How well a measured point is known: the formula against differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from simulated import calibration_of, scan_of

from profilecal.calibration.points import over_all_seen, points_seen
from profilecal.geometry.poses import homogeneous, rotations

pytestmark = pytest.mark.usefixtures("read_rightly")


def by_differences(function, variances):
    """Variances (n, 3) of points that a small twist δ (6,) moves, T · exp(δ), from the
    covariance (6, 6) of δ.
    """
    h = 1e-4
    steps = [
        function(homogeneous(rotations(d[3:]), d[:3]))
        - function(homogeneous(rotations(-d[3:]), -d[:3]))
        for d in h * np.eye(6)
    ]
    J = np.moveaxis(steps, 0, -1) / (2 * h)
    return np.diagonal(J @ variances @ J.mT, 0, 1, 2)


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
def test_points_vary_as_differences_of_pose_and_flange_have_it(mount):
    noise = {"profile_mm": 0.05, "position_mm": 0.2, "orientation_deg": 0.05}
    found = calibration_of("ball", seed=1, mount=mount, noise=noise)
    T, one = found.scans[0].T_base_flange[3], np.eye(4)
    x, z = np.array([-30.0, 0, 25]), np.array([80.0, 100, 140])
    p = np.stack([x, 0 * x, z, 1 + 0 * x], axis=1)
    to_hand = mount == "eye-to-hand"

    def measured(flange, delta):
        flange = np.linalg.inv(flange) if to_hand else flange
        return (p @ (flange @ found.pose @ delta).T)[:, :3]

    C = found.solution.covariance_total
    own = by_differences(lambda d: measured(one, d), C)
    assert_allclose(found.point_sd_mm(x, z) ** 2, own, rtol=1e-6)
    sizes = found.solution.error_sizes.of_robot
    mm = np.hypot(sizes["position_mm"], sizes["group_position_mm"])
    deg = np.hypot(sizes["orientation_deg"], sizes["group_orientation_deg"])
    robot = np.diag(np.repeat([mm, np.radians(deg)], 3) ** 2)
    total = by_differences(lambda d: measured(T, d), C)
    total = total + by_differences(lambda d: measured(T @ d, one), robot)
    assert_allclose(found.point_sd_mm(x, z, T) ** 2, total, rtol=1e-6)


@pytest.mark.parametrize("T", [np.eye(3), np.eye(4).ravel()])
def test_poses_of_the_flange_are_checked(T):
    with pytest.raises(ValueError, match=r"T_base_flange has shape .* \(n, 4, 4\)"):
        calibration_of("ball", seed=1).point_sd_mm(0, 100, T)


def test_what_was_seen_of_arcs_is_what_the_profiles_show():
    arcs, profiles = (
        points_seen(calibration_of("ball", seed=1, measured=measured).solution)
        for measured in ("arcs", "profiles")
    )
    assert_allclose(arcs.max(axis=1), profiles.max(axis=1), atol=10)
    x, z = over_all_seen(calibration_of("edge").solution)
    points = np.concatenate(scan_of("edge").values)
    low, high = points.min(axis=0), points.max(axis=0)
    assert_allclose([x.min(), z[1, 0]], [low[0], (low[1] + high[1]) / 2])
