"""One scan in files as people have them: poses in many syntaxes, profiles in many
layouts.
"""

import functools
from collections import defaultdict
from dataclasses import replace

import numpy as np
from numpy.random import default_rng
from pandas import DataFrame
from scipy.io import savemat

from profilecal.scan.conventions import from_rotations, named, pose_matrices
from profilecal.simulation.spec import WIDE, Spec, simulate_scan

TOOL = pose_matrices([[12, -35, 180]], [[90, 0, -90]], "FANUC angles")[0]


@functools.cache
def scan():
    """An edge in twelve raw profiles of as many points; nothing seen is NaN, at one
    point of 17.
    """
    scanner = replace(WIDE, points=120, quantum=0.125)
    simulated = simulate_scan(
        Spec(measured="profiles", groups=4, positions=3, seed=4, scanner=scanner)
    )
    count = min(map(len, simulated.values))
    missing = np.arange(count)[:, None] % 17 == 3
    profiles = [
        np.where(missing, np.nan, points[:count]) for points in simulated.values
    ]
    return replace(simulated, values=tuple(profiles))


def poses(convention, scale=1.0, tool=None):
    """The numbers of each pose (12, 3 + k), of the flange or of a tool on it."""
    T = scan().T_base_flange @ (np.eye(4) if tool is None else tool)
    angles = from_rotations(named(convention), T[:, :3, :3])
    return np.hstack([T[:, :3, 3] * scale, angles])


def text(numbers, separator=","):
    return separator.join(f"{value:.12f}" for value in numbers)


def write_lines(path, lines):
    path.write_text("\n".join([*lines, ""]))


def write_table(path, titles, rows, between=","):
    np.savetxt(path, rows, "%.15g", between, header=titles, comments="")


# The poses


def listed(
    head,
    line="{all}",
    convention="KUKA angles",
    scale=1.0,
    angle=1.0,
    tool=None,
    order=range(12),
    between=",",
    foot="",
    encoding="utf-8",
    name="poses.csv",
):
    """A text with a line for each pose, or a file for each if it is called by a number.

    In a line {0} is the first number of the pose, {k} says which pose it is, from 0,
    {n} from 1, and {at} which line. What is not between commas has decimal ones.
    """

    def write(folder):
        rows = poses(convention, scale, tool)
        rows[:, 3:] *= angle
        files = defaultdict(list)
        for at, k in enumerate(order):
            cells = text(rows[k]).split(",")
            own = {"k": k, "n": k + 1, "at": at, "all": between.join(cells)}
            files[folder / name.format(k)].append(line.format(*cells, **own))
        for path, lines in files.items():
            content = "\n".join([head, *lines, foot]).strip("\n")
            content = content if between == "," else content.replace(".", ",")
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content.encode(encoding))

    return write


