"""Scans from the files that people have: a table of folders, each read at once, asked
about in one line that answers, or refused in a sentence.
"""

import functools
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import peoples_files as people
import pytest
from command import run
from corruptions import CORRUPTIONS
from folders import edited, written
from makers_table import README, with_table
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from openpyxl import load_workbook
from pandas import DataFrame, ExcelWriter
from peoples_files import (
    POSES,
    PROFILES,
    listed,
    poses,
    scan,
    text,
    write_lines,
    write_table,
)
from simulated import scan_of

from profilecal.calibration.calibrate import calibrate
from profilecal.scan.conventions import from_rotations, named
from profilecal.scan.folder import read_scan
from profilecal.scan.tables import ScanError
from profilecal_tool.importing.import_scan import Layout, import_scan
from profilecal_tool.importing.makers import ROBOTS
from profilecal_tool.importing.program_lines import matches_of, program_blocks
from profilecal_tool.importing.questions import Question

HERE = np.eye(4)
BACKWARDS = range(11, -1, -1)
CHANGES = ["bytes_flipped", "lines_lost_or_doubled", "cut_short"]
CHANGES += ["other_separators", "something_inserted"]
FUZZ = int(os.environ.get("PROFILECAL_FUZZ", "30"))


def read(folder, **said):
    """The edge's scan that a folder is taken for, and what was taken for granted."""
    return import_scan(folder, "edge", {}, Layout(**said))


def by_name(function):
    return function.__name__


def check_scan(imported, base=HERE):
    """All poses and profiles are there, in whatever order."""
    T = base @ imported.T_base_flange
    order, known = (np.argsort(one[:, 0, 3]) for one in (T, scan().T_base_flange))
    assert_allclose(T[order], scan().T_base_flange[known], atol=1e-6)
    for k, row in zip(order, known, strict=True):
        own, points = imported.values[k], scan().values[row]
        own, points = (one[np.isfinite(one[:, 1])] for one in (own, points))
        assert_allclose(own, points, atol=1e-4)


@pytest.mark.parametrize("of_poses", POSES, ids=by_name)
def test_poses_in_any_syntax_are_the_same(of_poses, tmp_path):
    imported, _ = read(people.written(tmp_path / "in", of_poses))
    check_scan(imported, people.BASE if of_poses in people.IN_A_BASE else HERE)


@pytest.mark.parametrize("of_profiles", PROFILES, ids=by_name)
def test_profiles_in_any_layout_are_the_same(of_profiles, tmp_path):
    check_scan(read(people.written(tmp_path / "in", people.tum, of_profiles))[0])


# folders that are asked about; each with what the question has


def named_profiles(name, titles="x,z", encoding="utf-8", begin=0):
    def write(folder):
        for k, points in enumerate(scan().values, begin):
            lines = "\r\n".join([titles, *map(text, points)]).replace("nan", "")
            (folder / name.format(k)).write_bytes(lines.encode(encoding))

    return write


def points_of(titles, *columns, scale=1.0, nothing=""):
    """Profiles in a table each, with further columns for every point, or none."""

    def write(folder):
        for k, points in enumerate(scan().values):
            lines = [
                f"{column},{text(scale * point)}"
                for column in columns or ("",)
                for j, point in enumerate(points)
            ]
            lines = [line.strip(",").replace("nan", nothing) for line in lines]
            write_lines(folder / f"p{k}.csv", [titles] * bool(titles) + lines)

    return people.tum, write


def doubled(one, other):
    """Two files in place of each."""

    def write(folder):
        people.one_each(folder)
        for path in [*folder.glob("scan_*")]:
            shutil.copy(path, folder / other.format(path.stem))
            path.rename(folder / one.format(path.stem))

    return write


def two_poses(folder):
    rows = [dict(zip("xyzabc", row, strict=True)) for row in poses("KUKA angles")]
    rows = [{"one": row, "two": {**row, "x": 1.0}} for row in rows]
    (folder / "poses.json").write_text(json.dumps(rows))


def transforms(folder):
    """Of the flange and of a camera on it, as ROS prints them, in turn."""
    documents = []
    for position, turn in people.samples():
        for k, child in enumerate(("camera_link", "tool0")):
            own = position | {"x": position["x"] + k - 1}
            own = {"translation": own, "rotation": turn}
            documents.append(json.dumps({"child_frame_id": child, "transform": own}))
    write_lines(folder / "tf.yaml", ["\n---\n".join(documents)])


def lists_of_four(folder):
    """As most libraries have quaternions."""
    rows = [
        {"position": [*position.values()], "orientation": [*turn.values()]}
        for position, turn in people.samples()
    ]
    (folder / "poses.json").write_text(json.dumps(rows))


