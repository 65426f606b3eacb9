"""Poses that are not where the robot was, or are given otherwise than stated; faultless
scans of another sensor.
"""

from functools import wraps

import numpy as np
from scipy.spatial.transform import Rotation

from corruptions.folder import (
    CONVENTIONS_COLUMNS,
    SLIGHT,
    any_size,
    corruption,
    one,
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


@corruption
def angles_in_other_sequence(rng, folder):
    table, _, R, _ = folder.poses()
    sequence = one(rng, ["XYZ", "xyz", "ZYX", "zyx", "ZYZ", "YXZ"])
    angles = Rotation.from_matrix(R).as_euler(sequence, degrees=True)
    table = table.drop(columns=CONVENTIONS_COLUMNS.intersection(table))
    table[one(rng, ["a b c", "w p r", "alpha beta gamma"]).split()] = angles
    folder.put("poses", table)


@on_poses
def inverted(rng, R, T, folder):
    return R.mT, T if rng.uniform() < 0.5 else -np.einsum("nba,nb->na", R, T)


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
def robot_noise(rng, R, T, folder):
    T = T + any_size(rng, 0.01, 30) * rng.normal(size=T.shape)
    return R @ turns(rng, any_size(rng, 0.001, 5), T.shape), T


@on_poses
def one_orientation(rng, R, T, folder):
    about_z = Rotation.from_rotvec([0, 0, 1] * rng.normal(size=(len(R), 1))).as_matrix()
    return R[:1] @ (about_z if rng.uniform() < 0.5 else np.eye(3) + 0 * R), T


@on_poses
def base_moved(rng, R, T, folder):
    X = Rotation.random(rng=rng).as_matrix()
    return X @ R, T @ X.T + rng.uniform(-500, 500, 3)


@on_poses
def poses_of_a_tool(rng, R, T, folder):
    X = np.eye(4)
    X[:3, :3] = Rotation.random(rng=rng).as_matrix()
    X[:3, 3] = rng.uniform(-300, 300, 3)
    folder.truth = np.linalg.inv(X) @ folder.truth
    return R @ X[:3, :3], T + R @ X[:3, 3]


@on_poses
def left_handed_robot(rng, R, T, folder):
    M = np.diag([1.0, -1, 1, 1])
    folder.truth = M @ folder.truth @ M
    return M[:3, :3] @ R @ M[:3, :3], T @ M[:3, :3]


@corruption
def few_poses(rng, folder):
    poses, profiles = folder.table("poses"), folder.table("profiles")
    rows = rng.choice(len(poses), rng.integers(0, 14), replace=False)
    poses = poses.iloc[np.sort(rows)]
    folder.put("poses", poses)
    folder.put("profiles", profiles[profiles["pose"].isin(poses["pose"])])


@corruption
def everything_in_other_lengths(rng, folder):
    factor = one(rng, [1.01, 0.5, 1 / 25.4, 10, 1000, 0.001])
    for name, columns in (("poses", ["x", "y", "z"]), ("profiles", ["x", "z"])):
        table = folder.table(name)
        folder.put(name, table.assign(**(table[columns] * factor)))
    header = folder.header()
    if "radius" in header["target"]:
        header["target"]["radius"] *= factor
        folder.put_header(header)
    folder.truth = folder.truth @ np.eye(4)
    folder.truth[:3, 3] *= factor
