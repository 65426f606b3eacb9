"""Scans from the files that people have: one scan in many syntaxes, wrong guesses,
corrupted files, real ones.
"""

import functools
import json
import os
import re
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import edited, run
from corruptions import CORRUPTIONS
from scipy.spatial.transform import Rotation

from profilecal.calibration.calibration import calibrate
from profilecal.geometry.poses import homogeneous
from profilecal.scan.conventions import from_rotations, named
from profilecal.scan.folder import read_scan
from profilecal.scan.scan import ScanError
from profilecal.simulation.spec import WIDE, Spec, simulate_scan
from profilecal.targets.target import find_features
from profilecal_tool.importing.import_scan import Layout, import_scan

FUZZ = int(os.environ.get("PROFILECAL_FUZZ", "60"))
TOOL = (10.0, -20.0, 150.0, 12.0, -5.0, 30.0)


@functools.cache
def scan():
    """An edge in twelve raw profiles of as many points; nothing seen is NaN."""
    scanner = replace(WIDE, points=120, quantum=0.125)
    found = simulate_scan(
        Spec(measured="profiles", groups=4, positions=3, seed=4, scanner=scanner)
    )
    count = min(map(len, found.values))
    missing = np.arange(count)[:, None] % 17 == 3
    return replace(
        found, values=tuple(np.where(missing, np.nan, v[:count]) for v in found.values)
    )


def poses(convention, scale=1.0):
    """The numbers of each pose (12, 3 + k)."""
    return np.hstack(
        [
            scan().p_base_flange * scale,
            from_rotations(named(convention), scan().R_base_flange),
        ]
    )


def text(numbers, separator=","):
    return separator.join(f"{value:.12f}" for value in numbers)


def kuka(folder):
    rows = [
        f"DECL E6POS XP{k}={{{','.join(f'{n} {v:.12f}' for n, v in zip('XYZABC', row, strict=True))},S 2,T 35}}\n"
        f"DECL FDAT FP{k}={{TOOL_NO 1,BASE_NO 0}}\n"
        for k, row in enumerate(poses("KUKA angles"), 1)
    ]
    (folder / "scan.dat").write_text(
        "DEFDAT SCAN PUBLIC\n;FOLD X 1, Y 2\n" + "".join(rows) + "ENDDAT\n"
    )


def abb(folder):
    rows = [
        f"  CONST robtarget p{10 * k}:=[[{text(row[:3])}],[{text(row[3:])}],[-1,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
        for k, row in enumerate(poses("quaternion"), 1)
    ]
    tool = "  PERS tooldata tScan:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    (folder / "scan.mod").write_text(
        "MODULE Scan\n" + tool + "".join(rows) + "ENDMODULE\n"
    )


def ur(folder):
    rows = [
        f"  global P_{k}_p=p[{text(row)}]\n  movej([0,1,2,3,4,5], a=1.4)\n"
        for k, row in enumerate(poses("rotation vector", 0.001))
    ]
    (folder / "scan.script").write_text("def scan():\n" + "".join(rows) + "end\n")


def as_json(folder):
    (folder / "poses.json").write_text(
        json.dumps({"RobPoses": poses("FANUC angles").tolist()}, indent=4)
    )


def nested(folder):
    T = homogeneous(scan().R_base_flange, scan().p_base_flange)
    (folder / "poses.json").write_text(json.dumps([{"T": one.tolist()} for one in T]))


def fanuc(folder, tool=0, more=""):
    units = ("mm",) * 3 + ("deg",) * 3
    rows = [
        f"P[{k}]{{\n   GP1:\n\tUF : 0, UT : {tool},\t\tCONFIG : 'N U T, 0, 0, -1',\n\t"
        + ",\t".join(
            f"{n} = {v:.12f} {unit}"
            for n, v, unit in zip("XYZWPR", row, units, strict=True)
        )
        + f"{more}\n}};\n"
        for k, row in enumerate(poses("FANUC angles"), 1)
    ]
    header = "/PROG  SCAN\n/MN\n   1:L P[1] 500mm/sec FINE ;\n/POS\n"
    (folder / "CALIB.LS").write_text(header + "".join(rows) + "/END\n")


def key_lines(folder):
    rows = [
        f"r {text(row[3:], ' ')}\nt {text(row[:3], ' ')}\n" for row in poses("matrix")
    ]
    (folder / "poses.txt").write_text("".join(rows))


