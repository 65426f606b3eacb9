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
from pathlib import Path

import numpy as np
import peoples_files as people
import pytest
from command import run
from corruptions import CORRUPTIONS
from folders import edited, removed
from folders import written as a_file
from makers_table import README, with_table
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from pandas import DataFrame, ExcelWriter
from peoples_files import (
    POSES,
    PROFILES,
    abb,
    csv,
    each,
    fanuc,
    kuka,
    listed,
    one_each,
    poses,
    scan,
    tum,
    upwards,
    write_table,
    written,
)
from simulated import scan_of

from profilecal.calibration.calibrate import calibrate
from profilecal.scan.conventions import from_rotations, named
from profilecal.scan.folder import read_scan
from profilecal.scan.tables import ScanError
from profilecal_tool.importing.import_scan import Layout, import_scan
from profilecal_tool.importing.makers import ROBOTS, robot_of
from profilecal_tool.importing.program_lines import KINDS, program_blocks, rows_by_forms
from profilecal_tool.importing.robot_poses import pose_fields, robot_poses
from profilecal_tool.importing.tool_frames import lines_of_program

FUZZ = int(os.environ.get("PROFILECAL_FUZZ", "30"))


def check_scan(folder):
    """All poses and profiles are there, in whatever order, in some base."""
    turns, seen = [], []
    for one in (read_scan(folder), scan()):
        order = np.argsort([np.nansum(points) for points in one.values])
        T = one.T_base_flange[order]
        turns.append(np.linalg.inv(T[0]) @ T)
        points = np.concatenate([one.values[k] for k in order])
        seen.append(points[np.isfinite(points[:, 1])])
    assert_allclose(*turns, atol=1e-6)
    assert_allclose(*seen, atol=1e-4)


def log_with_stops(folder):
    """At 2 Hz, of a robot that stands still for two seconds of each minute."""
    rows = np.repeat(poses("quaternion"), 120, axis=0)
    beats = np.arange(len(rows))
    rows[:, :3] += np.maximum(beats % 120 - 3, 0)[:, None]
    table = np.column_stack([1.7e12 + 500 * beats, rows])
    write_table(folder / "robot_log.csv", "time_ms,x,y,z,qw,qx,qy,qz", table)


def in_one_table(folder):
    """A row for each point, with its pose."""
    pairs = zip(poses("quaternion"), scan().values, strict=True)
    rows = [[*row, *point] for row, points in pairs for point in points]
    write_table(folder / "log.csv", "x,y,z,qw,qx,qy,qz,px,pz", rows)


def samples(folder):
    """A line for each pose as ROS has it, with its profile."""
    every = []
    for row, points in zip(poses("quaternion", 0.001), scan().values, strict=True):
        position = dict(zip("xyz", row[:3], strict=True))
        turn = dict(zip("wxyz", row[3:], strict=True))
        robot = {"position": position, "orientation": turn}
        profile = DataFrame(points, columns=["x", "z"]).to_dict("records")
        every.append({"robot": robot, "profile": profile})
    (folder / "c.jsonl").write_text("\n\n".join(map(json.dumps, every)))


def sheets(folder):
    """A sheet for each profile, with blank rows where nothing was seen."""
    with ExcelWriter(folder / "profiles.xlsx") as book:
        for k, points in enumerate(scan().values):
            table = DataFrame(points, columns=["x", "z"])
            table.to_excel(book, sheet_name=f"scan_{k:03d}", index=False)


def nothing(folder):
    """No more files."""


def german(label, encoding="utf-8"):
    titles = f"{label};X in mm;Y in mm;Z [mm];A in Grad;B in Grad;C in Grad"
    return upwards(titles, "XP{k};{all}", between=";", encoding=encoding)


of_angles = functools.partial(listed, convention="FANUC angles")
by_target = each("p{}0.csv", begin=1)
NO_MOVES = edited("scan.mod", "MoveL", "!", 12)
far_point = functools.partial(edited, "scan_003.csv", "nan,nan")

