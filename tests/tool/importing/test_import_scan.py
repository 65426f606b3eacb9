"""Scans from the files that people have: one scan in many syntaxes, wrong guesses,
corrupted files, real ones.
"""

import functools
import json
import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import run
from corruptions import CORRUPTIONS
from folders import edited
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from openpyxl import Workbook
from peoples_files import (
    POSES,
    PROFILES,
    abb,
    archives,
    as_json,
    binary_pcd,
    csv,
    fanuc,
    frame,
    json_lines,
    kuka,
    lists,
    matrices,
    matrices_of_poses,
    mitsubishi,
    named_numbers,
    one_each,
    poses,
    said_of,
    samples,
    scan,
    staubli,
    text,
    tum,
    wide_table,
    write_lines,
    write_table,
    written,
    yaskawa,
)
from scipy.spatial.transform import Rotation
from simulated import scan_of

from profilecal.calibration.calibration import calibrate
from profilecal.scan.conventions import from_rotations, named
from profilecal.scan.folder import read_scan, write_scan
from profilecal.scan.tables import ScanError, Table
from profilecal.targets import TARGETS
from profilecal_tool.importing.import_scan import Layout, import_scan
from profilecal_tool.importing.profiles import profiles_of, read_profiles, x_and_z
from profilecal_tool.importing.tables import encoding_of

FUZZ = int(os.environ.get("PROFILECAL_FUZZ", "60"))
TOOL = (10.0, -20.0, 150.0, 12.0, -5.0, 30.0)


def read(folder, **said):
    """The edge's scan that a folder is taken for, and the guesses."""
    return import_scan(folder, "edge", {}, Layout(**said))


def refuse(folder, sentence, **said):
    """Ask or complain, in one sentence, which is returned."""
    with pytest.raises(ScanError, match=sentence) as caught:
        read(folder, **said)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def check_poses(imported):
    """All poses are there. Returns where the first, the second, … of them is."""
    numbers = [int(re.findall(r"\d+", label)[-1]) for label in imported.labels]
    order = np.argsort(numbers)
    R, p = imported.R_base_flange[order], imported.p_base_flange[order]
    assert_allclose(R, scan().R_base_flange, atol=1e-9)
    assert_allclose(p, scan().p_base_flange, atol=1e-8)
    assert not imported.side.any()
    return order


def check_profiles(imported, expected, atol=1e-9):
    for points, true in zip(imported.values, expected.values, strict=True):
        assert_allclose(points, true, atol=atol)


@pytest.mark.parametrize("name", POSES)
def test_poses_in_any_syntax_are_the_same(name, tmp_path):
    folder = written(tmp_path / "files", POSES[name])
    imported, guesses = read(folder, **said_of(name))
    check_poses(imported)
    assert len([line for line in guesses if not line.startswith("note")]) == 6


@pytest.mark.parametrize("name", PROFILES)
def test_profiles_in_any_layout_are_the_same(name, tmp_path):
    folder = written(tmp_path / "files", tum, PROFILES[name])
    imported, guesses = read(folder, **said_of(name))
    unseen = 0
    for k, points in zip(check_poses(imported), scan().values, strict=True):
        seen = np.isfinite(points[:, 1])
        assert_array_equal(np.isfinite(imported.values[k][:, 1]), seen)
        assert_allclose(imported.values[k][seen], points[seen], atol=1e-9)
        unseen += (~seen).sum()
    assert f"nothing seen in {unseen} of them" in guesses[2]


def test_poses_counted_from_1_have_the_profiles_counted_from_0(tmp_path):
    folder = written(tmp_path / "in", fanuc, one_each)
    for path in sorted(folder.glob("scan_*.csv")):
        path.rename(folder / f"{int(path.stem[-3:])}.csv")
    imported, guesses = read(folder)
    assert check_poses(imported).tolist() == [*range(len(imported.labels))]
    assert any("one counts from 0 and the other from 1" in line for line in guesses)
    (folder / "3.csv").unlink()
    imported, guesses = read(folder)
    assert imported.labels == tuple(f"P{k}" for k in range(1, 13) if k != 4)
    assert guesses[3].endswith("; left out, without a profile: P4")


X = -20 + 0.5 * np.arange(41)
ROWS = {  # what is above rows of z, and what is said
    "x": [[*X]],
    "x behind a word": [["shot", *X]],
    "x above names": [["X_mm", *X]],
    "start and pitch": [["X start (mm)", -20], ["Unit", "mm"], ["X pitch (mm)", 0.5]],
    "start and pitch below": [["N", "X offset", "X resolution"], [12, -20, 0.5]],
    "numbered": [[f"z{k}" for k in range(41)]],
    "nothing": [],
}


@pytest.mark.parametrize("above", ROWS)
def test_z_may_lie_in_rows(above, tmp_path):
    z = default_rng(2).uniform(90, 110, (12, 1)) + 0.1 * X
    rows = z.tolist()
    if above == "x behind a word":
        rows = [[k, *row] for k, row in enumerate(rows)]
    if above == "x above names":
        rows = [[f"p{k}", *row] for k, row in enumerate(rows)]

    def in_rows(folder):
        lines = [",".join(map(str, row)) for row in [*ROWS[above], *rows]]
        write_lines(folder / "all.csv", lines)

    folder = written(tmp_path / "files", tum, in_rows)
    said = {}
    if above in ("numbered", "nothing"):
        refuse(folder, "--x START PITCH")
        said = {"x": (-20.0, 0.5)}
    imported, _ = read(folder, **said)
    expected = [np.column_stack([X, row]) for row in z]
    assert_allclose(imported.values, expected)


def numbered_poses(title, encoding="utf-8"):
    """Poses listed backwards, numbered in a column of some title."""

    def write(folder):
        rows = [f"XP{k};{text(row, ';')}" for k, row in enumerate(poses("KUKA angles"))]
        titles = f"{title};X [mm];Y [mm];Z [mm];A [°];B [°];C [°]"
        if encoding == "cp932":
            titles = titles.replace(" [mm]", "座標[mm]")
        lines = "\n".join([titles, *rows[::-1]]).replace(".", ",")
        (folder / "robot.csv").write_bytes(lines.encode(encoding))

    return write


def named_profiles(name, encoding="utf-8", titles="x,z"):
    """A file each, two of pose 0, none of pose 3, one of a pose that is not there."""

    def write(folder):
        for k in (0, 0.5, 1, 2, *range(4, 12), 40):
            points = scan().values[int(k) % 12]
            lines = "\n".join([titles, *(text(point) for point in points)])
            path = folder / name.format(int(k), int(k % 1 * 2))
            path.write_bytes(lines.encode(encoding))

    return write


@pytest.mark.parametrize(
    ("title", "name", "encoding", "titles"),
    [
        ("Messung", "line2_{:02}_{}.csv", "cp1252", "X Achse [mm],Höhe [mm]"),
        ("Nr.", "lage{:03}_bild{}.txt", "utf-16", "X-Koordinate,Abstand"),
        ("序号", "位姿{0}.{1}.csv", "gb18030", "X坐标(毫米),高度(毫米)"),
        ("番号", "測定{0}_{1}.csv", "cp932", "X座標,高さ"),
        ("번호", "프로파일{0}_{1}.csv", "cp949", "X (mm),높이 (mm)"),
    ],
)
def test_poses_are_numbered_in_any_column_and_encoding(
    title, name, encoding, titles, tmp_path
):
    of_profiles = named_profiles(name, encoding, titles)
    folder = written(tmp_path / "in", numbered_poses(title, encoding), of_profiles)
    imported, guesses = read(folder, poses="robot.csv")
    rows = [*range(11, 3, -1), 2, 1, 0, 0]
    assert_allclose(imported.p_base_flange, scan().p_base_flange[rows])
    for k, points in zip(rows, imported.values, strict=True):
        assert_allclose(points, scan().values[k])
    assert re.search(
        r"without a pose: \S*40\S*; .* without a profile: XP3$", guesses[3]
    )
    assert any(encoding in line for line in guesses) or encoding == "utf-16"