of_tool = functools.partial(listed, tool=TOOL)
upwards = functools.partial(listed, order=range(11, -1, -1))
matrices = functools.partial(
    listed,
    "",
    "{3} {4} {5} {0}\n{6} {7} {8} {1}\n{9} {10} {11} {2}\n0 0 0 1",
    "matrix",
)
kuka = listed(
    "DEFDAT SCAN PUBLIC\n;FOLD X 1, Y 2",
    "DECL E6POS XP{k}={{X {0},Y {1},Z {2},A {3},B {4},C {5},S 2,T 35}}\n"
    "DECL FDAT FP{k}={{TOOL_NO 0,BASE_NO 0}}",
    foot="ENDDAT",
    name="scan.dat",
)
fanuc = listed(
    "/PROG  SCAN\n/MN\n   1:L P[1] 500mm/sec FINE ;\n/POS",
    "P[{k}]{{\n   GP1:\n\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, -1',\n"
    "\tX = {0} mm,\tY = {1} mm,\tZ = {2} mm,\n"
    "\tW = {3} deg,\tP = {4} deg,\tR = {5} deg\n}};",
    "FANUC angles",
    foot="/END",
    name="CALIB.LS",
)
opencv = listed(
    "%YAML:1.0\n---",
    "R_{k}: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [ {3}, {4}, {5}, {6}, {7}, {8}, {9}, {10}, {11} ]\n"
    "t_{k}: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n"
    "   data: [ {0}, {1}, {2} ]",
    "matrix",
    name="poses.yml",
)
# a pose without a profile is turned by more than half a turn
ur = of_tool(
    "def scan():\n  global Home_p=p[0.4,0,0.3,0,4,0]\n"
    "  tcp1=p[0.012,-0.035,0.18,1.209199576156,-1.209199576156,-1.209199576156]\n"
    "  set_tcp(tcp1)",
    "  global P_{k}_p=p[{all}]\n  # global P_{k}_p=p[0,0,0,0,0,0]\n"
    "  movej([0,1,2,3,4,5], a=1.4)",
    "rotation vector",
    0.001,
    foot="end",
    name="scan.script",
)
# as Universal Robots' controllers log them, with the tool that poses are of
robot_states = of_tool(
    "timestamp actual_TCP_pose_0 actual_TCP_pose_1 actual_TCP_pose_2 actual_TCP_pose_3 "
    "actual_TCP_pose_4 actual_TCP_pose_5 tcp_offset_0 tcp_offset_1 tcp_offset_2 "
    "tcp_offset_3 tcp_offset_4 tcp_offset_5",
    "{k}.5 {0} {1} {2} {3} {4} {5} "
    "0.012 -0.035 0.18 1.209199576156 -1.209199576156 -1.209199576156",
    "rotation vector",
    0.001,
    name="robot.csv",
)
# targets of a tool in a base, to which moves come from the last one on
abb = of_tool(
    "MODULE Scan\n"
    "  PERS tooldata tScan:=[TRUE,[[12,-35,180],[0.5,0.5,-0.5,-0.5]],[1,[0,0,1]]];\n"
    '  PERS wobjdata wBall:=[FALSE,TRUE,"",[[100,50,0],[1,0,0,0]],[[0,0,0]]];\n'
    "  !CONST robtarget p10:=[[9,9,9],[1,0,0,0],[-1,0,-1,0],"
    "[9E9,9E9,9E9,9E9,9E9,9E9]];",
    "  CONST robtarget p{n}0:=[[{0},{1},{2}],[{3},{4},{5},{6}],[-1,0,-1,0],"
    "[9E9,9E9,9E9,9E9,9E9,9E9]];",
    "quaternion",
    order=range(11, -1, -1),
    foot="\n".join(
        f"  MoveL p{n}0,v100,fine,tScan\\WObj:=wBall; ! p{n}0" for n in range(1, 13)
    ),
    name="scan.mod",
)
abb_array = of_tool(
    "  PERS tooldata tScan:=[TRUE,[[12,-35,180],[0.5,0.5,-0.5,-0.5]],[1,[0,0,1]]];\n"
    "  CONST robtarget p{12}:=[",
    "  [[{0},{1},{2}],[{3},{4},{5},{6}],[-1,0,-1,0],[9E9,9E9]],",
    "quaternion",
    foot="  MoveJ home,v100,fine,tool0;\n  MoveL p{i},v100,fine,tScan;",
    name="scan.mod",
)
of_tool_above = of_tool(
    "tcp_offset: [0.012, -0.035, 0.18, 1.209199576156, -1.209199576156, "
    "-1.209199576156]\nposes:",
    "- {{x: {0}, y: {1}, z: {2}, rx: {3}, ry: {4}, rz: {5}}}",
    "rotation vector",
    0.001,
    name="poses.yaml",
)
csv = listed(
    "Name;X [mm];Y [mm];Z [mm];Alpha [°];Beta [°];Gamma [°]",
    "scan_{k:03d};{all}",
    "Stäubli angles",
    order=default_rng(1).permutation(12),
    between=";",
    name="robot.csv",
)
tum = listed(
    "# timestamp tx ty tz qx qy qz qw",
    "17000000{k:02} {0} {1} {2} {4} {5} {6} {3}",
    "quaternion",
    0.001,
    name="poses.tum",
)
by_columns = listed(
    "",
    "{3},{6},{9},0,{4},{7},{10},0,{5},{8},{11},0,{0},{1},{2},1",
    "matrix",
    name="poses.txt",
)
# beside each other
of_flange_and_tool = listed(
    "tcp_x,tcp_y,tcp_z,tcp_a,tcp_b,tcp_c,"
    "flange_x,flange_y,flange_z,flange_a,flange_b,flange_c",
    "{2},{0},{1},{4},{5},{3},{all}",
)
# in front of positions, whose angles name no owner
with_speeds = listed("vel_x,vel_y,vel_z,tcp_x,tcp_y,tcp_z,a,b,c", "{3},{4},{5},{all}")
# in another order, beside the names of the profiles' files
of_images = upwards(
    "",
    "- {{tvec: [{0}, {1}, {2}], q_wxyz: [{3}, {4}, {5}, {6}], "
    "file: raw/scan_{k:03d}.csv}}",
    "quaternion",
    0.001,
    name="poses.yaml",
)
# of the flange and of a camera on it, as ROS prints them, in turn
transforms = listed(
    "",
    "---\nchild_frame_id: camera_link\ntransform: {{"
    "translation: {{x: 0.1, y: 0.2, z: {k}}}, rotation: {{w: 1, x: 0, y: 0, z: 0}}}}\n"
    "---\nchild_frame_id: tool0\ntransform: {{"
    "translation: {{x: {0}, y: {1}, z: {2}}}, "
    "rotation: {{w: {3}, x: {4}, y: {5}, z: {6}}}}}",
    "quaternion",
    0.001,
    name="tf.yaml",
)


