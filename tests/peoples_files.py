"""One scan in files as people have them: poses in many syntaxes, profiles in many
layouts.
"""

import functools
import json
from dataclasses import replace

import numpy as np
from numpy.random import default_rng
from openpyxl import Workbook
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import from_rotations, named
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
    return homogeneous(scan().R_base_flange, scan().p_base_flange)


def frame(*numbers):
    """A tool or a base (4, 4) from x, y, z, mm, and w, p, r, degrees."""
    R = Rotation.from_euler("xyz", numbers[3:], degrees=True).as_matrix()
    return homogeneous(R, np.array(numbers[:3]))


TOOL, BASE = frame(12, -35, 180, 10, -20, 30), frame(100, 50, 0, 0, 0, 15)


def poses_of_tool(convention, scale=1.0):
    """The numbers of the tool's poses in that base."""
    of_tool = np.linalg.inv(BASE) @ matrices_of_poses() @ TOOL
    return poses(convention, scale, of_tool)


def numbers_of(frame, convention, scale=1.0):
    return poses(convention, scale, frame[None])[0]


def text(numbers, separator=","):
    return separator.join(f"{value:.12f}" for value in numbers)


def named_numbers(names, numbers, between):
    """Such as X 1.0,Y 2.0."""
    pairs = zip(names, numbers, strict=True)
    return between.join(f"{name} {value:.12f}" for name, value in pairs)


def write_lines(path, lines):
    path.write_text("\n".join([*lines, ""]))


def write_table(path, titles, rows):
    np.savetxt(path, rows, "%.12g", ",", header=titles, comments="")


# The poses


def kuka(folder):
    lines = ["DEFDAT SCAN PUBLIC", ";FOLD X 1, Y 2"]
    for k, row in enumerate(poses("KUKA angles"), 1):
        pose = named_numbers("XYZABC", row, ",")
        lines.append(f"DECL E6POS XP{k}={{{pose},S 2,T 35}}")
        lines.append(f"DECL FDAT FP{k}={{TOOL_NO 0,BASE_NO 0}}")
    write_lines(folder / "scan.dat", [*lines, "ENDDAT"])


def abb(folder, used=True, backwards=False):
    """Targets of a tool in a base; or, where no move uses them, of the tool alone."""
    x, q = np.split(numbers_of(TOOL, "quaternion"), [3])
    at = f"[[{text(x)}],[{text(q)}]]"
    tool = f"[TRUE,{at},[1,[0,0,1],[1,0,0,0],0,0,0]]"
    x, q = np.split(numbers_of(BASE, "quaternion"), [3])
    base = f'[FALSE,TRUE,"",[[{text(x)}],[{text(q)}]],[[0,0,0],[1,0,0,0]]]'
    targets, moves = [], []
    of_tool = poses("quaternion", matrices=matrices_of_poses() @ TOOL)
    for k, row in enumerate(poses_of_tool("quaternion") if used else of_tool, 1):
        pose = f"[{text(row[:3])}],[{text(row[3:])}]"
        axes = "[-1,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
        targets.append(f"  CONST robtarget p{10 * k}:=[{pose},{axes}];")
        moves.append(f"  MoveL p{10 * k},v100,fine,tScan\\WObj:=wBall; ! p{10 * k}")
    lines = ["MODULE Scan", f"  PERS tooldata tScan:={tool};"]
    lines += [f"  TASK PERS wobjdata wBall:={base};", *targets[:: 1 - 2 * backwards]]
    lines += [f"  !{targets[0]}", *moves * used, "ENDMODULE", ""]
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


def yaskawa(folder):
    lines = ["/JOB", "//NAME SCAN", "//POS", "///NPOS 12,0,0,0,0,0", "///TOOL 0"]
    lines += ["///POSTYPE BASE", "///RECTAN", "///RCONF 0,1,1,0,0,0,0,0"]
    for k, row in enumerate(poses("FANUC angles")):
        lines.append(f"C{k:05d}={text(row)}")
    lines += ["//INST", "NOP", "MOVL C00000 V=50.0", "END", ""]
    write_lines(folder / "SCAN.JBI", lines)


def kawasaki(folder):
    lines = [".PROGRAM scan()", "  TOOL tip", "  LMOVE p1", ".END", ".TRANS"]
    lines.append(f"tip {text(numbers_of(TOOL, 'Kawasaki angles'), ' ')}")
    lines.append("home 400 0 600 0 180 0")
    rows = poses("Kawasaki angles", matrices=matrices_of_poses() @ TOOL)
    lines += [f"p[{k}] {text(row, ' ')}" for k, row in enumerate(rows)]
    lines += [".END", ".JOINTS", "#home 0 10 20 30 40 50", ".END", ""]
    write_lines(folder / "scan.as", lines)


