"""One scan in files as people have them: poses in many syntaxes, profiles in many
layouts.
"""

import functools
import json
from dataclasses import replace

import numpy as np
from numpy.random import default_rng
from pandas import DataFrame
from scipy.io import savemat

from profilecal.scan.conventions import from_rotations, named, pose_matrices
from profilecal.simulation.spec import WIDE, Spec, simulate_scan

UNSEEN = 17  # of so many points one was not seen


@functools.cache
def scan():
    """An edge in twelve raw profiles of as many points; nothing seen is NaN."""
    scanner = replace(WIDE, points=120, quantum=0.125)
    simulated = simulate_scan(
        Spec(measured="profiles", groups=4, positions=3, seed=4, scanner=scanner)
    )
    count = min(map(len, simulated.values))
    missing = np.arange(count)[:, None] % UNSEEN == 3
    profiles = [
        np.where(missing, np.nan, points[:count]) for points in simulated.values
    ]
    return replace(simulated, values=tuple(profiles))


def poses(convention, scale=1.0, matrices=None):
    """The numbers of each pose (12, 3 + k)."""
    matrices = matrices_of_poses() if matrices is None else matrices
    angles = from_rotations(named(convention), matrices[:, :3, :3])
    return np.hstack([matrices[:, :3, 3] * scale, angles])


def matrices_of_poses():
    return scan().T_base_flange


TOOL, BASE = pose_matrices(
    [[12, -35, 180], [100, 50, 0]], [[10, -20, 30], [0, 0, 15]], "FANUC angles"
)


def poses_of_tool(convention, scale=1.0):
    """The numbers of the tool's poses in that base."""
    of_tool = np.linalg.inv(BASE) @ matrices_of_poses() @ TOOL
    return poses(convention, scale, of_tool)


def numbers_of(frame, convention, scale=1.0):
    return poses(convention, scale, frame[None])[0]


def text(numbers, separator=","):
    return separator.join(f"{value:.12f}" for value in numbers)


def write_lines(path, lines):
    path.write_text("\n".join([*lines, ""]))


def write_table(path, titles, rows, between=","):
    np.savetxt(path, rows, "%.15g", between, header=titles, comments="")


# The poses


def program(name, lines, convention, head="", foot=""):
    """Lines for each pose, with its number and numbers."""

    def write(folder):
        rows = poses(convention)
        texts = [lines.format(*row, k=k) for k, row in enumerate(rows)]
        write_lines(folder / name, [head, *texts, foot])

    return write


kuka = program(
    "scan.dat",
    "DECL E6POS XP{k}={{X {0:.12f},Y {1:.12f},Z {2:.12f},A {3:.12f},B {4:.12f},"
    "C {5:.12f},S 2,T 35}}\nDECL FDAT FP{k}={{TOOL_NO 0,BASE_NO 0}}",
    "KUKA angles",
    head="DEFDAT SCAN PUBLIC\n;FOLD X 1, Y 2",
    foot="ENDDAT",
)
fanuc = program(
    "CALIB.LS",
    "P[{k}]{{\n   GP1:\n\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, -1',\n"
    "\tX = {0:.12f} mm,\tY = {1:.12f} mm,\tZ = {2:.12f} mm,\n"
    "\tW = {3:.12f} deg,\tP = {4:.12f} deg,\tR = {5:.12f} deg\n}};",
    "FANUC angles",
    head="/PROG  SCAN\n/MN\n   1:L P[1] 500mm/sec FINE ;\n/POS",
    foot="/END",
)
opencv = program(
    "poses.yml",
    "R_{k}: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {3:.12f}, "
    "{4:.12f}, {5:.12f}, {6:.12f}, {7:.12f}, {8:.12f}, {9:.12f}, {10:.12f}, "
    "{11:.12f} ]\nt_{k}: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n"
    "   data: [ {0:.12f}, {1:.12f}, {2:.12f} ]",
    "matrix",
    head="%YAML:1.0\n---",
)


