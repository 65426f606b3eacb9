"""Profiles that are not what the scanner saw from their pose."""

import numpy as np
import pandas as pd

from corruptions.folder import SLIGHT, any_size, any_table, corruption, some


@corruption
def labels_permuted(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    old = table["pose"].unique()
    if rng.uniform() < 0.5:
        new = np.roll(old, rng.choice([1, -1, 2]))
    else:
        new, rows = old.copy(), some(rng, len(old), 2, len(old))
        new[rows] = old[rng.permutation(rows)]
    folder.put(name, table.assign(pose=table["pose"].map(dict(zip(old, new, strict=True)))))


def each_profile(rng, folder, change, every=False, most=1.0):
    """Some of the profiles, up to a share of them, or all, changed by a function of (n, 2) points."""
    table = folder.table("profiles")
    labels = table["pose"].unique()
    chosen = set(labels if every else labels[some(rng, len(labels), 1, max(1, int(most * len(labels))))])
    parts = []
    for label, part in table.groupby("pose", sort=False):
        points = part[["x", "z"]].to_numpy(float)
        points = change(points) if label in chosen else points
        parts.append(pd.DataFrame({"pose": label, "x": points[:, 0], "z": points[:, 1]}))
    folder.put("profiles", pd.concat(parts))


@corruption
def profiles_emptied(rng, folder):
    how = rng.integers(6)
    each_profile(
        rng,
        folder,
        [
            lambda p: p[:0],
            lambda p: p[len(p) // 2 :][:1],
            lambda p: np.repeat(p[:1], len(p), axis=0),
            lambda p: np.column_stack([p[:, 0], np.full(len(p), p[0, 1])]),
            lambda p: np.full_like(p, np.nan),
            lambda p: np.zeros_like(p),
        ][how],
    )


@corruption
def profiles_cut(rng, folder):
    low, high = np.sort(rng.uniform(size=2))
    each_profile(rng, folder, lambda p: p[int(low * len(p)) : int(high * len(p)) + 1])


@corruption
def profiles_mirrored(rng, folder):
    """Some of them."""
    sign = [[-1, 1], [1, -1], [-1, -1]][rng.integers(3)]
    each_profile(rng, folder, lambda p: p * sign, most=0.4)


@corruption
def profiles_reversed(rng, folder):
    each_profile(rng, folder, lambda p: p[::-1], every=rng.uniform() < 0.5)


@corruption
def profiles_scaled(rng, folder):
    factor = [1.01, 10, 0.1, 25.4, 1000, 1 + any_size(rng, SLIGHT, 0.2)][rng.integers(6)]
    each_profile(rng, folder, lambda p: p * factor, every=rng.uniform() < 0.7)


@corruption
def profiles_stretched(rng, folder):
    """A scanner with wrong scales in x and z."""
    factor = 1 + rng.choice([-1, 1, 2], 2) * any_size(rng, SLIGHT, 0.2)
    each_profile(rng, folder, lambda p: p * factor, every=True)


@corruption
def profiles_moved(rng, folder):
    shift = any_size(rng, 0.02, 100) * rng.normal(size=2)
    each_profile(rng, folder, lambda p: p + shift, most=0.4)


@corruption
def profiles_turned(rng, folder):
    angle = np.radians(any_size(rng, 0.05, 90))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    each_profile(rng, folder, lambda p: p @ turn.T, most=0.4)


@corruption
def profiles_noisy(rng, folder):
    noise = any_size(rng, 0.02, 20)
    each_profile(rng, folder, lambda p: p + noise * rng.normal(size=p.shape))


@corruption
def profiles_spiky(rng, folder):
    share = rng.uniform(0.01, 0.8)

    def change(points):
        bad = rng.uniform(size=len(points)) < share
        points[bad, 1] = rng.choice([0, 500, -500, points[0, 1]]) + rng.normal(size=bad.sum())
        return points

    each_profile(rng, folder, change)


@corruption
def profiles_sheared(rng, folder):
    """The laser plane is not where the scanner believes it is."""
    shear = any_size(rng, SLIGHT, 0.5)
    each_profile(rng, folder, lambda p: p @ np.array([[1, 0], [shear, 1]]), every=True)


@corruption
def profile_of_another_pose(rng, folder):
    table = folder.table("profiles")
    parts = dict(list(table.groupby("pose", sort=False)))
    labels = list(parts)
    for i in some(rng, len(labels)):
        parts[labels[i]] = parts[labels[rng.integers(len(labels))]].assign(pose=labels[i])
    folder.put("profiles", pd.concat(parts.values()))


@corruption
def profiles_of_something_else(rng, folder):
    """Random walks, as of a cluttered table."""
    each_profile(rng, folder, lambda p: np.column_stack([p[:, 0], 150 + np.cumsum(rng.normal(size=len(p)))]))
