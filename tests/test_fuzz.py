"""Random corruptions of the example scans: never a traceback, a hang, or a wrong answer that claims to be right.

The suite tries 36; `PROFILECAL_FUZZ=2000 pytest -s tests/test_fuzz.py` tries as many as it says and prints what came
of each kind. A corruption is drawn from its own seed, the number in a failure's first line.

Some corruptions make a faultless scan of another sensor pose, which no program can tell from a scan of that sensor.
They carry the pose that they stand for:

- the profiles' x or z negated or exchanged for each other, in all of them: as the scan plane has no y, that is the
  scanner turned by 180° about its z, x, or a diagonal;
- poses of a tool instead of the flange: the sensor pose relative to the tool;
- a left-handed robot frame, y and two angles negated: the mirror image of the flange and the sensor;
- all lengths in another unit: the sensor pose in that unit;
- the other mount with inverted poses: the same numbers;
- all poses moved by one motion of the base, negated quaternions, rows in another order: no change.
"""

import json
import os
import shutil
import signal
import time
import tomllib
from collections import Counter, defaultdict
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from profilecal.calibrate.calibration import calibrate
from profilecal.calibrate.check import check
from profilecal.cli import main
from profilecal.joint.state import pose_error
from profilecal.scan.conventions import CONVENTIONS, find_convention, from_rotations, to_rotations
from profilecal.scan.folder import read_scan
from profilecal.scan.scan import ScanError
from profilecal.scan.tables import toml_text

EXAMPLES = Path(__file__).parents[1] / "data" / "examples"
COUNT = int(os.environ.get("PROFILECAL_FUZZ", "36"))
LONGEST = 30  # seconds of one processor
BELIEVED = 5.0  # standard deviations
SLIGHT = 4e-3  # of wrong scales: in these scans residuals do not show less, which moves the answer all the same
CORRUPTIONS = {}


class Folder:
    """A scan folder in memory, and the sensor pose that its measurements stand for."""

    def __init__(self, kind: str):
        self.files = {path.name: path.read_bytes() for path in (EXAMPLES / kind).iterdir()}
        self.truth = np.array(tomllib.loads(self.files["truth.toml"].decode())["T_flange_sensor"])

    def table(self, name):
        """The rows of a table, numbers where they are numbers. Another corruption may have left nothing to read."""
        return pd.read_csv(StringIO(self.files[f"{name}.csv"].decode()), dtype={"pose": str})

    def put(self, name, table):
        self.files[f"{name}.csv"] = table.to_csv(index=False, float_format="%.12g").encode()

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
        table = table.drop(columns=[c for c in CONVENTIONS_COLUMNS if c in table])
        table[["x", "y", "z"]] = T
        table[list(convention.columns)] = from_rotations(convention, R)
        self.put("poses", table)

    def write(self, folder):
        folder.mkdir()
        for name, content in self.files.items():
            (folder / name).write_bytes(content)


CONVENTIONS_COLUMNS = {column for convention in CONVENTIONS for column in convention.columns}


def corruption(function):
    CORRUPTIONS[function.__name__] = function
    return function


def any_file(rng, folder):
    return str(rng.choice([name for name in sorted(folder.files) if name != "truth.toml"]))


def any_table(rng):
    return str(rng.choice(["poses", "profiles"]))


