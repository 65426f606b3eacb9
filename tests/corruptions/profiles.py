"""Profiles that are not what the scanner saw from their pose."""

from functools import wraps

import numpy as np
import pandas as pd

from corruptions.folder import SLIGHT, any_size, corruption, one, some


def by_pose(table):
    """The rows of each pose."""
    return dict(list(table.groupby("pose", sort=False)))


def on_profiles(most):
    """A corruption of up to a share of the profiles, of all where it is 0.

    What it decorates draws a function of points (n, 2).
    """

    def decorated(function):
        @wraps(function)
        def change(rng, folder):
            of_points = function(rng)
            parts = by_pose(folder.table("profiles"))
            chosen = range(len(parts))
            if most:
                chosen = some(rng, len(parts), 1, max(1, int(most * len(parts))))
            for label in np.array(list(parts), dtype=object)[chosen]:
                x, z = of_points(parts[label][["x", "z"]].to_numpy(float)).T
                parts[label] = pd.DataFrame({"pose": label, "x": x, "z": z})
            folder.put("profiles", pd.concat(parts.values()))

        return corruption(change)

    return decorated


@on_profiles(1.0)
def profiles_emptied(rng):
    empties = [
        lambda p: p[:0],
        lambda p: p[len(p) // 2 :][:1],
        lambda p: np.repeat(p[:1], len(p), axis=0),
        lambda p: np.column_stack([p[:, 0], np.full(len(p), p[0, 1])]),
        lambda p: np.full_like(p, np.nan),
        lambda p: np.zeros_like(p),
    ]
    return one(rng, empties)


@on_profiles(0.4)
def profiles_mirrored(rng):
    sign = one(rng, [[-1, 1], [1, -1], [-1, -1]])
    return lambda p: p * sign


@on_profiles(0)
def profiles_stretched_or_sheared(rng):
    """A scanner with wrong scales in x and z, or whose laser plane is not where it
    believes it to be.
    """
    factors = 1 + rng.choice([-1, 1, 2], 2) * any_size(rng, SLIGHT, 0.2)
    shear = any_size(rng, SLIGHT, 0.5)
    distortion = one(rng, [np.diag(factors), np.array([[1, 0], [shear, 1]])])
    return lambda p: p @ distortion


@on_profiles(1.0)
def profiles_noisy(rng):
    noise = any_size(rng, 0.02, 20)
    return lambda p: p + noise * rng.normal(size=p.shape)


@on_profiles(1.0)
def profiles_spiky(rng):
    share = rng.uniform(0.01, 0.8)

    def change(points):
        bad = rng.uniform(size=len(points)) < share
        level = rng.choice([0, 500, -500, points[0, 1]])
        points[bad, 1] = level + rng.normal(size=bad.sum())
        return points

    return change


@corruption
def profile_of_another_pose(rng, folder):
    parts = by_pose(folder.table("profiles"))
    labels = list(parts)
    for i in some(rng, len(labels)):
        parts[labels[i]] = parts[one(rng, labels)].assign(pose=labels[i])
    folder.put("profiles", pd.concat(parts.values()))
