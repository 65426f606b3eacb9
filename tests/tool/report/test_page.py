"""The report as a file: it needs nothing else, and is whole or not there."""

import json
import re

import numpy as np
import pytest
from command import run, write_notebook
from scipy.spatial.transform import Rotation
from simulated import scan_of

import profilecal as pc
from profilecal_tool.report import page
from profilecal_tool.report.calibration import VERDICTS

PLAN = {"seed": 3, "groups": 7, "positions": 3, "noise": {"profile_mm": 0.03}}
PLAN |= {"title": "A <bar> & more", "convention": "KUKA angles"}
PICTURE = re.compile(r'src="data:image/png;base64,[^"]+"')


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """A small scan folder."""
    place = tmp_path_factory.mktemp("scan") / "bar, 8 x 6"
    pc.write_scan(scan_of("edge", measured="profiles", **PLAN), place)
    return place


@pytest.fixture(scope="module")
def written(scan):
    """What the command prints of the scan and one of a ball, and the report."""
    path, ball = scan.parent / "report.html", scan.parent / "ball"
    pc.write_scan(scan_of("ball", measured="arcs", **PLAN), ball)
    result = run("calibrate", scan, ball, "--json", "--report", path)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), path.read_text(encoding="utf-8")


def test_the_report_needs_nothing_else(written):
    _, report = written
    links = r"(src|href)=|//|<script|@import|url\(|<link"
    assert not re.search(links, PICTURE.sub("", report))
    assert len(PICTURE.findall(report)) >= 10
    assert 'name="viewport"' in report
    assert "@media print" in report
    assert len(report) < 2_000_000
    assert "import" not in report
    assert "recorded" not in report  # what a sweep would want
    assert "41 What motions can determine" in report  # without its link


def test_the_report_states_what_the_command_prints(written):
    answer, report = written
    T = np.array(answer["T_flange_sensor"])
    x, y, z = T[:3, 3]
    yaw, _, _ = Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)
    for said in (
        f"translation    {x:.3f}  {y:.3f}  {z:.3f} mm",
        f"R = Rz({yaw:.4f})",
        f"{{X {x:.3f},Y {y:.3f},Z {z:.3f},A ",  # the line for the robot of these angles
        VERDICTS["ok"][0].partition("{")[0],
        "A &lt;bar&gt; &amp; more",
    ):
        assert said in report


def test_a_failing_notebook_gives_its_reason_and_keeps_the_old_report(
    scan, tmp_path, monkeypatch
):
    reason = 'raise RuntimeError("the reason")'
    bad = write_notebook(tmp_path / "bad.ipynb", "scan: list = []", reason)
    monkeypatch.setattr(page, "notebook", lambda: bad)
    report = tmp_path / "report.html"
    report.write_text("old")
    result = run("calibrate", scan, "--report", report)
    assert result.exit_code == 1
    sentence = r"profilecal: no report: error in cell \d: RuntimeError: the reason\n$"
    assert re.search(sentence, result.stderr)
    assert report.read_text() == "old"
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["bad.ipynb", "report.html"]


REFUSED = {
    "report.pdf": "expected a name that ends in .html or .htm",
    "folder.html": "folder.html: no file can be written there",
    "no/report.html": "no/report.html: no file can be written there",
    "report.html": "profilecal: --report needs papermill, not installed here: "
    'pip install "profilecal[notebooks]"\n',
}


@pytest.mark.parametrize("place", REFUSED)
def test_a_report_that_cannot_be_written_is_refused_at_once(
    scan, tmp_path, place, monkeypatch
):
    (tmp_path / "folder.html").mkdir()
    if place == "report.html":
        there = {"papermill": None}
        monkeypatch.setattr(page, "find_spec", lambda name: there.get(name, name))
    result = run("calibrate", scan, "--report", tmp_path / place)
    assert (result.exit_code, result.stdout) == (2, "")
    assert REFUSED[place] in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["folder.html"]