def csv(folder):
    rows = [
        f"scan_{k:03d};{text(row, ';').replace('.', ',')}\n"
        for k, row in enumerate(poses("Stäubli angles"))
    ]
    order = np.random.default_rng(1).permutation(12)
    header = "Name;X [mm];Y [mm];Z [mm];Alpha [°];Beta [°];Gamma [°]\n"
    (folder / "robot.csv").write_text(header + "".join(rows[k] for k in order))


def tum(folder, header="# timestamp tx ty tz qx qy qz qw\n"):
    order = [0, 1, 2, 4, 5, 6, 3]
    rows = [
        f"{1.7e9 + k} {text(row[order], ' ')}\n"
        for k, row in enumerate(poses("quaternion", 0.001))
    ]
    (folder / "poses.tum").write_text(header + "".join(rows))


def matrices(folder):
    for k, T in enumerate(homogeneous(scan().R_base_flange, scan().p_base_flange)):
        np.savetxt(folder / f"pose{k}.txt", T)


def array(folder):
    np.save(
        folder / "poses.npy", homogeneous(scan().R_base_flange, scan().p_base_flange)
    )


POSES = {
    f.__name__: f
    for f in (
        kuka,
        abb,
        ur,
        as_json,
        nested,
        fanuc,
        key_lines,
        csv,
        tum,
        matrices,
        array,
    )
}
# the numbers have no names there
SAID = {"as_json": Layout(pose_columns="x,y,z,w,p,r")}


def one_each(folder):
    for k, v in enumerate(scan().values):
        np.savetxt(
            folder / f"scan_{k:03d}.csv", v, delimiter=",", header="x,z", comments=""
        )


def lists(folder):
    for k, v in enumerate(scan().values, 1):
        listed = ", ".join(
            ".Nan" if np.isnan(x) else f"{x:.15g}"
            for x in np.insert(v, 1, 0.0, axis=1).ravel()
        )
        (folder / f"p{k}.yml").write_text(
            f"%YAML:1.0\n---\nprofile: [ {listed} ]\npicked: [ 1., 0., 2. ]\n"
        )


def archives(folder):
    for k, v in enumerate(scan().values):
        np.savez(
            folder / f"{k}.npz",
            profile=np.insert(v, 1, 0.0, axis=1),
            time=np.zeros((3, 2)),
        )


def codes(folder):
    """Without names, with a column of numbers, one of intensities, and a code where
    nothing was seen.
    """
    for k, v in enumerate(scan().values):
        filled = np.column_stack(
            [np.arange(len(v)), np.where(np.isnan(v), -999.0, v), np.full(len(v), 80)]
        )
        np.savetxt(folder / f"s{k}.asc", filled)


def zeros(folder):
    for k, v in enumerate(scan().values):
        np.savetxt(folder / f"s{k}.asc", np.nan_to_num(v), header="X [m]  Z [m]")


def long_table(folder, name="scan_{:03d}"):
    rows = [
        f"{name.format(k)},{x:.15g},{z:.15g}\n"
        for k, v in enumerate(scan().values)
        for x, z in v
    ]
    (folder / "all.csv").write_text("pose,x,z\n" + "".join(rows))


def numbered(folder):
    """2 before 10, in the order of the file."""
    long_table(folder, "{}")


def wide_table(folder):
    np.savetxt(folder / "all.txt", [v.ravel() for v in scan().values])


def stacked(folder):
    np.save(folder / "all.npy", np.stack(scan().values).swapaxes(1, 2))


PROFILES_OF = {fanuc: lists}  # counted from 1
PROFILES = {
    f.__name__: f
    for f in (
        one_each,
        lists,
        archives,
        codes,
        zeros,
        long_table,
        numbered,
        wide_table,
        stacked,
    )
}


def written(folder, of_poses=csv, of_profiles=None):
    folder.mkdir()
    of_poses(folder)
    (of_profiles or PROFILES_OF.get(of_poses, one_each))(folder)
    return folder


def check_poses(found):
    order = np.argsort([int(re.findall(r"\d+", label)[-1]) for label in found.labels])
    np.testing.assert_allclose(
        found.R_base_flange[order], scan().R_base_flange, atol=1e-9
    )
    np.testing.assert_allclose(
        found.p_base_flange[order], scan().p_base_flange, atol=1e-8
    )
    assert not found.side.any()
    return order