# what is in a folder, and what is said of it as it is read or asked about
FOLDERS = {name: (write, "/ written") for name, write in POSES.items()}
FOLDERS |= {name: (tum, write, "/ written") for name, write in PROFILES.items()}
FOLDERS |= {
    "zeros": (tum, each(nothing="0,0"), "0: 12 of 240 points"),
    "a far point": (tum, one_each, far_point("1e6,1e6"), "1000000 at 1 of 229"),
    "whole numbers": (tum, each(scale=1e5), "(--missing)"),
    "two conventions": (
        listed("x,y,z,a,b,c,w,p,r", "{all},{3},{4},{5}"),
        "KUKA angles or FANUC angles",
    ),
    "in cm": (listed("x,y,z,a,b,c", scale=0.1), "up to 101.7; cm, in or mm"),
    "beside joints": (
        listed(
            "j1,j2,j3,j4,j5,j6,c1,c2,c3,q1,q2,q3,q4", "0,0,0,0,0,0,{all}", "quaternion"
        ),
        "what are they",
    ),
    "q0 to q3": (
        listed("q0,q1,q2,q3,x,y,z", "{3},{4},{5},{6},{0},{1},{2}", "quaternion"),
        "qw,qx,qy,qz",
    ),
    "of tcp": (listed("x_tcp,y_tcp,z_tcp,a_tcp,b_tcp,c_tcp"), "poses of tcp"),
    "no titles": (of_angles("", scale=0.001, angle=np.pi / 180), "what are they"),
    "radians in files": (
        listed("x,y,z,a,b,c", angle=np.pi / 180, name="pose{}.csv"),
        "rad or deg",
    ),
    "a vector in radians": (
        listed("x,y,z,rx [radians],ry,rz", convention="rotation vector"),
        "in mm, radians",
    ),
    "a vector in degrees": (of_angles("x,y,z,rx [deg],ry [deg],rz [deg]"), "w, p, r?"),
    "a tool that no line uses": (
        abb,
        by_target,
        NO_MOVES,
        "is declared, which no known line",
    ),
    "a tool of an array": (
        people.abb_array,
        one_each,
        "moves have tools tscan, tool0; of which are the poses?",
    ),
    "a tool by its number": (
        people.of_tool("n,x,y,z,w,p,r,Tool-Nr", "{k},{all},3", "FANUC angles"),
        "tool 3, of which no frames are here… --tool X Y Z W P R",
    ),
    "a tool above": (people.of_tool_above, "tool tcp_offset is declared"),
    "brackets": (csv, each("[{:03d}].csv"), each("[{:03d}]b.csv"), "'[[]*].csv'"),
    "of a camera": (listed("cam_x,cam_y,cam_z,cam_a,cam_b,cam_c"), "poses are of cam"),
    "angles first": (
        of_angles("rx,ry,rz,x,y,z", "{3},{4},{5},{0},{1},{2}"),
        "rad, longer than pi; are they w, p, r?",
    ),
    # not among those corrupted: SciPy itself crashes at some cells
    "cells": (tum, people.cells, "in order"),
    "two frames in turn": (people.transforms, "tools tool0, camera_link"),
    "no columns": (tum, each(titles="", columns="7"), "1, 2, 3; a row is 7.0, "),
    "frames": (
        tum,
        each(titles="frame,x,z", columns="01"),
        "(all: --where 'frame=*')",
    ),
    "two scanners": (
        tum,
        each(titles="sensor,x,z", columns=("0.0", "1.0")),
        "sensor is 0.0 to 1.0",
    ),
    "along y": (tum, each(titles="x,y,z", columns="0"), "x always the same"),
    "several of a pose": (
        csv,
        each("scan_{:03d}_frame0.csv"),
        each("scan_{:03d}_frame1.csv"),
        "(all: 'scan_*_frame*.*')",
    ),
    "two families": (
        csv,
        one_each,
        each("under_scan_{:03d}.csv"),
        "which holds the profiles",
    ),
    "1.10 and 1.1": (
        listed("Pose,X [mm],Y,Z,A,B,C", "1.{n},{all}"),
        each("p_1.{}.csv", begin=1),
        "by Pose and the numbers in the profiles' names",
    ),
    "a date and a number": (
        german("Laufnummer"),
        each("20240503_1412{0:02}_{0:03}.csv"),
        "number in place 1",
    ),
    "a folder each": (
        people.matrices(name="{}/pose.txt"),
        each("{}/profile.csv"),
        "number in place 1",
    ),
    "Chinese": (
        german("序号", encoding="gb18030"),
        each("轮廓{}.csv", "X坐标(毫米),高度(毫米)", encoding="gb18030"),
        "number in place 1",
    ),
    "UTF-16": (
        german("Nr.", encoding="utf-16"),
        each("p{}.txt", encoding="utf-16", begin=1),
        "number in place 1 of the profiles' names -1",
    ),
    "a pose before": (
        listed("Nr,X,Y,Z,A,B,C\nref,400,0,600,0,90,0\n0,400,0,600,0,90,0", "{n},{all}"),
        each("profile_{:03}.csv", begin=1),
        "number in place 1 of the profiles' names; left out, without a profile: ref, 0",
    ),
    "units below": (
        upwards(
            "Nr;X;Y;Z;A;B;C\n;[m];[m];[m];°;°;°", "{k};{all}", scale=1e-3, between=";"
        ),
        each("p{}.csv", "# x,z\r\n# mm,mm"),
        "number in place 1 of the profiles' names",
    ),
    "milliseconds": (
        log_with_stops,
        each("scan_2023-11-14T22:{}:20.100.csv", begin=13),
        a_file("scan_2023-11-14T22:13:23.100.csv", "x,z\n1,100\n2,100\n"),
        "up to 0.1 s apart; left out, without a pose: scan_2023-11-14T22:13:23.100",
    ),
    "numbers like dates": (
        upwards("time,x,y,z,a,b,c", "17200312{k:02}141500000,{all}"),
        each("17200312{:02}141500000.csv"),
        "up to 0 s apart",
    ),
    "points of nobody": (in_one_table, nothing, "in order"),
    "samples": (samples, nothing, "in order"),
    "sheets": (csv, sheets, "by Name and the profiles' names"),
    "driven backwards": (
        abb,
        one_each,
        edited("scan.mod", "  MoveL p10", "  MoveL Offs(p10,0);\n  MoveL p10"),
        "moves beside poses… in order of the lines that use them",
    ),
    "no frame": (
        abb,
        one_each,
        edited("scan.mod", "tooldata tScan", "tooldata tOther"),
        "tool tscan, of which no frames",
    ),
    "a frame beside": (people.robot_states, "one at [0.012, -0.035, 0.18]"),
    "a frame with a name": (people.ur, "tcp1 at [0.012, -0.035, 0.18] m, taken off"),
}
FOLDERS |= {
    f"a tool in {unit}": (
        people.of_tool(
            f"n,x [mm],y,z,w,p,r,tcp_offset_x {unit},"
            "tcp_offset_y,tcp_offset_z,tcp_offset_w,tcp_offset_p,tcp_offset_r",
            f"{{k}},{{all}},{where},0,0,30",
            "FANUC angles",
        ),
        "a tool without a name, of which no frames are here… --tool X Y Z W P R",
    )
    for unit, where in (("", "0.012,-0.035,0.18"), ("[cm]", "1.2,-3.5,18"))
}