def named_arrays(folder):
    """Rotations and translations in arrays of their own, as OpenCV takes them."""
    T = scan().T_base_flange
    parts = {"R_gripper2base": T[:, :3, :3], "t_gripper2base": T[:, :3, 3:]}
    np.savez(folder / "poses.npz", **parts)


def matlab(folder):
    """The poses along the last axis."""
    savemat(folder / "poses.mat", {"T": np.moveaxis(scan().T_base_flange, 0, -1)})


def workbook(folder):
    rows = DataFrame(
        poses("KUKA angles"), columns=["X [mm]", "Y [mm]", "Z [mm]", *"ABC"]
    )
    rows.to_excel(folder / "poses.xlsx", startrow=1, index_label="Nr")


# The profiles


def each(
    name="scan_{:03d}.csv",
    titles="x,z",
    columns=("",),
    scale=1.0,
    nothing="nan,nan",
    encoding="utf-8",
    begin=0,
):
    """A table for each profile, with each of further columns for every point."""

    def write(folder):
        for k, points in enumerate(scan().values, begin):
            rows = [f"{own},{text(scale * p)}" for own in columns for p in points]
            lines = "\r\n".join([titles, *(row.strip(",") for row in rows)])
            content = lines.lstrip().replace("nan,nan", nothing)
            (folder / name.format(k)).write_bytes(content.encode(encoding))

    return write


one_each = each()


def every(name, write):
    """A file for each profile."""

    def fill(folder):
        for k, points in enumerate(scan().values):
            write(folder / name.format(k), points)

    return fill


def with_y(points):
    """Points x, 0, z."""
    return np.insert(points, 1, 0.0, axis=1)


def unseen_at_first(path, points):
    """One row of nan below the titles, or more than are looked at for titles."""
    blanks = 1 if path.stem.endswith("1") else 61
    write_table(path, "x,z", np.insert(points, [0] * blanks, np.nan, axis=0))


def opencv_list(path, points):
    numbers = text(with_y(points).ravel(), ", ").replace("nan", ".Nan")
    lines = f"profile: [ {numbers} ]\npicked: [ 1., 0., 2. ]"
    write_lines(path, ["%YAML:1.0", "---", lines])