def ur(folder):
    """In a base of its own, which no UR program says: poses of the tool alone, turned
    by more than half a turn.
    """
    rows = poses("rotation vector", 0.001, matrices_of_poses() @ TOOL)
    rows[:, 3:] *= 1 - 2 * np.pi / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    tcp = numbers_of(TOOL, "rotation vector", 0.001)
    lines = ["def scan():", f"  set_tcp(p[{text(tcp)}])"]
    for k, row in enumerate(rows):
        lines.append(f"  global P_{k}_p=p[{text(row)}]")
        lines.append(f"  # global P_{k}_p=p[{text(rows[0])}]")
        lines.append("  movej([0,1,2,3,4,5], a=1.4)")
    write_lines(folder / "scan.script", [*lines, "end"])


def abb(folder, used=True, backwards=False):
    """Targets of a tool in a base; or, where no move uses them, of the tool alone."""

    def pose(row):
        return f"[{text(row[:3])}],[{text(row[3:])}]"

    tool = pose(numbers_of(TOOL, "quaternion"))
    base = pose(numbers_of(BASE, "quaternion"))
    targets, moves = [], []
    of_tool = poses("quaternion", matrices=matrices_of_poses() @ TOOL)
    for k, row in enumerate(poses_of_tool("quaternion") if used else of_tool, 1):
        axes = "[-1,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
        targets.append(f"  CONST robtarget p{10 * k}:=[{pose(row)},{axes}];")
        moves.append(f"  MoveL p{10 * k},v100,fine,tScan\\WObj:=wBall; ! p{10 * k}")
    lines = ["MODULE Scan", f"  PERS tooldata tScan:=[TRUE,[{tool}],[1,[0,0,1]]];"]
    lines.append(f'  PERS wobjdata wBall:=[FALSE,TRUE,"",[{base}],[[0,0,0]]];')
    lines += [*targets[:: 1 - 2 * backwards], f"  !{targets[0]}", *moves * used]
    write_lines(folder / "scan.mod", lines)


def by_columns(folder):
    rows = matrices_of_poses().swapaxes(1, 2).reshape(-1, 16)
    np.savetxt(folder / "poses.txt", rows, delimiter=",")


def listed(
    titles,
    labels=(),
    convention="KUKA angles",
    scale=1.0,
    angle=1.0,
    columns=None,
    order=range(12),
    encoding="utf-8",
    name="poses.csv",
):
    """A table of poses under titles, or under none; each row behind its label."""

    def write(folder):
        between = next((mark for mark in ",; " if mark in titles), ",")
        rows = poses(convention, scale)
        rows[:, 3:] *= angle
        rows = rows if columns is None else rows[:, columns]
        lines = [text(row, between) for row in rows]
        if labels:
            pairs = zip(labels, lines, strict=True)
            lines = [f"{label}{between}{line}" for label, line in pairs]
        lines = [*titles.split("\n"), *(lines[k] for k in order)]
        content = "\n".join(lines).strip("\n")
        content = content.replace(".", ",") if between != "," else content
        (folder / name).write_bytes(content.encode(encoding))

    return write


csv = listed(
    "Name;X [mm];Y [mm];Z [mm];Alpha [°];Beta [°];Gamma [°]",
    [f"scan_{k:03d}" for k in range(12)],
    "Stäubli angles",
    order=default_rng(1).permutation(12),
    name="robot.csv",
)


def tum(folder):
    rows = poses("quaternion", 0.001)[:, [0, 1, 2, 4, 5, 6, 3]]
    table = np.column_stack([1.7e9 + np.arange(12), rows])
    write_table(folder / "poses.tum", "# timestamp tx ty tz qx qy qz qw", table, " ")


def matrices(name):
    """In a file each."""

    def write(folder):
        for k, matrix in enumerate(matrices_of_poses()):
            path = folder / name.format(k)
            path.parent.mkdir(exist_ok=True)
            np.savetxt(path, matrix)

    return write