def said_of(tmp_path, row):
    """What is said of a folder of a row's files, imported with its options; it has the
    words that stand last in the row.
    """
    *given, words = row
    folder = written(tmp_path / "in", *filter(callable, given))
    options = [one for one in given if isinstance(one, str)]
    command = ["import", folder, tmp_path / "scan", "--target", "edge"]
    said = run(*command, *" ".join(options).split()).output
    expected = re.escape(words).replace("…", ".*").replace("\\\n", "\n\\Z")
    assert re.search(expected, said, re.S), said
    return said


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_is_read_at_once_or_by_the_line_that_is_printed(name, tmp_path):
    said = said_of(tmp_path, FOLDERS[name])
    question, _, line = said.rpartition("\nprofilecal import ")
    if question:
        line = re.sub("--tool X Y Z .*", "--tool 12 -35 180 90 0 -90", line)
        pasted = run("import", *shlex.split(line))
        assert pasted.exit_code == 0, pasted.output
    check_scan(tmp_path / "scan")


# what else is said of folders, with options; … for anything, and no line behind \n

FRAMES = """[*POSREG*]$POSREG  Storage: SHADOW
[1,3] =   'HOME'
  Group: 1   Config: N U T, 0, 0, 0
  X: 900.0 Y: 0.0 Z: 700.0
  W: 180.0 P: 0.0 R: 0.0
[*SYSTEM*]$MNUFRAME  Storage: CMOS
[1,3] =
  Group: 1
  X: 7.0 Y: -35.0 Z: 180.0
  W: 10.0 P: -20.0 R: 30.0
[*SYSTEM*]$MNUFRAMENUM  Storage: CMOS
  [1] = 3
[*SYSTEM*]$MNUTOOL  Storage: CMOS
[1,3] =
  Group: 1
  X: 12.0 Y: -35.0 Z: 180.0
  W: 10.0 P: -20.0 R: 30.0
[*SYSTEM*]$MNUTOOLNUM  Storage: CMOS
  [1] = 3
"""
DENSO = """' TOOL 1, (0, 0, 99, 0, 0, 0)
TOOL 1, (12, -35, 180, 10, -20, 30)
P[0] = P(400, 0, 300, 180, 0, 90, 5)
P[1] = P(400, 50, 300, 180, 0, 90, 5)
CHANGETOOL 1
CHANGETOOL 0
"""
ON_THE_FLANGE = edited("scan.mod", "v100,fine,tScan", "v100,fine,tool0")
TOOL_OF_ABB = (
    "PERS tooldata {}:=[TRUE,[[13,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
)
HEIGHTS = "".join(f"{k}{10 * ',90.5,100.5'}\n" for k in range(12))
HEIGHTS_BY_XP = "".join(f"XP{k}{10 * ';90,5;100,5'}\n" for k in range(12))
SAID = {
    "a point for each pose": (
        tum,
        a_file("points.csv", "x,z\n" + 12 * "1,100\n"),
        "X 1.0 to 1.0, Z 100.0 to 100.0 mm",
    ),
    "a frame beside files that are said": (
        kuka,
        one_each,
        edited("scan.dat", "DECL FDAT", ";", 12),
        a_file("scan.src", "$TOOL={X 12,Y 0,Z 0,A 0,B 0,C 0}"),
        a_file("notes.npz", "PK\3"),
        "--poses scan.dat --profiles scan_*.csv",
        "files left out… notes.npz… one at [12.0, 0.0, 0.0] mm, taken off",
    ),
    "two frames of one tool": (
        abb,
        one_each,
        a_file("other.mod", TOOL_OF_ABB.format("tScan")),
        "tool tscan, of which 2 frames",
    ),
    "listed frames": (
        fanuc,
        one_each,
        edited("CALIB.LS", "UT : 0", "UT : 3", 12),
        a_file("SYSFRAME.VA", FRAMES),
        "3 at [12.0, -35.0, 180.0] mm, taken off",
    ),
    "moves that name no poses": (
        a_file("scan.pcs", DENSO),
        "--where tool=2",
        "no line says which poses are of tool 0 or 1 or 2; split it, one per tool",
    ),
    "two that moves have": (
        abb,
        one_each,
        ON_THE_FLANGE,
        "have tools tscan, tool0; of which are the poses?… --where tool=tscan",
    ),
    "one of two that moves have": (
        abb,
        by_target,
        ON_THE_FLANGE,
        "--where tool=tscan",
        "left out, without a pose: p10",
    ),
    "a tool of one move": (
        abb,
        by_target,
        edited("scan.mod", "MoveL p10,v100,fine,tScan", "MoveJ p10,v100,fine,tool0"),
        edited("scan.mod", "MoveL", "!", 11),
        edited("scan.mod", "12,-35,180", "0,0,0"),  # it only turns
        "is declared, which no",
    ),
    "a tool of a script": (
        people.of_tool("x,y,z,rx,ry,rz", "{all}", "rotation vector", 0.001),
        one_each,
        a_file("s.script", "set_tcp(p[0.012,-0.035,0.18,1.2,-1.2,-1.2])"),
        "poses may be of tool in s.script",
    ),
    "a tool in a remark": (
        listed("# Tool: 1\nNr,X,Y,Z,A,B,C", "{n},{all}"),
        one_each,
        "of a tool without a name",
    ),
    "an offset": (
        abb,
        by_target,
        edited("scan.mod", "MoveL p", "MoveL RelTool(p", 12),
        "moves go beside p10, p100, p110",
    ),
    "one that no move has": (abb, "--where tool=tool0", "no poses where tool=tool0"),
    "tools in a list": (
        kuka,
        one_each,
        edited("scan.dat", "FP5={TOOL_NO 0", "FP5={TOOL_NO 1"),
        "--where tool=0",
        "left out, without a pose: scan_005",
    ),
    "zeros that are heights": (
        tum,
        each(nothing="0,0"),
        "--missing 1e9",
        "blank: 0 of 240 points",
    ),
    "a label that lost a cell": (
        upwards("n,scan_no,x,y,z,a,b,c", "{at},{k},{all}"),
        edited("poses.csv", ",5,", ",,"),
        one_each,
        "which pose has scan_000",
    ),
    "two labels of a pose": (
        listed("n,x,y,z,a,b,c", "{k},{all}"),
        people.long_table,
        edited("all.csv", "scan_001", "scan_000b"),
        "scan_000 and scan_000b are of one pose; leave one out",
    ),
    "a pose lost": (
        listed("n,x,y,z,a,b,c", "{n},{all}"),
        one_each,
        edited("poses.csv", "\n6,", "\n99,"),
        "in place 1 of the profiles' names +1; left out, without a pose: scan_005; ",
    ),
    "a sample in each file": (
        listed(
            "",
            '{{"pose": {{"x": {0}, "y": {1}, "z": {2}, "a": {3}, "b": {4}, "c": {5}}}, '
            '"profile": [[0, 100], [20, 101], [40, 102], [60, 103]]}}',
            name="c{:02d}.json",
        ),
        nothing,
        "X 0.0 to 60.0, Z 100.0 to 103.0 mm… by file and the profiles' names",
    ),
    "a list of heights": (
        tum,
        a_file("c.json", '[{"profile": [1, 2, 3, 4]}]'),
        "c.json: 4 numbers of profile are no x, y, z",
    ),
    "heights": (
        tum,
        a_file("z.csv", HEIGHTS),
        "--x 0 2",
        "X 0.0 to 38.0, Z 90.5 to 100.5 mm",
    ),
    "heights behind names": (
        german("Messung"),
        a_file("z.csv", "X start [mm];0\nX pitch [mm];2,0\n" + HEIGHTS_BY_XP),
        "X 0.0 to 38.0, Z 90.5 to 100.5 mm… by Messung and the profiles' names",
    ),
    "titles that count": (
        tum,
        a_file("z.csv", f"n{','.join(map(str, range(21)))[1:]}\n{HEIGHTS}"),
        "where is it along x?",
    ),
    "two places of the first height": (
        tum,
        a_file("z.csv", "X offset,0\nX start,-9\nX pitch,1\n" + HEIGHTS),
        "where is it along x?",
    ),
    "times before heights": (
        tum,
        a_file("z.csv", HEIGHTS),
        edited("z.csv", "\n", "\n9", 11),
        "--x 0 2",
        "column 1 rises from row to row",
    ),
    "a word in heights": (
        tum,
        a_file("z.csv", HEIGHTS_BY_XP),
        edited("z.csv", "XP5;", "XP5;oops"),
        "--x 0 2",
        "z.csv line 6: column 2 is 'oops",
    ),
    "x and z by turns": (
        tum,
        a_file("z.csv", HEIGHTS_BY_XP),
        edited("z.csv", "XP1;", "X;"),
        edited("z.csv", "XP2;", "Z;"),
        "by column 1, rows are of x and of z by turns",
    ),
    "a file of both": (tum, "--poses p*.tum --profiles *.tum", "no x and z in columns"),
    "two runs": (
        listed("x,y,z,a,b,c", name="run1/poses.csv"),
        listed("x,y,z,a,b,c", name="run2/poses.csv"),
        each("run1/{}.csv"),
        "several poses in each of run1/poses, run2/poses; import each folder",
    ),
    "called by words": (
        a_file("poses.csv", "n,x,y,z,a,b,c\nA,1,2,3,4,5,6\nB,2,3,4,5,6,7"),
        a_file("A.csv", "x,z\n1,2"),
        a_file("B.csv", "x,z\n1,2"),
        "of the poses called so?… --poses poses.csv --profiles '*.csv'",
    ),
    "rows": (tum, "--where y=0", "no rows where y=0; the columns are … x, z"),
    "no rows": (tum, "--where x=999", "no profiles in these rows"),
    "doubled angles": (
        listed("x,y,z,a,b,c,a,b,c", "{all},{3},{4},{5}"),
        "which of those called alike? (…qz)\n",
    ),
    "two positions": (
        listed("x,y,z,tx,ty,tz,a,b,c", "{0},{1},{2},{all}"),
        "which of those called alike? (…qz)\n",
    ),
    "numbers without titles": (
        tum,
        each(titles="", columns=("0.5",)),
        "--columns x,2",
        "no x in columns 1, 2, 3; a row is 0.5, 9.125, 89.5; --columns says them\n",
    ),
    "one column": (tum, "--columns 2,2", "x and z are one column"),
    "four columns": (tum, "--columns _,x,z,_", "expected two"),
    "entry": (tum, "--entry flnage", "no entry flnage; those read are x,z"),
    "zeros among points": (
        tum,
        each(nothing="0,0"),
        edited("scan_003.csv", "0,0", "0,-20"),
        "z is 0 at 11 of 240 points",
    ),
    "a second code": (
        tum,
        each(nothing="9999,9999"),
        edited("scan_003.csv", "9999", "-1", 2),
        edited("scan_004.csv", "9999", "-1", 2),
        "--missing 9999",
        "z is -1 at 2 …: a second code?",
    ),
    "a row cut short": (
        csv,
        one_each,
        edited("robot.csv", "scan_005;", "scan_099;1;2\nscan_005;"),
        "line …: 3 fields; expected 7",
    ),
    "a label lost": (
        csv,
        one_each,
        edited("robot.csv", "scan_005;", "\n"),
        "6 fields; expected 7",
    ),
    "a label twice": (
        csv,
        one_each,
        edited("robot.csv", "scan_004;", "scan_005;"),
        "lines 4 and 6: two poses of profile scan_005",
    ),
    "joints": (
        a_file("tcp.csv", "j1,j2,j3,j4,j5,j6\n0,1,2,3,4,5"),
        "joint angles: export Cartesian poses",
    ),
    "tools alone": (
        nothing,
        one_each,
        a_file("f.va", FRAMES),
        "12 profiles for 1 poses",
    ),
    "nothing": (nothing, nothing, "in: no files"),
    "no poses": (nothing, one_each, "no file holds the poses"),
    "two numbers": (
        upwards("Zeile,Bahnpunkt,X,Y,Z,A,B,C", "{at},{k},{all}"),
        "Zeile and the number in place 1 … or by Bahnpunkt and the number in place 1",
    ),
    "another clock": (
        tum,
        each("17000072{:02}.csv"),
        removed("1700007205.csv"),
        "11 profiles for 12 poses",
    ),
    "two clocks": (
        upwards("time,x,y,z,a,b,c", "2024-05-03T14:12:{k:02},{all}"),
        each("20240503_1512{:02}.csv"),
        "by two clocks, and in another order",
    ),
    "no time of a pose": (
        tum,
        a_file("1700000003.csv", "x,z\n1,100\n30,99\n"),
        a_file("1700000004.csv", "x,z\n5,90\n40,95\n"),
        "stands still, up to 0 s apart, and no profile has a pose",
    ),
    "times that are no labels": (
        listed("n,t [min],x,y,z,a,b,c", "{k},{n},{all}"),
        "--times 60 0.01666666666667",
        "by time, up to 0 s apart",
    ),
    "no rate": (tum, "--times 0 0", "--times: 0 profiles a second"),
    "times that no pose has": (
        listed("x,y,z,a,b,c"),
        "--times 0 1",
        "12 profiles for 12 poses, and no label or time that both have",
    ),
    "a stack, and poses in another order": (
        upwards("id,x,y,z,a,b,c", "{k},{all}"),
        people.stacked,
        "sort the rows",
    ),
    "an inverse": (
        listed("x,y,z,a,b,c", name="base2flange.csv"),
        "may be the inverse",
    ),
    "one unit": (tum, each(titles="x,z [um]", scale=1e3), "units are mm, um"),
    "a unit that is none": (
        tum,
        each(titles="x [furlong],z [furlong]"),
        "units are furlong; expected one of mm, cm, m, um",
    ),
    "open list": (
        fanuc,
        PROFILES["lists"],
        edited("p2.yml", " ]", ""),
        "p2.yml: … cut short",
    ),
}


