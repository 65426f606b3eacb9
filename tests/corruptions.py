"""What can go wrong with a scan folder, by kind: each corruption changes one file of it
as a random generator tells it to.
"""

import tomllib
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd

from profilecal.scan.toml import toml_text

EXAMPLES = Path(__file__).parents[1] / "data" / "examples"
# the least that a scale is wrong by: less moves the answer too, but the residuals of
# these scans do not show it
SLIGHT = 4e-3
CORRUPTIONS = {}  # by name; each changes contents of files, by the files' names


def example(kind):
    """The content of an example's files, and the sensor pose that is right."""
    files = {path.name: path.read_bytes() for path in (EXAMPLES / kind).iterdir()}
    truth = tomllib.loads(files.pop("truth.toml").decode())
    return files, np.array(truth["T_flange_sensor"])


def some(rng, count, most=None):
    """A few of `count` rows, or a share of them."""
    most = most or max(1, count // 2)
    number = round(np.exp(rng.uniform(0, np.log(most))))
    return rng.choice(count, min(count, number), replace=False)


def any_size(rng, low, high):
    """Log-uniform, either sign."""
    size = np.exp(rng.uniform(np.log(low), np.log(high)))
    return float(size * rng.choice([-1, 1]))


def one(rng, choices):
    """One of these, as it is."""
    return choices[rng.integers(len(choices))]


def corruption(adapted, *names):
    """Of one of these files, or of any, by a function of something that is `adapted` to
    content.
    """

    def decorated(function):
        def change(rng, files):
            name = one(rng, names or sorted(files))
            files[name] = adapted(function, rng, files[name])

        CORRUPTIONS[function.__name__] = change

    return decorated


def on_bytes(function, rng, content):
    return bytes(function(rng, content))


def on_table(function, rng, content):
    table = pd.read_csv(StringIO(content.decode()), dtype={"pose": str})
    return function(rng, table).to_csv(index=False, float_format="%.12g").encode()


def on_points(function, rng, content):
    """Of points (n, 2) of some profiles."""

    def of_table(rng, table):
        parts = list(table.groupby("pose", sort=False))
        for k in some(rng, len(parts), len(parts)):
            label, part = parts[k]
            x, z = function(rng, part[["x", "z"]].to_numpy(float)).T
            parts[k] = label, pd.DataFrame({"pose": label, "x": x, "z": z})
        return pd.concat(part for _, part in parts)

    return on_table(of_table, rng, content)


@corruption(on_bytes)
def bytes_flipped(rng, content):
    """In one of two, digits alone become other digits."""
    content, digits = bytearray(content), b"0123456789.-,e"
    places = range(len(content))
    if digits_alone := rng.uniform() < 0.5:
        places = [i for i, byte in enumerate(content) if byte in digits]
    for i in some(rng, len(places), 30):
        content[places[i]] = one(rng, digits if digits_alone else range(256))
    return content


@corruption(on_bytes)
def cut_short(rng, content):
    return content[: rng.integers(len(content))]


@corruption(on_bytes)
def other_separators(rng, content):
    content = content.replace(b",", one(rng, [b";", b"\t", b" ", b", "]))
    return content.replace(b".", b",") if rng.uniform() < 0.5 else content


NASTY = [
    *(0, -1, 1e-300, 1e308, 1e400, float("nan"), -0.0, True, "", "edge", "50"),
    *([], [1.0], {}, 10**400, 1, 25.0, 3000.0, "é" * 3000, "m", "mm", "eye-to-hand"),
]
ENTRIES = {
    "noise": ["position_mm", "orientation_deg", "profile_mm"],
    "target": ["side", "radius", "kind", "size"],
    "": ["title", "units", "mount", "comment"],
}


@corruption(on_bytes, "scan.toml")
def entry_set_to_anything(rng, content):
    header = tomllib.loads(content.decode())
    table = one(rng, list(ENTRIES))
    entries = header.setdefault(table, {}) if table else header
    entries[one(rng, ENTRIES[table])] = one(rng, NASTY)
    text = toml_text(header).replace("Infinity", "inf").replace("NaN", "nan")
    return text.encode()


CELLS = [
    *(np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 0, 9999.99, -32768, 1e9),
    *("text", "", "NA", "1,5", "None", "1.5 mm"),
]


@corruption(on_table, "poses.csv", "profiles.csv")
def cells_replaced(rng, table):
    table = table.astype(object)
    for row in some(rng, len(table), 20):
        table.iat[row, rng.integers(table.shape[1])] = one(rng, CELLS)
    return table


@corruption(on_table, "poses.csv", "profiles.csv")
def a_column_scaled(rng, table):
    column = one(rng, [name for name in table if name not in ("pose", "side")])
    of_units = 1000, 0.001, 10, 0.1, 25.4, 180 / np.pi, np.pi / 180
    factor = one(rng, [*of_units, 1 + any_size(rng, SLIGHT, 0.1)])
    return table.assign(**{column: table[column] * factor})


@corruption(on_table, "poses.csv")
def some_poses_wrong(rng, table):
    rows = some(rng, len(table))
    off = any_size(rng, 0.05, 2000) * rng.normal(size=(len(rows), 3))
    table.loc[rows, ["x", "y", "z"]] += off
    return table


@corruption(on_table, "poses.csv")
def target_moved(rng, table):
    """Somebody knocked against it in the middle of the scan."""
    later = table.index >= rng.integers(len(table))
    off = any_size(rng, 0.05, 50) * rng.normal(size=3)
    table.loc[later, ["x", "y", "z"]] += off
    return table


@corruption(on_table, "profiles.csv")
def few_poses(rng, table):
    labels = table["pose"].unique()
    kept = rng.choice(labels, rng.integers(0, 14), replace=False)
    return table[table["pose"].isin(kept)]


@corruption(on_points, "profiles.csv")
def profiles_emptied(rng, points):
    empties = [
        points[:0],
        points[:1],
        np.repeat(points[:1], len(points), axis=0),
        np.full_like(points, np.nan),
        np.zeros_like(points),
    ]
    return one(rng, empties)


@corruption(on_points, "profiles.csv")
def profiles_noisy(rng, points):
    return points + any_size(rng, 0.02, 20) * rng.normal(size=points.shape)


@corruption(on_points, "profiles.csv")
def profiles_spiky(rng, points):
    bad = rng.uniform(size=len(points)) < rng.uniform(0.01, 0.8)
    level = one(rng, [0, 500, -500, points[0, 1]])
    points[bad, 1] = level + rng.normal(size=bad.sum())
    return points