def some(rng, count, least=1, most=None):
    """A few of `count` rows, or a share of them."""
    most = most or max(least, count // 2)
    number = min(count, max(least, round(float(np.exp(rng.uniform(np.log(least), np.log(most)))))))
    return rng.choice(count, number, replace=False)


def any_size(rng, low, high):
    """Log-uniform, either sign."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))) * rng.choice([-1, 1]))


# Bytes and lines


@corruption
def bytes_flipped(rng, folder):
    name = any_file(rng, folder)
    content = bytearray(folder.files[name])
    for i in some(rng, len(content), 1, 30):
        content[i] = rng.integers(256)
    folder.files[name] = bytes(content)


@corruption
def digits_flipped(rng, folder):
    name = any_file(rng, folder)
    content = bytearray(folder.files[name])
    digits = [i for i, c in enumerate(content) if c in b"0123456789.-,"]
    for i in some(rng, len(digits), 1, 30):
        content[digits[i]] = rng.choice(list(b"0123456789.-,e"))
    folder.files[name] = bytes(content)


@corruption
def lines_deleted(rng, folder):
    name = any_file(rng, folder)
    lines = folder.files[name].splitlines(keepends=True)
    gone = set(some(rng, len(lines)).tolist())
    folder.files[name] = b"".join(line for i, line in enumerate(lines) if i not in gone)


@corruption
def lines_doubled(rng, folder):
    name = any_file(rng, folder)
    lines = folder.files[name].splitlines(keepends=True)
    twice = set(some(rng, len(lines)).tolist())
    folder.files[name] = b"".join(line * (1 + (i in twice)) for i, line in enumerate(lines))


@corruption
def lines_exchanged(rng, folder):
    name = any_file(rng, folder)
    lines = folder.files[name].splitlines(keepends=True)
    for _ in range(rng.integers(1, 10)):
        i, j = rng.integers(len(lines), size=2)
        lines[i], lines[j] = lines[j], lines[i]
    folder.files[name] = b"".join(lines)


@corruption
def cut_short(rng, folder):
    name = any_file(rng, folder)
    folder.files[name] = folder.files[name][: rng.integers(len(folder.files[name]))]


@corruption
def other_delimiter(rng, folder):
    name = f"{any_table(rng)}.csv"
    folder.files[name] = folder.files[name].replace(b",", [b";", b"\t", b" ", b", "][rng.integers(4)])


@corruption
def decimal_commas(rng, folder):
    name = f"{any_table(rng)}.csv"
    content = folder.files[name]
    if rng.uniform() < 0.5:
        content = content.replace(b",", b";")
    folder.files[name] = content.replace(b".", b",")


@corruption
def other_encoding(rng, folder):
    name = any_file(rng, folder)
    text = folder.files[name].decode("utf-8", "replace").replace("g1p1", "g1ä1").replace("Simulated", "Prüfkörper")
    folder.files[name] = text.encode(
        str(rng.choice(["utf-8-sig", "utf-16", "utf-16-le", "latin-1", "cp500"])), "replace"
    )


@corruption
def other_line_ends(rng, folder):
    name = any_file(rng, folder)
    folder.files[name] = folder.files[name].replace(b"\n", [b"\r\n", b"\r", b"\n\n", b"\n\r"][rng.integers(4)])


@corruption
def something_inserted(rng, folder):
    name = any_file(rng, folder)
    content = folder.files[name]
    for i in sorted(some(rng, len(content), 1, 5).tolist(), reverse=True):
        nasty = [b'"', b"'", b"\0", b"\x1a", b",", b"#", b"\n", b"nan", b"\xff", b"-", b"e", b"[", b"1e999", b'""']
        content = content[:i] + nasty[rng.integers(len(nasty))] + content[i:]
    folder.files[name] = content


@corruption
def file_emptied(rng, folder):
    name = any_file(rng, folder)
    folder.files[name] = [b"", b"\n", b" ", folder.files[name].split(b"\n")[0] + b"\n"][rng.integers(4)]


@corruption
def file_missing(rng, folder):
    del folder.files[any_file(rng, folder)]


@corruption
def files_exchanged(rng, folder):
    a, b = rng.choice(["poses.csv", "profiles.csv", "scan.toml"], 2, replace=False)
    folder.files[a], folder.files[b] = folder.files[b], folder.files[a]


@corruption
def number_rewritten(rng, folder):
    """One line's numbers as another program prints them."""
    name = f"{any_table(rng)}.csv"
    lines = folder.files[name].decode().split("\n")
    i = int(rng.integers(1, len(lines)))
    old = rng.choice(list("0123456789.,"))
    lines[i] = lines[i].replace(
        old, str(rng.choice(["1'000", "1 0", "O", "l", "٣", "½", "0x1F", "1_0", "True", " mm", "°"]))
    )
    folder.files[name] = "\n".join(lines).encode()


# Columns


@corruption
def column_renamed(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    old = str(rng.choice(table.columns))
    folder.put(
        name, table.rename(columns={old: str(rng.choice(["", "X", f" {old} ", old + "_mm", "pose", "x", "qx"]))})
    )


@corruption
def column_dropped(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    folder.put(name, table.drop(columns=rng.choice(table.columns)))


@corruption
def column_doubled(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice(table.columns))
    again = table[column] if rng.uniform() < 0.5 else table[column].sample(frac=1, random_state=1).to_numpy()
    table.insert(int(rng.integers(table.shape[1] + 1)), f"{column}#", again)
    folder.put(name, table.rename(columns={f"{column}#": str(rng.choice([column, column.upper(), f" {column}"]))}))


@corruption
def columns_in_other_order(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    folder.put(name, table[rng.permutation(table.columns)])


@corruption
def header_missing(rng, folder):
    name = f"{any_table(rng)}.csv"
    folder.files[name] = folder.files[name].split(b"\n", 1)[1]


@corruption
def names_of_columns_exchanged(rng, folder):
    """Only the header line: x for y, qw for qx, a for c."""
    name = any_table(rng)
    table = folder.table(name)
    a, b = rng.choice([c for c in table.columns if c not in ("pose", "side")], 2, replace=False)
    if name == "profiles":  # x for z
        turned(folder, [1, 0, 1])
    folder.put(name, table.rename(columns={a: b, b: a}))


@corruption
def a_second_orientation(rng, folder):
    table = folder.table("poses")
    other = CONVENTIONS[rng.integers(len(CONVENTIONS))]
    for column in other.columns:
        table[column] = rng.uniform(-1, 1, len(table))
    folder.put("poses", table)


@corruption
def other_convention_named(rng, folder):
    """The angles of one convention under the names of another."""
    table, old, _, _ = folder.poses()
    same = [c for c in CONVENTIONS if len(c.columns) == len(old.columns)]
    new = same[rng.integers(len(same))]
    folder.put("poses", table.rename(columns=dict(zip(old.columns, rng.permutation(new.columns), strict=True))))


# The header


NASTY = (
    *(0, -1, 1e-300, 1e308, 1e400, float("nan"), -0.0, True, "", "edge", "50", [], [1.0], {}, 10**400, 1, 25.0, 3000.0),
    *("é" * 3000, "m", "mm", "eye-to-hand", [[[1]]]),
)


@corruption
def entry_replaced(rng, folder):
    header = folder.header()
    section = (
        header
        if rng.uniform() < 0.4
        else header[str(rng.choice([k for k, v in header.items() if isinstance(v, dict)]))]
    )
    section[str(rng.choice(list(section)))] = NASTY[rng.integers(len(NASTY))]
    put_nasty(folder, header)


@corruption
def entry_added(rng, folder):
    header = folder.header()
    where, name = [
        *(("noise", n) for n in ("position_mm", "orientation_deg", "group_position_mm", "steering_mm", "profile_mm")),
        *(("target", n) for n in ("side", "radius", "kind", "size")),
        *(("", n) for n in ("title", "units", "mount", "comment")),
    ][rng.integers(13)]
    (header.setdefault(where, {}) if where else header)[name] = NASTY[rng.integers(len(NASTY))]
    put_nasty(folder, header)


def put_nasty(folder, header):
    text = toml_text(header).replace("Infinity", "inf").replace("NaN", "nan")
    folder.files["scan.toml"] = text.encode()


@corruption
def entry_missing(rng, folder):
    header = folder.header()
    section = header["target"] if rng.uniform() < 0.3 else header
    del section[str(rng.choice(list(section)))]
    folder.put_header(header)


@corruption
def other_kind(rng, folder):
    header = folder.header()
    kind = str(rng.choice(["edge", "disk", "ball", "plane", "point"]))
    header["target"] = {"kind": kind} | ({"radius": float(rng.uniform(10, 80))} if kind in ("disk", "ball") else {})
    folder.put_header(header)


@corruption
def other_radius(rng, folder):
    header = folder.header()
    if "radius" in header["target"]:
        header["target"]["radius"] *= [1000, 0.001, 2, 0.5, 25.4, 1 + any_size(rng, SLIGHT, 0.5)][rng.integers(6)]
    else:
        header["target"]["radius"] = 50.0
    folder.put_header(header)


@corruption
def other_units(rng, folder):
    header = folder.header()
    header["units"] = "m"
    if rng.uniform() < 0.5 and "radius" in header["target"]:
        header["target"]["radius"] /= 1000
    folder.put_header(header)


@corruption
def other_mount(rng, folder):
    header = folder.header()
    header["mount"] = "eye-to-hand"
    folder.put_header(header)


@corruption
def nested_deeply(rng, folder):
    folder.files["scan.toml"] += b"\ndeep = " + b"[" * 20_000 + b"]" * 20_000


# Single values


@corruption
def cells_replaced(rng, folder):
    name = any_table(rng)
    table = folder.table(name).astype(object)
    nasty = (
        np.nan,
        np.inf,
        -np.inf,
        1e308,
        -1e308,
        1e-320,
        "text",
        "",
        0,
        9999.99,
        -32768,
        1e9,
        "NA",
        "1,5",
        "None",
        "1.5 mm",
    )
    for i in some(rng, len(table), 1, 20):
        table.iat[i, rng.integers(table.shape[1])] = nasty[rng.integers(len(nasty))]
    folder.put(name, table)


@corruption
def cells_negated(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    columns = [c for c in table.columns if c not in ("pose", "side")]
    for i in some(rng, len(table)):
        column = rng.choice(columns)
        table.loc[i, column] = -table.loc[i, column]
    folder.put(name, table)


@corruption
def a_column_negated(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice([c for c in table.columns if c not in ("pose", "side")]))
    if name == "profiles":
        turned(folder, [0, 0, 1] if column == "x" else [1, 0, 0])
    folder.put(name, table.assign(**{column: -table[column]}))


@corruption
def a_column_scaled(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice([c for c in table.columns if c not in ("pose", "side")]))
    factor = [1000, 0.001, 10, 0.1, 25.4, 180 / np.pi, np.pi / 180, 1 + any_size(rng, SLIGHT, 0.1)][rng.integers(8)]
    folder.put(name, table.assign(**{column: table[column] * factor}))


@corruption
def a_column_constant(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice([c for c in table.columns if c not in ("pose", "side")]))
    folder.put(name, table.assign(**{column: [0.0, 1.0, table[column][0]][rng.integers(3)]}))


@corruption
def digits_lost(rng, folder):
    """Values printed coarsely."""
    name = any_table(rng)
    table = folder.table(name)
    columns = [c for c in table.columns if c not in ("pose", "side")]
    folder.put(name, table.assign(**table[columns].round(int(rng.integers(-1, 3)))))


# Poses


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


# Faultless scans of another sensor pose


def turned(folder, axis):
    """The scanner turned by 180°."""
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec(np.pi * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    folder.truth = folder.truth @ X


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


# Profiles


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


# The oracle


def corrupt(seed):
    """The folder of a seed and the names of what was done to it; one in five suffers twice."""
    rng = np.random.default_rng(seed)
    kind = ("edge", "disk", "ball")[seed % 3]
    names = list(CORRUPTIONS)
    chosen = [names[(seed // 3) % len(names)]]
    chosen += [names[rng.integers(len(names))]] if rng.uniform() < 0.2 else []
    folder, done = Folder(kind), [kind]
    for name in chosen:
        try:
            CORRUPTIONS[name](rng, folder)
            done.append(name)
        except Exception:
            if done == [kind]:
                raise
            # what the first corruption left is no table that the second one could change
    return folder, done


def outcome(path, truth, checking):
    """What calibrating a folder ends in: "refused", "ok", "weak" or "unobservable".

    Raises AssertionError for what must never be. Any exception but ScanError is such a thing too.
    """
    try:
        scan = read_scan(path)
        if checking:
            lines = check(scan)
            assert all("\n" not in line for line in lines), lines
        found = calibrate([scan])
    except ScanError as error:
        sentence = str(error)
        assert "\n" not in sentence, sentence
        assert 10 < len(sentence) < 600, sentence
        return "refused", sentence
    result = json.loads(json.dumps(found.to_json(), allow_nan=False))
    said = " | ".join(result["messages"])
    assert len(said) < 20_000, said
    if found.status in ("weak", "unobservable"):
        assert said, "a doubtful answer without a reason"
    if found.status == "ok":
        s = found.solution
        delta = pose_error(s.rotation, s.translation, truth[:3, :3], truth[:3, 3])
        sds = np.abs(delta) / np.sqrt(np.diag(s.covariance))
        size = np.sqrt(delta @ np.linalg.solve(s.covariance, delta))
        text = f"ok, but {size:.1f} standard deviations away, {np.abs(delta[:3]).max():.3g} mm; {s.level.how}; {said}"
        # the distance of six independent components that is as unlikely as 5 of one
        assert sds.max() <= BELIEVED, text
        assert size <= 6.3, text
    return found.status, said


def hung(signum, frame):
    raise AssertionError(f"still running after {4 * LONGEST} s")


def attempt(seed, folder_path):
    """(names, outcome, sentence, seconds) of one corruption."""
    folder, names = corrupt(seed)
    folder.write(folder_path)
    signal.signal(signal.SIGALRM, hung)
    signal.alarm(4 * LONGEST)  # others may keep the machine busy
    start = time.process_time()
    try:
        what, said = outcome(folder_path, folder.truth, seed % 5 == 0)
    except Exception as error:
        what, said = "FAILED", f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    seconds = time.process_time() - start
    return (names, what, said, seconds) if seconds < LONGEST else (names, "FAILED", f"took {seconds:.0f} s", seconds)


def test_corrupted_scans_are_refused_or_doubted_or_right(tmp_path):
    """PROFILECAL_FUZZ of them, 36 if it is not set. Spread over the kinds of corruption in the suite's part."""
    seeds = range(COUNT) if 3 * len(CORRUPTIONS) <= COUNT else range(0, 10 * COUNT, 10)
    table, slowest, failed = defaultdict(Counter), (0.0, 0), []
    for seed in seeds:
        names, what, said, seconds = attempt(seed, tmp_path / "scan")
        shutil.rmtree(tmp_path / "scan")
        table[names[-1]][what] += 1
        slowest = max(slowest, (seconds, seed))
        if what == "FAILED":
            failed.append(f"{seed} {'+'.join(names)}: {said}")
    print(f"\nlongest: {slowest[0]:.1f} s, of {slowest[1]}")
    for name, counts in sorted(table.items()):
        print(f"{name:30}", ", ".join(f"{count} {what}" for what, count in sorted(counts.items())))
    assert not failed, "\n".join(failed)


@pytest.mark.parametrize("seed", range(7, 7 * len(CORRUPTIONS), 61))
def test_the_command_line_says_it_in_its_exit_status(tmp_path, seed):
    folder, _ = corrupt(seed)
    folder.write(tmp_path / "scan")
    before = sorted(tmp_path.rglob("*"))
    done = CliRunner().invoke(main, ["calibrate", str(tmp_path / "scan"), "--json"])
    assert sorted(tmp_path.rglob("*")) == before
    if done.exit_code == 2:
        assert done.stdout == ""
        assert done.stderr.startswith("profilecal: ")
        assert done.stderr.count("\n") == 1
    else:
        status = json.loads(done.stdout)["status"]
        assert done.exit_code == (3 if status == "unobservable" else 0)