@pytest.mark.parametrize("name", SAID)
def test_what_is_said(name, tmp_path):
    said_of(tmp_path, SAID[name])


def corrupted(folder, rng):
    """One file changed as disks, editors and people do."""
    path = rng.choice([path for path in folder.iterdir() if path.stat().st_size])
    files = {path.name: path.read_bytes()}
    CORRUPTIONS[rng.choice(["bytes_flipped", "cut_short", "other_separators"])](
        rng, files
    )
    path.write_bytes(files[path.name])


def test_corrupted_files_give_a_sentence_or_a_scan(tmp_path):
    for seed in range(FUZZ):
        rng = default_rng([7, seed])
        kinds = [[*one.values()] for one in (POSES, PROFILES)]
        folder = tmp_path / str(seed)
        written(folder, *(own[seed % len(own)] for own in kinds))
        for _ in range(1 + seed % 2):
            corrupted(folder, rng)
        with suppress(ScanError):
            import_scan(folder, "edge", {})
        shutil.rmtree(folder)


# the command, and what it leaves


def test_what_a_user_knows_is_kept_and_pictures_are_passed_over(tmp_path):
    one_point = a_file("scan_003.csv", "x,z\n1,2\n")
    further = [one_point, a_file("scan_004.csv", ""), a_file("cell.png", "\0")]
    folder = written(tmp_path / "in", tum, one_each, *further)
    command = ["import", folder, tmp_path / "scan"]
    said = run(*command, "--target", "edge").output
    assert "empty: scan_003, scan_004\n" in said
    imported = read_scan(tmp_path / "scan")
    assert sum(np.isnan(points).all() for points in imported.values) == 2
    edited("scan.toml", "[", "[guess]\nmount = [0, 80, 120, 0, 0, 90]\n[")(command[2])
    answers = tmp_path / "scan" / "import.toml"
    kept = answers.read_text()
    assert run(*command).exit_code == 0
    assert answers.read_text() == kept
    answers.write_text(kept + 'columns = "z,x"\n')
    assert run(*command).exit_code == 0
    turned = read_scan(tmp_path / "scan")
    assert turned.guess is not None
    assert_array_equal(turned.values[0], imported.values[0][:, ::-1])
    assert "name a new folder" in run(*command, "--mount", "eye-to-hand").output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "scan"]
    answers.write_text('colums = "z,x"\n')
    assert "unknown entry 'colums'" in run(*command).output