def staubli(folder):
    names = ("x", "y", "z", "rx", "ry", "rz")

    def value(key, row, father):
        pairs = zip(names, row, strict=True)
        numbers = " ".join(f'{name}="{number:.12f}"' for name, number in pairs)
        return f'<Value key="{key}" {numbers} fatherId="{father}" />'

    of_base = np.linalg.inv(BASE) @ matrices_of_poses()
    rows = poses("Stäubli angles", matrices=of_base)
    lines = ['<?xml version="1.0"?>', '<Database xmlns="robotics/VAL3/Data/2"><Datas>']
    lines.append('<Data name="fPart" type="frame" size="1">')
    lines.append(value(0, numbers_of(BASE, "Stäubli angles"), "world[0]"))
    lines.append('</Data><Data name="pScan" type="pointRx" size="12">')
    lines += [value(k, row, "fPart[0]") for k, row in enumerate(rows)]
    lines += ["<!--", lines[-1], "-->", "</Data></Datas></Database>", ""]
    write_lines(folder / "scan.dtx", lines)


def xml_log(folder):
    """Words, and each pose twice: as attributes, and as a matrix."""
    lines = ["Control Version: 1.17.3", "Server listening on port 59153..."]
    rows = poses("KUKA angles")
    for matrix, row in zip(matrices_of_poses(), rows, strict=True):
        pairs = zip("XYZABC", row, strict=True)
        numbers = " ".join(f'{name}="{number:.12f}"' for name, number in pairs)
        lines += [f"<Send><Position {numbers}></Position></Send>", ">>> TCP:"]
        lines += [*map(text, matrix, 4 * " "), "Dropped 0 frames in buffer"]
    write_lines(folder / "pose_log.txt", lines)


def samples():
    """Position and orientation of each pose, as ROS has them, m."""
    for x, y, z, qw, qx, qy, qz in poses("quaternion", 0.001).tolist():
        position = {"x": x, "y": y, "z": z}
        yield position, {"x": qx, "y": qy, "z": qz, "w": qw}


def stamped(folder):
    """Documents of ROS, as it prints them."""
    lines = []
    for k, parts in enumerate(samples()):
        lines += ["header:", f"  seq: {k}", "pose:"]
        for name, numbers in zip(("position", "orientation"), parts, strict=True):
            lines.append(f"  {name}:")
            lines += [f"    {axis}: {number}" for axis, number in numbers.items()]
        lines.append("---")
    write_lines(folder / "poses.yaml", lines)


def opencv(folder):
    """R and t in nodes of their own, 10 before 2."""
    lines = ["%YAML:1.0", "---"]
    order = sorted(range(12), key=str)
    for k, matrix in zip(order, matrices_of_poses()[order], strict=True):
        for name, part in (("R", matrix[:3, :3]), ("t", matrix[:3, 3:])):
            rows, cols = part.shape
            lines += [f"{name}_{k}: !!opencv-matrix", f"   rows: {rows}"]
            lines += [
                f"   cols: {cols}",
                "   dt: d",
                f"   data: [ {text(part.ravel())} ]",
            ]
    write_lines(folder / "poses.yml", lines)


def by_columns(folder):
    rows = [text(matrix.T.ravel()) for matrix in matrices_of_poses()]
    write_lines(folder / "poses.txt", rows)


def fanuc(folder, tool=0, more=""):
    lines = ["/PROG  SCAN", "/MN", "   1:L P[1] 500mm/sec FINE ;", "/POS"]
    for k, row in enumerate(poses("FANUC angles"), 1):
        numbers = [f"{value:.12f}" for value in row]
        x, y, z = (f"{n} = {v} mm" for n, v in zip("XYZ", numbers[:3], strict=True))
        w, p, r = (f"{n} = {v} deg" for n, v in zip("WPR", numbers[3:], strict=True))
        pose = ",\t".join([x, y, z, w, p, r])
        lines.append(f"P[{k}]{{\n   GP1:")
        lines.append(f"\tUF : 0, UT : {tool},\t\tCONFIG : 'N U T, 0, 0, -1',")
        lines.append(f"\t{pose}{more}\n}};")
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


def tum(folder):
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for k, row in enumerate(poses("quaternion", 0.001)):
        x, y, z, qw, qx, qy, qz = row
        lines.append(f"{1.7e9 + k} {text([x, y, z, qx, qy, qz, qw], ' ')}")
    write_lines(folder / "poses.tum", lines)


def matrices(folder):
    for k, matrix in enumerate(matrices_of_poses()):
        np.savetxt(folder / f"pose{k}.txt", matrix)


def stacked_matrices(folder):
    """Below one another."""
    np.savetxt(folder / "poses.txt", np.concatenate(matrices_of_poses()))


def array(folder):
    np.save(folder / "poses.npy", matrices_of_poses())


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
    titles = [
        f"{name}_{k}" for name in ("actual_TCP_pose", "tcp_offset") for k in range(6)
    ]
    rows = poses("rotation vector", 0.001, matrices_of_poses() @ TOOL)
    tool = text(numbers_of(TOOL, "rotation vector", 0.001), " ")
    lines = [" ".join(["timestamp", *titles])]
    lines += [f"{k}.5 {text(row, ' ')} {tool}" for k, row in enumerate(rows)]
    write_lines(folder / "robot.csv", lines)