@pytest.mark.parametrize("name", POSES)
def test_poses_in_any_syntax_are_the_same(name, tmp_path):
    found, guessed = import_scan(
        written(tmp_path / "files", POSES[name]), "edge", {}, SAID.get(name, Layout())
    )
    check_poses(found)
    assert len(guessed) == 6


@pytest.mark.parametrize("name", PROFILES)
def test_profiles_in_any_layout_are_the_same(name, tmp_path):
    said = {
        "codes": Layout(columns="2,3", missing=-999),
        "zeros": Layout(columns="x [mm],z [mm]"),
    }.get(name, Layout())
    found, guessed = import_scan(
        written(tmp_path / "files", tum, PROFILES[name]), "edge", {}, said
    )
    for ours, theirs in zip(
        [found.values[k] for k in check_poses(found)], scan().values, strict=True
    ):
        seen = np.isfinite(theirs[:, 1])
        np.testing.assert_array_equal(np.isfinite(ours[:, 1]), seen)
        np.testing.assert_allclose(ours[seen], theirs[seen], atol=1e-9)
    assert (
        f"nothing seen in {sum(np.isnan(v[:, 1]).sum() for v in scan().values)} of them"
        in guessed[2]
    )


def test_poses_counted_from_1_have_the_profiles_counted_from_0(tmp_path):
    folder = written(tmp_path / "in", fanuc, one_each)
    for path in sorted(folder.glob("scan_*.csv")):
        path.rename(folder / f"{int(path.stem[-3:])}.csv")
    found, said = import_scan(folder, "edge", {})
    assert check_poses(found).tolist() == [*range(len(found.labels))]
    assert any("one counts from 0 and the other from 1" in line for line in said)
    (folder / "0.csv").unlink()
    with pytest.raises(ScanError, match="no profile for pose"):
        import_scan(folder, "edge", {})


def test_z_may_stand_under_the_x_of_the_first_row(tmp_path):
    x, z = np.linspace(-20, 20, 41), np.random.default_rng(2).uniform(90, 110, (12, 41))
    folder = written(
        tmp_path / "files",
        tum,
        lambda f: np.savetxt(f / "all.csv", [x, *z], delimiter=","),
    )
    found, _ = import_scan(folder, "edge", {})
    np.testing.assert_allclose(found.values, [np.column_stack([x, row]) for row in z])


@pytest.mark.parametrize("name", ["quaternion", "rotation vector"])
def test_a_tool_is_taken_off_and_a_mount_said(tmp_path, name):
    R, t = (
        Rotation.from_euler("xyz", TOOL[3:], degrees=True).as_matrix(),
        np.array(TOOL[:3]),
    )
    R_tool, T_tool = (
        scan().R_base_flange @ R,
        scan().p_base_flange + scan().R_base_flange @ t,
    )

    def of_tool(folder):
        np.savetxt(
            folder / "poses.txt",
            np.hstack([T_tool, from_rotations(named(name), R_tool)]),
        )

    turn = TOOL[3:] if name == "quaternion" else Rotation.from_matrix(R).as_rotvec()
    columns = ",".join(["x,y,z", *named(name).columns])
    layout = Layout(pose_columns=columns, tool=(*TOOL[:3], *turn), mount="eye-to-hand")
    found, _ = import_scan(written(tmp_path / "files", of_tool), "edge", {}, layout)
    check_poses(found)
    assert found.mount == "eye-to-hand"


def test_from_the_command_line_to_a_scan_that_is_read(tmp_path):
    folder = written(tmp_path / "files", tum)
    (folder / "scan_003.csv").write_text("x,z\n")
    result = run("import", folder, tmp_path / "scan", "--target", "edge")
    assert result.exit_code == 0, result.output
    assert [len(v) for v in read_scan(tmp_path / "scan").values].count(0) == 1
    assert (
        "poses.tum: 12, a quaternion (qw, qx, qy, qz), in m (the largest is"
        in result.output
    )
    check_poses(read_scan(tmp_path / "scan"))


def notes(folder, **said):
    return [
        line
        for line in import_scan(folder, "edge", {}, Layout(**said))[1]
        if line.startswith("note")
    ]