@pytest.mark.parametrize("maker", ROBOTS)
def test_each_form_of_a_line_takes_its_example(maker):
    robot = ROBOTS[maker]
    for kind in KINDS:
        names, examples = [], []
        for form, example in getattr(robot, kind):
            table, _ = rows_by_forms([form], example)
            assert len(table.dropna(axis=1)) == 1, (
                f"{maker}: {form} is not of {example}"
            )
            names += map(str.lower, table.get("name", []))
            examples.append(example)
        blocks = program_blocks(Path(), "\n".join([robot.has, *examples]))
        rows = lines_of_program(blocks, maker)[kind]
        assert len(rows) == len(examples)
        assert names == [row["name"] for row in rows if row.get("name")]
        if kind == "uses":
            assert all(row.keys() <= {"name", "tool", "base"} for row in rows)


# the first example of each maker is one pose; or that of its own row, if it has one
SAME = "1101.8 -35.7 95.9", ".496 .17 -.851  .393 -.918 .046  -.774 -.357 -.523"
EXPECTED = dict.fromkeys(ROBOTS, SAME) | {"Mecademic": ("250 -35.7 95.9", SAME[1])}


@pytest.mark.parametrize("maker", ROBOTS)
def test_a_first_example_is_at_this_position_and_turned_so(maker):
    robot, path = ROBOTS[maker], Path(maker)
    program = f"{robot.has}\n{robot.pose[0][1]}"
    found = robot_poses({path: [*program_blocks(path, program)]}, Layout())
    fields, _ = pose_fields(found, ["p"])
    position, matrix = (np.array(text.split(), float) for text in EXPECTED[maker])
    hint = "its position and rotation matrix are in EXPECTED"
    assert_allclose(fields["p_base_flange"][0], position, atol=0.4, err_msg=hint)
    assert_allclose(fields["R_base_flange"][0].ravel(), matrix, atol=0.002)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"poses": []}, "robot 'Acme': unknown entry 'poses'; there are maker, pose"),
        ({"pose": ["P $x"]}, "robot 'Acme': pose is ['P $x']; expected [["),
        ({"maker": 7}, "robot 7: maker is 7; expected one line of text"),
    ],
)
def test_a_row_says_what_a_row_may(keys, words):
    with pytest.raises(ScanError, match=re.escape(words)):
        robot_of({"maker": "Acme", "pose": []} | keys)


