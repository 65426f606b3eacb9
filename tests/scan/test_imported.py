"""Scans from the files that people have: ten layouts of one scan, wrong guesses, corrupted files, real ones."""

import functools
import os
import re
import shutil
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from command import run
from real_scans import real_scan
from scipy.spatial.transform import Rotation

from profilecal.calibrate.calibration import calibrate
from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import from_rotations, named
from profilecal.scan.folder import read_scan
from profilecal.scan.imported import Layout, import_scan, x_and_z
from profilecal.scan.scan import ScanError
from profilecal.simulate.spec import WIDE, Spec, simulate_scan
from profilecal.targets.target import find_features

FUZZ = int(os.environ.get("PROFILECAL_FUZZ", "60"))
TOOL = (10.0, -20.0, 150.0, 12.0, -5.0, 30.0)


@functools.cache
def scan():
    """An edge in twelve raw profiles; nothing seen is NaN."""
    spec = Spec(measured="profiles", groups=4, positions=3, seed=4, scanner=replace(WIDE, points=120))
    found = simulate_scan(spec)
    values = tuple(np.where(np.arange(len(v))[:, None] % 17 == 3, np.nan, v) for v in found.values)
    return replace(found, values=values)


def angles(name, R=None):
    return from_rotations(named(name), scan().R_base_flange if R is None else R)


def fanuc(folder):
    poses = []
    for k, (t, a) in enumerate(zip(scan().T_base_flange, angles("FANUC angles"), strict=True), 1):
        entries = zip("XYZWPR", (*t, *a), ("mm",) * 3 + ("deg",) * 3, strict=True)
        inner = ",\t".join(f"{name} = {value:.12f} {unit}" for name, value, unit in entries)
        poses.append(f"P[{k}]{{\n   GP1:\n\tUF : 0, UT : 0,\n\t{inner}\n}};\n")
    (folder / "CALIB.LS").write_text("/PROG\n/POS\n" + "".join(poses) + "/END\n")
    for k, v in enumerate(scan().values, 1):
        triplets = np.insert(v, 1, 0.0, axis=1).ravel()
        listed = ", ".join(".Nan" if np.isnan(x) else f"{x:.15g}" for x in triplets)
        (folder / f"p{k}.yml").write_text(f"%YAML:1.0\n---\nprofile: [ {listed} ]\npicked: [ 1., 0., 2. ]\n")


def kuka(folder):
    frame = pd.DataFrame(np.hstack([scan().T_base_flange, angles("KUKA angles")]), columns=list("XYZABC"))
    frame.insert(0, "name", [f"scan_{k:03d}" for k in range(12)])
    frame.to_csv(folder / "robot_poses.csv", index=False)
    for k, v in enumerate(scan().values):
        pd.DataFrame(v, columns=["x", "z"]).to_csv(folder / f"scan_{k:03d}.csv", index=False)


def rows_and_matrices(folder):
    for k, (v, T) in enumerate(
        zip(scan().values, homogeneous(scan().R_base_flange, scan().T_base_flange), strict=True)
    ):
        np.savetxt(folder / f"profile{k}.txt", v.T, header="x above z")
        np.savetxt(folder / f"pose{k}.txt", T)


def numpys(folder):
    np.save(folder / "poses.npy", homogeneous(scan().R_base_flange, scan().T_base_flange))
    for k, v in enumerate(scan().values):
        np.savez(folder / f"{k}.npz", profile=np.insert(v, 1, 0.0, axis=1), time=np.zeros((3, 2)))


def ros(folder):
    turned = Rotation.from_matrix(scan().R_base_flange).as_quat()
    frame = pd.DataFrame(
        np.hstack([scan().T_base_flange / 1000, turned]), columns=["tx", "ty", "tz", "qx", "qy", "qz", "qw"]
    )
    frame.to_csv(folder / "tcp.csv", index=False)
    for k, v in enumerate(scan().values):
        head = f"ply\nformat ascii 1.0\nelement vertex {len(v)}\n" + "".join(f"property float {c}\n" for c in "xyz")
        body = "\n".join(f"{x / 1000:.15g} 0 {z / 1000:.15g}" for x, z in v)
        (folder / f"cloud{k}.ply").write_text(f"{head}end_header\n{body}\n")