def workbook(folder):
    book = Workbook()
    rows = poses("KUKA angles").tolist()
    book.active.append(["Cell 4"])
    book.active.append(["Nr", "X [mm]", "Y [mm]", "Z [mm]", "A", "B", "C"])
    for k, row in enumerate(rows):
        book.active.append([k, *row])
    book.save(folder / "poses.xlsx")


def of_flange_and_tool(folder):
    """Of the flange, and of the tool before it."""
    pairs = zip(poses_of_tool("KUKA angles"), poses("KUKA angles"), strict=True)
    rows = [
        {
            name: dict(zip("xyzabc", row.tolist(), strict=True))
            for name, row in zip(("tcp", "flange"), pair, strict=True)
        }
        for pair in pairs
    ]
    (folder / "poses.json").write_text(json.dumps(rows))


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


def one_each(folder):
    for k, points in enumerate(scan().values):
        path = folder / f"scan_{k:03d}.csv"
        write_table(path, "x,z", points)


def with_y(points):
    """Points x, 0, z."""
    return np.insert(points, 1, 0.0, axis=1)


def with_gaps(folder):
    """Blank lines where nothing was seen."""
    for k, points in enumerate(scan().values):
        rows = ["" if np.isnan(point[1]) else text(point) for point in points]
        write_lines(folder / f"s{k}.csv", ["x,z", *rows])


def unseen_at_first(folder):
    """One row of nan below the titles, or more than are looked at for titles."""
    for k, points in enumerate(scan().values):
        rows = np.insert(points, np.zeros(1 + 60 * (k % 2), int), np.nan, axis=0)
        write_table(folder / f"s{k}.csv", "x,z", rows)


def codes_in_um(folder):
    for k, points in enumerate(scan().values):
        rows = np.where(np.isnan(points), -999.999, points) * 1000
        write_table(folder / f"s{k}.csv", "x [um],z [um]", rows)


def lists(folder):
    for k, points in enumerate(scan().values, 1):
        numbers = with_y(points).ravel()
        cells = [".Nan" if np.isnan(value) else f"{value:.15g}" for value in numbers]
        profile = f"profile: [ {', '.join(cells)} ]"
        lines = ["%YAML:1.0", "---", profile, "picked: [ 1., 0., 2. ]", ""]
        write_lines(folder / f"p{k}.yml", lines)


def archives(folder):
    for k, points in enumerate(scan().values):
        np.savez(folder / f"{k}.npz", profile=with_y(points), time=np.zeros((3, 2)))


def surfaces(folder):
    """As Gocators have resampled profiles: z below the places along x."""
    for k, (x, z) in enumerate(points.T for points in scan().values):
        rows, seen = np.arange(len(x)), np.isfinite(x)
        titles = text(np.interp(rows, rows[seen], x[seen]))
        z = text(z).replace("nan", "")
        lines = ["Part", "Frame,Rows", "1,1", f"Y\\X,{titles}", f"0.0,{z}", "End", ""]
        write_lines(folder / f"s{k}.csv", lines)


def numbered_columns(folder):
    count = len(scan().values[0])
    titles = [f"{axis}{k}" for axis in "xz" for k in range(count)]
    rows = [text(points.T.ravel()) for points in scan().values]
    rows = [row.replace("nan", "Invalid") for row in rows]
    write_lines(folder / "all.csv", [",".join(titles), *rows])


def long_table(folder, name="scan_{:03d}"):
    lines = ["pose,x,z"]
    for k, points in enumerate(scan().values):
        lines += [f"{name.format(k)},{x:.15g},{z:.15g}" for x, z in points]
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
    np.save(folder / "all.npy", np.stack(scan().values).swapaxes(1, 2))


def point_clouds(folder):
    head = ["ply", "format ascii 1.0", f"element vertex {len(scan().values[0])}"]
    head += [f"property float {axis}" for axis in "xyz"] + ["end_header"]
    for k, points in enumerate(scan().values):
        rows = [text(point, " ") for point in with_y(points)]
        write_lines(folder / f"cloud{k}.ply", [*head, *rows])


POSES = (
    *(kuka, abb, ur, fanuc, yaskawa, kawasaki, staubli),
    *(xml_log, stamped, opencv, of_images, csv, tum, matrices, array),
    *(
        with_speeds,
        stacked_matrices,
        of_flange_and_tool,
        by_columns,
        named_arrays,
        matlab,
        workbook,
    ),
)
IN_A_BASE = (abb, staubli)
PROFILES = (
    *(one_each, with_gaps, unseen_at_first, codes_in_um, lists, archives, surfaces),
    *(numbered_columns, long_table, below, ragged, stacked, point_clouds),
)


def written(folder, of_poses=csv, of_profiles=None):
    """The folder, filled."""
    folder.mkdir()
    of_poses(folder)
    counts_from_1 = of_poses in (fanuc,)
    (of_profiles or (lists if counts_from_1 else one_each))(folder)
    return folder
