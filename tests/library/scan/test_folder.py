"""Scan folders, written and read, and every mistake in them."""

import os
import re
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from folders import assert_same, edited, instead_of, removed, tabulated, written
from numpy.testing import assert_allclose
from simulated import scan_of

import profilecal as pc
from profilecal.joint.prior import TYPICAL, USUAL
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.folder import HEADER
from profilecal.scan.toml import read_toml, toml_text

TRUTH = {
    "seed": 1,
    "T_flange_sensor": np.eye(4).tolist(),
    "target": {"centre": [1.0, 2.0, 3.0]},
}


def twelve_poses(kind, measured):
    """Three of each of four orientations."""
    plan = {"groups": 4, "positions": 3, "scanner": {"points": 60}}
    return scan_of(kind, measured=measured, title='A "quoted" bar, 25 °', **plan)


@pytest.fixture
def folder(tmp_path):
    """Where a scan is written."""
    return tmp_path / "scan"


IN_CONVENTIONS = [(each.name, "points", "edge") for each in CONVENTIONS]
MEASUREMENTS = [
    ("quaternion", "profiles", "plane"),
    ("quaternion", "profiles", "disk"),
    ("quaternion", "chords", "disk"),
    ("quaternion", "arcs", "ball"),
    ("quaternion", "points", "point"),
]


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(
    ("convention", "measured", "kind"), [*IN_CONVENTIONS, *MEASUREMENTS]
)
def test_a_scan_written_is_read_back(folder, mount, convention, measured, kind):
    scan = replace(
        twelve_poses(kind, measured),
        side=np.where(np.arange(12) % 2, 1.0, -1.0),
        truth=TRUTH,
        convention=convention,
        mount=mount,
        group=np.repeat(range(8), [2, 1] * 4) if mount == "eye-to-hand" else None,
        group_given=mount == "eye-to-hand",
    )
    start = replace(scan, guess=np.eye(4), guess_sd=(np.inf, 5.0))
    pc.write_scan(start, folder)
    assert pc.read_scan(folder).guess_sd == (1000, 5)  # the most that a file can say
    assert_same(pc.read_scan(folder), start)
    truth = folder / "truth.toml"
    assert read_toml(truth) == TRUTH
    truth.write_text("broken = [", encoding="utf-8")
    assert_same(pc.read_scan(folder), start)


@pytest.mark.parametrize("said", [{"a": None}, {"a.b": 1}, {"a": {"b": {"c": 1}}}])
def test_what_would_be_read_otherwise_is_not_written(said):
    with pytest.raises(ValueError, match="cannot be written as TOML"):
        toml_text(said)


def in_metres(*columns):
    """What changes columns of a table from mm to m."""
    return lambda table: table.assign(**table[[*columns]] / 1000)


def test_metres_and_millimetres_are_the_same_scan_in_any_order_of_columns(folder):
    scan = replace(twelve_poses("ball", "arcs"), side=0)
    pc.write_scan(scan, folder)
    for change in (
        tabulated("poses.csv", in_metres("x", "y", "z")),
        tabulated("poses.csv", lambda table: table[table.columns[::-1]]),
        tabulated("arcs.csv", in_metres("x", "z", "r")),
        edited("scan.toml", 'units = "mm"', 'units = "m"'),
        edited("scan.toml", "radius = 25.0", "radius = 0.0203\nside = -1"),
    ):
        change(folder)
    again = pc.read_scan(folder)
    assert_same(again, replace(scan, side=np.array(-1), sizes={"radius": 20.3}))
    assert again.sizes == {"radius": 20.3}  # not 20.299999999999997


def test_the_example_of_all_entries_leaves_none_out_and_says_what_is_usual():
    place = Path(__file__).parents[3] / "data" / "examples" / "scan.toml"
    text = place.read_text(encoding="utf-8")
    said = tomllib.loads(re.sub(r"^# (?=\[|\w+ = )", "", text, flags=re.M))
    assert said.keys() == HEADER.keys()
    assert said["noise"].keys() == HEADER["noise"].keys()
    usual = vars(USUAL) | vars(TYPICAL)
    others = {"profile_mm", "steering_mm"}
    assert {k: v for k, v in said["noise"].items() if usual[k] != v}.keys() == others