def archive(path, points):
    np.savez(path, profile=with_y(points), time=np.zeros((3, 2)))


def surface(path, points):
    """As Gocators have resampled profiles: z below the places along x; German."""
    x, z = points.T
    rows, seen = np.arange(len(x)), np.isfinite(x)
    titles = text(np.interp(rows, rows[seen], x[seen]), ";")
    lines = ["Part", "FOV X;FOV Z;FOV Height", "9;9;9", f"Y\\X;{titles}"]
    lines += [f"0.0;{text(z, ';')}", "End", ""]
    write_lines(path, [line.replace("nan", "").replace(".", ",") for line in lines])


HEADS = {
    ".ply": "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\n"
    "property float y\nproperty float z\nend_header",
    ".pcd": "# PCD\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS {}\nDATA ascii",
}


def point_cloud(path, points):
    write_table(path, HEADS[path.suffix].format(len(points)), with_y(points), " ")


def numbered_columns(folder):
    count = len(scan().values[0])
    titles = [f"{axis}{k}_um" for axis in "xz" for k in range(count)]
    rows = [1e3 * points.T.ravel() for points in scan().values]
    table = DataFrame(rows, columns=titles)
    table.to_csv(folder / "all.csv", na_rep="Invalid", index=False)


def long_table(folder):
    """Each label once, as spreadsheets have merged cells."""
    lines = ["pose,x,z"]
    for k, points in enumerate(scan().values):
        rows = [f",{x:.15g},{z:.15g}" for x, z in points]
        lines += [f"scan_{k:03}{rows[0]}", *rows[1:]]
    write_lines(folder / "all.csv", lines)


def below(folder):
    """Below one another, with a blank line between."""
    profiles = ["\n".join(map(text, points)) for points in scan().values]
    write_lines(folder / "all.csv", ["\n\n".join(profiles).replace("nan", "")])


def ragged(folder):
    """Below one another, every second with two rows more."""
    more = [[99.0, np.nan]] * 2
    profiles = [[*points, *more * (k % 2)] for k, points in enumerate(scan().values)]
    write_table(folder / "all.csv", "x,z", np.concatenate(profiles))


def stacked(folder):
    profiles = np.stack([*map(with_y, scan().values)])
    np.save(folder / "all.npy", profiles.swapaxes(1, 2))


def cells(folder):
    """As MATLAB has them: each as long as it is, x above z."""
    every = np.empty(12, object)
    for k, points in enumerate(scan().values):
        every[k] = points[np.isfinite(points[:, 1])].T
    savemat(folder / "all.mat", {"profiles": every})


POSES = {
    "KUKA": kuka,
    "OpenCV": opencv,
    "beside images": of_images,
    "with speeds": with_speeds,
    "TUM": tum,
    "4 x 4 below one another": matrices(name="poses.txt"),
    "of flange and tool": of_flange_and_tool,
    "matrices by columns": by_columns,
    "named arrays": named_arrays,
    "MATLAB": matlab,
    "sheet": workbook,
}
PROFILES = {
    "with gaps": each(nothing=""),
    "unseen at first": every("s{}.csv", unseen_at_first),
    "codes in um": each("{}.csv", "x [um],z [um]", scale=1000, nothing="0,-32.768"),
    "lists": every("p{}.yml", opencv_list),
    "archives": every("{}.npz", archive),
    "surfaces": every("s{}.csv", surface),
    "numbered columns": numbered_columns,
    "a long table": long_table,
    "below one another": below,
    "ragged": ragged,
    "stacked": stacked,
    "point clouds": every("cloud{}.ply", point_cloud),
    "clouds of ROS": every("{}.pcd", point_cloud),
}


def written(folder, *writers):
    """The folder, filled; with a profile for each pose if only poses are written."""
    folder.mkdir()
    for write in writers if len(writers) > 1 else (*writers, one_each):
        write(folder)
    return folder
