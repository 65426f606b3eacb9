"""Faultless scans of another sensor pose."""

import numpy as np
from scipy.spatial.transform import Rotation

from corruptions.folder import any_table, corruption


@corruption
def base_moved(rng, folder):
    table, convention, R, T = folder.poses()
    X = Rotation.random(rng=rng).as_matrix()
    folder.put_poses(table, convention, X @ R, T @ X.T + rng.uniform(-500, 500, 3))


@corruption
def poses_of_a_tool(rng, folder):
    table, convention, R, T = folder.poses()
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-300, 300, 3)
    folder.truth = np.linalg.inv(X) @ folder.truth
    folder.put_poses(table, convention, R @ X[:3, :3], T + R @ X[:3, 3])


@corruption
def left_handed_robot(rng, folder):
    table, convention, R, T = folder.poses()
    M = np.diag([1.0, -1, 1])
    folder.put_poses(table, convention, M @ R @ M, T @ M)
    M4 = np.diag([1.0, -1, 1, 1])
    folder.truth = M4 @ folder.truth @ M4


@corruption
def everything_in_other_lengths(rng, folder):
    factor = [1.01, 0.5, 1 / 25.4, 10, 1000, 0.001][rng.integers(6)]
    table, profiles, header = folder.table("poses"), folder.table("profiles"), folder.header()
    folder.put("poses", table.assign(**(table[["x", "y", "z"]] * factor)))
    folder.put("profiles", profiles.assign(**(profiles[["x", "z"]] * factor)))
    if "radius" in header["target"]:
        header["target"]["radius"] *= factor
        folder.put_header(header)
    folder.truth = folder.truth @ np.eye(4)
    folder.truth[:3, 3] *= factor


@corruption
def rows_in_other_order(rng, folder):
    """Of poses, or of profiles: their points lose the order of the scan."""
    name = any_table(rng)
    folder.put(name, folder.table(name).sample(frac=1, random_state=int(rng.integers(1000))))
