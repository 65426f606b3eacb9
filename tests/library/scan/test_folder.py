import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command import edited, run
from scipy.spatial.transform import Rotation

from profilecal.geometry.poses import rotation_groups
from profilecal.scan.conventions import CONVENTIONS
from profilecal.scan.folder import MEASURED, read_scan, write_scan
from profilecal.scan.scan import Scan, ScanError
from profilecal.scan.toml import read_toml

TRUTH = {
    "seed": 1,
    "T_flange_sensor": np.eye(4).tolist(),
    "target": {"centre": [1.0, 2.0, 3.0]},
}


def random_scan(rng, measured="points", kind="edge", **changes):
    R = np.repeat(Rotation.random(4, rng=rng).as_matrix(), 3, axis=0)
    columns = len(MEASURED[measured])
    rows = 50 if measured == "profiles" else 1
    scan = Scan(
        kind=kind,
        labels=tuple(f"P{k}" for k in range(12)),
        R_base_flange=R,
        p_base_flange=rng.uniform(-800, 800, (12, 3)),
        measured=measured,
        values=tuple(rng.uniform(-60, 60, (rows, columns)) for _ in range(12)),
        sizes=(40.0,) if kind in ("ball", "disk") else (),
        side=np.zeros(12),
        group=np.repeat(np.arange(4), 3),
        noise={"profile_mm": 0.05},
        title='A "quoted" bar, 25 °',
    )
    return replace(scan, **changes)


