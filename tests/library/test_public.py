"""The library from outside: what users type who have nothing but docstrings."""

import ast
import pickle
import re
import subprocess
import sys
from inspect import getdoc, getsource, isclass
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform

import profilecal as pc

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "data" / "examples"


def poses_and_values(scan):
    """What a user has of a scan in arrays of their own."""
    return scan.T_base_flange, [np.array(rows) for rows in scan.values]


def test_a_mistake_of_every_kind_is_a_sentence():
    poses, points = poses_and_values(pc.simulate("edge", seed=1)[0])
    scan = {
        "kind": "edge",
        "T_base_flange": poses,
        "points": np.concatenate(points),
    }
    mirrored = poses @ np.diag([1, 1, -1, 1.0])
    in_metres = poses.copy()
    in_metres[:, :3, 3] /= 1000
    unknown = poses.copy()
    unknown[4, 0, 3] = np.nan
    mistakes = {
        "T_base_flange has shape": {"T_base_flange": poses[:, :3]},
        "T_base_flange has 9 poses for 250 points; expected": {
            "T_base_flange": poses[:9]
        },
        r"T_base_flange\[0\] is a reflection": {"T_base_flange": mirrored},
        r"T_base_flange\[4, 0, 3\] is nan": {"T_base_flange": unknown},
        "mount is 'eye_to_hand'; expected": {"mount": "eye_to_hand"},
        "unknown entry 'profile_um'": {"noise": {"profile_um": 50}},
        "noise is 0.05; expected a table": {"noise": 0.05},
        "points .* are the units right": {"points": scan["points"] / 1000},
        "of T_base_flange is 0.8.* are the units right": {"T_base_flange": in_metres},
        "points has shape": {"points": scan["points"][:, :1]},
        "expected one of profiles, points": {"profiles": points},
        "unknown entry 'radius'": {"radius": 50.0},
        "Scan: 'int' object is not": {"points": None, "profiles": 5},
        "radius is missing": {"kind": "disk"},
        r"group has shape \(3,\)": {"group": [0, 0, 1]},
        "labels has 'p' 250 times": {"labels": ["p"] * 250},
        r"labels has shape \(1,\); expected \(250,\)": {"labels": ["p"]},
    }
    for sentence, change in mistakes.items():
        with pytest.raises(pc.ScanError, match=sentence) as caught:
            pc.Scan.of(**scan | change)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["edge", "disk", "ball"])
def test_arrays_and_a_folder_give_the_same_answer_to_the_last_digit(kind):
    from_folder = pc.read_scan(EXAMPLES / kind)
    poses, profiles = poses_and_values(from_folder)
    from_arrays = pc.Scan.of(
        kind,
        poses,
        profiles=profiles,
        noise=dict(from_folder.noise),
        labels=from_folder.labels,
        title=from_folder.title,
        **from_folder.sizes,
    )
    assert from_arrays.convention == "quaternion"  # as which poses are written
    found = [pc.calibrate(scan).to_json() for scan in (from_folder, from_arrays)]
    assert found[0] == found[1]


def test_a_rigid_transform_is_taken_for_poses():
    scan, _ = pc.simulate("point", seed=1)
    transforms = RigidTransform.from_matrix(scan.T_base_flange)
    points = np.concatenate(scan.values)
    again = pc.Scan.of("point", transforms, points=points)
    assert_allclose(again.T_base_flange, scan.T_base_flange, atol=1e-9)


@pytest.mark.parametrize(
    ("few", "more"),
    [({"spread_deg": 0.0}, ()), ({"groups": 4, "positions": 1}, ("solution",))],
)
def test_where_nothing_was_found_the_answer_raises_what_to_add(few, more):
    scan, _ = pc.simulate("edge", seed=1, **few)
    found = pc.calibrate(scan)
    assert found.status == "unobservable"
    for name in ("pose", "covariance_mm_deg", "translation_sd_mm", "targets", *more):
        with pytest.raises(pc.UnobservableError, match="add poses"):
            getattr(found, name)


@pytest.mark.parametrize("spread_deg", [0.0, 30.0])
def test_what_is_shown_at_the_prompt_fits_a_screen(spread_deg):
    scan, _ = pc.simulate("disk", seed=1, spread_deg=spread_deg, groups=3)
    for shown in (repr(scan), repr(pc.calibrate(scan))):
        assert len(shown.splitlines()) <= 20
        assert max(map(len, shown.splitlines())) <= 88


