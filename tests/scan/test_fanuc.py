"""FANUC listings."""

import numpy as np
import pytest

from profilecal.scan.imported import Layout, pose_table, read_poses
from profilecal.scan.scan import ScanError

POSE = """P[{n}]{{
   GP1:
\tUF : 0, UT : 2,\t\tCONFIG : 'N U T, 0, 0, -1',
\tX =   {x:.3f}  mm,\tY =   -.500  mm,\tZ =   331.032  mm,
\tW =  -177.169 deg,\tP =    -1.812 deg,\tR =   {r:.3f} deg{more}
}};
"""
AXIS = ",\n   GP2:\n\tUF : 0, UT : 0,\n\tJ1 =   {:.3f}  mm"


def write(folder, poses=3, more=""):
    text = "".join(POSE.format(n=n, x=400 + n, r=10.0 * n, more=more) for n in range(1, poses + 1))
    (folder / "calib.ls").write_text(f"/PROG  TEST\n/MN\n   1:J P[1] 100% FINE    ;\n/POS\n{text}/END\n")
    return folder


def read(folder):
    path = folder / "calib.ls"
    poses, units = pose_table([path], Layout())
    read_poses(path, poses, units, Layout())
    return poses, units


def test_a_listing_is_read_with_its_units(tmp_path):
    poses, units = read(write(tmp_path))
    assert poses["pose"].tolist() == ["P1", "P2", "P3"]
    assert poses["uf"].eq(0).all()
    assert poses["ut"].eq(2).all()
    np.testing.assert_allclose(poses[[*"xyzwpr"]].iloc[1], [402, -0.5, 331.032, -177.169, -1.812, 20])
    assert [units[name] for name in "xyzwpr"] == ["mm"] * 3 + ["deg"] * 3


@pytest.mark.parametrize("axis", [AXIS, ",\tE1 =   {:.3f}  mm"])
def test_external_axes_may_stand_still_but_not_move(axis, tmp_path):
    assert len(read(write(tmp_path, more=axis.format(12.5)))[0]) == 3
    path = tmp_path / "calib.ls"
    path.write_text(path.read_text().replace("1 =   12.500", "1 =   12.551").replace("1 =   12.551", "1 =   12.549", 1))
    assert len(read(tmp_path)[0]) == 3
    path.write_text(path.read_text().replace("1 =   12.549", "1 =   13.500", 1))
    with pytest.raises(ScanError, match=r"calib.ls: the external axis .*1 differs between poses; expected one"):
        read(tmp_path)


def test_the_frame_in_use_is_one(tmp_path):
    path = write(tmp_path) / "calib.ls"
    path.write_text(path.read_text().replace("UF : 0, UT : 2", "UF : F, UT : F"))
    assert {*read(tmp_path)[0]["ut"]} == {"F"}


MISTAKES = {
    "empty section": (("calib.ls", "P[", "Q["), "holds no position"),
    "not closed": (("calib.ls", "};", ""), r"calib.ls line 5: P\[1\] is not closed by };"),
    "twice": (("calib.ls", "P[2]", "P[1]"), "calib.ls line 11: pose 'P1' is there twice"),
    "untaught": (("calib.ls", "401.000", "********"), r"line 5: x is '\*+'; expected a finite number"),
    "joints": (("calib.ls", "X = ", "J1 = "), "calib.ls line 5: x is empty or NaN; expected a finite number"),
    "metres": (("calib.ls", "401.000  mm", "401.000  m"), "calib.ls: no column x; there are"),
    "no group": (("calib.ls", "GP1:", "GP3:"), "calib.ls line 5: x is empty or NaN; expected a finite number"),
    "other tool": (("calib.ls", "UT : 2", "UT : 3"), "the tool differs between poses"),
    "no tool": (("calib.ls", "UT : 2", "XX"), "the tool differs between poses; expected one"),
    "not text": (lambda f: (f / "calib.ls").write_bytes(b"/POS\xff"), "calib.ls: not UTF-8 text"),
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
        everywhere = mistake == "empty section"
        (folder / name).write_text(text.replace(old, new, -1 if everywhere else 1))
    with pytest.raises(ScanError, match=sentence) as caught:
        read(folder)
    assert "\n" not in str(caught.value)
