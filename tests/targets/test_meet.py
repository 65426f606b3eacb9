import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.targets.ball import Ball
from profilecal.targets.disk import Disk
from profilecal.targets.edge import Edge


def random_scan_planes(rng, count):
    """Scan planes through points near the origin."""
    return Rotation.random(count, random_state=rng).as_matrix(), rng.uniform(-20, 20, (count, 3))


def to_base(rotation, origin, x, z):
    """Points of the sensor frame's plane y = 0 in the base frame."""
    return origin + x[..., None] * rotation[..., :, 0] + z[..., None] * rotation[..., :, 2]


def unit(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def test_edge_points_lie_on_the_line():
    rng = np.random.default_rng(1)
    rotation, origin = random_scan_planes(rng, 200)
    edge = Edge(rng.uniform(-50, 50, 3), unit(rng))
    x, z = edge.meet(rotation, origin).T
    offset = to_base(rotation, origin, x, z) - edge.point
    scale = 1 + np.linalg.norm(offset, axis=1)
    assert (np.linalg.norm(np.cross(offset, edge.direction), axis=1) / scale).max() < 1e-12


def test_chord_tips_lie_on_the_rim_of_the_disk_and_a_missed_disk_is_nan():
    rng = np.random.default_rng(2)
    rotation, origin = random_scan_planes(rng, 200)
    disk = Disk(np.array([1.0, -2.0, 3.0]), unit(rng), 25.0)
    tips = disk.meet(rotation, origin)
    hit = np.isfinite(tips).all(axis=(1, 2))
    assert 100 < hit.sum() < 200
    rim = to_base(rotation[:, None], origin[:, None], tips[..., 0], tips[..., 1])[hit] - disk.centre
    np.testing.assert_allclose(np.linalg.norm(rim, axis=-1), disk.radius, rtol=1e-12)
    np.testing.assert_allclose(rim @ disk.normal, 0, atol=1e-11)
    assert (tips[hit, 0, 0] <= tips[hit, 1, 0]).all()


def test_ball_circle_gives_its_centre_back_on_the_right_side():
    rng = np.random.default_rng(3)
    rotation, origin = random_scan_planes(rng, 200)
    ball = Ball(np.array([5.0, 0.0, -4.0]), 40.0)
    in_sensor = ((ball.centre - origin)[:, None] @ rotation)[:, 0]
    circle = ball.meet(rotation, origin)
    np.testing.assert_allclose(ball.centre_from_circle(circle, np.sign(in_sensor[:, 1])), in_sensor, atol=1e-11)