def with_a_far_point(folder):
    people.one_each(folder)
    edited("scan_003.csv", "nan,nan", "1e6,1e6")(folder)


of_camera = listed("cam_x,cam_y,cam_z,cam_a,cam_b,cam_c")


def angles_first(folder):
    """In degrees in front of positions, under a vector's titles."""
    rows = np.roll(poses("FANUC angles"), 3, axis=1)
    write_table(folder / "poses.csv", "rx,ry,rz,x,y,z", rows)


def two_arrays(folder):
    left = np.array(scan().values)
    np.savez(folder / "profiles.npz", left=left, right=left + 1)


declared = functools.partial(people.abb, used=False)


ASKED = {
    "a code": (*points_of("x,z", nothing="-1"), "z is -1 at 12 of 240 points"),
    "a far point": (people.tum, with_a_far_point, "1000000 at 1 of 229"),
    "lists of four": (lists_of_four, people.one_each, "what are they"),
    "German angles": (
        listed("X-Pos;Y-Pos;Z-Pos;Winkel X;Winkel Y;Winkel Z", (), "FANUC angles"),
        people.one_each,
        "what are they",
    ),
    "called as in quaternions": (
        listed("X,Y,Z,Rot X,Rot Y,Rot Z", (), "FANUC angles"),
        people.one_each,
        "what are they",
    ),
    "one title twice": (listed("X,X,Z,A,B,C"), people.one_each, "X, X, Z"),
    "inches": (*points_of("x,z", scale=1 / 25.4), "mm wide, up to"),
    "no titles": (
        listed("", (), "FANUC angles", 0.001, np.pi / 180),
        people.one_each,
        "what are they",
    ),
    "radians": (
        listed("x,y,z,w,p,r", (), "FANUC angles", 1, np.pi / 180),
        people.one_each,
        "rad or deg",
    ),
    "quaternions": (
        listed("x,y,z,q1,q2,q3,q4", (), "quaternion"),
        people.one_each,
        "what are they",
    ),
    "two positions": (
        lambda folder: write_table(
            folder / "poses.csv",
            "x,y,z,tx,ty,tz,a,b,c",
            np.insert(poses("KUKA angles"), [3, 3, 3], 7.0, axis=1),
        ),
        people.one_each,
        "which of those called alike",
    ),
    "one unknown": (
        listed("x,y,z,Quaternion V,qx,qy,qz", (), "quaternion"),
        people.one_each,
        "V, qx, qy, qz; what are they",
    ),
    "a tool that no line uses": (declared, people.one_each, "is declared, and no line"),
    "two poses": (two_poses, people.one_each, "one or two"),
    "of a camera": (of_camera, people.one_each, "poses are of cam"),
    "angles first": (angles_first, people.one_each, "rad or deg"),
    "two arrays": (people.tum, two_arrays, "left_points_1,left_points_2 or right"),
    "two frames in turn": (transforms, people.one_each, "tools tool0, camera_link"),
    "no columns": (*points_of("", "7"), "no x and z"),
    "frames": (*points_of("frame,x,z", "0", "1"), "(all: --where 'frame=*')"),
    "two scanners": (*points_of("sensor,x,z", "0", "1"), "sensor is 0 to 1"),
    "along y": (*points_of("x,y,z", "0"), "x always the same"),
    "a cloud": (*points_of("y,x,z", "-2", "0", "2"), "y is -2 to 2"),
    "whole numbers": (*points_of("x,z", scale=1e5), "(--missing)"),
    "several of a pose": (
        people.csv,
        doubled("{}_frame0.csv", "{}_frame1.csv"),
        "of one pose",
    ),
    "two families": (
        people.csv,
        doubled("{}.csv", "under_{}.csv"),
        "which holds the profiles",
    ),
}


@pytest.mark.parametrize("name", ASKED)
def test_the_line_that_is_printed_answers_the_question(name, tmp_path):
    of_poses, of_profiles, words = ASKED[name]
    folder = people.written(tmp_path / "in", of_poses, of_profiles)
    asked = run("import", folder, tmp_path / "scan", "--target", "edge")
    question, line = asked.output.strip().split("\n")
    assert asked.exit_code == 2
    assert words in question
    pasted = run(*shlex.split(line)[1:])
    assert pasted.exit_code == 0, pasted.output
    check_scan(read_scan(tmp_path / "scan"))
    kept = (tmp_path / "scan" / "import.toml").read_text()
    again = run("import", folder, tmp_path / "scan")
    assert again.exit_code == 0, again.output
    assert (tmp_path / "scan" / "import.toml").read_text() == kept