@pytest.mark.parametrize(
    ("title", "encoding"),
    [
        ("Relevé", "cp1252"),
        ("X;Z;qualité", "cp1252"),
        ("Точка;X (мм)", "cp1251"),
        ("编组,横向,纵向", "gb18030"),
    ],
)
def test_titles_tell_their_encoding(title, encoding, tmp_path):
    (tmp_path / "p.csv").write_bytes(title.encode(encoding))
    assert encoding_of([tmp_path / "p.csv"]) == encoding


def in_one_table(folder):
    """A row for each point, with its pose."""
    rows = poses("quaternion")
    lines = ["tcp_x,tcp_y,tcp_z,tcp_qw,tcp_qx,tcp_qy,tcp_qz,laser_x,laser_z"]
    for row, points in zip(rows, scan().values, strict=True):
        lines += [f"{text(row)},{text(point)}" for point in points]
    write_lines(folder / "log.csv", lines)


def in_one_row(folder):
    """A row for each pose, with all its points."""
    count = len(scan().values[0])
    lines = [
        ",".join([*"xyzwpr", *(f"{axis}{k}" for k in range(count) for axis in "xz")])
    ]
    for row, points in zip(poses("FANUC angles"), scan().values, strict=True):
        lines.append(f"{text(row)},{text(points.ravel())}")
    write_lines(folder / "log.csv", lines)


def in_json(folder):
    """A file for each pose, with its profile."""
    for k, ((position, turn), points) in enumerate(
        zip(samples(), scan().values, strict=True)
    ):
        cells = [[None if z != z else z for z in point] for point in points.tolist()]
        pose = {"position": position, "orientation": turn}
        content = json.dumps({"robot": pose, "profile": {"points": cells}})
        (folder / f"capture{k:02d}.json").write_text(content)


def in_arrays(folder):
    everything = {"T_base_flange": matrices_of_poses(), "z": np.stack(scan().values)}
    np.savez(folder / "all.npz", **everything)


def in_folders(folder):
    """One for each pose: the robot's file and the scanner's, with thousands parted."""
    lines = "\n".join(["x;y;z;w;p;r", "{}", ""])
    for k, (row, points) in enumerate(
        zip(poses("FANUC angles"), scan().values, strict=True)
    ):
        (folder / f"pos_{k}").mkdir()
        numbers = ";".join(f"{value:,.9f}" for value in row)
        numbers = numbers.translate(str.maketrans(",.", "\xa0,"))
        (folder / f"pos_{k}" / "robot.txt").write_text(lines.format(numbers))
        np.savetxt(folder / f"pos_{k}" / "profile.csv", points, header="x z")


def in_sheets(folder):
    book = Workbook()
    book.active.title = "Robot poses"
    for row in [["nr", *"xyzwpr"], *np.c_[:12, poses("FANUC angles")].tolist()]:
        book.active.append(row)
    sheet = book.create_sheet("Scans")
    sheet.append(["nr", "x", "z"])
    for k, points in enumerate(scan().values):
        for point in points.tolist():
            sheet.append([k, *(None if z != z else z for z in point)])
    book.save(folder / "all.xlsx")


def by_clock(start, step, name, hours=0.0):
    """A log of 2 Hz, of a robot that stands still for two seconds of four, and profiles
    named by the time at which they were taken, 0.1 s after an entry of it, by a clock
    some hours ahead.
    """

    def write(folder):
        rows = poses("quaternion")
        between = (rows + np.roll(rows, -1, axis=0)) / 2
        states = np.stack([*4 * [rows], *4 * [between + 1]], axis=1)
        states[:, 4:] += np.arange(4)[:, None]
        lines = ["time,x,y,z,qw,qx,qy,qz"]
        for k, row in enumerate(states.reshape(-1, 7)):
            lines.append(f"{start + step * k / 2:.3f},{text(row)}")
        write_lines(folder / "robot_log.csv", lines)
        for k, points in enumerate(scan().values):
            at = 1.7e9 + 4 * k + 1.1 + 3600 * hours
            moment = datetime.fromtimestamp(at, UTC)
            path = folder / f"{moment.strftime(name)}.csv"
            write_table(path, "x,z", points)

    return write


@pytest.mark.parametrize(
    ("write", "how"),
    [
        (in_one_table, "in order"),
        (in_one_row, "in order"),
        (in_json, "by their names"),
        (in_arrays, "in order"),
        (in_sheets, "as in column nr"),
        (in_folders, "by their names"),
        (by_clock(1.7e9, 1, "scan_%Y-%m-%d_%H-%M-%S.%f"), "up to 0.1 s apart"),
        (by_clock(1.7e12, 1000, "%Y%m%dT%H%M%S,%f"), "up to 0.1 s apart"),
        (by_clock(1.7e9, 1, "%Y-%m-%d_%H-%M-%S.%f", 5.5), "clock +5.5 h of the poses'"),
    ],
    ids=[
        "points",
        "rows",
        "JSON",
        "arrays",
        "sheets",
        "folders",
        "seconds",
        "milliseconds",
        "zones",
    ],
)
def test_poses_are_found_in_the_same_table_or_by_time(write, how, tmp_path):
    (tmp_path / "in").mkdir()
    write(tmp_path / "in")
    imported, guesses = read(tmp_path / "in")
    assert_allclose(imported.p_base_flange, scan().p_base_flange, atol=1e-8)
    check_profiles(imported, scan())
    assert how in guesses[3]


def long_points(titles, *columns):
    """A long table with columns beside x and z, of what says them of a pose's number,
    a point's and all points.
    """

    def write(folder):
        lines = [titles]
        for k, points in enumerate(scan().values):
            for column in columns:
                lines += [
                    f"{column.format(k, j)},{text(p)}" for j, p in enumerate(points)
                ]
        write_lines(folder / "all.csv", lines)

    return write


def test_profiles_are_told_apart_by_a_column_that_poses_have(tmp_path):
    """The poses are listed backwards; times are no names of theirs."""
    of_profiles = long_points("time [s],zähler,x,z", "{0}.25,XP{0}")
    folder = written(tmp_path / "in", numbered_poses("Zähler"), of_profiles)
    imported, guesses = read(folder)
    assert guesses[3].endswith("by their names, as in column zähler")
    assert_allclose(imported.p_base_flange, scan().p_base_flange[::-1])
    assert_allclose(imported.values[0], scan().values[-1])


@pytest.mark.parametrize(
    ("titles", "columns", "sentence"),
    [
        ("pose,head,x,z", ("{0},A", "{0},B"), "head is A to B .* --where head=A"),
        ("pose,y,x,z", ("{0},-1.5", "{0},0.0"), "a cloud of 2 .* --where y=0.0"),
        ("pose,k,x,z", ("{0},3", "{0},4"), "k is 3 to 4 in one .* --where k=3"),
    ],
)
def test_which_of_several_profiles_is_meant_is_asked(
    titles, columns, sentence, tmp_path
):
    folder = written(tmp_path / "in", tum, long_points(titles, *columns))
    refuse(folder, f"all.csv: .*{sentence}$")
    where = sentence.split()[-1]
    imported, _ = read(folder, where=where)
    check_poses(imported)
    assert_allclose(imported.values[3], scan().values[3])


def in_units(titles, scale, *codes):
    """As many to a millimetre, to four digits; codes in turn where nothing was seen."""

    def write(folder):
        for k, points in enumerate(scan().values):
            numbers = np.round(points * scale, 4)
            rows = np.flatnonzero(np.isnan(points[:, 1]))
            numbers[rows] = (
                np.array(codes)[rows % len(codes), None] if codes else np.nan
            )
            path = folder / f"{k}.csv"
            write_table(path, titles, numbers)

    return write