@pytest.mark.parametrize("name", pc.__all__)
def test_a_public_name_is_documented(name):
    thing = getattr(pc, name)
    text = getdoc(thing)
    assert text.splitlines()[0].endswith(".")
    if not isclass(thing):
        assert "\nParameters\n---" in text
        assert "\nReturns\n---" in text or "-> None" in getsource(thing)
        assert "\nSee Also\n---" in text
        assert "\nExamples\n---" in text or "with an example" in text
        if "raise" in getsource(thing):
            assert "\nRaises\n---" in text


def test_type_checkers_see_the_public_names():
    stub = ast.parse((ROOT / "lib/profilecal/__init__.pyi").read_text(encoding="utf-8"))
    *imports, _, exported = stub.body  # the version between
    imported = {line.names[0].asname for line in imports}
    assert imported == {*ast.literal_eval(exported.value)} == {*pc.__all__}
    assert (ROOT / "lib/profilecal/py.typed").exists()
    with pytest.raises(AttributeError, match="has no attribute 'calibrat'"):
        _ = pc.calibrat


def test_nothing_is_loaded_before_it_is_used():
    code = "import sys, profilecal; print('numpy' in sys.modules, len(dir(profilecal)))"
    command = [sys.executable, "-c", code]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said.split() == ["False", str(len(pc.__all__))]


def test_the_example_in_the_readme_runs(monkeypatch, tmp_path):
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert len(code.splitlines()) <= 12
    exec(code, {})
    assert pc.read_answer("T.json").status == "ok"
    assert pc.__version__ in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_numbers_of_numpy_are_numbers():
    scan, _ = pc.simulate("ball", seed=np.int64(1), radius=np.float32(25))
    again = pc.Scan.of(
        "ball",
        scan.T_base_flange,
        arcs=np.concatenate(scan.values),
        radius=np.float64(25),
        noise={"profile_mm": np.float32(0.05)},
        labels=range(len(scan.labels)),
    )
    assert again.sizes == {"radius": 25.0}
    assert again.labels[:2] == ("0", "1")


def test_one_pose_is_one_in_words():
    scan, _ = pc.simulate("point", groups=1, positions=1)
    assert repr(scan) == "Scan(point, 1 pose of 1 orientation, points, eye-in-hand)"


@pytest.mark.parametrize("entries", [{}, {"motion": {"sweeps": 8, "profiles": 20}}])
def test_results_are_handed_to_other_processes(entries):
    found = pc.calibrate(pc.simulate("disk", seed=1, **entries)[0])
    again = pickle.loads(pickle.dumps(found))
    assert again.to_json() == found.to_json()
    assert len(pc.self_test(again, 10).squares) == 10


def test_arguments_of_another_kind_are_refused_by_name():
    scan, _ = pc.simulate("edge", seed=1)
    found = pc.calibrate(scan)
    for call, sentence in {
        (lambda: pc.calibrate(None)): "scans is a NoneType; expected a Scan",
        (lambda: pc.calibrate("folder")): "scans is a str; expected a Scan",
        (lambda: pc.calibrate(scan, scan)): "guess is a Scan; expected several scans",
        (lambda: pc.verify(scan, found)): "found is a Scan; expected a Calibration or",
        (lambda: pc.self_test(scan)): "found is a Scan; expected a Calibration",
    }.items():
        with pytest.raises(TypeError, match=sentence):
            call()


def test_a_scan_keeps_what_it_was_given():
    scan, _ = pc.simulate("edge", seed=1)
    poses, points = scan.T_base_flange, np.concatenate(scan.values)
    made = pc.Scan.of("edge", poses, points=points)
    points[:], poses[:] = 0, 0
    assert made.T_base_flange[0, 3, 3] == 1
    assert np.abs(made.values[0]).max() > 0
    with pytest.raises(ValueError, match="read-only"):
        made.values[0][:] = 0


def test_a_profile_that_saw_nothing_may_be_none_or_empty():
    scan, _ = pc.simulate("plane", seed=1, measured="profiles")
    profiles = [None, [], *scan.values[2:]]
    made = pc.Scan.of("plane", scan.T_base_flange, profiles=profiles)
    assert np.isnan(np.concatenate(made.values[:2])).all()