def test_blank_and_nan_points_are_missing_and_extra_columns_ignored(folder):
    pc.write_scan(twelve_poses("edge", "points"), folder)
    path = folder / "points.csv"
    lines = path.read_text().splitlines()
    lines[1:3] = "g1p1,,", "g1p2,nan,NaN"
    path.write_text("\n".join(f"{line},comment" for line in lines) + "\n\n , \n")
    missing = [np.isnan(rows).all() for rows in pc.read_scan(folder).values]
    assert missing == [True, True] + 10 * [False]


def as_arrays(name, **changed):
    """The columns of a table, some of them changed, as arrays in its place."""

    def change(folder):
        table = pd.read_csv(folder / f"{name}.csv")
        columns = {key.title(): table[key].to_numpy() for key in table} | changed
        labels = columns["Pose"].astype(str)
        labelled = columns | {"Pose": labels}
        np.savez(folder / f"{name}.npz", about=["noon", "hall 2"], **labelled)
        (folder / f"{name}.csv").unlink()

    return change


@pytest.mark.parametrize("by_us", [True, False])
def test_arrays_are_the_same_scan_as_the_table(folder, monkeypatch, by_us):
    scan = twelve_poses("plane", "profiles")
    rows = [rows[: 40 + k] for k, rows in enumerate(scan.values)]
    rows[3], rows[5] = np.full((1, 2), np.nan), rows[5][:0]  # nothing
    if by_us:
        monkeypatch.setattr("profilecal.scan.folder.SPREADSHEET", 100)
    scan = replace(scan, values=tuple(rows))
    pc.write_scan(scan, folder)
    if not by_us:
        as_arrays("profiles")(folder)
    assert not (folder / "profiles.csv").exists()
    for expected, read in zip(scan.values, pc.read_scan(folder).values, strict=True):
        assert_allclose(read, expected, atol=1e-9)


header = partial(edited, "scan.toml")
poses = partial(tabulated, "poses.csv")
arcs = partial(tabulated, "arcs.csv")
put = partial(written, "arcs.csv")


def relabelled(label):
    """What gives the row of pose g2p1 another label."""
    return lambda table: table.replace({"pose": {"g2p1": label}})


def everywhere(**columns):
    return lambda table: table.assign(**columns)


def without(column):
    return lambda table: table.drop(columns=column)


def text_for_a_number(table):
    words = table["x"].astype(object)
    words[1] = "abc"
    return table.assign(x=words)


def not_text(folder):
    (folder / "arcs.csv").write_bytes(b"pose\nP\xff\xfe")


def arrays_cut_short(folder):
    as_arrays("arcs")(folder)
    os.truncate(folder / "arcs.npz", 900)


def two_axes(folder):
    as_arrays("arcs", X=np.ones((12, 2)))(folder)


def too_large(folder):
    os.truncate(folder / "arcs.csv", 500_000_000)