@pytest.mark.parametrize(
    ("titles", "scale", "codes", "unit"),
    [
        ("x [um],z [µm]", 1e3, (-99999.9,), ""),
        ("X (0.1um),Z (0.1um)", 1e4, (-2147483648,), ""),
        ("x,z", 1e5, (-2147483648, -2147483647), "0.01 um"),
        ("x/inch,z/inch", 1 / 25.4, (-99.9999,), ""),
        ("x_mm,z_mm", 1, (12345.6,), ""),
    ],
)
def test_units_and_codes_are_recognised_or_asked_about(
    titles, scale, codes, unit, tmp_path
):
    folder = written(tmp_path / "in", tum, in_units(titles, scale, *codes))
    if unit:
        refuse(folder, f"expected 1 to .*--unit .*'{unit}'")
    imported, _ = read(folder, unit=unit)
    check_profiles(imported, scan(), 1e-4 / scale)


@pytest.mark.parametrize("name", ["quaternion", "rotation vector"])
def test_a_tool_is_taken_off_and_a_mount_said(tmp_path, name):
    of_tool = Rotation.from_euler("xyz", TOOL[3:], degrees=True)
    R = scan().R_base_flange @ of_tool.as_matrix()
    p = scan().p_base_flange + scan().R_base_flange @ np.array(TOOL[:3])

    def poses_of_tool(folder):
        rows = np.hstack([p, from_rotations(named(name), R)])
        np.savetxt(folder / "poses.txt", rows)

    turn = TOOL[3:] if name == "quaternion" else of_tool.as_rotvec()
    imported, _ = read(
        written(tmp_path / "files", poses_of_tool),
        pose_columns=",".join(["x,y,z", *named(name).columns]),
        tool=(*TOOL[:3], *turn),
        mount="eye-to-hand",
    )
    check_poses(imported)
    assert imported.mount == "eye-to-hand"


def test_from_the_command_line_to_a_scan_that_is_read(tmp_path):
    folder = written(tmp_path / "files", tum)
    (folder / "scan_003.csv").write_text("x,z\n")
    result = run("import", folder, tmp_path / "scan", "--target", "edge")
    assert result.exit_code == 0, result.output
    sentence = "poses.tum: 12, a quaternion (qw, qx, qy, qz), in m (the largest is"
    assert sentence in result.output
    imported = read_scan(tmp_path / "scan")
    assert [len(points) for points in imported.values].count(0) == 1
    check_poses(imported)


def test_each_length_of_a_target_has_an_option(tmp_path, monkeypatch):
    lengths = {"lengths": ("depth", "width")}
    monkeypatch.setitem(TARGETS, "groove", type("Groove", (TARGETS["plane"],), lengths))
    folder = written(tmp_path / "files", tum)
    command = ["import", folder, tmp_path / "scan", "--target", "groove", "--width", 5]
    assert "depth is missing" in run(*command).output
    assert run(*command, "--depth", 2).exit_code == 0
    assert "width = 5.0" in (tmp_path / "scan" / "scan.toml").read_text()
    assert "Of a disk, ball, rod, mm." in run("import", "--help").output


def notes(folder, **said):
    _, guesses = read(folder, **said)
    return [line for line in guesses if line.startswith("note")]


def test_what_matters_of_frames_and_axes_is_told(tmp_path):
    of_tool = functools.partial(fanuc, tool=2, more=",\tE1 =   12.500  mm")
    folder = written(tmp_path / "files", of_tool, lists)
    (note,) = notes(folder)
    assert note.endswith(
        "of tool 2, and so will be the sensor pose; "
        "for one on the flange give its frame: --tool X Y Z W P R"
    )
    _, guesses = read(folder)
    assert guesses[1] == "of         tool 2, not taken off"
    assert not notes(folder, tool=TOOL)
    edited("CALIB.LS", "12.500  mm", "12.8  mm")(folder)
    assert "e1 differs by up to 0.3 between poses" in notes(folder, tool=TOOL)[0]
    edited("CALIB.LS", "12.8  mm", "13.1  mm")(folder)
    sentence = r"CALIB.LS: e1 differs between poses, 13.1, 12.500; expected one for all"
    refuse(folder, sentence)


def numbered_log(folder):
    lines = [
        f"{k} {{{named_numbers('XYZABC', row, ',')}}} TOOL=0"
        for k, row in enumerate(poses("KUKA angles"))
    ]
    write_lines(folder / "poses.log", lines)


TOOLS = {  # what is done to a program, and what a note then says
    "no frame": (
        abb,
        edited("scan.mod", "tooldata tScan", "tooldata tOther"),
        "tool tScan,",
    ),
    "a number": (kuka, edited("scan.dat", "TOOL_NO 0", "TOOL_NO 3", 12), "tool 3, and"),
    "a pose's number": (
        numbered_log,
        edited("poses.log", "TOOL=0", "TOOL=3", 12),
        "tool 3, and so",
    ),
    "a line": (yaskawa, edited("SCAN.JBI", "///TOOL 0", "///TOOL 2"), "tool 2, and so"),
    "a numbered line": (
        mitsubishi,
        edited("scan.prg", "10 MVS P1", "5 Tool PTL\n10 MVS P1"),
        "tool ptl, and so",
    ),
    "no move": (
        staubli,
        edited("scan.dtx", 'type="frame"', 'type="tool"'),
        "of tool fPart0 and does not say .* --tool 100 50 0 ",
    ),
}


@pytest.mark.parametrize("name", TOOLS)
def test_a_tool_whose_frame_or_use_is_not_in_the_program_is_told(name, tmp_path):
    of_poses, change, words = TOOLS[name]
    folder = written(tmp_path / "files", of_poses)
    change(folder)
    assert any(re.search(words, note) for note in notes(folder))


SAID_OF_TOOL = {  # in any text: what a note then has
    "# Tool: LASER\n": "tool LASER",
    "Werkzeug;3;;\n": "tool 3",
    "TCP offset = 0.0, 0, 0.12\n": "tool 0.0, 0, 0.12",
    "# arm R7, tcp offset [0, 0, 0.12]\n": "tool 0, 0, 0.12",
    "measured with tool 3\n": "tool 3",
    "$ACT_TOOL=3\n": "tool 3",
    "Werkzeugnummer 5\n": "tool 5",
    "# Outil n° 3\n": "tool 3",
    "active TCP is LASER\n": "tool LASER",
    "# TCP LASER\n": "tool LASER",
    "# CRobT(\\Tool:=tool0), then tool=LASER\n": "tool LASER",
    "# TCP positions\n": "",
    "工具坐标系: 3\n": "tool 3",
    "ツール番号：2\n": "tool 2",
    "TCP=(0, 0, 120)\n": "tool 0, 0, 120",
    "TCP speed: 250\n": "",
    "$ rosrun tf tf_echo base_link laser\n": "tool laser",
    "child_frame_id: laser\n": "tool laser",
    "child_frame_id: tool0\n": "",
    "measured with tool 0\n": "",
    '{"robot": "R7", "tool": "laser", "poses": [': "tool laser",
    "Tool: 0\n": "",
    "TCP: 192.168.0.1\n": "",
    "tool offset: [0.0, 0, 0]\n": "",
}


@pytest.mark.parametrize("said", SAID_OF_TOOL)
def test_a_tool_that_any_text_says_is_told(said, tmp_path):
    rows = poses("quaternion")
    titles = ("x", "y", "z", "qw", "qx", "qy", "qz")

    def table(folder):
        lines = [",".join(titles), *map(text, rows)]
        content = said + "\n".join(lines)
        if said.startswith("{"):
            entries = [dict(zip(titles, row, strict=True)) for row in rows.tolist()]
            content = said + json.dumps(entries)[1:] + "}"
        (folder / "poses.txt").write_text(content)

    folder = written(tmp_path / "files", table)
    imported, guesses = read(folder)
    check_poses(imported)
    words = SAID_OF_TOOL[said]
    assert guesses[1].endswith(f"{words}, not taken off") is bool(words)
    assert len(notes(folder)) == bool(words)