# pairing: poses, profiles, what is said of how


def log_with_stops(folder):
    """At 2 Hz, of a robot that stands still for two seconds of four."""
    rows = poses("quaternion")
    between = (rows + np.roll(rows, -1, axis=0)) / 2
    states = np.stack([*4 * [rows], *4 * [between + 1]], axis=1)
    states[:, 4:] += np.arange(4)[:, None]
    times = 1.7e9 + np.arange(8 * len(rows)) / 2
    lines = [
        f"{1000 * t:.0f},{text(row)}"
        for t, row in zip(times, states.reshape(-1, 7), strict=True)
    ]
    write_lines(folder / "robot_log.csv", ["time [ms],x,y,z,qw,qx,qy,qz", *lines])


def named_by_the_clock(folder):
    """0.1 s after a line of the log."""
    for k, points in enumerate(scan().values):
        moment = datetime.fromtimestamp(1.7e9 + 4 * k + 1.1, UTC)
        name = moment.strftime("scan_%Y-%m-%d_%H-%M-%S.%f")
        write_table(folder / f"{name}.csv", "x,z", points)


def in_one_table(folder):
    """A row for each point, with its pose."""
    lines = ["tcp_x,tcp_y,tcp_z,tcp_qw,tcp_qx,tcp_qy,tcp_qz,laser_x,laser_z"]
    for row, points in zip(poses("quaternion"), scan().values, strict=True):
        lines += [f"{text(row)},{text(point)}".replace("nan", "") for point in points]
    write_lines(folder / "log.csv", lines)


def captures(of_points):
    for (position, turn), points in zip(people.samples(), scan().values, strict=True):
        pose = {"position": position, "orientation": turn}
        yield {"robot": pose, "profile": {"points": of_points(points)}}


def in_json(folder):
    """A file for each pose, with its profile."""
    for k, capture in enumerate(captures(np.ndarray.tolist)):
        (folder / f"capture{k:02d}.json").write_text(json.dumps(capture))


def in_one_json(folder):
    """A sample for each pose, with points by name."""
    samples = captures(lambda points: [{"x": x, "z": z} for x, z in points])
    (folder / "samples.json").write_text(json.dumps([*samples]))


def sheets(folder):
    """A sheet for each profile, with blank rows where nothing was seen."""
    with ExcelWriter(folder / "profiles.xlsx") as book:
        for k, points in enumerate(scan().values):
            table = DataFrame(points, columns=["x", "z"])
            table.to_excel(book, sheet_name=f"scan_{k:03d}", index=False)


def nothing(folder):
    """No more files."""


GERMAN = "{};X in mm;Y in mm;Z [mm];A in Grad;B in Grad;C in Grad"
SINCE_1970 = [f"17200312{k:02}141500000" for k in range(12)]  # ns
BY_XP = [f"XP{k}" for k in range(12)]