def universal(folder):
    frame = pd.DataFrame(np.hstack([scan().T_base_flange / 1000, angles("rotation vector")]))
    frame.columns = ["x [m]", "y [m]", "z [m]", "rx [rad]", "ry [rad]", "rz [rad]"]
    frame.to_csv(folder / "poses.txt", index=False, sep="\t")
    for k, v in enumerate(np.nan_to_num(v) for v in scan().values):
        head = f"VERSION .7\nFIELDS x y z\nPOINTS {len(v)}\nDATA ascii\n"
        (folder / f"c{k}.pcd").write_text(head + "\n".join(f"{x:.15g} 0 {z:.15g}" for x, z in v))


def commas(folder):
    block = np.hstack([scan().T_base_flange, angles("Stäubli angles")])
    lines = [";".join(f"{value:.12f}".replace(".", ",") for value in row) for row in block]
    (folder / "poses.csv").write_text("X;Y;Z;Alpha;Beta;Gamma\n" + "\n".join(lines) + "\n")
    for k, v in enumerate(scan().values):
        lines = [";".join("" if np.isnan(x) else f"{x:.15g}".replace(".", ",") for x in row) for row in v]
        (folder / f"line{k}.asc").write_text("X [mm];Z [mm]\n" + "\n".join(lines) + "\n")


def of_a_tool(folder):
    R, t = Rotation.from_euler("xyz", TOOL[3:], degrees=True).as_matrix(), np.array(TOOL[:3])
    R_tool, T_tool = scan().R_base_flange @ R, scan().T_base_flange + scan().R_base_flange @ t
    np.savetxt(folder / "robot.dat", np.hstack([T_tool, angles("quaternion", R_tool)]))
    for k, v in enumerate(scan().values):
        filled = np.column_stack([np.arange(len(v)), np.where(np.isnan(v), -999.0, v), np.full(len(v), 80)])
        np.savetxt(folder / f"s{k}.dat", filled)


def shuffled(folder):
    """The poses in another order than their profiles; a column of a name of its own says which is which."""
    frame = pd.DataFrame(np.hstack([scan().T_base_flange, angles("KUKA angles")]), columns=list("XYZABC"))
    frame.insert(0, "Take", np.arange(12) + 5)
    frame.iloc[np.random.default_rng(1).permutation(12)].to_csv(folder / "robot.csv", index=False, sep=";")
    for k, v in enumerate(scan().values):
        np.savetxt(folder / f"scan_{k + 5:03d}.txt", v)


def a_row_each(folder):
    block = np.hstack([scan().T_base_flange, angles("quaternion")])
    for k, (v, row) in enumerate(zip(scan().values, block, strict=True)):
        np.savetxt(folder / f"p{k:02d}.csv", v.T, delimiter=",")
        np.savetxt(folder / f"p{k:02d}.pose", row[None], delimiter=" ")


LAYOUTS = {
    "fanuc": (fanuc, Layout()),
    "kuka": (kuka, Layout()),
    "rows and matrices": (rows_and_matrices, Layout()),
    "numpy": (numpys, Layout()),
    "ros": (ros, Layout()),
    "universal": (universal, Layout()),
    "commas": (commas, Layout()),
    "shuffled": (shuffled, Layout()),
    "a row each": (a_row_each, Layout(pose_columns="x,y,z,qw,qx,qy,qz")),
    "of a tool": (
        of_a_tool,
        Layout(pose_columns="x,y,z,qw,qx,qy,qz", columns="2,3", missing=-999.0, tool=TOOL, poses="robot.dat"),
    ),
}


def written(name, folder):
    folder.mkdir(parents=True)
    LAYOUTS[name][0](folder)
    return folder


@pytest.mark.parametrize("name", LAYOUTS)
def test_ten_layouts_are_one_scan(name, tmp_path):
    found, guessed = import_scan(written(name, tmp_path / "files"), "edge", {}, LAYOUTS[name][1])
    order = np.argsort([int(re.findall(r"\d+", label)[-1]) for label in found.labels])
    np.testing.assert_allclose(found.R_base_flange[order], scan().R_base_flange, atol=1e-9)
    np.testing.assert_allclose(found.T_base_flange[order], scan().T_base_flange, atol=1e-9)
    for ours, theirs in zip([found.values[k] for k in order], scan().values, strict=True):
        seen = np.isfinite(theirs[:, 1])
        np.testing.assert_array_equal(np.isfinite(ours[:, 1]), seen)
        np.testing.assert_allclose(ours[seen], theirs[seen], atol=1e-9)
    assert len(guessed) == 5