@pytest.mark.parametrize("name", ["poses_tool3.csv", "poses.csv"])
def test_a_tool_that_names_of_files_say_is_told(name, tmp_path):
    folder = written(tmp_path / "files")
    (folder / "robot.csv").rename(folder / name)
    if "tool" not in name:
        (folder / "tool.txt").write_text("10 20 100 0 0 0")
    (note,) = notes(folder)
    assert re.search(r"the poses are of tool (3|tool.txt), and so", note)


@pytest.mark.parametrize(
    "title", ["Werkzeug", "UTOOL", "end effector", "child", "ツール", "Basis"]
)
def test_a_column_of_tools_or_bases_is_one_in_any_language(title, tmp_path):
    def table(folder):
        lines = [f"X, мм;Y, мм;Z, мм;A, град;B, град;C, град;{title}"]
        lines += [f"{text(row, ';')};2" for row in poses("KUKA angles")]
        write_lines(folder / "robot.csv", lines)

    folder = written(tmp_path / "files", table)
    frame = "base or user frame 2" if title == "Basis" else "tool 2"
    (note,) = notes(folder, mount="eye-to-hand")
    assert f"the poses are of {frame}, and so will be the sensor pose" in note


def left_and_right(folder):
    one_each(folder)
    for path in [*folder.glob("scan_*.csv")]:
        path.rename(path.with_name(f"L_{path.name}"))
    one_each(folder)


def in_two_folders(folder):
    for name in ("one", "two"):
        (folder / name).mkdir()
        one_each(folder / name)


def by_serials(folder):
    """At each pose one sees z where the other sees 30 mm more."""
    for k, points in enumerate(scan().values):
        write_table(folder / f"2180_{k}.csv", "x,z", points)
        write_table(folder / f"2191_{k}.csv", "x,z", points + np.array([0, 30]))


@pytest.mark.parametrize(
    ("of_profiles", "sentence"),
    [
        (left_and_right, "as many files each"),
        (in_two_folders, "as many files each"),
        (by_serials, "have the same pose and are 30 mm apart: of two scanners?"),
    ],
)
def test_which_of_two_scanners_is_asked(of_profiles, sentence, tmp_path):
    folder = written(tmp_path / "files", csv, of_profiles)
    said = refuse(folder, sentence)
    (pattern,) = re.findall("--profiles '(.*?)'", said)
    check_poses(read(folder, profiles=pattern)[0])


def test_columns_of_two_scanners_are_named_in_pairs(tmp_path):
    points = dict.fromkeys(("x1", "z1", "x2", "z2"), np.arange(3.0))
    table = Table(tmp_path / "p1.csv", points, [1, 2, 3], units=dict.fromkeys(points))
    with pytest.raises(ScanError, match='--columns "x1,z1"'):
        x_and_z([table], Layout())


def test_one_column_of_z_needs_x_of_its_points(tmp_path):
    folder = written(tmp_path / "files", csv)
    for path in folder.glob("scan_*"):
        path.write_text("z\n" + "".join(f"{100 + k % 7}.5\n" for k in range(50)))
    refuse(folder, "z alone, and x nowhere; .*--x START PITCH")
    imported, _ = read(folder, x=(-40.0, 0.5))
    assert_allclose(imported.values[0][:, 0], -40 + 0.5 * np.arange(50))


def test_spaces_part_numbers_with_decimal_commas(tmp_path):
    folder = written(tmp_path / "files", csv)
    rows = [f"{k / 2 - 12.25:.2f} {100 + k % 7}.5" for k in range(50)]
    for path in folder.glob("scan_*"):
        path.write_text("\n".join(rows).replace(".", ","))
    expected = [[float(cell) for cell in row.split()] for row in rows]
    assert_allclose(read(folder)[0].values[0], expected)


def test_one_point_is_no_profile(tmp_path):
    folder = written(tmp_path / "files", csv)
    path = folder / "scan_003.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:2]))
    imported, _ = read(folder)
    assert [*map(len, imported.values)].count(0) == 1
    write_scan(imported, tmp_path / "scan")
    read_scan(tmp_path / "scan")


@pytest.mark.parametrize(
    ("remark", "base"),
    [
        ("# User frame: 3", "3"),
        ("# work_object = table", "table"),
        ("# Base no: 0", ""),
    ],
)
def test_a_base_that_a_remark_names_is_told_where_the_scanner_stands(
    remark, base, tmp_path
):
    folder = written(tmp_path / "files", csv)
    robot = folder / "robot.csv"
    robot.write_text(f"{remark}\n{robot.read_text()}")
    told = f"the poses are of base or user frame {base}, and so will be the sensor pose"
    _, guesses = read(folder, mount="eye-to-hand")
    assert any(told in line for line in guesses) == bool(base)
    assert not any("user frame" in line for line in read(folder)[1])


LANGUAGES = {  # a move, and what is said of the tool
    "moveto([{}], 50, 100)": ("  settcp([12,-35,180,10,-20,30])", "tool (12, -35, 180"),
    "MOVEX A=1,AC=0,M1X,L,({})U,S=100,H=2,MS": ("10 REM", "tool 2"),
    "at rest: [{}] TCP=(1, 2, 100, 0, 0, 0)": ("", "tool 1, 2, 100"),
}


@pytest.mark.parametrize("move", LANGUAGES)
def test_a_tool_in_a_language_that_is_not_known_is_told(move, tmp_path):
    above, words = LANGUAGES[move]
    lines = [above, *(move.format(text(row)) for row in poses("KUKA angles"))]

    def program(folder):
        write_lines(folder / "robot.prg", lines)

    folder = written(tmp_path / "files", program)
    refuse(folder, "say what they are")
    imported, guesses = read(folder, pose_columns="x,y,z,a,b,c")
    check_poses(imported)
    assert guesses[1].startswith(f"of         {words}")
    assert guesses[1].endswith(", not taken off")


def test_a_tool_that_moves_name_is_taken_off(tmp_path):
    folder = written(tmp_path / "files", staubli)
    edited("scan.dtx", 'type="frame"', 'type="tool"')(folder)
    edited("scan.dtx", 'fatherId="fPart[0]"', "", 24)(folder)
    moves = [f"movel(pScan[{k}], fPart, mSlow)" for k in range(12)]
    write_lines(folder / "start.pgx", ["begin", *moves, "end"])
    _, guesses = read(folder)
    assert "tool fpart0 at [100.0, 50.0, 0.0] mm, taken off" in guesses[1]


def test_a_program_may_lie_in_several_files_and_a_tool_may_be_left_on(tmp_path):
    folder = written(tmp_path / "files", abb)
    lines = (folder / "scan.mod").read_text().splitlines(keepends=True)
    (folder / "scan.mod").write_text("".join([lines[0], *lines[2:]]))
    (folder / "CalibData.mod").write_text(lines[1])
    imported, guesses = read(folder)
    check_poses(imported)
    assert "base wBall at [100.0, 50.0, 0.0] mm and tool tScan at" in guesses[1]
    imported, guesses = read(folder, tool=6 * (0.0,))
    expected = scan().T_base_flange @ frame(12, -35, 180, 10, -20, 30)
    assert_allclose(imported.T_base_flange, expected, atol=1e-6)


def abb_inline(folder):
    """Targets within moves, below one of another tool."""
    abb(folder)
    path = folder / "scan.mod"
    content = path.read_text()
    axes = "[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    content = content.replace(
        "  MoveL", f"  MoveAbsJ {axes},v500,fine,tool0;\n  MoveL", 1
    )
    for name, target in re.findall(r"^  CONST robtarget (\w+):=(.*);", content, re.M):
        content = content.replace(f"MoveL {name},", f"MoveL {target},")
    path.write_text(re.sub(r"  CONST robtarget .*\n", "", content))


