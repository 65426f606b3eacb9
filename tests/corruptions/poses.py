"""Poses that are not where the robot was, or are given otherwise than stated."""

import numpy as np
from scipy.spatial.transform import Rotation

from corruptions.folder import CONVENTIONS_COLUMNS, SLIGHT, any_size, corruption, some
from profilecal.scan.conventions import CONVENTIONS


@corruption
def angles_in_other_unit(rng, folder):
    table, convention, _, _ = folder.poses()
    columns = list(convention.columns)
    folder.put("poses", table.assign(**(table[columns] * [np.pi / 180, 180 / np.pi, 10, 0.1][rng.integers(4)])))


@corruption
def angles_in_other_sequence(rng, folder):
    table, _, R, _ = folder.poses()
    angles = Rotation.from_matrix(R).as_euler(str(rng.choice(["XYZ", "xyz", "ZYX", "zyx", "ZYZ", "YXZ"])), degrees=True)
    table = table.drop(columns=[c for c in CONVENTIONS_COLUMNS if c in table])
    table[list(rng.choice(["a b c", "w p r", "alpha beta gamma"]).split())] = angles
    folder.put("poses", table)


@corruption
def rotations_inverted(rng, folder):
    table, convention, R, T = folder.poses()
    folder.put_poses(table, convention, R.transpose(0, 2, 1), T)


@corruption
def poses_inverted(rng, folder):
    table, convention, R, T = folder.poses()
    Rt = R.transpose(0, 2, 1)
    folder.put_poses(table, convention, Rt, -np.einsum("nab,nb->na", Rt, T))


@corruption
def other_convention_valid(rng, folder):
    """The same poses, in another convention."""
    table, _, R, T = folder.poses()
    folder.put_poses(table, CONVENTIONS[rng.integers(len(CONVENTIONS))], R, T)


@corruption
def some_poses_wrong(rng, folder):
    table, convention, R, T = folder.poses()
    rows = some(rng, len(T))
    T[rows] += any_size(rng, 0.05, 2000) * rng.normal(size=(len(rows), 3))
    if rng.uniform() < 0.5:
        turn = np.radians(any_size(rng, 0.02, 90))
        R[rows] = R[rows] @ Rotation.from_rotvec(turn * rng.normal(size=(len(rows), 3))).as_matrix()
    folder.put_poses(table, convention, R, T)


@corruption
def one_shift_of_some_poses(rng, folder):
    table, convention, R, T = folder.poses()
    T[some(rng, len(T))] += any_size(rng, 0.05, 500) * rng.normal(size=3)
    folder.put_poses(table, convention, R, T)


@corruption
def groups_shifted(rng, folder):
    table, convention, R, T = folder.poses()
    group = np.unique(R.round(4).reshape(len(R), -1), axis=0, return_inverse=True)[1].ravel()
    for g in some(rng, group.max() + 1):
        T[group == g] += any_size(rng, 0.05, 100) * rng.normal(size=3)
    folder.put_poses(table, convention, R, T)


@corruption
def drift(rng, folder):
    """The robot warms up or the target creeps: positions change with the number of the pose."""
    table, convention, R, T = folder.poses()
    T += np.linspace(0, 1, len(T))[:, None] ** rng.choice([1, 2, 0.5]) * any_size(rng, 0.02, 20) * rng.normal(size=3)
    folder.put_poses(table, convention, R, T)


@corruption
def target_moved(rng, folder):
    """Somebody knocked against it in the middle of the scan."""
    table, convention, R, T = folder.poses()
    T[rng.integers(len(T)) :] += any_size(rng, 0.05, 50) * rng.normal(size=3)
    folder.put_poses(table, convention, R, T)


@corruption
def robot_scaled(rng, folder):
    table, convention, R, T = folder.poses()
    folder.put_poses(table, convention, R, T * (1 + any_size(rng, SLIGHT, 0.5)))


@corruption
def robot_noise(rng, folder):
    table, convention, R, T = folder.poses()
    T += any_size(rng, 0.01, 30) * rng.normal(size=T.shape)
    turn = np.radians(any_size(rng, 0.001, 5)) * rng.normal(size=(len(R), 3))
    folder.put_poses(table, convention, R @ Rotation.from_rotvec(turn).as_matrix(), T)


@corruption
def quaternions_wrong(rng, folder):
    table, _, R, T = folder.poses()
    folder.put_poses(table, CONVENTIONS[0], R, T)
    table = folder.table("poses")
    names = list(CONVENTIONS[0].columns)
    rows, how = some(rng, len(table)), rng.integers(5)
    q = table[names].to_numpy()
    if how == 0:
        q[rows] *= -1  # the same rotation
    elif how == 1:
        q[rows] *= 1 + any_size(rng, 1e-4, 0.5)
    elif how == 2:
        q[rows] = 0
    elif how == 3:
        q = q[:, [1, 2, 3, 0]]
    else:
        q[rows] *= [1, -1, -1, -1]
    table[names] = q
    folder.put("poses", table)


@corruption
def one_orientation(rng, folder):
    table, convention, R, T = folder.poses()
    R[:] = (
        R[0]
        if rng.uniform() < 0.5
        else R[0] @ Rotation.from_rotvec([0, 0, 1] * rng.normal(size=(len(R), 1))).as_matrix()
    )
    folder.put_poses(table, convention, R, T)


@corruption
def few_poses(rng, folder):
    table, profiles = folder.table("poses"), folder.table("profiles")
    table = table.iloc[np.sort(rng.choice(len(table), rng.integers(0, 14), replace=False))]
    folder.put("poses", table)
    folder.put("profiles", profiles[profiles["pose"].isin(table["pose"])])


@corruption
def same_pose_everywhere(rng, folder):
    table = folder.table("poses")
    rows = some(rng, len(table), 2)
    columns = [c for c in table.columns if c != "pose"]
    table.loc[rows, columns] = table.loc[rows[0], columns].to_numpy()
    folder.put("poses", table)


@corruption
def wrong_group_or_side(rng, folder):
    table = folder.table("poses")
    if rng.uniform() < 0.5:
        table["group"] = rng.integers(0, 4, len(table)) if rng.uniform() < 0.5 else np.arange(len(table)) // 2
    else:
        table["side"] = rng.choice([1, -1], len(table))
    folder.put("poses", table)
