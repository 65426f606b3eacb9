"""FANUC listings and OpenCV profiles, and the measurements of HandEyeSync where a user has them."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from profilecal.joint.observations import Observations
from profilecal.joint.solve import solve
from profilecal.scan.folder import read_scan, write_scan
from profilecal.scan.handeyesync import read_handeyesync, read_listing, read_profile
from profilecal.scan.scan import ScanError

POSE = """P[{n}]{{
   GP1:
\tUF : 0, UT : 2,\t\tCONFIG : 'N U T, 0, 0, -1',
\tX =   {x:.3f}  mm,\tY =   -.500  mm,\tZ =   331.032  mm,
\tW =  -177.169 deg,\tP =    -1.812 deg,\tR =   {r:.3f} deg{more}
}};
"""
AXIS = ",\n   GP2:\n\tUF : 0, UT : 0,\n\tJ1 =   {:.3f}  mm"
PROFILE = "%YAML:1.0\n---\nprofile: [ 1., 0., -2.5, 1.05e+00, 0.,\n    -2.4, 1.1, 0., .Nan ]\n"


def write(folder, poses=3, more="", point="feature_point: [ 1.5, 0., -2. ]\n"):
    text = "".join(POSE.format(n=n, x=400 + n, r=10.0 * n, more=more) for n in range(1, poses + 1))
    (folder / "calib.ls").write_text(f"/PROG  TEST\n/MN\n   1:J P[1] 100% FINE    ;\n/POS\n{text}/END\n")
    for n in range(1, poses + 1):
        (folder / f"p{n}.yml").write_text(PROFILE + point)
    return folder


def test_a_listing_is_read(tmp_path):
    listing = read_listing(write(tmp_path) / "calib.ls")
    assert listing.numbers == (1, 2, 3)
    assert (listing.user_frame, listing.tool) == (0, 2)
    np.testing.assert_allclose(listing.poses[1], [402, -0.5, 331.032, -177.169, -1.812, 20])


def test_a_folder_is_a_scan_that_can_be_written_and_read(tmp_path):
    (tmp_path / "in").mkdir()
    scan = read_handeyesync(write(tmp_path / "in"))
    assert (scan.kind, scan.labels, scan.sizes) == ("edge", ("P1", "P2", "P3"), ())
    expected = Rotation.from_euler("ZYX", [20, -1.812, -177.169], degrees=True).as_matrix()
    np.testing.assert_allclose(scan.R_base_flange[1], expected, atol=1e-15)
    np.testing.assert_array_equal(scan.values[0], [[1, -2.5], [1.05, -2.4], [1.1, np.nan]])
    write_scan(scan, tmp_path / "out")
    again = read_scan(tmp_path / "out")
    np.testing.assert_allclose(again.R_base_flange, scan.R_base_flange, atol=1e-12)
    np.testing.assert_array_equal(again.values, scan.values)


def test_picked_points_and_balls(tmp_path):
    picked = read_handeyesync(write(tmp_path), picked=True)
    np.testing.assert_array_equal(picked.values, np.tile([1.5, -2.0], (3, 1, 1)))
    assert picked.measured == "points"
    for path in tmp_path.glob("*.yml"):
        path.write_text(PROFILE)
    ball = read_handeyesync(tmp_path)
    assert (ball.kind, ball.sizes) == ("ball", (40.0,))
    with pytest.raises(ScanError, match=r"p1.yml: no feature_point"):
        read_handeyesync(tmp_path, picked=True)


def test_external_axes_may_stand_still_but_not_move(tmp_path):
    assert read_listing(write(tmp_path, more=AXIS.format(12.5)) / "calib.ls").numbers == (1, 2, 3)
    path = tmp_path / "calib.ls"
    path.write_text(path.read_text().replace("J1 =   12.500", "J1 =   13.500", 1))
    with pytest.raises(ScanError, match=r"calib.ls: group GP2 moves between positions; expected external axes to"):
        read_listing(path)


MISTAKES = {
    "no listing": (lambda f: (f / "calib.ls").unlink(), "0 listings .* expected one"),
    "two listings": (lambda f: (f / "b.LS").write_text(""), "2 listings .* expected one"),
    "no positions": (("calib.ls", "/POS", "/POZ"), "no /POS section"),
    "empty section": (("calib.ls", "P[", "Q["), "holds no position"),
    "not closed": (("calib.ls", "};", ""), r"calib.ls line 5: P\[1\] is not closed by };"),
    "twice": (("calib.ls", "P[2]", "P[1]"), r"calib.ls line 11: P\[1\] is there twice"),
    "untaught": (("calib.ls", "401.000", "********"), r"line 5: P\[1\]: X is '\*+ mm'; expected a number in mm"),
    "joints": (("calib.ls", "X = ", "J1 = "), r"P\[1\] has no X; expected X, Y, Z in mm and W, P, R in deg"),
    "metres": (("calib.ls", "401.000  mm", "401.000  m"), "X is '401.000 m'; expected a number in mm"),
    "no group": (("calib.ls", "GP1:", "GP3:"), "has no group GP1"),
    "other tool": (("calib.ls", "UT : 2", "UT : 3"), "positions in 2 user frames or tools"),
    "no tool": (("calib.ls", "UT : 2", "XX"), r"P\[1\] has no UT"),
    "no profile": (lambda f: (f / "p2.yml").unlink(), r"no p2.yml for position P\[2\] of calib.ls"),
    "spare profile": (lambda f: (f / "p9.yml").write_text(PROFILE), r"p9.yml: no such position"),
    "not YAML": (("p1.yml", "%YAML", "%JSON"), "p1.yml: expected an OpenCV file"),
    "no list": (("p1.yml", "profile", "outline"), "p1.yml: no 'profile"),
    "cut short": (("p1.yml", " ]", ""), "p1.yml line 3: the list profile is not closed; is the file cut short"),
    "text": (("p1.yml", "-2.5", "abc"), "p1.yml line 3: profile holds 'abc'; expected numbers"),
    "pairs": (("p1.yml", "-2.5, ", ""), "p1.yml line 3: profile has 8 numbers; expected triplets"),
    "y": (("p1.yml", "0., -2.5", "3., -2.5"), "p1.yml line 3: profile has a y of 3; expected 0"),
    "not text": (lambda f: (f / "p1.yml").write_bytes(b"%YAML\xff"), "p1.yml: not UTF-8 text"),
    "a folder": (lambda f: ((f / "p1.yml").unlink(), (f / "p1.yml").mkdir()), "p1.yml: Is a directory"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_every_mistake_is_one_sentence_with_its_place(tmp_path, mistake):
    change, sentence = MISTAKES[mistake]
    folder = write(tmp_path)
    if callable(change):
        change(folder)
    else:
        name, old, new = change
        text = (folder / name).read_text()
        assert old in text
        everywhere = mistake in ("empty section", "cut short")
        (folder / name).write_text(text.replace(old, new, -1 if everywhere else 1))
    with pytest.raises(ScanError, match=sentence) as caught:
        read_handeyesync(folder)
    assert "\n" not in str(caught.value)


def test_an_unknown_kind_is_refused(tmp_path):
    with pytest.raises(ScanError, match="kind is 'cone'; expected edge or ball"):
        read_handeyesync(write(tmp_path), "cone")


def test_an_empty_profile_is_empty(tmp_path):
    path = tmp_path / "p1.yml"
    path.write_text("%YAML:1.0\n---\nprofile: [ ]\n")
    assert read_profile(path)[0].shape == (0, 2)


def real(name, picked=False):
    folder = os.environ.get("PROFILECAL_REAL_DATA")
    if not folder:
        pytest.skip("the measurements of HandEyeSync are not here: PROFILECAL_REAL_DATA is not set")
    return read_handeyesync(Path(folder) / "handeyesync" / name, picked=picked)


def solved(scan, features):
    points = np.full((1, len(features), max(len(f.points) for f in features), 2), np.nan)
    for row, feature in zip(points[0], features, strict=True):
        row[: len(feature.points)] = feature.points
    R, T = scan.R_base_flange[None], scan.T_base_flange[None]
    return solve([Observations(scan.kind, R, T, points, scan.sizes, scan.group)], robust=False)


def test_the_real_ridge_is_found_in_every_profile_and_calibrates():
    scan = real("edge")
    features = scan.target.features(scan.values)
    assert len(features) == 26
    assert {f.shape for f in features} == {"corner"}
    picked = np.concatenate(real("edge", picked=True).values)
    apart = np.array([f.points[0] for f in features]) - picked
    assert np.abs(apart).max() < 0.5  # mm: the same ridge; picks err by 0.1 and the edge is round
    assert solved(scan, features).rms_mm <= 0.15


def test_the_real_sphere_is_found_in_every_profile_and_calibrates():
    scan = real("sphere")
    features = scan.target.features(scan.values, scan.sizes)
    assert len(features) == 15
    assert {f.shape for f in features} == {"arc"}
    assert solved(scan, features).rms_mm <= 0.25