def techman_numbers(folder):
    tool = text(poses("FANUC angles", 1, frame(12, -35, 180, 10, -20, 30)[None])[0])
    rows = poses(
        "FANUC angles", 1, matrices_of_poses() @ frame(12, -35, 180, 10, -20, 30)
    )
    lines = [f"ChangeTCP({tool})", *(f'PTP("CPP",{text(row)},100,200)' for row in rows)]
    write_lines(folder / "scan.script", lines)


def fanuc_listings(folder):
    """The frames of all tools and bases in a listing of the system's variables."""
    fanuc(folder, 4)
    lines = []
    for name in ("MNUFRAME", "MNUTOOL"):
        lines.append(f"[*SYSTEM*]${name}  Storage: CMOS  Access: RW  : ARRAY[1,9]")
        for k in range(1, 10):
            lines += [f"     [1,{k}] = ", "  Group: 1   Config: N D B, 0, 0, 0"]
            lines += [f"  X: {k} Y: 0.0 Z: 0.0", "  W: 0.0 P: 0.0 R: 0.0"]
    write_lines(folder / "sysframe.va", lines)


@pytest.mark.parametrize(
    ("of_poses", "off"),
    [
        (abb_inline, "tool tScan at [12.0, -35.0, 180.0] mm"),
        (techman_numbers, "at [12.0, -35.0, 180.0] mm"),
        (fanuc_listings, "tool 4 at [4.0, 0.0, 0.0] mm"),
    ],
)
def test_a_tool_with_a_frame_anywhere_is_taken_off(of_poses, off, tmp_path):
    folder = written(tmp_path / "files", of_poses, lists)
    imported, guesses = read(folder)
    assert f"{off}, taken off" in guesses[1]
    taken = frame(4 * (of_poses is fanuc_listings), 0, 0, 0, 0, 0)
    assert_allclose(imported.T_base_flange @ taken, scan().T_base_flange, atol=1e-6)


def test_a_tool_of_the_machine_data_is_taken_off(tmp_path):
    """KUKA's, beside the program; all but the profiles is called like poses."""
    folder = written(tmp_path / "files", kuka, lambda folder: None)
    edited("scan.dat", "TOOL_NO 0", "TOOL_NO 3", 12)(folder)
    frames = [f"TOOL_DATA[{k}]={{X {k},Y 0,Z 0,A 0,B 0,C 0}}" for k in range(1, 5)]
    write_lines(folder / "$config.dat", ["DEFDAT $CONFIG", *frames, "ENDDAT"])
    (folder / "profiles").mkdir()
    one_each(folder / "profiles")
    imported, guesses = read(folder)
    assert "has tool 3 at [3.0, 0.0, 0.0] mm, taken off" in guesses[1]
    expected = scan().T_base_flange @ frame(-3, 0, 0, 0, 0, 0)
    assert_allclose(imported.T_base_flange, expected, atol=1e-6)


AXES = {
    "a.dat": "DECL E6AXIS XP1={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 10.0,A6 0.0}",
    "a.jbi": "//POS\n///PULSE\nC00000=100,200,-300,400,500,6",
    "a.dtx": '<Value key="0" j1="0" j2="1" j3="2" j4="3" j5="4" j6="5" />',
    "tcp.csv": "j1,j2,j3,j4,j5,j6\n0,1,2,3,4,5",
    "pose.yaml": "- joint_1: 0\n  joint_2: 1\n  joint_3: 2\n  joint_4: 3\n"
    "  joint_5: 4\n  joint_6: 5",
}


@pytest.mark.parametrize("name", AXES)
def test_joint_angles_are_called_so(name, tmp_path):
    folder = written(tmp_path / "files", tum)
    (folder / "poses.tum").unlink()
    (folder / name).write_text(AXES[name] + "\n")
    refuse(folder, rf"{name}: joint angles or pulses, .* --poses")


def turned_over():
    """Poses with w, p, r beyond what is needed: the middle angle over 90°."""
    rows = poses("FANUC angles")
    rows[:, 3:] = [180, 180, 180] + rows[:, 3:] * [1, -1, 1]
    return rows


@pytest.mark.parametrize(
    ("titles", "count"), [("rx,ry,rz", 3), ("rvec_x,rvec_y,rvec_z", 12)]
)
def test_vectors_beyond_half_a_turn_are_read(titles, count, tmp_path):
    """A few, as controllers write them; or all under a title that says so."""
    T = matrices_of_poses() @ frame(0, 0, 0, 165, 20, 0)
    rows = poses("rotation vector", 0.001, T)
    lengths = np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    rows[:count, 3:] *= 1 - 2 * np.pi / lengths[:count]

    def table(folder):
        lines = [f"x,y,z,{titles}", *map(text, rows)]
        write_lines(folder / "poses.csv", lines)

    imported, guesses = read(written(tmp_path / "files", table))
    assert_allclose(imported.T_base_flange, T, atol=1e-8)
    assert f"taken for rotation vectors, {count} of them longer than π" in guesses[-1]


QUESTIONS = {  # the titles, and the numbers of which nobody can be sure
    "rx,ry,rz": np.radians,
    "w,p,r": np.radians,
    "w, p, r": lambda degrees: 1000 * np.radians(degrees),
    "rx [deg],ry [deg],rz [deg]": np.asarray,
}


@pytest.mark.parametrize("titles", QUESTIONS)
def test_a_question_has_the_answer_that_works(titles, tmp_path):
    rows = turned_over()
    rows[:, 3:] = QUESTIONS[titles](rows[:, 3:])

    def table(folder):
        lines = [f"x,y,z,{titles}", *map(text, rows)]
        write_lines(folder / "poses.csv", lines)

    folder = written(tmp_path / "files", table)
    (answer,) = re.findall('--pose-columns "(.*?)"', refuse(folder, "--pose-columns"))
    imported, _ = read(folder, pose_columns=answer)
    check_poses(imported)


def test_numbers_are_written_as_they_were_read(tmp_path):
    """Those of another convention, too: vectors longer than π."""
    rows = turned_over()
    rows[:, 3:] = np.radians(rows[:, 3:])
    assert (np.linalg.norm(rows[:, 3:], axis=1) > np.pi).any()
    folder = written(
        tmp_path / "files", lambda folder: np.savetxt(folder / "poses.txt", rows)
    )
    imported, _ = read(folder, pose_columns="x,y,z,rx,ry,rz")
    write_scan(imported, tmp_path / "scan")
    kept = read_scan(tmp_path / "scan").orientation
    assert_allclose(kept, rows[:, 3:], rtol=1e-11)


def test_of_several_poses_one_is_said(tmp_path):
    folder = written(tmp_path / "files", json_lines)
    assert "robot_pose is taken for the robot's pose, not target" in notes(folder)[0]
    edited("poses.txt", "robot_pose", "first_pose", 12)(folder)
    refuse(folder, r"several poses .*--entry target_pose")
    check_poses(read(folder, entry="first")[0])
    lines = [
        f"<{tag} {' '.join(f'{name}={number!r}' for name, number in pose.items())}/>"
        for row in poses("KUKA angles").astype(str).tolist()
        for tag, pose in (
            ("RIst", dict(zip("XYZABC", row, strict=True))),
            ("RSol", dict(zip("XYZABC", row[::-1], strict=True))),
        )
    ]
    (folder / "poses.txt").write_text("\n".join(lines).replace("'", '"'))
    refuse(folder, r"several poses .* rist, rsol.*--entry rist")
    check_poses(read(folder, entry="rist")[0])


