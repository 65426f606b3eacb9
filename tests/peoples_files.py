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


def kuka(folder):
    lines = ["DEFDAT SCAN PUBLIC", ";FOLD X 1, Y 2"]
    pose = "X {:.12f},Y {:.12f},Z {:.12f},A {:.12f},B {:.12f},C {:.12f}"
    for k, row in enumerate(poses("KUKA angles"), 1):
        lines.append(f"DECL E6POS XP{k}={{{pose.format(*row)},S 2,T 35}}")
        lines.append(f"DECL FDAT FP{k}={{TOOL_NO 0,BASE_NO 0}}")
    write_lines(folder / "scan.dat", [*lines, "ENDDAT"])


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


def samples():
    """Position and orientation of each pose, as ROS has them."""
    for row in xyzw():
        turn = dict(zip("xyzw", row[3:], strict=True))
        yield dict(zip("xyz", row[:3], strict=True)), turn


def opencv(folder):
    """R and t in nodes of their own, 10 before 2."""
    node = "{}_{}: !!opencv-matrix\n   rows: 3\n   cols: {}\n   dt: d\n   data: [ {} ]"
    lines = ["%YAML:1.0", "---"]
    for k in sorted(range(12), key=str):
        R, t = np.split(matrices_of_poses()[k, :3], [3], axis=1)
        lines.append(node.format("R", k, 3, text(R.ravel())))
        lines.append(node.format("t", k, 1, text(t.ravel())))
    write_lines(folder / "poses.yml", lines)


def by_columns(folder):
    rows = matrices_of_poses().swapaxes(1, 2).reshape(-1, 16)
    np.savetxt(folder / "poses.txt", rows, delimiter=",")


def fanuc(folder):
    lines = ["/PROG  SCAN", "/MN", "   1:L P[1] 500mm/sec FINE ;", "/POS"]
    pose = "\tX = {:.12f} mm,\tY = {:.12f} mm,\tZ = {:.12f} mm,\n"
    pose += "\tW = {:.12f} deg,\tP = {:.12f} deg,\tR = {:.12f} deg\n}};"
    for k, row in enumerate(poses("FANUC angles"), 1):
        lines.append(f"P[{k}]{{\n   GP1:")
        lines.append("\tUF : 0, UT : 0,\t\tCONFIG : 'N U T, 0, 0, -1',")
        lines.append(pose.format(*row))
    write_lines(folder / "CALIB.LS", [*lines, "/END"])


def listed(
    titles,
    labels=(),
    convention="KUKA angles",
    scale=1.0,
    angle=1.0,
    order=range(12),
    encoding="utf-8",
    name="poses.csv",
):
    """A table of poses under titles, or under none; each row behind its label."""

    def write(folder):
        between = next((mark for mark in ",; " if mark in titles), ",")
        rows = poses(convention, scale)
        rows[:, 3:] *= angle
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


def xyzw():
    """The numbers of each pose in m, as most libraries have quaternions."""
    return poses("quaternion", 0.001)[:, [0, 1, 2, 4, 5, 6, 3]].tolist()


def tum(folder):
    table = [[1.7e9 + k, *row] for k, row in enumerate(xyzw())]
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


def beside(**poses_of):
    """The poses that functions give, beside each other under names."""

    def write(folder):
        columns = [own("KUKA angles").tolist() for own in poses_of.values()]
        rows = [
            {
                n: dict(zip("xyzabc", row, strict=True))
                for n, row in zip(poses_of, rows, strict=True)
            }
            for rows in zip(*columns, strict=True)
        ]
        (folder / "poses.json").write_text(json.dumps(rows))

    return write


def with_speeds(folder):
    """In front of positions, whose angles name no owner."""
    titles = [f"{owner}_{axis}" for owner in ("vel", "tcp") for axis in "xyz"]
    rows = np.insert(poses("KUKA angles"), [0, 0, 0], 7.0, axis=1)
    write_table(folder / "robot.csv", ",".join([*titles, "a", "b", "c"]), rows)