def test_poses_are_called_as_their_files(tmp_path):
    found, guessed = import_scan(written("a row each", tmp_path / "files"), "edge", {}, LAYOUTS["a row each"][1])
    assert found.labels == tuple(f"p{k:02d}" for k in range(12))
    points, nothing = (sum(map(count, scan().values)) for count in (len, lambda v: np.isnan(v[:, 1]).sum()))
    (x, z), (x_most, z_most) = (f(np.concatenate(scan().values), axis=0) for f in (np.nanmin, np.nanmax))
    ranges = f"x (column 1) from {x:.4g} to {x_most:.4g} mm, z (column 2) from {z:.4g} to {z_most:.4g} mm"
    assert f"{points} points, in mm (the largest is {max(x_most, z_most):.3g}), {ranges}" in guessed[2]
    assert guessed[2].endswith(f"nothing seen in {nothing} of them")
    assert guessed[3] == "matched    by their names"


def test_from_the_command_line_to_a_scan_that_calibrates(tmp_path):
    result = run("import", written("ros", tmp_path / "files"), tmp_path / "scan", "--target", "edge")
    assert result.exit_code == 0, result.output
    assert "tcp.csv: 12, a quaternion (qx, qy, qz, qw), in m (the largest is" in result.output
    assert len(read_scan(tmp_path / "scan").labels) == 12


def test_what_a_profile_does_not_show_first_is_no_title(tmp_path):
    folder = written("kuka", tmp_path / "files")
    for path in folder.glob("scan_*.csv"):
        table = pd.read_csv(path)[["z", "x"]]
        blank = pd.DataFrame({"z": [np.nan] * 2, "x": [-99, -98]})
        pd.concat([blank, table]).to_csv(path, index=False)
    found, guessed = import_scan(folder, "edge", {})
    assert "x (column x) from" in guessed[2]
    np.testing.assert_allclose(found.values[0][2:], scan().values[0])


def test_files_in_folders_of_their_own_are_found(tmp_path):
    folder = written("kuka", tmp_path / "files" / "monday")
    layout = Layout(profiles="monday/scan*.csv", poses="monday/robot*.csv")
    (by_pattern, _), (alone, _) = import_scan(tmp_path / "files", "edge", {}, layout), import_scan(folder, "edge", {})
    np.testing.assert_allclose(np.concatenate(by_pattern.values), np.concatenate(alone.values))


def test_doubts_about_a_guess_are_told_with_it(tmp_path):
    _, guessed = import_scan(written("kuka", tmp_path / "files"), "edge", {}, Layout(columns="z,x"))
    assert guessed[-1].startswith("note       x of the profiles runs from")
    assert guessed[-1].endswith("are x and z exchanged?")


def retitled(path, old, new, factor=1.0, decimals=12):
    """A CSV file with columns of other titles, in other units."""
    table = pd.read_csv(path)
    table[old] = (table[old] * factor).round(decimals)
    table.rename(columns=dict(zip(old, new, strict=True))).to_csv(path, index=False)


TITLES = {  # columns of a file, their titles, how much larger the numbers are, and what is told
    "angles in rad": (
        "robot*",
        "ABC",
        ["A [rad]", "B (rad)", "C_rad"],
        np.pi / 180,
        "angles in rad, as the file says)",
    ),
    "angles in °": ("robot*", "ABC", ["A [°]", "B [°]", "C [°]"], 1.0, "(KUKA angles in deg, as the file says)"),
    "positions": ("robot*", "XYZ", ["X (m)", "Y (m)", "Z (m)"], 0.001, "in m, as the file says"),
    "centimetres": ("robot*", "XYZ", ["tX [cm]", "tY [cm]", "tZ [cm]"], 0.1, "in cm, as the file says"),
    "suffixes": ("scan*", "xz", ["x_mm", "z_mm"], 1.0, "points, in mm, as the file says"),
    "micrometres": ("scan*", "xz", ["x/um", "z [µm]"], 1000.0, "points, in um, as the file says"),
    "metres": ("scan*", "xz", ["X m", "Z m"], 0.001, "points, in m, as the file says"),
}