def test_other_files_are_left_out_and_files_in_folders_of_their_own_are_found(tmp_path):
    folder = written(tmp_path / "monday")
    (folder / "CalibConfig.json").write_text('{"HTM": [[1, 0], [0, 1]], "radius": 40}')
    imported, guesses = read(folder)
    check_poses(imported)
    assert guesses[-1] == "left out   CalibConfig.json"
    said = {"profiles": "monday/scan*.csv", "poses": "monday/robot*.csv"}
    check_poses(read(tmp_path, **said)[0])


NONSENSE = {  # in each syntax of poses
    "kuka": ("scan.dat", "XP3={X ", "XP3={X oops", "dat line 7: XP3 has .*y, z, a, b"),
    "abb": ("scan.mod", "],[-1,0,-1,0]", ",1],[-1,0,-1,0]", "mod line 4: p10 has 18"),
    "ur": ("scan.script", "p[", "p[oops,", "script line 2: frame has 7 numbers"),
    "as_json": (
        "poses.json",
        "[\n            ",
        '[\n            "oops",',
        "12 profiles for 11 poses",
    ),
    "fanuc": (
        "CALIB.LS",
        "X = ",
        "X = ********  mm, Q = ",
        "CALIB.LS line 7: x is '\\*+'; expected a finite number",
    ),
    "key_lines": ("poses.txt", "\nt ", "\nt oops ", "12 profiles for 11 poses"),
    "csv": (
        "robot.csv",
        "scan_003;",
        "scan_003;oops",
        "robot.csv line .*: x.* is 'oops",
    ),
    "tum": ("poses.tum", "0 ", "0 oops", "poses.tum line 2: x is 'oops"),
}


@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_in_any_syntax_is_one_sentence(name, tmp_path):
    file, before, after, sentence = NONSENSE[name]
    folder = written(tmp_path / "files", POSES[name])
    edited(file, before, after)(folder)
    refuse(folder, sentence, **said_of(name))


# changes of a folder


def lost(name):
    return lambda folder: (folder / name).unlink()


def renamed(name, new):
    return lambda folder: (folder / name).rename(folder / new)


def copied(name, new):
    return lambda folder: shutil.copy(folder / name, folder / new)


def replaced(name, content):
    return lambda folder: (folder / name).write_bytes(content)


def cut_short(name):
    def change(folder):
        content = (folder / name).read_text()
        (folder / name).write_text(content[: content.rindex(",")])

    return change


def nothing(folder):
    """No change."""


def reflected(folder):
    np.savetxt(folder / "pose4.txt", -np.eye(4))


def five_columns(folder):
    np.savez(folder / "3.npz", profile=np.ones((9, 5)))


def rows_alike(folder):
    np.savetxt(folder / "all.txt", np.ones((9, 40)))