def assert_same(first, second):
    np.testing.assert_allclose(first.R_base_flange, second.R_base_flange, atol=1e-9)
    np.testing.assert_allclose(first.p_base_flange, second.p_base_flange, atol=1e-9)
    for a, b in zip(first.values, second.values, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    for name in (
        "kind",
        "labels",
        "measured",
        "sizes",
        "noise",
        "title",
        "mount",
        "convention",
    ):
        assert getattr(first, name) == getattr(second, name)
    np.testing.assert_array_equal(first.group, second.group)
    np.testing.assert_array_equal(first.side, second.side)


SHOWN = [
    ("profiles", "plane"),
    ("profiles", "disk"),
    ("chords", "disk"),
    ("arcs", "ball"),
    ("points", "point"),
]


@pytest.mark.parametrize("mount", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(
    ("convention", "measured", "kind"),
    [
        *((c.name, "points", "edge") for c in CONVENTIONS),
        *(("quaternion", *shown) for shown in SHOWN),
    ],
)
def test_a_scan_written_is_read_back(tmp_path, mount, convention, measured, kind):
    about = {
        "side": np.where(np.arange(12) % 2, 1.0, -1.0),
        "truth": TRUTH,
        "convention": convention,
        "mount": mount,
    }
    scan = random_scan(np.random.default_rng(1), measured, kind, **about)
    write_scan(scan, tmp_path / "scan")
    read = read_scan(tmp_path / "scan")
    assert_same(read, scan)
    truth = tmp_path / "scan" / "truth.toml"
    assert read_toml(truth) == TRUTH
    truth.write_text("broken = [", encoding="utf-8")
    assert_same(read_scan(tmp_path / "scan"), scan)


def test_metres_and_millimetres_are_the_same_scan(tmp_path):
    scan = random_scan(np.random.default_rng(3), "arcs", "ball")
    for unit in ("mm", "m"):
        write_scan(scan, tmp_path / unit)
    for name, columns in (
        ("poses.csv", ["x", "y", "z"]),
        ("arcs.csv", ["x", "z", "r"]),
    ):
        table = pd.read_csv(tmp_path / "m" / name)
        table[columns] /= 1000
        table.to_csv(tmp_path / "m" / name, index=False)
    header = tmp_path / "m" / "scan.toml"
    in_metres = header.read_text().replace('units = "mm"', 'units = "m"')
    header.write_text(in_metres.replace("radius = 40.0", "radius = 0.04"))
    assert_same(read_scan(tmp_path / "m"), read_scan(tmp_path / "mm"))


def test_groups_are_found_and_given_groups_are_kept(tmp_path):
    rng = np.random.default_rng(4)
    scan = random_scan(rng)
    wobble = Rotation.from_rotvec(
        np.radians(0.01) * rng.normal(size=(12, 3))
    ).as_matrix()
    np.testing.assert_array_equal(
        rotation_groups(scan.R_base_flange @ wobble), scan.group
    )
    write_scan(replace(scan, group=np.arange(12), group_given=True), tmp_path / "scan")
    read = read_scan(tmp_path / "scan")
    assert read.group_given
    assert len(set(read.group)) == 12


def test_blank_and_nan_points_are_missing_and_extra_columns_ignored(tmp_path):
    write_scan(random_scan(np.random.default_rng(5)), tmp_path / "scan")
    path = tmp_path / "scan" / "points.csv"
    lines = path.read_text().splitlines()
    lines[1], lines[2] = "P0,,", "P1,nan,NaN"
    path.write_text("\n".join(f"{line},comment" for line in lines) + "\n\n")
    read = read_scan(tmp_path / "scan")
    assert np.isnan(read.values[0]).all()
    assert np.isnan(read.values[1]).all()
    assert np.isfinite(read.values[2]).all()


def rewrite(name, function):
    def change(folder):
        table = pd.read_csv(folder / name)
        function(table).to_csv(folder / name, index=False)

    return change


def header(old, new):
    return edited("scan.toml", old, new)


def poses(function):
    return rewrite("poses.csv", function)


def arcs(function):
    return rewrite("arcs.csv", function)


def put(text):
    return lambda folder: (folder / "arcs.csv").write_text(text)


def loop(name):
    return lambda folder: ((folder / name).unlink(), (folder / name).symlink_to(name))


MISTAKES = {
    "no header": (
        lambda f: (f / "scan.toml").unlink(),
        r"scan.toml: no such file; expected it to name the target",
    ),
    "broken header": (header("[target]", "[target"), r"scan.toml: .*\(at line"),
    "unknown entry": (
        header("units", "unit"),
        "unknown entry 'unit'; there are title, units",
    ),
    "negative noise": (
        header("0.05", "-0.05"),
        r"profile_mm is -0.05 in \[noise\]; expected zero, or 1e-06 to 100",
    ),
    "unknown unit": (header('"mm"', '"inch"'), "units is 'inch'; expected mm or m"),
    "unknown kind": (
        header('"ball"', '"sphere"'),
        r"kind is 'sphere' in \[target\]; expected edge or",
    ),
    "no radius": (
        header("radius = 40.0", ""),
        r"radius is missing in \[target\]; expected 0.5 to 1000",
    ),
    "absurd radius": (
        header("40.0", "40000.0"),
        r"radius is 40000.0 in \[target\]; expected 0.5 to 1000",
    ),
    "no poses": (lambda f: (f / "poses.csv").unlink(), r"poses.csv: no such file"),
    "no measurement": (
        lambda f: (f / "arcs.csv").unlink(),
        r"expected one of profiles, .*; found none",
    ),
    "two measurements": (
        lambda f: (f / "points.csv").write_text("pose,x,z\n"),
        "found points and arcs",
    ),
    "not for a ball": (
        header('kind = "ball"\nradius = 40.0', 'kind = "edge"'),
        "'edge' needs profiles or points",
    ),
    "no column": (
        poses(lambda t: t.drop(columns="y")),
        "poses.csv: no columns 'y'; expected one; there are pose, x",
    ),
    "long quaternion": (
        poses(lambda t: t.assign(qw=t["qw"] + 1)),
        "line 2: quaternion of length",
    ),
    "duplicate pose": (
        poses(lambda t: t.replace({"pose": {"P3": "P2"}})),
        "line 5: pose 'P2' is there twice",
    ),
    "unknown pose": (
        arcs(lambda t: t.replace({"pose": {"P3": "P33"}})),
        "line 5: pose 'P33' is not in poses",
    ),
    "no label": (
        arcs(lambda t: t.replace({"pose": {"P3": None}})),
        "line 5: no pose label",
    ),
    "NaN pose": (
        poses(lambda t: t.assign(z=t["z"].where(t.index != 4))),
        "line 6: z is empty",
    ),
    "text": (
        arcs(lambda t: t.astype({"x": object}).replace({"x": {t["x"][1]: "abc"}})),
        "line 3: x is 'abc'",
    ),
    "infinite": (
        arcs(lambda t: t.assign(x=np.inf)),
        "line 2: x is 'inf'; expected a finite number",
    ),
    "no rows": (put("pose,x,z,r\n"), "arcs.csv: no rows"),
    "empty file": (put(""), "arcs.csv: no rows; expected names of columns"),
    "not text": (
        lambda f: (f / "arcs.csv").write_bytes(b"pose\nP\xff\xfe"),
        "not UTF-8 text, b'.xff' in line 2; save",
    ),
    "a group missing": (
        poses(lambda t: t.assign(group=[*"ab", *[None] * (len(t) - 2)])),
        "line 4: no group; expected",
    ),
    "bad side": (
        poses(lambda t: t.assign(side=2)),
        "line 2: side is 2; expected 1 or -1",
    ),
    "positions in m": (
        poses(lambda t: t.assign(x=t.x / 1e3, y=t.y / 1e3, z=t.z / 1e3)),
        "are the units",
    ),
    "arcs in m": (
        arcs(lambda t: t.assign(x=t.x / 1e3, z=t.z / 1e3, r=t.r / 1e3)),
        "are the units",
    ),
    "symlink loop": (loop("arcs.csv"), "arcs.csv: Too many levels of symbolic links"),
    "folder is a file": (
        lambda f: (f.rename(f.with_name("s")), f.write_text("")),
        "scan.toml: Not a directory",
    ),
    "a pipe": (
        lambda f: ((f / "poses.csv").unlink(), os.mkfifo(f / "poses.csv")),
        "poses.csv: not a file",
    ),
    "a folder for a file": (
        lambda f: ((f / "arcs.csv").unlink(), (f / "arcs.csv").mkdir()),
        "arcs.csv: not a file",
    ),
    "column twice": (
        put("pose,x,X ,z,r\nP0,1,1,2,3\n"),
        "arcs.csv: 2 columns 'x'; expected one",
    ),
    "cut short": (
        put("pose,x,z,r\nP0,1,2,3\nP1,1"),
        "arcs.csv line 3: 2 fields; expected 4: is the file cut short",
    ),
    "open quote": (
        put('pose,x,z,r\n"P0,1,2,3\n'),
        "cannot be read: unexpected end of data",
    ),
    "a code for no point": (
        arcs(lambda t: t.assign(z=-32768)),
        "line 2: z is -32768; expected at most 10000: .*blank",
    ),
    "two arcs": (
        arcs(lambda t: t.replace({"pose": {"P3": "P2"}})),
        "line 4: pose 'P2' has 2 rows; expected one",
    ),
    "a long label": (
        arcs(lambda t: t.replace({"pose": {"P3": "long\n" * 99}})),
        r"'long\\nlong.*… is not in poses",
    ),
    "too far away": (
        poses(lambda t: t.assign(x=25e3 * (t.index == 4))),
        r"line 6: .* pose 'P4', is 2.5e\+04 mm",
    ),
    "no table": (
        lambda f: (f / "scan.toml").write_text("target = 5"),
        "target is 5; expected a table",
    ),
    "radius is true": (
        header("radius = 40.0", "radius = true"),
        r"radius is True in \[target\]; expected 0.5 to 1000",
    ),
    "a huge radius": (
        header("40.0", f"1{'0' * 400}"),
        r"radius is a huge number in \[target\]; expected 0.5 to 1000",
    ),
    "nested deeply": (header("40.0", "[" * 20_000), "scan.toml: nested too deeply"),
    "a long header": (
        header("[target]", "#" * 1_000_000 + "\n[target]"),
        r"scan.toml: 1.0\d+ MB; expected at most",
    ),
    "too large": (
        lambda f: os.truncate(f / "arcs.csv", 500_000_000),
        "arcs.csv: 500 MB; expected at most 400 MB",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_every_mistake_is_one_sentence_with_file_and_value(tmp_path, mistake):
    change, sentence = MISTAKES[mistake]
    folder = tmp_path / "scan"
    write_scan(random_scan(np.random.default_rng(6), "arcs", "ball"), folder)
    change(folder)
    with pytest.raises(ScanError, match=sentence) as caught:
        read_scan(folder)
    assert "scan" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_pose_with_one_point_is_no_profile(tmp_path):
    write_scan(random_scan(np.random.default_rng(9), "profiles"), tmp_path / "scan")
    rewrite("profiles.csv", lambda t: t[(t["pose"] != "P1") | ~t["pose"].duplicated()])(
        tmp_path / "scan"
    )
    with pytest.raises(
        ScanError,
        match=r"profiles.csv line 52: pose 'P1' has 1 rows; expected more, or none",
    ):
        read_scan(tmp_path / "scan")


@pytest.mark.parametrize(
    "command",
    [["calibrate"], ["calibrate", "--json"], ["check"], ["verify", "--with", "T.json"]],
)
@pytest.mark.skipif(
    os.name != "posix" or os.getuid() != 0, reason="gives up root's permissions"
)
def test_without_permission_a_command_says_so_and_writes_nothing(command):
    with (
        tempfile.TemporaryDirectory() as above
    ):  # not below pytest's folder, which is root's alone
        os.chmod(above, 0o755)
        folder = Path(above) / "scan"
        write_scan(random_scan(np.random.default_rng(9)), folder)
        arguments = command[0], folder, *command[1:]
        run(*arguments)  # which imports what root alone may read
        for locked, unread in (("poses.csv", "poses.csv"), (".", "scan.toml")):
            (folder / locked).chmod(0)
            os.seteuid(65534)
            try:
                done = run(*arguments)
            finally:
                os.seteuid(0)
            assert (done.exit_code, done.stdout) == (2, "")
            assert done.stderr == f"profilecal: {folder / unread}: Permission denied\n"


@pytest.mark.parametrize(
    "mistake",
    ["no header", "text", "cut short", "symlink loop", "a pipe", "nested deeply"],
)
@pytest.mark.parametrize("command", ["calibrate", "check", "verify"])
def test_every_command_refuses_in_one_line_with_status_2(tmp_path, mistake, command):
    folder = tmp_path / "scan"
    write_scan(random_scan(np.random.default_rng(6), "arcs", "ball"), folder)
    MISTAKES[mistake][0](folder)
    before = sorted(tmp_path.rglob("*"))
    options = {
        "calibrate": ["--json", "--report", tmp_path / "report.html"],
        "verify": ["--with", "T.json"],
    }
    done = run(command, folder, *options.get(command, []))
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.startswith("profilecal: ")
    assert done.stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_with_something_in_it_is_not_overwritten(tmp_path):
    scan = random_scan(np.random.default_rng(8))
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(ScanError, match="already in use; name a new folder"):
        write_scan(scan, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]