LONG_COMMENT = "#" * 1_000_000
MISTAKES = {  # by what is said of each
    # scan.toml
    "scan.toml: no such file; expected it to name the target": removed("scan.toml"),
    "unknown entry 'unit'; there are title, units": header("units", "unit"),
    r"profile_mm is -0.05 in \[noise\]; expected zero, or 1e-06 to 100": header(
        "0.05", "-0.05"
    ),
    "units is 'inch'; expected mm or m": header('"mm"', '"inch"'),
    r"kind is 'sphere' in \[target\]; expected edge or": header('"ball"', '"sphere"'),
    r"radius is missing in \[target\]; expected 0.5 to 1000": header(
        "radius = 25.0", ""
    ),
    r"mount is missing in \[guess\]; expected 6 numbers": header(
        "[", "[guess]\nsd_mm = 5\n["
    ),
    "'edge' needs profiles or points": header('"ball"\nradius = 25.0', '"edge"'),
    "target is 5; expected a table": written("scan.toml", "target = 5"),
    "scan.toml: nested too deeply": header("25.0", "[" * 20_000),
    r"scan.toml: 1.0\d+ MB; expected at most": header("[", f"{LONG_COMMENT}\n["),
    # which files there are
    "poses.csv: no such file": removed("poses.csv"),
    "expected one of profiles, .*; found none": removed("arcs.csv"),
    "found points.csv and arcs.csv": written("points.csv", "pose,x,z\n"),
    "arcs.csv: Too many levels of symbolic links": instead_of(
        "arcs.csv", lambda path: path.symlink_to(path.name)
    ),
    "poses.csv: not a file": instead_of("poses.csv", os.mkfifo),
    # tables as such
    "arcs.csv: no rows; expected names of columns": put(""),
    "arcs.csv: 2 columns 'x'; expected one": put("pose,x,X ,z,r\nP0,1,1,2,3\n"),
    "arcs.csv line 3: 2 fields; expected 4: is the file cut short": put(
        "pose,x,z,r\nP0,1,2,3\nP1,1"
    ),
    "cannot be read: unexpected end of data": put('pose,x,z,r\n"P0,1,2,3\n'),
    "not UTF-8 text, b'.xff' in line 2; save": not_text,
    "arcs.csv: 500 MB; expected at most 400 MB": too_large,
    "poses.csv: no columns 'y'; expected one; there are pose, x": poses(without("y")),
    "qw, qx, .*; found none among pose, x, y, z, qx": poses(without("qw")),
    "; found quaternion and KUKA angles": poses(everywhere(a=1, b=2, c=3)),
    # the same in arrays
    "arcs.npz: no arrays; expected .* cut short": arrays_cut_short,
    "x is float64 of shape .12, 2.; expected numbers or text, .12,.": two_axes,
    "x is complex128 of shape": as_arrays("arcs", X=np.ones(12, complex)),
    r"arcs.npz: .* text .dtype str.: is it": as_arrays("arcs", Z=np.array([None] * 12)),
    # labels
    "line 5: pose 'g1p3' is there twice": poses(relabelled("g1p3")),
    "line 5: pose 'g9' is not in poses": arcs(relabelled("g9")),
    "line 5: no pose label": arcs(relabelled(None)),
    "scan: Scan: pose 'g1p3' has 2 rows of arcs; expected one": arcs(
        relabelled("g1p3")
    ),
    r"'long\\nlong.*… is not in poses": arcs(relabelled("long\n" * 99)),
    # numbers
    "line 2: quaternion of length": poses(lambda table: table.assign(qw=table.qw + 1)),
    "line 6: z is empty": poses(
        lambda table: table.assign(z=table.z.where(table.index != 4))
    ),
    "line 3: x is 'abc'; expected a finite number": arcs(text_for_a_number),
    "line 2: x is '4_00'": arcs(everywhere(x="4_00")),
    "the least r of arcs is -15": arcs(everywhere(r=-15)),
    "line 4: no group; expected": poses(everywhere(group=[*"ab", *[None] * 10])),
    "poses.csv.*are the units": poses(in_metres("x", "y", "z")),
    "line 2: z is -32768; expected at most 10000: .*blank": arcs(everywhere(z=-32768)),
    r"line 6: the flange is 2500\d.* mm": poses(
        lambda table: table.assign(x=25e3 * (table.index == 4))
    ),
}


@pytest.mark.parametrize("sentence", MISTAKES)
def test_every_mistake_is_one_sentence_with_file_and_value(folder, sentence):
    pc.write_scan(twelve_poses("ball", "arcs"), folder)
    MISTAKES[sentence](folder)
    with pytest.raises(pc.ScanError, match=sentence) as caught:
        pc.read_scan(folder)
    assert "scan" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_long_table_is_read_to_its_end_and_its_empty_lines_are_counted(folder):
    pc.write_scan(twelve_poses("plane", "profiles"), folder)
    path = folder / "profiles.csv"
    lines = path.read_text().splitlines()
    lines += lines[1:] * 4
    lines.insert(450, "")
    lines[2000] += ",5"
    path.write_text("\n".join(lines))
    with pytest.raises(pc.ScanError, match="line 2001: 4 fields; expected 3"):
        pc.read_scan(folder)


def test_a_folder_with_something_in_it_is_not_overwritten(tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    scan = twelve_poses("edge", "points")
    with pytest.raises(pc.ScanError, match="already in use; name a new folder"):
        pc.write_scan(scan, tmp_path)
    with pytest.raises(pc.ScanError, match="Not a directory"):
        pc.write_scan(scan, tmp_path / "note.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]