def stacked_matrices(folder):
    """Below one another."""
    np.savetxt(folder / "poses.txt", np.concatenate(matrices_of_poses()))


def named_arrays(folder):
    """Rotations and translations in arrays of their own, as OpenCV takes them."""
    T = matrices_of_poses()
    parts = {"R_gripper2base": T[:, :3, :3], "t_gripper2base": T[:, :3, 3:]}
    np.savez(folder / "poses.npz", **parts)


def matlab(folder):
    """The poses along the last axis."""
    savemat(folder / "poses.mat", {"T": np.moveaxis(matrices_of_poses(), 0, -1)})


def robot_states(folder):
    """As Universal Robots' controllers log them, with the tool that poses are of."""
    names = ("actual_TCP_pose", "tcp_offset")
    titles = ["timestamp", *(f"{name}_{k}" for name in names for k in range(6))]
    rows = poses("rotation vector", 0.001, matrices_of_poses() @ TOOL)
    tool = numbers_of(TOOL, "rotation vector", 0.001)
    table = [[k + 0.5, *row, *tool] for k, row in enumerate(rows)]
    write_table(folder / "robot.csv", " ".join(titles), table, " ")


def workbook(folder):
    rows = DataFrame(
        poses("KUKA angles"), columns=["X [mm]", "Y [mm]", "Z [mm]", *"ABC"]
    )
    rows.to_excel(folder / "poses.xlsx", startrow=1, index_label="Nr")


def of_flange_and_tool(folder):
    """Beside each other."""
    rows = [own("KUKA angles") for own in (poses_of_tool, poses)]
    titles = [f"{name}_{axis}" for name in ("tcp", "flange") for axis in "xyzabc"]
    write_table(folder / "poses.csv", ",".join(titles), np.hstack(rows))


# in front of positions, whose angles name no owner
with_speeds = listed(
    "vel_x,vel_y,vel_z,tcp_x,tcp_y,tcp_z,a,b,c", columns=[3, 4, 5, *range(6)]
)


def in_json(name, sample, turned=1):
    """A sample for each pose and its profile, in a file each or a list."""

    def write(folder):
        rows = poses("quaternion", 0.001).tolist()
        triples = zip(range(12), rows, scan().values, strict=True)
        samples = [sample(*triple) for triple in triples][::turned]
        for k, own in enumerate(samples):
            one = own if "{" in name else {"poses": samples}
            (folder / name.format(k)).write_text(json.dumps(one))

    return write


def as_ros(row):
    """Position and orientation."""
    position = dict(zip("xyz", row[:3], strict=True))
    return position, dict(zip("wxyz", row[3:], strict=True))


# in another order, beside the names of the profiles' files
of_images = in_json(
    "poses.json",
    lambda k, row, points: {
        "tvec": row[:3],
        "q_wxyz": row[3:],
        "file": f"raw/scan_{k:03d}.csv",
    },
    turned=-1,
)


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
    lines = ["%YAML:1.0", "---", f"profile: [ {numbers} ]"]
    write_lines(path, [*lines, "picked: [ 1., 0., 2. ]"])


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


def point_cloud(path, points):
    head = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\n"
    head += "property float y\nproperty float z\nend_header"
    write_table(path, head.format(len(points)), with_y(points), " ")


def numbered_columns(folder):
    count = len(scan().values[0])
    titles = [f"{axis}{k}" for axis in "xz" for k in range(count)]
    rows = [points.T.ravel() for points in scan().values]
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


POSES = {
    "KUKA": kuka,
    "OpenCV": opencv,
    "beside images": of_images,
    "with speeds": with_speeds,
    "TUM": tum,
    "4 x 4 below one another": stacked_matrices,
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
}


def written(folder, *writers):
    """The folder, filled; with a profile for each pose if only poses are written."""
    folder.mkdir()
    for write in writers if len(writers) > 1 else (*writers, one_each):
        write(folder)
    return folder
