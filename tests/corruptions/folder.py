"""A scan folder that corruptions change, and what they draw: rows, files, sizes."""

import tomllib
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from profilecal.scan.conventions import (
    CONVENTIONS,
    find_convention,
    from_rotations,
    to_rotations,
)
from profilecal.scan.toml import toml_text

EXAMPLES = Path(__file__).parents[2] / "data" / "examples"
# the least that a scale is wrong by: less moves the answer too, but the residuals of
# these scans do not show it
SLIGHT = 4e-3
CONVENTIONS_COLUMNS = {
    column for convention in CONVENTIONS for column in convention.columns
}
CORRUPTIONS = {}


class Folder:
    """A scan folder in memory, and the sensor pose that its measurements stand for."""

    def __init__(self, kind: str):
        self.files = {
            path.name: path.read_bytes() for path in (EXAMPLES / kind).iterdir()
        }
        truth = tomllib.loads(self.files["truth.toml"].decode())
        self.truth = np.array(truth["T_flange_sensor"])

    def table(self, name):
        """The rows of a table, numbers where they are numbers.

        Another corruption may have left nothing to read.
        """
        text = self.files[f"{name}.csv"].decode()
        return pd.read_csv(StringIO(text), dtype={"pose": str})

    def put(self, name, table):
        text = table.to_csv(index=False, float_format="%.12g")
        self.files[f"{name}.csv"] = text.encode()

    def header(self):
        return tomllib.loads(self.files["scan.toml"].decode())

    def put_header(self, header):
        self.files["scan.toml"] = toml_text(header).encode()

    def poses(self):
        """The table of poses, its convention, R (P, 3, 3) and T (P, 3)."""
        table = self.table("poses")
        convention = find_convention(table.columns)
        R = to_rotations(convention, table[list(convention.columns)].to_numpy(float))
        return table, convention, R, table[["x", "y", "z"]].to_numpy(float)

    def put_poses(self, table, convention, R, T):
        table = table.drop(columns=CONVENTIONS_COLUMNS.intersection(table))
        table[["x", "y", "z"]] = T
        table[list(convention.columns)] = from_rotations(convention, R)
        self.put("poses", table)

    def write(self, folder):
        folder.mkdir()
        for name, content in self.files.items():
            (folder / name).write_bytes(content)


def corruption(function):
    CORRUPTIONS[function.__name__] = function
    return function


def some(rng, count, least=1, most=None):
    """A few of `count` rows, or a share of them."""
    most = most or max(least, count // 2)
    number = round(float(np.exp(rng.uniform(np.log(least), np.log(most)))))
    return rng.choice(count, min(count, max(least, number)), replace=False)


def any_size(rng, low, high):
    """Log-uniform, either sign."""
    size = np.exp(rng.uniform(np.log(low), np.log(high)))
    return float(size * rng.choice([-1, 1]))


def one(rng, choices):
    """One of these, as it is."""
    return choices[rng.integers(len(choices))]


def turned(folder, axis):
    """The scanner turned by 180°."""
    half_turn = Rotation.from_rotvec(np.pi * np.array(axis) / np.linalg.norm(axis))
    X = np.eye(4)
    X[:3, :3] = half_turn.as_matrix()
    folder.truth = folder.truth @ X