@pytest.mark.parametrize("case", TITLES)
def test_a_unit_in_a_title_is_used(case, tmp_path):
    files, old, new, factor, told = TITLES[case]
    folder = written("kuka", tmp_path / "files")
    for path in folder.glob(files):
        retitled(path, list(old), new, factor)
    found, guessed = import_scan(folder, "edge", {})
    assert told in "\n".join(guessed)
    np.testing.assert_allclose(found.R_base_flange, scan().R_base_flange, atol=1e-9)
    np.testing.assert_allclose(found.T_base_flange, scan().T_base_flange, atol=1e-6)
    np.testing.assert_allclose(np.concatenate(found.values), np.concatenate(scan().values), atol=1e-6)


def test_a_title_is_believed_where_numbers_look_otherwise(tmp_path):
    folder = written("kuka", tmp_path / "files")
    retitled(folder / "robot_poses.csv", list("ABC"), ["A [deg]", "B [deg]", "C [deg]"], 0.01)
    assert not import_scan(folder, "edge", {})[0].warnings
    for path in folder.glob("scan*"):
        retitled(path, ["x", "z"], ["x_mm", "z_mm"], 0.001)
    with pytest.raises(
        ScanError, match=r"the profiles, in mm, as the file says, reach 0\.1\d*; expected 1 to 10000 mm: is it the unit"
    ):
        import_scan(folder, "edge", {})


def test_an_option_wins_over_a_title_and_says_so(tmp_path):
    folder = written("kuka", tmp_path / "files")
    for path in folder.glob("scan*"):
        retitled(path, ["x", "z"], ["x [inch]", "z [inch]"])
    retitled(folder / "robot_poses.csv", list("XYZ"), ["x [m]", "y [m]", "z [m]"])
    retitled(folder / "robot_poses.csv", list("ABC"), ["A [grad]", "B [grad]", "C [grad]"])
    with pytest.raises(ScanError, match=r"title of column a says the unit 'grad'; expected deg or rad, the same for"):
        import_scan(folder, "edge", {})
    layout = Layout(units="mm", pose_units="mm", pose_columns="_,x,y,z,a [deg],b [deg],c [deg]")
    found, guessed = import_scan(folder, "edge", {}, layout)
    assert guessed[0].endswith("in mm, as you say, where the file says m")
    assert "in mm, as you say, where the file says inch" in guessed[2]
    np.testing.assert_allclose(found.T_base_flange, scan().T_base_flange, atol=1e-9)


def test_titles_may_stand_in_a_remark_and_units_in_a_row_of_their_own(tmp_path):
    folder = written("kuka", tmp_path / "files")
    for path in folder.glob("scan*"):
        path.write_text(path.read_text().replace("x,z", "# Profile A\n# z [m], x [m]"))
    robot = folder / "robot_poses.csv"
    robot.write_text(robot.read_text().replace("\n", "\n,m,m,m,deg,deg,deg\n", 1))
    found, guessed = import_scan(folder, "edge", {}, Layout(pose_units="mm", units="mm"))
    np.testing.assert_allclose(np.concatenate(found.values)[:, ::-1], np.concatenate(scan().values))
    assert guessed[0].endswith("in mm, as you say, where the file says m")
    assert "where the file says m" in guessed[2]
    for path in folder.glob("scan*"):
        path.write_text("# Profile A\n" + path.read_text().partition("\n")[2].partition("\n")[2])
    assert "x (column 1) from" in import_scan(folder, "edge", {}, Layout(pose_units="mm"))[1][2]


@pytest.mark.parametrize(
    ("titles", "values", "names"),
    [
        ("z,x,intensity", [100, 2, 3], ("x", "z")),
        ("x,y,z", [2, 0, 100], ("x", "z")),
        ("1,2,3", [2, 0, 100], ("1", "3")),
        ("a,x,y,z", [1, 2, 0, 100], ("x", "z")),
    ],
)
def test_x_and_z_are_the_columns_of_these_names_or_without_names_those_that_vary(titles, values, names, tmp_path):
    table = pd.DataFrame([values, values], columns=titles.split(","), dtype=float)
    table.iloc[1] += np.array(values) != 0
    assert tuple(x_and_z(tmp_path, table, "")) == names