def test_a_form_takes_a_whole_name_and_stands_in_its_own_line():
    table, _ = rows_by_forms(["^$name AT <$x>"], "7 10 AT <3>\n\n  120 AT <5>")
    assert dict(table["name"]) == {1: "10", 3: "120"}
    table, _ = rows_by_forms(["^$name $x $y …"], "7 400.5 3 2 1")
    assert table["name"].tolist() == ["7"]
    table, _ = rows_by_forms(["{X $x}"], "home\n\n  {X 5}")
    assert table.index.tolist() == [3]
    remark = f"<!--\n{ROBOTS['Stäubli'].pose[0][1]}\n-->"
    pulses = "///PULSE\nC00000=1,2,3,4,5,6\n///RECTAN\n"
    assert not [*program_blocks(Path(), remark + pulses)]


def test_the_readme_has_the_table():
    assert README.read_text(encoding="utf-8") == with_table()


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
    rows = [f"scan_{k:03d},{line}" for k in range(12) for line in lines]
    return a_file("all.csv", "pose,x,z\n" + "".join(rows))


def test_a_long_file_takes_five_times_its_size_of_memory(tmp_path):
    """From the command to the written scan, beside what it takes for short ones."""
    folders = [tmp_path / "short", tmp_path / "long"]
    for folder, count in zip(folders, (10, 8_000), strict=True):
        written(folder, csv, long_file(count))
    said = subprocess.check_output([sys.executable, "-c", PEAKS, *folders], text=True)
    peaks = [int(line) for line in said.splitlines() if line.isdigit()]
    assert peaks[1] - peaks[0] <= 5 * (folder / "all.csv").stat().st_size