PAIRED = {
    "1.10 and 1.1": (
        listed("Pose,X [mm],Y,Z,A,B,C", [f"1.{k + 1}" for k in range(12)]),
        named_profiles("p_1.{}.csv", begin=1),
        "by Pose and the numbers in the names",
    ),
    "a date and a number": (
        listed(GERMAN.format("Laufnummer"), BY_XP, order=BACKWARDS),
        named_profiles("20240503_1412{0:02}_{0:03}.csv"),
        "number 1",
    ),
    "a folder each": (
        lambda folder: [
            (folder / f"{k}").mkdir() or np.savetxt(folder / f"{k}" / "pose.txt", T)
            for k, T in enumerate(people.matrices_of_poses())
        ],
        named_profiles("{}/profile.csv"),
        "number 1",
    ),
    "German": (
        listed(GERMAN.format("Messung"), BY_XP, order=BACKWARDS, encoding="cp1252"),
        named_profiles("line2_{:02}.csv", "X Achse [mm],Höhe [mm]", "cp1252"),
        "number 2 in the names",
    ),
    "Chinese": (
        listed(GERMAN.format("序号"), BY_XP, order=BACKWARDS, encoding="gb18030"),
        named_profiles("轮廓{}.csv", "X坐标(毫米),高度(毫米)", "gb18030"),
        "number 1",
    ),
    "UTF-16": (
        listed(GERMAN.format("Nr."), BY_XP, order=BACKWARDS, encoding="utf-16"),
        named_profiles("p{}.txt", "x,z", "utf-16", 1),
        "from 0 and from 1",
    ),
    "decimal commas between spaces": (
        listed("X Y Z A B C"),
        named_profiles("p{}.csv"),
        "in order",
    ),
    "a pose before": (
        listed("Nr,X,Y,Z,A,B,C\n0,400,0,600,0,90,0", range(1, 13)),
        named_profiles("profile_{:03}.csv", begin=1),
        "number 1 in the names; left out, without a profile: 0",
    ),
    "an index without a title": (
        listed(",x,y,z,a,b,c", range(12), order=BACKWARDS),
        named_profiles("p{}.csv"),
        "number 1 in the names",
    ),
    "units below": (
        listed("Nr;X;Y;Z;A;B;C\n;[m];[m];[m];°;°;°", range(12), scale=1e-3),
        named_profiles("p{}.csv", "# x,z\r\n# mm,mm"),
        "number 1 in the names",
    ),
    "units in a remark": (
        listed("X,Y,Z,A,B,C\n# m,m,m,deg,deg,deg", scale=1e-3),
        named_profiles("p{}.csv"),
        "in order",
    ),
    "milliseconds": (log_with_stops, named_by_the_clock, "up to 0.1 s apart"),
    "numbers like dates": (
        listed("time,x,y,z,a,b,c", SINCE_1970, order=BACKWARDS),
        named_profiles("17200312{:02}141500000.csv"),
        "up to 0 s apart",
    ),
    "points": (in_one_table, nothing, "in order"),
    "JSON": (in_json, nothing, "by file and the names"),
    "a speed": (
        listed("speed,X,Y,Z,A,B,C", 12 * [100]),
        named_profiles("v100_{:02}.csv"),
        "in order",
    ),
    "samples": (in_one_json, nothing, "in order"),
    "sheets": (people.csv, sheets, "by Name and the names"),
}


@pytest.mark.parametrize("name", PAIRED)
def test_profiles_have_their_poses(name, tmp_path):
    of_poses, of_profiles, how = PAIRED[name]
    imported, taken = read(people.written(tmp_path / "in", of_poses, of_profiles))
    assert how in taken["matched"]
    check_scan(imported)


# what poses are of; what is done to a program, and what is then said


def listed_frames(folder):
    """A FANUC's program, and the bases' and tools' frames in a listing beside it."""
    people.fanuc(folder, tool=3)
    lines = []
    for name, x in (("FRAME", 7.0), ("TOOL", 12.0)):
        lines += [f"[*SYSTEM*]$MNU{name}  Storage: CMOS", "[1,3] =", "  Group: 1"]
        lines += [f"  X: {x} Y: -35.0 Z: 180.0", "  W: 10.0 P: -20.0 R: 30.0"]
        lines += [f"[*SYSTEM*]$MNU{name}NUM  Storage: CMOS", "  [1] = 3"]
    write_lines(folder / "SYSFRAME.VA", lines)


def two_declared(folder):
    declared(folder)
    line = (folder / "scan.mod").read_text().splitlines()[1]
    edited("scan.mod", line, f"{line}\n{line.replace('tScan', 'tOther')}")(folder)


def two_frames(folder):
    people.abb(folder)
    line = (folder / "scan.mod").read_text().splitlines()[1]
    write_lines(folder / "other.mod", [line.replace("12.0", "13.0")])


def denso(folder):
    """Tool 1 is taken before the first move, none after the last."""
    lines = ["' TOOL 1, (0, 0, 99, 0, 0, 0)", "TOOL 1, (12, -35, 180, 10, -20, 30)"]
    for k, row in enumerate(poses("FANUC angles")):
        lines.append(f"P[{k}] = P({text(row)}, 5)")
    write_lines(folder / "scan.pcs", [*lines, "CHANGETOOL 1", "CHANGETOOL 0"])