# the poses, what is done to the folder, what is said of it; the profiles
MISTAKES = {
    "nothing": (
        csv,
        shutil.rmtree,
        "no such folder, or nothing in it is named like the robot's poses",
    ),
    "no poses": (
        csv,
        lost("robot.csv"),
        "nothing in it is named like the robot",
    ),
    "two": (
        csv,
        copied("robot.csv", "tcp.csv"),
        "robot.csv … tcp.csv may all be the robot.s poses; expected one file",
    ),
    "fewer": (tum, lost("scan_003.csv"), "11 profiles for 12 poses"),
    "unnamed": (
        as_json,
        nothing,
        "poses.json: 6 columns, 1, .*; say what they are, .*--pose-columns .*; w,p,r",
    ),
    "half": (
        csv,
        edited("robot.csv", "Alpha [°]", "tilt"),
        "7 columns, name, .*tilt, beta.*--pose-columns",
    ),
    "two units": (
        csv,
        edited("robot.csv", "Y [mm]", "Y [m]"),
        r"robot.csv: the columns are x \[mm\], y \[m\], z \[mm\]; expected one unit",
    ),
    "no unit": (
        csv,
        edited("robot.csv", "[°]", "[gon]", 3),
        r"alpha \[gon\], .*; expected one unit .*, deg or mrad or rad",
    ),
    "twice": (
        fanuc,
        edited("CALIB.LS", "P[2]{", "P[1]{"),
        "CALIB.LS line 12: pose 'P1' is there twice",
    ),
    "not closed": (
        fanuc,
        edited("CALIB.LS", "};", ""),
        "CALIB.LS: not as many } as {; is the file cut short",
    ),
    "other tool": (
        fanuc,
        edited("CALIB.LS", "UT : 0", "UT : 3"),
        "CALIB.LS: tool differs between poses, 3, 0; expected",
    ),
    "reflection": (
        matrices,
        reflected,
        "pose pose4: matrix with determ",
    ),
    "a word": (
        as_json,
        replaced("poses.json", b'["a"]'),
        "poses.json: no numbers in columns",
    ),
    "not text": (
        tum,
        replaced("poses.tum", b"1 2\xff\0"),
        "poses.tum: binary data; save it as text",
    ),
    "far": (
        csv,
        edited("scan_001.csv", "z\n", "z\n1,-99999.9\n"),
        r"files: the profiles .* \(--missing\)",
    ),
    "word": (
        csv,
        edited("scan_001.csv", "z\n", "z\n1,2\n3,oops\n"),
        "scan_001.csv line 3: z is 'oops'; exp",
    ),
    "titles": (
        csv,
        edited("scan_001.csv", "x,z", "x,width"),
        "scan_001.csv: columns x, width, where scan_000",
    ),
    "cut": (
        csv,
        cut_short("scan_001.csv"),
        "scan_001.csv line .* 1 fields; expected 2: is the file cut short",
    ),
    "columns": (
        tum,
        five_columns,
        "3.npz: columns 1, .*, 5, w",
        archives,
    ),
    "no entry": (
        tum,
        edited("p2.yml", "profile:", "outline:"),
        "no list 'profile'; there are outline, picked",
        lists,
    ),
    "compressed": (
        tum,
        replaced(
            "cloud3.pcd",
            b"# .PCD\nFIELDS x z\nSIZE 4 4\nTYPE F F\nPOINTS 9\nDATA "
            b"binary_compressed\n\0",
        ),
        "cloud3.pcd: compressed; save it as DATA binary or ascii",
        binary_pcd,
    ),
    "open list": (
        tum,
        edited("p2.yml", " ]", ""),
        "p2.yml: not as many ] as \\[",
        lists,
    ),
    "pairs": (
        tum,
        edited("p2.yml", "profile: [", "profile: [ 1.,"),
        "p2.yml line 3: . fields; expected 3: is",
        lists,
    ),
    "not alike": (
        tum,
        rows_alike,
        "all.txt: z alone, and x nowhere; say where it begins",
        wide_table,
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_guess_that_cannot_be_made_is_refused_in_a_sentence(mistake, tmp_path):
    of_poses, spoil, sentence, *of_profiles = MISTAKES[mistake]
    folder = written(tmp_path / "files", of_poses, *of_profiles)
    spoil(folder)
    refuse(folder, sentence)


ON_BYTES = (
    "bytes_flipped",
    "lines_lost_or_doubled",
    "cut_short",
    "other_separators",
    "something_inserted",
)


def corrupted(folder, rng):
    """One file lost, misnamed, or changed as disks, editors and people do."""
    path = rng.choice(sorted(folder.iterdir()))
    how = rng.choice(["lost", "misnamed", *ON_BYTES])
    if how == "lost" or not path.stat().st_size:
        path.unlink()
    elif how == "misnamed":
        path.rename(path.with_name(f"{rng.choice(['pose', 'p1', 'x'])}{path.name}"))
    else:
        files = {path.name: path.read_bytes()}
        CORRUPTIONS[how](rng, SimpleNamespace(files=files))
        path.write_bytes(files[path.name])


def test_corrupted_files_give_a_sentence_or_a_scan(tmp_path):
    names, layouts = [*POSES], [*PROFILES.values()]
    for seed in range(FUZZ):
        rng = default_rng([7, seed])
        name, of_profiles = names[seed % len(names)], layouts[seed % len(layouts)]
        folder = written(tmp_path / str(seed), POSES[name], of_profiles)
        for _ in range(1 + seed % 2):
            corrupted(folder, rng)
        with suppress(ScanError):
            read(folder, **said_of(name))
        shutil.rmtree(folder)


def test_a_large_table_becomes_arrays(tmp_path):
    """A thousand rows at a time: lists of text take thirty times the file's size."""
    rows = "".join(f"{k // 1500 + 1},{k % 1500 / 20},{k % 7}\n" for k in range(4500))
    path = tmp_path / "all.csv"
    path.write_text(f"pose,x,z\n{rows}4,oops,1\n")
    table = read_profiles(path, 3, Layout())
    with pytest.raises(ScanError, match=r"all.csv line 4502: x is 'oops'; "):
        profiles_of([table], 3, Layout())
    path.write_text(f"pose,x,z\n{rows}")
    table = read_profiles(path, 3, Layout())
    assert all(isinstance(cells, np.ndarray) for cells in table.columns.values())
    names, counts, _, _ = profiles_of([table], 3, Layout())
    assert names == ["1", "2", "3"]
    assert counts == 3 * [1500]
    tables = []
    for count in (12, 1200):  # text, and arrays
        rising = np.arange(count)
        columns = [rising / 20, np.zeros(count), 100 + rising]
        np.savetxt(tmp_path / "p.txt", np.column_stack(columns))
        tables.append(read_profiles(tmp_path / "p.txt", 0, Layout()))
    *_, axes = profiles_of(tables, 0, Layout())
    assert [*axes] == ["1", "3"]


PEAK = """
import resource, subprocess, sys
command = [sys.executable, "-m", "profilecal_tool", "import", *sys.argv[1:]]
subprocess.run([*command, "--target", "edge"], check=True, stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
"""


def long_file_of_profiles(count):
    """Of so many points each."""
    x = np.linspace(-40, 40, count)
    lines = [f"{x:.9f},{100 + x / 5:.9f}\n" for x in x.tolist()]

    def write(folder):
        with (folder / "all.csv").open("w") as file:
            file.write("pose,x,z\n")
            for k in range(12):
                file.writelines(f"scan_{k:03d},{line}" for line in lines)

    return csv, write


def long_log(count):
    """With so many entries where the robot stands, beside profiles with times."""

    def log(folder):
        lines = [text(row) for row in poses("quaternion") for _ in range(count)]
        with (folder / "robot_log.csv").open("w") as file:
            file.write("time,x,y,z,qw,qx,qy,qz\n")
            file.writelines(f"{k / 125:.3f},{line}\n" for k, line in enumerate(lines))

    def profiles(folder):
        for k, points in enumerate(scan().values):
            path = folder / f"{(k + 0.5) * count / 125:.3f}.csv"
            write_table(path, "x,z", points)

    return log, profiles


@pytest.mark.parametrize(
    ("files", "few", "many"),
    [(long_file_of_profiles, 10, 25_000), (long_log, 10, 8_500)],
)
def test_long_files_take_five_times_their_size_of_memory(files, few, many, tmp_path):
    """From the command to the written scan, beside what it takes for short ones."""
    peaks = []
    for count in (few, many):
        folder = written(tmp_path / f"in{count}", *files(count))
        size = max(path.stat().st_size for path in folder.iterdir())
        command = [sys.executable, "-c", PEAK, folder, tmp_path / f"out{count}"]
        peaks.append(int(subprocess.check_output(command)))
    assert size > 10e6
    assert peaks[1] - peaks[0] <= 5 * size


REAL_DATA = os.environ.get("PROFILECAL_REAL_DATA")
needs_real_data = pytest.mark.skipif(
    not REAL_DATA,
    reason="the measurements of HandEyeSync are not here: "
    "PROFILECAL_REAL_DATA is not set",
)


def real_scan(name, entry=""):
    """Of HandEyeSync, where a user has it (data/README.md): the "edge", or the
    "sphere"; `entry`: such as "feature_point".
    """
    kind, sizes = ("edge", {}) if name == "edge" else ("ball", {"radius": 40.0})
    folder = Path(REAL_DATA) / "handeyesync" / name
    imported, _ = import_scan(folder, kind, sizes, Layout(entry=entry))
    return imported


@needs_real_data
@pytest.mark.parametrize(
    ("name", "shape", "largest_mm"), [("edge", "corner", 0.15), ("sphere", "arc", 0.25)]
)
def test_the_real_measurements_are_found_in_every_profile_and_calibrate(
    name, shape, largest_mm
):
    scan = real_scan(name)
    features = scan.target.find(scan.values, *scan.sizes)
    assert [feature.shape for feature in features] == [shape] * len(scan.labels)
    found = calibrate([scan])
    assert found.status == "ok"
    assert found.solution.rms_mm <= largest_mm


@needs_real_data
def test_picked_points_lie_on_the_ridge_that_is_found():
    scan = real_scan("edge")
    features = scan.target.find(scan.values)
    ridges = np.array([feature.points[0] for feature in features])
    picked = np.concatenate(real_scan("edge", "feature_point").values)
    # mm: the same ridge; picks err by 0.1 and the edge is round
    assert np.abs(ridges - picked).max() < 0.5


@pytest.mark.parametrize(("unit", "scale"), [("", 1), (" [ms]", 1000)])
def test_two_logs_are_a_scan_in_motion(unit, scale, tmp_path):
    """The robot's with poses, the scanner's with profiles, each by its own clock."""
    driven = scan_of(
        "plane",
        motion={"sweeps": 3, "profiles": 8, "turn_deg": 5.0},
        scanner={"points": 60},
    )
    log = driven.log
    turned = from_rotations(named("quaternion"), log.R)
    rows = np.column_stack([scale * log.t, log.p, turned])
    folder = tmp_path / "in"
    folder.mkdir()
    titles = f"time{unit},x,y,z,qw,qx,qy,qz"
    write_table(folder / "robot.csv", titles, rows)
    points = [
        np.column_stack([np.full(len(own), scale * t), own])
        for t, own in zip(driven.times, driven.values, strict=True)
    ]
    titles = f"time{unit},x,z"
    path = folder / "scanner.csv"
    write_table(path, titles, np.concatenate(points))

    imported, guesses = import_scan(folder, "plane", {})
    assert "by time, in motion: 24 profiles in 3 sweeps" in guesses[3]
    assert imported.labels == driven.labels
    assert_allclose(imported.T_base_flange, driven.T_base_flange, atol=1e-6)
    check_profiles(imported, driven)


@pytest.mark.parametrize("points", ["px,pz", "scan x [mm],scan z [mm]", "x,z"])
@pytest.mark.parametrize("is_one", [True, False])
def test_points_with_a_time_each_are_a_scan_in_motion(is_one, points, tmp_path):
    """The robot's poses in the same rows, or in a file of their own."""
    driven = scan_of("edge", motion={"sweeps": 3, "profiles": 20})
    R, p, _ = driven.log.at(driven.times)
    turned = from_rotations(named("quaternion"), R)
    t, seen = driven.times, np.concatenate(driven.values)
    of = "tcp_" * (points == "x,z")
    poses = f"t,{of}X,{of}Y,{of}Z,{of}qw,{of}qx,{of}qy,{of}qz"
    tables = {f"{poses},{points}": [t, p, turned, seen]}
    if not is_one:
        tables = {poses: [t, p, turned], f"t,{points}": [t, seen]}
    for k, (titles, columns) in enumerate(tables.items()):
        path = tmp_path / ("scanner.csv" if k else "robot.csv")
        write_table(path, titles, np.column_stack(columns))
    scan, guesses = read(tmp_path)
    assert "by time, in motion: 60 profiles in 3 sweeps" in guesses[3]
    assert_allclose(scan.times, t, atol=1e-9)
    assert_allclose(scan.p_base_flange, p, atol=1e-6)
    assert_allclose(scan.R_base_flange, R, atol=1e-6)
    assert_allclose(np.concatenate(scan.values), seen, atol=1e-9)


def test_profiles_at_a_rate_are_a_scan_in_motion(tmp_path):
    driven = scan_of(
        "plane", motion={"sweeps": 1, "profiles": 9}, scanner={"points": 60}
    )
    turned = from_rotations(named("quaternion"), driven.log.R)
    rows = np.column_stack([driven.log.t, driven.log.p, turned])
    titles = "t,x,y,z,qw,qx,qy,qz"
    write_table(tmp_path / "robot.csv", titles, rows)
    for k, points in enumerate(driven.values):
        np.savetxt(tmp_path / f"p{k}.txt", points, header="x z")
    start, rate = driven.times[0], 1 / np.diff(driven.times).mean()
    imported, guesses = import_scan(tmp_path, "plane", {}, Layout(times=(start, rate)))
    assert "9 profiles in 1 sweeps" in guesses[3]
    assert_allclose(imported.times, driven.times, atol=2e-6)
    for times in ((-5.0, 100.0), (start, 0.0), (start + 1000, rate)):
        with pytest.raises(ScanError, match="--times"):
            import_scan(tmp_path, "plane", {}, Layout(times=times))


@pytest.mark.parametrize("unit", [1, 1000])
def test_a_tool_beside_all_poses_of_a_json_file_is_taken_off(unit, tmp_path):
    """In the unit of the poses; in another one it is asked about."""

    def write(folder):
        tool = frame(*TOOL)
        rows = poses("FANUC angles", 1.0, matrices_of_poses() @ tool)
        named_rows = [dict(zip("xyzwpr", row, strict=True)) for row in rows.tolist()]
        x = (value / unit for value in TOOL[:3])
        offset = dict(zip("xyzwpr", (*x, *TOOL[3:]), strict=True))
        content = {"tool_offset": offset, "samples": named_rows}
        (folder / "poses.json").write_text(json.dumps(content))

    folder = written(tmp_path / "files", write)
    if unit == 1000:
        refuse(folder, "is at .* --tool 10 -20 150 12 -5 30$")
    check_poses(read(folder, tool=None if unit == 1 else TOOL)[0])


@pytest.mark.parametrize("names", ["R_base2gripper t_base2gripper", "T_base2gripper"])
def test_base2gripper_is_the_inverse_of_a_pose(names, tmp_path):
    """OpenCV's name; where positions speak against it, it is asked about."""
    T = matrices_of_poses()

    def write(T, folder):
        parts = [T] if names[0] == "T" else [T[:, :3, :3], T[:, :3, 3:]]
        np.savez(folder / "poses.npz", **dict(zip(names.split(), parts, strict=True)))

    written(tmp_path / "a", functools.partial(write, np.linalg.inv(T)))
    written(tmp_path / "b", functools.partial(write, T))
    check_poses(read(tmp_path / "a")[0])
    assert "the inverse of the robot's pose" in notes(tmp_path / "a")[0]
    said = refuse(tmp_path / "b", "call it gripper2base there; .*--entry")
    imported, _ = read(tmp_path / "b", entry=said.split()[-1])
    assert_allclose(imported.T_base_flange, np.linalg.inv(T), atol=1e-8)


def in_a_name(folder):
    rows = np.linalg.inv(matrices_of_poses()).reshape(-1, 4)
    np.savetxt(folder / "gripper_T_base.txt", rows, "%.12f")


def in_titles(folder):
    titles = ",".join(f"T_tcp_base_{k}{j}" for k in range(3) for j in range(4))
    rows = np.linalg.inv(matrices_of_poses())[:, :3].reshape(-1, 12)
    write_lines(folder / "poses.csv", [titles, *map(text, rows)])


def beside_one_tool(folder):
    content = {"flange_T_tcp": TOOL_AT, "base_T_tcp": matrices_of_poses() @ TOOL_AT}
    content = {name: matrices.tolist() for name, matrices in content.items()}
    (folder / "poses.json").write_text(json.dumps(content))


def of_the_flange(folder):
    """A tool's frame is there, and the poses are not of it."""
    T = matrices_of_poses()
    content = {"flange_T_tcp": TOOL_AT.tolist(), "tool": 3, "T_flange": T.tolist()}
    (folder / "poses.json").write_text(json.dumps(content))


def beside_the_tool(folder):
    rows = np.hstack(
        [poses("KUKA angles", 1, matrices_of_poses() @ TOOL_AT), poses("KUKA angles")]
    )
    titles = ",".join(f"{of}_{name}" for of in ("tcp", "flange") for name in "xyzabc")
    write_lines(folder / "robot.csv", [titles, *map(text, rows)])


TOOL_AT = frame(*TOOL)


@pytest.mark.parametrize(
    "of_poses",
    [in_a_name, in_titles, beside_one_tool, of_the_flange, beside_the_tool],
)
def test_what_poses_are_of_is_in_their_names(of_poses, tmp_path):
    imported, guesses = read(written(tmp_path / "files", of_poses))
    check_poses(imported)
    assert "not taken off" not in guesses[1]


@pytest.mark.parametrize("name", ["T_tool_camera", "home_tcp"])
def test_a_frame_that_is_no_tool_is_not_taken_off(name, tmp_path):
    def write(folder):
        poses_and_another = {name: TOOL_AT.tolist(), "T": matrices_of_poses().tolist()}
        (folder / "poses.json").write_text(json.dumps(poses_and_another))

    check_poses(read(written(tmp_path / "files", write))[0])


def test_the_column_with_even_steps_is_x(tmp_path):
    """Behind z of a plane, which goes on as x does; a shade; blank rows first."""
    x = np.arange(60) * 0.7

    def write(folder):
        rng = default_rng(5)
        for k in range(12):
            z = 80 + k + x + rng.normal(0, 0.05, len(x))
            rows = np.c_[z, x - 20.05, rng.integers(9, size=len(x))]
            write_lines(folder / f"p{k}.csv", [",,", *map(text, rows)])

    imported, guesses = read(written(tmp_path / "files", tum, write))
    assert "x (column 2)" in guesses[2]
    assert_allclose(imported.values[3][:, 0], x - 20.05, atol=1e-9)


def test_a_day_may_come_first(tmp_path):
    def table(folder):
        lines = ["Zeit;x;y;z;a;b;c"]
        for k, row in enumerate(poses("KUKA angles")[::-1]):
            lines.append(f"17.05.2024 10:{k:02d}:31;{text(row, ';')}")
        write_lines(folder / "robot.csv", lines)

    def by_date(folder):
        for k, points in enumerate(scan().values[::-1]):
            write_table(folder / f"2024-05-17_10-{k:02d}-32.csv", "x,z", points)

    imported, guesses = read(written(tmp_path / "files", table, by_date))
    assert guesses[3].endswith("by time, up to 1 s apart")
    assert_allclose(imported.p_base_flange, scan().p_base_flange[::-1], atol=1e-6)


def test_whole_numbers_have_the_one_unit_that_is_possible(tmp_path):
    def write(folder):
        for k, points in enumerate(scan().values):
            write_table(folder / f"{k}.txt", "", np.nan_to_num(points * 2e5).round())

    imported, guesses = read(written(tmp_path / "files", tum, write))
    assert "in 0.01 um" in guesses[2]
    doubled = SimpleNamespace(values=[2 * points for points in scan().values])
    check_profiles(imported, doubled, 1e-5)


def test_a_column_that_counts_points_is_not_x(tmp_path):
    def write(folder):
        for k, points in enumerate(scan().values):
            rows = [f"{i},{z}" for i, z in enumerate(points[:, 1])]
            write_lines(folder / f"p{k}.csv", ["index,z", *rows])

    folder = written(tmp_path / "files", tum, write)
    refuse(folder, "--x START PITCH")