def test_what_matters_of_frames_and_axes_is_told(tmp_path):
    folder = written(
        tmp_path / "files",
        functools.partial(fanuc, tool=2, more=",\tE1 =   12.500  mm"),
        lists,
    )
    (note,) = notes(folder)
    assert note.endswith(
        "of tool 2, and so will be the sensor pose; for one on the flange give its frame: --tool X Y Z W P R"
    )
    assert not notes(folder, tool=TOOL)
    listing = folder / "CALIB.LS"
    listing.write_text(listing.read_text().replace("12.500  mm", "12.8  mm", 1))
    assert "e1 differs by up to 0.3 between poses" in notes(folder, tool=TOOL)[0]
    listing.write_text(listing.read_text().replace("12.8  mm", "13.1  mm", 1))
    with pytest.raises(
        ScanError, match=r"CALIB.LS: e1 differs between poses; expected one for all"
    ):
        notes(folder)


def test_other_files_are_left_out_and_files_in_folders_of_their_own_are_found(tmp_path):
    folder = written(tmp_path / "monday")
    (folder / "CalibConfig.json").write_text('{"HTM": [[1, 0], [0, 1]], "radius": 40}')
    found, guessed = import_scan(folder, "edge", {})
    check_poses(found)
    assert guessed[-1] == "left out   CalibConfig.json"
    layout = Layout(profiles="monday/scan*.csv", poses="monday/robot*.csv")
    check_poses(import_scan(tmp_path, "edge", {}, layout)[0])


def cut_short(name):
    def changed(folder):
        content = (folder / name).read_text()
        (folder / name).write_text(content[: content.rindex(",")])

    return changed