TOOLS = {
    "no frame": (
        people.abb,
        ("tooldata tScan", "tooldata tOther"),
        "tscan, whose frame",
    ),
    "a vector": (
        listed("x,y,z,rx,ry,rz", (), "rotation vector"),
        None,
        "rx, ry, rz: a rotation vector",
    ),
    "a base": (people.kuka, ("BASE_NO 0", "BASE_NO 2", 12), "in base 2, not taken off"),
    "an offset": (
        people.abb,
        ("MoveL p", "MoveL RelTool(p", 12),
        "taken off; in base wball, not taken off; moves beside poses",
    ),
    "a frame in the program": (
        people.kuka,
        ("DECL FDAT", "$TOOL={X 12,Y 0,Z 0,A 0,B 0,C 0}\n$BASE=BASE_DATA[2];", 12),
        "one at [12.0, 0.0, 0.0], taken off; in base 2, not taken off",
    ),
    "a frame with a name": (
        people.ur,
        ("set_tcp(p[", "set_tcp(tcp1)\n  tcp1=p["),
        "tcp1 at [0.012, -0.035, 0.18], taken off",
    ),
    "a line": (
        people.yaskawa,
        ("///TOOL 0", "///TOOL 2"),
        "2, whose frame is not here",
    ),
    "a frame": (people.abb, ("", ""), "tscan at [12.0, -35.0, 180.0], taken off"),
    "a frame beside": (
        people.robot_states,
        None,
        "one at [0.012, -0.035, 0.18]",
    ),
    "two frames of one tool": (two_frames, None, "tscan, whose 2 frames are here"),
    "listed frames": (listed_frames, None, "3 at [12.0, -35.0, 180.0], taken off"),
    "a tool before the first move": (denso, None, "are the poses? tool=1"),
    "two that moves have": (
        people.abb,
        ("v100,fine,tScan", "v100,fine,tool0"),
        "have tools tool0, tscan; of which are the poses? tool=tscan",
    ),
    "two that no move has": (
        two_declared,
        None,
        "tool tother or tscan is declared, and no line uses it; are poses of it? "
        "(--tool 0 0 0 0 0 0: of the flange) tool=NAME",
    ),
}


@pytest.mark.parametrize("name", TOOLS)
def test_a_tool_or_base_is_taken_off_or_named(name, tmp_path):
    of_poses, change, words = TOOLS[name]
    folder = people.written(tmp_path / "in", of_poses)
    if change:
        others = [p for p in folder.iterdir() if not re.match(r"scan_|p\d", p.name)]
        edited(others[0].name, *change)(folder)
    try:
        taken = read(folder)[1]
        said = "; ".join(taken.values())
    except Question as question:
        said = " ".join([str(question), *map(str, question.answer.values())])
    assert words in said


def test_targets_are_taken_in_the_order_driven(tmp_path):
    driven = functools.partial(people.abb, backwards=True)
    imported, taken = read(people.written(tmp_path / "in", driven))
    assert "in order of the moves" in taken["matched"]
    check_scan(imported, people.BASE)


def test_a_number_before_rows_of_heights_is_none_of_them(tmp_path):
    z = np.array([points[:, 1] for points in scan().values])
    people.tum(tmp_path)
    np.savetxt(tmp_path / "z.csv", np.insert(z, 0, range(1, 13), axis=1), "%g", ",")
    imported, _ = read(tmp_path, x=(-40, 2))
    assert_allclose([points[:, 1] for points in imported.values], z, atol=1e-3)


SAID = {
    "no rows where y=0; the columns are .* x, z": {"where": "y=0"},
    "no profiles in rows where x=7": {"where": "x=7"},
    "--pose-columns says x,y": {"pose_columns": "x,y"},
    "x and z are one column": {"columns": "2,2"},
    "_,x,z,_: expected two": {"columns": "_,x,z,_"},
    "no Hoehe in columns x, z": {"columns": "x,Hoehe"},
    "no entry flnage; the entries are": {"entry": "flnage"},
}


def test_what_is_said_of_columns_holds_for_those_that_are_there(tmp_path):
    folder = people.written(tmp_path / "in", people.tum)
    for sentence, said in SAID.items():
        with pytest.raises(ScanError, match=sentence):
            read(folder, **said)
    folder = people.written(tmp_path / "camera", of_camera)
    with pytest.raises(Question, match="poses are of cam"):
        read(folder, entry="x,z")  # as profiles are called
    folder = people.written(tmp_path / "codes", *points_of("x,z", nothing="9999"))
    edited("p3.csv", "9999", "-1", 2)(folder)
    edited("p4.csv", "9999", "-1", 2)(folder)
    with pytest.raises(ScanError, match="a second code"):
        read(folder, missing=9999)


# what is wrong, and what is said of it


def lost(name):
    return lambda folder: (folder / name).unlink()


def inverted(folder):
    for path in folder.glob("pose*"):
        path.rename(path.with_stem(f"base2{path.stem}".replace("pose", "flange")))


def emptied(folder):
    for path in folder.iterdir():
        path.unlink()


def a_row_cut_short(folder):
    lines = (folder / "robot.csv").read_text().split("\n")
    write_lines(folder / "robot.csv", [*lines[:5], "scan_099;1;2", *lines[5:]])


def labels_lost(folder):
    """Below a blank line."""
    lines = (folder / "robot.csv").read_text().splitlines()
    rest = [line.partition(";")[2] for line in lines[9:]]
    write_lines(folder / "robot.csv", [*lines[:9], "", *rest])


