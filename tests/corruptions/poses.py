"""Poses that are not where the robot was, or too few."""

from functools import wraps

import numpy as np
from scipy.spatial.transform import Rotation

from corruptions.folder import (
    SLIGHT,
    any_size,
    corruption,
    some,
)


def on_poses(function):
    """A corruption (rng, R, T, folder) that gives other R and T."""

    @wraps(function)
    def change(rng, folder):
        table, convention, R, T = folder.poses()
        folder.put_poses(table, convention, *function(rng, R, T, folder))

    return corruption(change)


def turns(rng, deg, shape):
    return Rotation.from_rotvec(np.radians(deg) * rng.normal(size=shape)).as_matrix()


@on_poses
def some_poses_wrong(rng, R, T, folder):
    rows = some(rng, len(T))
    T[rows] += any_size(rng, 0.05, 2000) * rng.normal(size=(len(rows), 3))
    if rng.uniform() < 0.5:
        R[rows] = R[rows] @ turns(rng, any_size(rng, 0.02, 90), (len(rows), 3))
    return R, T


@on_poses
def target_moved(rng, R, T, folder):
    """Somebody knocked against it in the middle of the scan."""
    T[rng.integers(len(T)) :] += any_size(rng, 0.05, 50) * rng.normal(size=3)
    return R, T


@on_poses
def robot_scaled(rng, R, T, folder):
    return R, T * (1 + any_size(rng, SLIGHT, 0.5))


@on_poses
def one_orientation(rng, R, T, folder):
    about_z = Rotation.from_rotvec([0, 0, 1] * rng.normal(size=(len(R), 1))).as_matrix()
    return R[:1] @ (about_z if rng.uniform() < 0.5 else np.eye(3) + 0 * R), T


@corruption
def few_poses(rng, folder):
    poses, profiles = folder.table("poses"), folder.table("profiles")
    rows = rng.choice(len(poses), rng.integers(0, 14), replace=False)
    poses = poses.iloc[np.sort(rows)]
    folder.put("poses", poses)
    folder.put("profiles", profiles[profiles["pose"].isin(poses["pose"])])