NONSENSE = {  # in each syntax of poses
    "kuka": ("scan.dat", "XP3={X ", "XP3={X oops", "12 profiles for 11 poses"),
    "abb": ("scan.mod", "],[-1,0,-1,0]", ",1],[-1,0,-1,0]", "12 profiles for 11 poses"),
    "ur": ("scan.script", "p[", "p[oops,", "12 profiles for 11 poses"),
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
    file, old, new, sentence = NONSENSE[name]
    folder = written(tmp_path / "files", POSES[name])
    edited(file, old, new)(folder)
    with pytest.raises(ScanError, match=sentence) as caught:
        import_scan(folder, "edge", {}, SAID.get(name, Layout()))
    assert "\n" not in str(caught.value)


MISTAKES = {
    "nothing": (
        csv,
        shutil.rmtree,
        "no such folder, or nothing in it is named like the robot's poses",
    ),
    "no poses": (
        csv,
        lambda f: (f / "robot.csv").rename(f / "b.csv"),
        "nothing in it is named like the robot",
    ),
    "two": (
        csv,
        lambda f: shutil.copy(f / "robot.csv", f / "tcp.csv"),
        "robot.csv … tcp.csv may all be the robot.s poses; expected one file",
    ),
    "no profile": (
        csv,
        lambda f: (f / "scan_003.csv").unlink(),
        "robot.csv: no profile for pose scan_003",
    ),
    "spare": (
        csv,
        lambda f: shutil.copy(f / "scan_003.csv", f / "scan_055.csv"),
        "no pose for profile scan_055",
    ),
    "fewer": (tum, lambda f: (f / "scan_003.csv").unlink(), "11 profiles for 12 poses"),
    "unnamed": (
        as_json,
        lambda f: None,
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
        edited("robot.csv", "[°]", "[grad]", 3),
        r"alpha \[grad\], .*; expected one unit .*, deg or rad",
    ),
    "twice": (
        fanuc,
        edited("CALIB.LS", "P[2]{", "P[1]{"),
        "CALIB.LS line 12: profile 'p1' is of pose 'P1' already",
    ),
    "not closed": (
        fanuc,
        edited("CALIB.LS", "};", ""),
        "CALIB.LS: not as many } as {; is the file cut short",
    ),
    "other tool": (
        fanuc,
        edited("CALIB.LS", "UT : 0", "UT : 3"),
        "CALIB.LS: tool differs between poses; expected",
    ),
    "reflection": (
        matrices,
        lambda f: np.savetxt(f / "pose4.txt", -np.eye(4)),
        "pose pose4: matrix with determ",
    ),
    "other file": (
        matrices,
        lambda f: (f / "pose4.txt").rename(f / "pose44.txt"),
        "no profile for pose pose44",
    ),
    "a word": (
        as_json,
        lambda f: (f / "poses.json").write_text('["a"]'),
        "poses.json: no numbers in columns",
    ),
    "not text": (
        tum,
        lambda f: (f / "poses.tum").write_bytes(b"1 2\xff"),
        "poses.tum: not UTF-8 text",
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
        edited("scan_001.csv", "x,z", "x,height"),
        "scan_001.csv: columns x, height, where scan_000",
    ),
    "cut": (
        csv,
        cut_short("scan_001.csv"),
        "scan_001.csv line .* 1 fields; expected 2: is the file cut short",
    ),
    "columns": (
        tum,
        lambda f: np.savez(f / "3.npz", profile=np.ones((9, 5))),
        "3.npz: columns 1, .*, 5, w",
        archives,
    ),
    "no entry": (
        tum,
        edited("p2.yml", "profile:", "outline:"),
        "no list 'profile'; there are outline, picked",
        lists,
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
    "unknown pose": (
        csv,
        edited("all.csv", "scan_003", "scan_033", 999),
        "no profile for pose scan_003",
        long_table,
    ),
    "not alike": (
        tum,
        lambda f: np.savetxt(f / "all.txt", np.ones((9, 40))),
        "say which are x and z",
        wide_table,
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_guess_that_cannot_be_made_is_refused_in_a_sentence(mistake, tmp_path):
    of_poses, spoil, sentence, *of_profiles = MISTAKES[mistake]
    folder = written(tmp_path / "files", of_poses, *of_profiles)
    spoil(folder)
    with pytest.raises(ScanError, match=sentence) as caught:
        import_scan(folder, "edge", {})
    assert "\n" not in str(caught.value)


ON_BYTES = (
    "bytes_flipped",
    "lines_lost_or_doubled",
    "cut_short",
    "other_separators",
    "something_inserted",
)


def corrupted(folder, rng):
    """One file lost, misnamed, or changed as disks, editors and people do."""
    path, how = (
        rng.choice(sorted(folder.iterdir())),
        rng.choice(["lost", "misnamed", *ON_BYTES]),
    )
    if how == "lost" or not path.stat().st_size:
        path.unlink()
    elif how == "misnamed":
        path.rename(path.with_name(f"{rng.choice(['pose', 'p1', 'x'])}{path.name}"))
    else:
        changed = SimpleNamespace(files={path.name: path.read_bytes()})
        CORRUPTIONS[how](rng, changed)
        path.write_bytes(changed.files[path.name])


def test_corrupted_files_give_a_sentence_or_a_scan(tmp_path):
    for seed in range(FUZZ):
        rng, folder = np.random.default_rng([7, seed]), tmp_path / str(seed)
        name = [*POSES][seed % len(POSES)]
        written(folder, POSES[name], [*PROFILES.values()][seed % len(PROFILES)])
        for _ in range(1 + seed % 2):
            corrupted(folder, rng)
        with suppress(ScanError):
            import_scan(folder, "edge", {}, SAID.get(name, Layout()))
        shutil.rmtree(folder)


def real_scan(name, entry=""):
    """ "edge", or "sphere", of HandEyeSync, where a user has it (data/README.md);
    `entry`: such as "feature_point".
    """
    folder = os.environ.get("PROFILECAL_REAL_DATA")
    if not folder:
        pytest.skip(
            "the measurements of HandEyeSync are not here: PROFILECAL_REAL_DATA is not set"
        )
    kind, sizes = ("edge", {}) if name == "edge" else ("ball", {"radius": 40.0})
    return import_scan(
        Path(folder) / "handeyesync" / name, kind, sizes, Layout(entry=entry)
    )[0]


@pytest.mark.parametrize(
    ("name", "shape", "largest_mm"), [("edge", "corner", 0.15), ("sphere", "arc", 0.25)]
)
def test_the_real_measurements_are_found_in_every_profile_and_calibrate(
    name, shape, largest_mm
):
    scan = real_scan(name)
    features = find_features(scan.target, scan.values, scan.sizes)
    assert [feature.shape for feature in features] == [shape] * len(scan.labels)
    found = calibrate([scan])
    assert found.status == "ok"
    assert found.solution.rms_mm <= largest_mm


def test_picked_points_lie_on_the_ridge_that_is_found():
    scan, picked = real_scan("edge"), real_scan("edge", "feature_point")
    features = find_features(scan.target, scan.values)
    apart = np.array([feature.points[0] for feature in features]) - np.concatenate(
        picked.values
    )
    assert (
        np.abs(apart).max() < 0.5
    )  # mm: the same ridge; picks err by 0.1 and the edge is round