# in motion


def test_a_log_and_profiles_are_a_scan_in_motion(tmp_path):
    """By the scanner's clock, or of its first sweep by a rate."""
    motion = {"sweeps": 3, "profiles": 8, "turn_deg": 5.0}
    driven = scan_of("plane", motion=motion, scanner={"points": 60})
    turned = from_rotations(named("quaternion"), driven.log.R)
    rows = np.column_stack([1e3 * driven.log.t, driven.log.p, turned])
    write_table(tmp_path / "robot.csv", "t [ms],x,y,z,qw,qx,qy,qz", rows)
    pairs = zip(driven.times, driven.values, strict=True)
    points = [[1e3 * t, *point] for t, own in pairs for point in own]
    write_table(tmp_path / "all.csv", "time [ms],x,z", points)
    imported, taken = import_scan(tmp_path, "plane", {})
    assert "by time, in motion" in taken["matched"]
    assert imported.labels == driven.labels
    assert_allclose(imported.T_base_flange, driven.T_base_flange, atol=1e-6)
    removed("all.csv")(tmp_path)
    for k, points in enumerate(driven.values[:8]):
        write_table(tmp_path / f"p{k}.csv", "x,z", points)
    start, rate = driven.times[0], 1 / np.diff(driven.times[:8]).mean()
    imported, _ = import_scan(tmp_path, "plane", {}, Layout(times=(start, rate)))
    assert_allclose(imported.times, driven.times[:8], atol=2e-6)


# real ones


REAL_DATA = os.environ.get("PROFILECAL_REAL_DATA")


@pytest.mark.skipif(
    not REAL_DATA, reason="HandEyeSync is not here: PROFILECAL_REAL_DATA is not set"
)
@pytest.mark.parametrize(
    ("name", "sizes", "largest_mm"),
    [("edge", {}, 0.15), ("sphere", {"radius": 40.0}, 0.25)],
)
def test_the_real_measurements_calibrate(name, sizes, largest_mm):
    kind = "ball" if sizes else "edge"
    folder = Path(REAL_DATA) / "handeyesync" / name
    imported, _ = import_scan(folder, kind, sizes)
    found = calibrate([imported])
    assert found.status == "ok"
    assert found.solution.rms_mm <= largest_mm