def of_images(folder):
    """In another order, beside the names of the profiles' files."""
    vectors = poses("quaternion", 0.001).tolist()
    entries = [
        {"tvec": row[:3], "q_wxyz": row[3:], "file": f"raw/scan_{k:03d}.csv"}
        for k, row in enumerate(vectors)
    ]
    (folder / "poses.json").write_text(json.dumps({"poses": entries[::-1]}))


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
    """A table for each profile, with further columns for every point, or none."""

    def write(folder):
        for k, points in enumerate(scan().values, begin):
            rows = [f"{own},{text(scale * p)}" for own in columns for p in points]
            lines = "\r\n".join([titles, *(row.strip(",") for row in rows)])
            content = lines.lstrip().replace("nan,nan", nothing)
            (folder / name.format(k)).write_bytes(content.encode(encoding))

    return write


one_each = each()


def with_y(points):
    """Points x, 0, z."""
    return np.insert(points, 1, 0.0, axis=1)


def unseen_at_first(folder):
    """One row of nan below the titles, or more than are looked at for titles."""
    for k, points in enumerate(scan().values):
        rows = np.insert(points, np.zeros(1 + 60 * (k % 2), int), np.nan, axis=0)
        write_table(folder / f"s{k}.csv", "x,z", rows)


def lists(folder):
    for k, points in enumerate(scan().values, 1):
        numbers = text(with_y(points).ravel(), ", ").replace("nan", ".Nan")
        lines = ["%YAML:1.0", "---", f"profile: [ {numbers} ]"]
        write_lines(folder / f"p{k}.yml", [*lines, "picked: [ 1., 0., 2. ]"])


def archives(folder):
    for k, points in enumerate(scan().values):
        np.savez(folder / f"{k}.npz", profile=with_y(points), time=np.zeros((3, 2)))


def surfaces(folder):
    """As Gocators have resampled profiles: z below the places along x; German."""
    for k, (x, z) in enumerate(points.T for points in scan().values):
        rows, seen = np.arange(len(x)), np.isfinite(x)
        titles = text(np.interp(rows, rows[seen], x[seen]), ";")
        lines = ["Part", "FOV X;FOV Z;FOV Height", "9;9;9", f"Y\\X;{titles}"]
        lines += [f"0.0;{text(z, ';')}", "End", ""]
        lines = [line.replace("nan", "").replace(".", ",") for line in lines]
        write_lines(folder / f"s{k}.csv", lines)


def numbered_columns(folder):
    count = len(scan().values[0])
    titles = [f"{axis}{k}" for axis in "xz" for k in range(count)]
    rows = [points.T.ravel() for points in scan().values]
    table = DataFrame(rows, columns=titles)
    table.to_csv(folder / "all.csv", na_rep="Invalid", index=False)


def long_table(folder, name="scan_{:03d}"):
    """Each label once, as spreadsheets have merged cells."""
    lines = ["pose,x,z"]
    for k, points in enumerate(scan().values):
        rows = [f",{x:.15g},{z:.15g}" for x, z in points]
        lines += [name.format(k) + rows[0], *rows[1:]]
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


def point_clouds(folder):
    head = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\n"
    head += "property float y\nproperty float z\nend_header"
    for k, points in enumerate(scan().values):
        titles = head.format(len(points))
        write_table(folder / f"cloud{k}.ply", titles, with_y(points), " ")


POSES = {
    "KUKA": kuka,
    "ABB": abb,
    "UR": ur,
    "FANUC": fanuc,
    "OpenCV": opencv,
    "beside images": of_images,
    "with speeds": with_speeds,
    "4 x 4": matrices("pose{}.txt"),
    "text": csv,
    "TUM": tum,
    "4 x 4 below one another": stacked_matrices,
    "of flange and tool": beside(tcp=poses_of_tool, flange=poses),
    "matrices by columns": by_columns,
    "named arrays": named_arrays,
    "MATLAB": matlab,
    "sheet": workbook,
}
PROFILES = {
    "one each": one_each,
    "with gaps": each(nothing=""),
    "unseen at first": unseen_at_first,
    "codes in um": each("{}.csv", "x [um],z [um]", scale=1000, nothing="0,-999999"),
    "lists": lists,
    "archives": archives,
    "surfaces": surfaces,
    "numbered columns": numbered_columns,
    "a long table": long_table,
    "below one another": below,
    "ragged": ragged,
    "stacked": stacked,
    "point clouds": point_clouds,
}


def written(folder, *writers):
    """The folder, filled; with a profile for each pose if only poses are written."""
    folder.mkdir()
    for write in writers if len(writers) > 1 else (*writers, one_each):
        write(folder)
    return folder