def without_a_pose(folder):
    rows = [
        {"id": k, "T": T.tolist()} for k, T in enumerate(people.matrices_of_poses())
    ]
    del rows[7]["T"]
    (folder / "poses.json").write_text(json.dumps(rows))


def another_clock(folder):
    """Two hours later, and one less."""
    for k, path in enumerate(sorted(folder.glob("scan_*"))[1:]):
        path.rename(folder / f"{1.7e9 + 7200 + k:.0f}.csv")
    (folder / "scan_000.csv").unlink()


def stacked(folder):
    for path in folder.glob("scan_*"):
        path.unlink()
    people.stacked(folder)


def sheet_with_a_word(folder):
    book = load_workbook(folder / "poses.xlsx")
    book.active["C4"] = "oops"
    book.save(folder / "poses.xlsx")


MISTAKES = {
    "a row cut short": (people.csv, a_row_cut_short, "line 6: 3 fields; expected 7"),
    "labels lost": (people.csv, labels_lost, "line 11: 6 fields; expected 7"),
    "a label twice": (
        people.csv,
        edited("robot.csv", "scan_004;", "scan_005;"),
        "lines 4 and 6: two poses have the Name of profile scan_005",
    ),
    "joints": (
        lambda folder: (folder / "tcp.csv").write_text(
            "j1,j2,j3,j4,j5,j6\n0,1,2,3,4,5"
        ),
        nothing,
        "joint angles are none",
    ),
    "nothing": (people.csv, emptied, "no file matches"),
    "no poses": (people.csv, lost("robot.csv"), "no file holds the poses"),
    "nothing has titles": (
        listed("", (), "FANUC angles"),
        lambda folder: [p.write_text("1,2,3\n") for p in folder.glob("scan_*")],
        "what are they",
    ),
    "two numbers": (
        listed("Zeile,Bahnpunkt,X,Y,Z,A,B,C", [f"{11 - k},{k}" for k in range(12)]),
        people.one_each,
        "by Zeile and the number 1 .* or by Bahnpunkt and the number 1",
    ),
    "a sample without a pose": (
        without_a_pose,
        people.one_each,
        "line 8: T_4 is empty",
    ),
    "another clock": (people.tum, another_clock, "log begins at 17.* profiles at 17"),
    "a stack, and poses in another order": (
        listed("id,x,y,z,a,b,c", range(12), order=BACKWARDS),
        stacked,
        "sort the rows",
    ),
    "an inverse": (people.matrices, inverted, "is called as the inverse"),
    "one of many files": (
        people.matrices,
        written("pose5.txt", "1 0 0 nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"),
        "file pose5.txt line 1: column 4 is empty",
    ),
    "fewer": (people.tum, lost("scan_003.csv"), "11 profiles for 12 poses"),
    "units": (people.csv, edited("robot.csv", "Y [mm]", "Y [m]"), "units are m, mm"),
    "other tool": (people.fanuc, edited("CALIB.LS", "UT : 0", "UT : 3"), "tools 3, 0"),
    "word": (
        people.csv,
        edited("scan_001.csv", "z\n", "z\n1,2\n3,oops\n"),
        "scan_001.csv line 3: z is 'oops'; exp",
    ),
    "open list": (people.fanuc, edited("p2.yml", " ]", ""), "p2.yml: .* cut short"),
    "sheet": (people.workbook, sheet_with_a_word, "line 4: Y .mm. is 'oops'"),
    "archive": (
        lambda folder: (people.tum(folder), (folder / "0.npz").write_bytes(b"PK\3")),
        lost("scan_000.csv"),
        "0.npz: no arrays",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_refused_in_a_sentence(mistake, tmp_path):
    of_poses, spoil, sentence = MISTAKES[mistake]
    folder = people.written(tmp_path / "in", of_poses)
    spoil(folder)
    with pytest.raises(ScanError, match=sentence) as caught:
        read(folder)
    assert "\n" not in str(caught.value)


def corrupted(folder, rng):
    """One file changed as disks, editors and people do."""
    path = rng.choice([path for path in folder.iterdir() if path.stat().st_size])
    files = {path.name: path.read_bytes()}
    CORRUPTIONS[rng.choice(CHANGES)](rng, SimpleNamespace(files=files))
    path.write_bytes(files[path.name])


def test_corrupted_files_give_a_sentence_or_a_scan(tmp_path):
    for seed in range(FUZZ):
        rng = default_rng([7, seed])
        of_profiles = PROFILES[seed % len(PROFILES)]
        folder = tmp_path / str(seed)
        people.written(folder, POSES[seed % len(POSES)], of_profiles)
        for _ in range(1 + seed % 2):
            corrupted(folder, rng)
        with suppress(ScanError):
            read(folder)
        shutil.rmtree(folder)


# the command, and what it leaves


def test_what_a_user_knows_is_kept_and_pictures_are_passed_over(tmp_path):
    folder = people.written(tmp_path / "in", people.tum)
    (folder / "cell.png").write_bytes(b"\x89PNG\0\0")
    (folder / "scan_003.csv").write_text("x,z\n1,2\n")
    (folder / "scan_004.csv").write_text("")
    command = ["import", folder, tmp_path / "scan"]
    said = run(*command, "--target", "edge").output
    assert "empty: scan_003, scan_004\n" in said
    imported = read_scan(tmp_path / "scan")
    assert [len(points) for points in imported.values].count(0) == 2
    header = tmp_path / "scan" / "scan.toml"
    header.write_text(
        header.read_text() + "\n[guess]\nmount = [0, 80, 120, 0, 0, 90]\n"
    )
    answers = tmp_path / "scan" / "import.toml"
    answers.write_text(answers.read_text() + 'columns = "z,x"\n')
    assert run(*command).exit_code == 0
    turned = read_scan(tmp_path / "scan")
    assert turned.guess is not None
    assert_array_equal(turned.values[0], imported.values[0][:, ::-1])
    assert "name a new folder" in run(*command, "--mount", "eye-to-hand").output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "scan"]
    answers.write_text('colums = "z,x"\n')
    assert "unknown entry 'colums'" in run(*command).output


KINDS = ("pose", "tool", "base", "uses", "moved")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("maker", ROBOTS)
def test_each_line_of_the_table_has_an_example_that_is_read(maker, kind):
    robot = ROBOTS[maker]
    examples = iter(robot.examples)
    own = {name: [*islice(examples, len(getattr(robot, name)))] for name in KINDS}
    assert not [*examples], "more examples than lines"
    names = []
    for line, example in zip(getattr(robot, kind), own[kind], strict=True):
        table, _ = matches_of([line], example)
        assert len(table.dropna(axis=1)) == 1, line
        names += [*table.get("name", [])]
        if begin := re.search(r"(\w*)\$name", line):
            whole = rf"(?<!\w){begin[1]}{re.escape(table['name'].iloc[0])}(?!\w)"
            assert re.search(whole, example), line
    blocks = program_blocks(Path(), "\n".join([robot.has, *own[kind]]))
    found = [block for block in blocks if (block.robot, block.kind) == (maker, kind)]
    assert sum(len(block.table) for block in found) == len(own[kind])
    tables = [block.table.set_axis(block.titles, axis=1) for block in found]
    assert names == [n for table in tables for n in table.get("name", []) if n == n]
    if kind == "pose":
        assert found[0].poses, "no $x $y $z, or no columns of a convention"
    if kind == "uses":
        titles = {title for block in found for title in block.titles}
        assert titles <= {"name", "tool", "base"}


def test_a_pattern_takes_a_whole_name_and_stands_in_its_own_line():
    table, _ = matches_of(["^$name MOVEX $x"], "7 10 MOVEX 3\n\n120 MOVEX 5")
    assert table["name"].tolist() == ["10", "120"]
    assert table.index.tolist() == [1, 3]
    table, _ = matches_of(["^$name $x $y …"], "7 400.5 3 2 1")
    assert table["name"].tolist() == ["7"]
    table, _ = matches_of(["{X $x}"], "home\n\n  {X 5}")
    assert table.index.tolist() == [3]


def test_the_readme_has_the_table():
    assert README.read_text(encoding="utf-8") == with_table()


def test_the_help_is_on_one_screen():
    assert len(run("import", "--help").output.splitlines()) <= 24


PEAKS = """
import resource, sys
from profilecal_tool.cli import main
for place in sys.argv[1:]:
    command = ["import", place, f"{place}-scan", "--target", "edge"]
    main(command, standalone_mode=False)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


def long_file(count):
    """Of profiles of so many points each."""
    lines = [f"{x:.9f},{100 + x / 5:.9f}\n" for x in np.linspace(-40, 40, count)]

    def write(folder):
        with (folder / "all.csv").open("w") as file:
            file.write("pose,x,z\n")
            for k in range(12):
                file.writelines(f"scan_{k:03d},{line}" for line in lines)

    return write


def test_a_long_file_takes_five_times_its_size_of_memory(tmp_path):
    """From the command to the written scan, beside what it takes for short ones."""
    folders = [tmp_path / "short", tmp_path / "long"]
    for folder, count in zip(folders, (10, 8_000), strict=True):
        people.written(folder, people.csv, long_file(count))
    said = subprocess.check_output([sys.executable, "-c", PEAKS, *folders], text=True)
    peaks = [int(line) for line in said.splitlines() if line.isdigit()]
    assert peaks[1] - peaks[0] <= 5 * (folder / "all.csv").stat().st_size


# in motion


def log_of(driven, scale=1.0):
    turned = from_rotations(named("quaternion"), driven.log.R)
    return np.column_stack([scale * driven.log.t, driven.log.p, turned])


def test_two_logs_are_a_scan_in_motion(tmp_path):
    """The robot's with poses, the scanner's with profiles, each by its own clock."""
    motion = {"sweeps": 3, "profiles": 8, "turn_deg": 5.0}
    driven = scan_of("plane", motion=motion, scanner={"points": 60})
    titles = "time [ms],x,y,z,qw,qx,qy,qz"
    write_table(tmp_path / "robot.csv", titles, log_of(driven, 1000))
    points = [
        np.column_stack([np.full(len(own), 1000 * t), own])
        for t, own in zip(driven.times, driven.values, strict=True)
    ]
    write_table(tmp_path / "scanner.csv", "time [ms],x,z", np.concatenate(points))
    imported, taken = import_scan(tmp_path, "plane", {})
    assert "by time, in motion" in taken["matched"]
    assert imported.labels == driven.labels
    assert_allclose(imported.T_base_flange, driven.T_base_flange, atol=1e-6)


def test_points_with_a_time_and_a_pose_are_a_scan_in_motion(tmp_path):
    driven = scan_of("edge", motion={"sweeps": 3, "profiles": 20})
    R, p, _ = driven.log.at(driven.times)
    turned = from_rotations(named("quaternion"), R)
    rows = [driven.times, p, turned, np.concatenate(driven.values)]
    titles = "t,tcp_x,tcp_y,tcp_z,tcp_qw,tcp_qx,tcp_qy,tcp_qz,scan x [mm],scan z [mm]"
    write_table(tmp_path / "all.csv", titles, np.column_stack(rows))
    imported, _ = read(tmp_path)
    assert_allclose(imported.times, driven.times, atol=1e-9)
    assert_allclose(imported.p_base_flange, p, atol=1e-6)


@pytest.mark.parametrize(("unit", "scale"), [("", 1), (" [ms]", 1000)])
def test_profiles_at_a_rate_are_a_scan_in_motion(unit, scale, tmp_path):
    motion = {"sweeps": 1, "profiles": 9}
    driven = scan_of("plane", motion=motion, scanner={"points": 60})
    titles = f"t{unit},x,y,z,qw,qx,qy,qz"
    write_table(tmp_path / "robot.csv", titles, log_of(driven, scale))
    for k, points in enumerate(driven.values):
        np.savetxt(tmp_path / f"p{k}.txt", points, header="x z")
    start, rate = driven.times[0], 1 / np.diff(driven.times).mean()
    imported, _ = import_scan(tmp_path, "plane", {}, Layout(times=(start, rate)))
    assert_allclose(imported.times, driven.times, atol=2e-6)
    for times in ((start, 0.0), (start + 1000, rate)):
        with pytest.raises(ScanError, match="--times"):
            import_scan(tmp_path, "plane", {}, Layout(times=times))


# real ones


REAL_DATA = os.environ.get("PROFILECAL_REAL_DATA")
needs_real_data = pytest.mark.skipif(
    not REAL_DATA, reason="HandEyeSync is not here: PROFILECAL_REAL_DATA is not set"
)


@needs_real_data
@pytest.mark.parametrize(
    ("name", "sizes", "largest_mm"),
    [("edge", {}, 0.15), ("sphere", {"radius": 40.0}, 0.25)],
)
def test_the_real_measurements_calibrate(name, sizes, largest_mm):
    kind = "ball" if sizes else "edge"
    imported, _ = import_scan(Path(REAL_DATA) / "handeyesync" / name, kind, sizes)
    found = calibrate([imported])
    assert found.status == "ok"
    assert found.solution.rms_mm <= largest_mm


@needs_real_data
def test_picked_points_lie_on_the_ridge_that_is_found():
    folder = Path(REAL_DATA) / "handeyesync" / "edge"
    edge = read(folder)[0]
    features = edge.target.find(edge.values)
    ridges = np.array([feature.points[0] for feature in features])
    picked = np.concatenate(read(folder, entry="feature_point")[0].values)
    # mm: the same ridge; picks err by 0.1 and the edge is round
    assert np.abs(ridges - picked).max() < 0.5