@pytest.mark.parametrize("titles", ["x,y,z", "position,height", "x,height"])
def test_where_names_do_not_say_which_are_x_and_z_the_user_must(titles, tmp_path):
    table = pd.DataFrame(np.arange(9.0).reshape(3, 3)[:, : titles.count(",") + 1], columns=titles.split(","))
    with pytest.raises(ScanError, match="say which are x and z"):
        x_and_z(tmp_path, table, "")
    first, *_, last = titles.split(",")
    assert x_and_z(tmp_path, table, f"{first}, {last}") == [first, last]


def change(name, old, new):
    def changed(folder):
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))

    return changed


def other_frame(folder):
    """The last three positions in a listing of their own, of another tool."""
    listing = (folder / "CALIB.LS").read_text()
    cut = listing.index("P[10]")
    (folder / "CALIB.LS").unlink()
    (folder / "CALIB1.LS").write_text(listing[:cut] + "/END\n")
    (folder / "CALIB2.LS").write_text("/PROG\n/POS\n" + listing[cut:].replace("UT : 0", "UT : 2"))


MISTAKES = {
    "nothing": ("kuka", shutil.rmtree, "no such folder, or nothing in it is named like the robot's poses"),
    "no poses": (
        "kuka",
        lambda f: (f / "robot_poses.csv").rename(f / "b.csv"),
        "nothing in it is named like the robot's poses",
    ),
    "two": (
        "kuka",
        lambda f: shutil.copy(f / "robot_poses.csv", f / "tcp.csv"),
        "robot_poses.csv, tcp.csv may all be the",
    ),
    "no profile": ("kuka", lambda f: (f / "scan_003.csv").unlink(), "no profile for pose scan_003 of robot_poses.csv"),
    "spare": ("kuka", lambda f: shutil.copy(f / "scan_003.csv", f / "scan_055.csv"), "scan_055.csv: no such pose in"),
    "one for two": (
        "kuka",
        lambda f: [(f / "scan_003.csv").unlink(), change("robot_poses.csv", "scan_003", "again_002")(f)],
        "11 profiles .* and 12 poses",
    ),
    "rail": (
        "kuka",
        lambda f: (
            pd.read_csv(f / "robot_poses.csv").assign(E1=np.arange(12)).to_csv(f / "robot_poses.csv", index=False)
        ),
        "robot_poses.csv: the external axis e1 differs between poses; expected one for all",
    ),
    "far": (
        "kuka",
        change("scan_001.csv", "x,z\n", "x,z\n1,-99999.9999\n"),
        r"profiles, in mm .*, reach -99999.9999; expected 1 to 10000 mm: .* where nothing was seen \(--missing\)",
    ),
    "fewer": ("ros", lambda f: (f / "cloud3.ply").unlink(), "11 profiles .* and 12 poses"),
    "unnamed": (
        "of a tool",
        lambda f: None,
        "7 columns and 0 names for them; say what they are: --pose-columns x,y",
    ),
    "binary": (
        "ros",
        change("cloud2.ply", "ascii", "binary_little_endian"),
        "cloud2.ply: expected a header with 'format a",
    ),
    "cut": (
        "ros",
        lambda f: (f / "cloud1.ply").write_text((f / "cloud1.ply").read_text()[:200]),
        "cloud1.ply.*cut short",
    ),
    "word": (
        "kuka",
        change("scan_001.csv", "x,z\n", "x,z\n1,2\n3,oops\n"),
        "scan_001.csv line 3: z is 'oops'; expected a finite number",
    ),
    "columns": (
        "numpy",
        lambda f: np.savez(f / "3.npz", profile=np.ones((9, 5))),
        "3.npz: columns 1, 2, 3, 4, 5, where 0.npz has 1, 2, 3",
    ),
    "no entry": ("fanuc", change("p2.yml", "profile:", "outline:"), "no list 'profile'; there are outline, picked"),
    "not closed": ("fanuc", change("p2.yml", " ]", ""), "p2.yml line 3: the list profile is not closed"),
    "nested": (
        "fanuc",
        change("p2.yml", "profile: [", "profile: [["),
        r"p2.yml line 3: column 1 is '\[.*'; expected a fin",
    ),
    "two frames": ("fanuc", other_frame, "LS: the tool differs between poses; expected one"),
    "one point": ("kuka", lambda f: (f / "scan_002.csv").write_text("x,z\n1,90\n"), "scan_002.csv: a single point"),
    "pairs": ("fanuc", change("p2.yml", "profile: [", "profile: [ 1.,"), "fields; expected 3 for each point"),
    "two units": (
        "universal",
        change("poses.txt", "y [m]", "y [mm]"),
        "poses.txt: the title of column y says the unit",
    ),
    "half": (
        "universal",
        change("poses.txt", "z [m]", "z"),
        "poses.txt: the title of column z says no unit; expected mm",
    ),
    "degrees": (
        "universal",
        lambda f: [change("poses.txt", f"r{axis} [rad]", f"r{axis} [deg]")(f) for axis in "xyz"],
        "poses.txt: the title of column rx says the unit 'deg'; expected rad, the same for rx, ry, rz",
    ),
    "no length": (
        "commas",
        change("line3.asc", "Z [mm]", "Z [px]"),
        r"line3.asc: columns x \[mm\], z \[px\], where line0",
    ),
    "reflection": (
        "rows and matrices",
        lambda f: np.savetxt(f / "pose4.txt", -np.eye(4)),
        "row 5: matrix with determ",
    ),
    "untitled": (
        "commas",
        change("poses.csv", "Alpha", "tilt"),
        "lacks alpha of alpha, beta, gamma; say what the columns are: --pose-columns",
    ),
    "other numbers": (
        "rows and matrices",
        lambda f: (f / "pose4.txt").rename(f / "pose44.txt"),
        "no profile for pose",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_guess_that_cannot_be_made_is_refused_in_a_sentence(mistake, tmp_path):
    name, spoil, sentence = MISTAKES[mistake]
    folder = written(name, tmp_path / "files")
    spoil(folder)
    with pytest.raises(ScanError, match=sentence) as caught:
        import_scan(folder, "edge", {})
    assert "\n" not in str(caught.value)


def corrupted(folder, rng):
    """One file changed, as disks, editors and people do."""
    path = rng.choice(sorted(folder.iterdir()))
    content = path.read_bytes()
    place = int(rng.integers(len(content)))
    match rng.integers(7):
        case 0:
            path.unlink()
        case 1:
            path.write_bytes(content[:place])
        case 2:
            path.write_bytes(content[:place] + bytes(rng.integers(0, 256, 4).tolist()) + content[place:])
        case 3:
            path.write_bytes(content.replace(b".", b",", int(rng.integers(1, 50))))
        case 4:
            lines = content.splitlines(keepends=True)
            path.write_bytes(b"".join(rng.permutation(np.array(lines, dtype=object))))
        case 5:
            path.write_bytes(
                content[:place]
                + rng.choice([b"1e400", b"-", b"nan", b"[", b"\n\n", b"x", b"\0"])
                + content[place + 3 :]
            )
        case 6:
            path.rename(path.with_name(f"{rng.choice(['pose', 'p1', 'x'])}{path.name}"))


def test_corrupted_files_give_a_sentence_or_a_scan(tmp_path):
    for seed in range(FUZZ):
        rng, folder = np.random.default_rng([7, seed]), tmp_path / str(seed)
        name = [*LAYOUTS][seed % len(LAYOUTS)]
        written(name, folder)
        for _ in range(1 + seed % 2):
            corrupted(folder, rng)
        with suppress(ScanError):
            import_scan(folder, "edge", {}, LAYOUTS[name][1])
        shutil.rmtree(folder)


@pytest.mark.parametrize(("name", "shape", "largest_mm"), [("edge", "corner", 0.15), ("sphere", "arc", 0.25)])
def test_the_real_measurements_are_found_in_every_profile_and_calibrate(name, shape, largest_mm):
    scan = real_scan(name)
    features = find_features(scan.target, scan.values, scan.sizes)
    assert [feature.shape for feature in features] == [shape] * len(scan.labels)
    assert calibrate([scan]).solution.rms_mm <= largest_mm


def test_picked_points_lie_on_the_ridge_that_is_found():
    scan, picked = real_scan("edge"), real_scan("edge", "feature_point")
    features = find_features(scan.target, scan.values)
    apart = np.array([feature.points[0] for feature in features]) - np.concatenate(picked.values)
    assert np.abs(apart).max() < 0.5  # mm: the same ridge; picks err by 0.1 and the edge is round
