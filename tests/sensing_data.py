"""Random well-conditioned scenes with known answers, for the closed forms that start
from sensing data.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.simulation.scene import random_scene


def sensor(rng):
    """A sensor pose on the flange: any orientation, up to 400 mm away."""
    return Rotation.random(rng=rng).as_matrix(), rng.uniform(-400, 400, 3)


def ball_data(rng, translating=4, turning=4):
    """(R_sensor, T_sensor), (R_tcp, T_tcp, q) from which one point is seen, the first
    `translating` poses in one orientation, the others tilted by 30° from another, about
    axes spread evenly around a circle.
    """
    R_sensor, T_sensor = sensor(rng)
    still, other = Rotation.random(2, rng=rng)
    around = 2 * np.pi * np.arange(turning) / turning
    axes = np.column_stack([np.cos(around), np.sin(around), 0 * around])
    tilts = Rotation.from_rotvec(np.radians(30) * axes)
    turned = (other * tilts).as_matrix()
    R_tcp = np.concatenate([[still.as_matrix()] * translating, turned])
    q = rng.uniform(-60, 60, (len(R_tcp), 3))
    corners = 40 * np.eye(4, 3)[np.arange(translating) % 4]
    q[:translating] = corners + rng.uniform(-5, 5, (translating, 3))
    in_base = np.einsum("nab,nb->na", R_tcp, q @ R_sensor.T + T_sensor)
    return (R_sensor, T_sensor), (R_tcp, rng.uniform(-500, 500, 3) - in_base, q)


def point_data(rng, poses=10):
    """(R_sensor, T_sensor), (R_tcp, T_tcp, q): a point in the scan plane."""
    scene = random_scene("point", rng, groups=poses, positions=1)
    seen = scene.observations
    q = np.insert(seen.points[0, :, 0], 1, 0, axis=1)
    return (scene.R_sensor, scene.T_sensor), (seen.R_flange[0], seen.T_flange[0], q)
